"""The pages of docs/environments, from the docstrings, cards and settings of the environments, and the leaderboard.

``python -m tools.site.environments`` writes them; ``--check`` says instead which would change.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import tyro

import envs
from agents.console import note
from agents.evaluation.leaderboard import LEGEND
from envs.card import TaskCard
from planners import arm_names, load_arm
from planners.files import write_text
from tools.docs_figures import load as printed_tables

FOLDER = Path(__file__).parents[2] / "docs" / "environments"
_HEAD = "<!-- Written by python -m tools.site.environments from the docstring, the card and the leaderboard. -->"


@dataclass(frozen=True)
class PagesOptions:
    """Write the pages of the environments."""

    check: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Write nothing; name the pages that would change, with exit code 1."""


def main(options: PagesOptions) -> int:
    """Write the pages, or compare them; the exit code."""
    changed = [path for path, text in pages().items() if not path.exists() or path.read_text(encoding="utf-8") != text]
    for path in changed:
        if options.check:
            note(f"{path.name} is not what its environment says: run python -m tools.site.environments")
        else:
            write_text(path, pages()[path])
    return 1 if options.check and changed else 0


def pages() -> dict[Path, str]:
    """The text of every page, by its file."""
    return {FOLDER / f"{_folder(env_id)}.md": page(env_id) for env_id in envs.env_ids()}


def page(env_id: str) -> str:
    """The page of an environment."""
    env = gym.make(env_id)
    try:
        summary, _, body = str(type(env.unwrapped).__doc__).partition("\n\n## Description\n")
        description, _, sections = body.partition("\n\n## ")
        sections, _, history = sections.partition("\n\n## Version history\n")
        sections, _, difficulty = sections.partition("\n\n## Difficulty\n")
        name, card = _folder(env_id), envs.task_card(env_id)
        parts = [
            f"# {env_id}",
            _HEAD,
            summary,
            f"![{summary}](../pictures/{name}.gif)",
            _at_a_glance(env, card),
            f'```python\nimport envs, gymnasium as gym\n\nenv = gym.make("{env_id}")\n```',
            f"## Description\n\n{_spaced(description)}",
            f"## {_spaced(sections)}",
            _policies(env_id, card),
            f"## Difficulty\n\n{_spaced(difficulty)}\n\n{_arms(card)}",
            f"## Version history\n\n{_spaced(history)}",
        ]
    finally:
        env.close()
    text = "\n\n".join(part.strip() for part in parts) + "\n"
    return text.replace("(docs/environments/uncertainty.md)", "([uncertainty](uncertainty.md))")


def _at_a_glance(env: Any, card: TaskCard) -> str:
    """Facts of a task in a table."""
    config = env.unwrapped.task.config
    modes = type(config).model_fields["control_mode"].annotation.__args__
    rows = {
        "Action space": f"`{env.action_space}`",
        "Observation space": f"`Box{env.observation_space.shape}`, float32, scaled and bounded, see below",
        "Control modes": ", ".join(f"`{mode}`" for mode in modes),
        "Control period, physics step": f"{config.control_period:g} s, {config.physics_step:g} s",
        "Longest episode": f"{config.horizon:g} s, {env.unwrapped.task.horizon_steps} steps",
        "Primary metric": f"`{card.primary.key}`" if card.primary else "the return",
        "Experts": ", ".join(f"`{name}`" for name in card.experts),
        "Bound": card.bound.meaning if card.bound else "none is known",
        "Recipe": f"`planarm train {card.recipe}`",
    }
    return "\n".join(["| | |", "|---|---|", *(f"| {key} | {value} |" for key, value in rows.items())])


def _policies(env_id: str, card: TaskCard) -> str:
    """The task's tables of the leaderboard, as `planarm benchmark --full` has printed them, without the comparisons."""
    text = "\n".join(printed_tables()["leaderboard"]["lines"])
    found = [
        part.partition("\n\n|difference")[0].strip()
        for part in re.split(r"^### ", text, flags=re.MULTILINE)
        if part.startswith((f"{env_id}:", f"{env_id}/"))
    ]
    titled = "\n\n".join(f"### {part.replace(LEGEND, '').strip()}" for part in found)
    return (
        "## Leaderboard\n\nPrinted by `planarm benchmark --full`, see [the leaderboard](../benchmark/leaderboard.md) "
        "for the comparisons and times, and [the experts](../planners/experts.md) for what each policy does.\n\n"
        f"{LEGEND}\n\n{titled}"
    )


def _arms(card: TaskCard) -> str:
    """The arms that a task bears."""
    if not card.links:
        return "The machine is the task's own: the setting `arm` is refused."
    fitting = [name for name in arm_names() if load_arm(name).n_joints in card.links]
    links = " or ".join(map(str, card.links)) if len(card.links) < 4 else f"{card.links[0]} to {card.links[-1]}"
    presets = ", ".join(f"`{name}`" for name in fitting)
    return (
        f"`arm` may have {links} links: [a file of your own](../extend/arms.md), or a preset: {presets}. "
        "What an arm cannot do is refused with the reason."
    )


def _spaced(text: str) -> str:
    """Markdown with an empty line after every heading."""
    return re.sub(r"^((?:## )?[A-Z][a-z]+(?: [a-z]+)?)\n(?=\S)", r"\1\n\n", text.strip(), flags=re.MULTILINE)


def _folder(env_id: str) -> str:
    """Name of the folder of a task: ``conveyor_track`` of ``ConveyorTrack-v0``."""
    module = import_module(str(gym.spec(env_id).entry_point).partition(":")[0])
    return module.__name__.split(".")[-2]


if __name__ == "__main__":
    raise SystemExit(main(tyro.cli(PagesOptions)))
