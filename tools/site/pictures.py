"""The pictures of the site with the commands that draw them; ``python -m tools.site.pictures`` draws them.

``python -m tools.site.pictures paths_conveyor_track.png`` draws one of them; ``--table`` prints the table of
docs/pictures.md.
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from agents.cli import main as planarm
from tools import readme_pictures
from tools.readme_pictures import PictureOptions

FOLDER = "docs/pictures"
_FILMS = {
    "conveyor_track.gif": "ConveyorTrack-v0 --policy dpct --scenario paper",
    "min_torque_move.gif": "MinTorqueMove-v0 --policy lagrange --scenario paper",
    "obstacle_dodge.gif": "ObstacleDodge-v0 --policy apf --seed 3",
    "excavator_payload.gif": "ExcavatorPayload-v0 --policy agent --seed 12 --fps 10 --width 480",
}
_PATHS = {
    "paths_conveyor_track.png": "ConveyorTrack-v0 --seed 0",
    "paths_min_torque_move.png": "MinTorqueMove-v0 --policies follower dpct lagrange apf --seed 18",
    "paths_obstacle_dodge.png": "ObstacleDodge-v0 --policies follower dpct lagrange apf --seed 29",
    "paths_excavator_payload.png": "ExcavatorPayload-v0 "
    "--policies computed_torque integral_computed_torque adaptive agent --seed 12",
}
PICTURES = {
    **{name: f"planarm rollout {episode} --record {FOLDER}/{name}" for name, episode in _FILMS.items()},
    **{name: f"planarm paths {episode} --plot {FOLDER}/{name}" for name, episode in _PATHS.items()},
    **{f"paper_{paper}_*.png": f"planarm paper-{paper} --figures {FOLDER}" for paper in ("dpct", "lagrange", "apf")},
    "paper_excavator_*.png": f"planarm paper-excavator --figures {FOLDER}",
    "tasks.gif": "python -m tools.readme_pictures",
}
"""By file name, or pattern of names: what draws it."""

LONG = {
    "leaderboard.svg": "python -m tools.readme_pictures results.json",
    **{
        f"curves_{task}.png": f"planarm curves runs/{run}-* --against steps --plot {FOLDER}/curves_{task}.png"
        for task, run in {
            "conveyor_track": "belt",
            "obstacle_dodge": "dodge",
            "excavator_payload": "load",
        }.items()
    },
}
"""Those that need what runs for long: a benchmark's results (``planarm benchmark --full --json results.json``), or
five training runs (docs/agents/index.md)."""


@dataclass(frozen=True)
class PicturesOptions:
    """Draw the pictures of the site, in the folder of the repository."""

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Names of files or patterns, as in the table; all that need no training if left out."""
    table: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print the table of all pictures and their commands instead."""


def main(options: PicturesOptions) -> int:
    """Draw; the exit code."""
    if options.table:
        print(table(), end="")
        return 0
    for name in options.names or PICTURES:
        if name not in PICTURES:
            raise SystemExit(f"{name!r} must be one of {', '.join(PICTURES)}")
        program, *arguments = shlex.split(PICTURES[name])
        if code := planarm(arguments) if program == "planarm" else readme_pictures.main(PictureOptions()):
            return code
    return 0


def table() -> str:
    """All pictures and their commands, Markdown."""
    rows = [f"| `{name}` | `{command}` |\n" for name, command in {**PICTURES, **LONG}.items()]
    return "| picture | command |\n|---|---|\n" + "".join(rows)


def listed(path: Path) -> bool:
    """Whether a file is in the table."""
    return any(path.match(name) for name in (*PICTURES, *LONG))


if __name__ == "__main__":
    raise SystemExit(main(tyro.cli(PicturesOptions)))
