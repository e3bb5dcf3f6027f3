"""The pictures of the README: an episode of every task side by side, and the leaderboard.

``python -m tools.readme_pictures`` writes ``docs/pictures/tasks.gif``. With a file of results,
``planarm benchmark --full --json FILE``, it writes ``docs/pictures/leaderboard.svg`` as well.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from agents.console import note
from agents.environments import make_one
from agents.figures.film import Film
from agents.policies.lookup import find_policy
from agents.policies.play import play
from agents.report.pictures.figures import write_figures
from agents.report.results_file import Results
from envs.rendering import palette
from envs.rendering.renderer import PANEL_SHARE
from planners.files import write_bytes

PICTURES = Path(__file__).parent.parent / "docs" / "pictures"
FPS, PAUSE = 10, 8  # frames a second; frames until a shorter episode is shown again
WIDTH, HEIGHT, CAPTION, GAP = 232, 218, 22, 4  # of a panel, of its caption and of gaps, pixels

Frame = NDArray[np.uint8]


@dataclass(frozen=True)
class Episode:
    """An episode of the strip."""

    env: str
    policy: str
    seed: int = 0
    options: dict[str, Any] = field(default_factory=dict)
    speed: int = 1


EPISODES = (
    Episode("ConveyorTrack-v0", "dpct", options={"scenario": "paper"}),
    Episode("MinTorqueMove-v0", "lagrange", options={"scenario": "paper"}),
    Episode("ObstacleDodge-v0", "apf", 3),
    Episode("ExcavatorPayload-v0", "agent", 12, speed=2),
)


@dataclass(frozen=True)
class PictureOptions:
    """Write the pictures of the README."""

    results: tyro.conf.Positional[Path | None] = None
    """Results of planarm benchmark --full --json FILE, of which the leaderboard's picture is made."""


def main(options: PictureOptions) -> int:
    """Write the pictures; the exit code."""
    film = Film(FPS, len(EPISODES) * (WIDTH + GAP) - GAP)
    panels = [frames(episode) for episode in EPISODES]
    count = max(map(len, panels))
    for number in range(count):
        shown = [panel[min(number % (len(panel) + PAUSE), len(panel) - 1)] for panel in panels]
        film.take(number / FPS, partial(side_by_side, shown), last=number == count - 1)
    film.write(PICTURES / "tasks.gif")
    if options.results is not None:
        with TemporaryDirectory() as folder:
            write_figures([(options.results.stem, Results.read(options.results))], Path(folder))
            write_bytes(PICTURES / "leaderboard.svg", (Path(folder) / "leaderboard.svg").read_bytes())
    note(f"wrote {PICTURES}")
    return 0


def frames(episode: Episode) -> list[Frame]:
    """Pictures of an episode, ``FPS`` a second, each ``(HEIGHT + CAPTION, WIDTH, 3)``."""
    named = find_policy(episode.policy, episode.env)
    taken: list[Frame] = []
    with closing(make_one(episode.env, named.own_settings({}), "rgb_array")) as env:
        steps_between = episode.speed * float(env.metadata["render_fps"]) / FPS
        name = f"{episode.env.removesuffix('-v0')}: {episode.policy}"
        text = name if episode.speed == 1 else f"{name} ({episode.speed}x)"

        def take(steps: int, ended: bool) -> None:
            if ended or steps >= len(taken) * steps_between - 1e-9:
                taken.append(captioned(env.render(), text))

        play(env, named.policy, episode.seed, episode.options, take)
    return taken


def captioned(picture: Any, text: str) -> Frame:
    """The workspace in a picture of an environment, without the gauges beside it, and a line of text below it."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(picture)
    seen = image.crop((0, 0, round((1.0 - PANEL_SHARE) * image.width), image.height))
    workspace = seen.resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
    panel = Image.new("RGB", (WIDTH, HEIGHT + CAPTION), palette.PANEL)
    panel.paste(workspace, (0, 0))
    place = (WIDTH / 2, HEIGHT + CAPTION / 2)
    ImageDraw.Draw(panel).text(place, text, fill=palette.INK, font=ImageFont.load_default(14), anchor="mm")
    return np.asarray(panel)


def side_by_side(panels: list[Frame]) -> Frame:
    """Panels in a row, with gaps between them."""
    gap = np.full((HEIGHT + CAPTION, GAP, 3), palette.PANEL, dtype=np.uint8)
    return np.hstack([part for panel in panels for part in (panel, gap)][:-1])


if __name__ == "__main__":
    raise SystemExit(main(tyro.cli(PictureOptions)))
