"""The folder of a submission, read within limits: weights, their JSON and a card, and nothing else."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from agents.environments import task_type
from agents.evaluation.benchmark_config import SHIPPED_CONFIG, BenchmarkConfig, BenchmarkTask
from agents.policies.agent import Agent
from agents.policies.files import load_agent
from agents.submissions.card import CARDS, Card, read_card
from agents.yaml_config import load_config, refuse_twice
from envs.settings import refuse_unknown
from planners import arm_names
from planners.checks import brief
from planners.documents import read_document

WEIGHTS, JSON = "agent.safetensors", "agent.json"
"""Names of the files of the agent."""
MOST_WEIGHT_BYTES, MOST_JSON_BYTES, MOST_LAYERS = 1 << 21, 1 << 18, 8
"""Largest sizes of the agent's files, bytes, and most hidden layers: with them the time of an action is bounded."""
_REFERENCES = ("paper", "best known", "lower bound", "bound")  # rows of tables and lines of figures beside policies


@dataclass(frozen=True)
class Submission:
    """An agent and its card.

    Attributes:
        folder: where they are.
        card: what its authors say.
        agent: the policy.
        tasks: those of the leaderboard that it is for.
    """

    folder: Path
    card: Card
    agent: Agent
    tasks: tuple[BenchmarkTask, ...]


def leaderboard_config() -> BenchmarkConfig:
    """The configuration of the published leaderboard."""
    return load_config(SHIPPED_CONFIG, BenchmarkConfig)


def read_submission(folder: Path) -> Submission:
    """The submission in a folder; no code of it is run.

    Raises:
        ValueError: if files are missing, too large, damaged or no part of a submission; if agent and card contradict
            each other; or if the agent is not for a task of the leaderboard.
    """
    card_path = folder / _checked_names(folder)
    document = read_document(folder / JSON, MOST_JSON_BYTES)
    settings = document.get("env_config") if isinstance(document, dict) else None
    arm = settings.get("arm") if isinstance(settings, dict) else None
    if isinstance(arm, str) and arm not in arm_names():
        raise ValueError(f"{folder / JSON} names an arm in a file: write the arm itself there, as save_agent does")
    card = read_card(card_path)
    agent = load_agent(folder / WEIGHTS)
    if len(agent.document["hidden"]) > MOST_LAYERS:
        raise ValueError(
            f"{folder / JSON} has {len(agent.document['hidden'])} hidden layers; {MOST_LAYERS} are the most"
        )
    try:
        return Submission(folder, card, agent, _tasks(card, agent))
    except ValueError as error:
        raise ValueError(f"{card_path}: {error}") from None


def own_settings(agent: Agent) -> dict[str, object]:
    """The settings in which an agent acts, with the control mode also where that is the default."""
    mode = task_type(agent.env_id).config_type.model_fields["control_mode"].default
    return {"control_mode": mode, **agent.action_config}


def _checked_names(folder: Path) -> str:
    """The name of the card, if the folder holds what it must, as plain files of bounded size."""
    if not folder.is_dir():
        raise ValueError(f"no folder {folder}")
    found: dict[str, os.DirEntry[str]] = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name not in (WEIGHTS, JSON, *CARDS) or not entry.is_file(follow_symlinks=False):
                raise ValueError(
                    f"{folder} holds {entry.name!r:.80}, which is no part of a submission: it has {WEIGHTS}, {JSON} "
                    f"and {' or '.join(CARDS)}, plain files and no links"
                )
            found[entry.name] = entry
    cards = [name for name in CARDS if name in found]
    missing = [name for name in (WEIGHTS, JSON) if name not in found] + ([] if cards else [CARDS[0]])
    if missing:
        raise ValueError(f"{folder} lacks {' and '.join(missing)}: planarm submit export writes them")
    if len(cards) > 1:
        raise ValueError(f"{folder} has {' and '.join(cards)}: keep one of them")
    for name, most in ((WEIGHTS, MOST_WEIGHT_BYTES), (JSON, MOST_JSON_BYTES)):
        size = found[name].stat(follow_symlinks=False).st_size
        if size > most:
            raise ValueError(f"{folder / name} has {size} bytes; {most} are the most in a submission")
    return cards[0]


def _tasks(card: Card, agent: Agent) -> tuple[BenchmarkTask, ...]:
    """The tasks of a card; a ValueError if they, the settings or the name do not fit the agent or the leaderboard."""
    config = leaderboard_config()
    titles = {task.title: task for task in config.tasks}
    names = {*config.policies, *_REFERENCES}.union(*(task.policies or () for task in config.tasks))
    if any(map(partial(_looks_like, card.name), names)):
        raise ValueError(f'name "{card.name}" is that of a policy or of another row of the leaderboard: choose another')
    refuse_unknown(card.tasks, titles, "task of the leaderboard")
    refuse_twice(card.tasks, "task")
    tasks = tuple(titles[title] for title in card.tasks)
    for task in tasks:
        if task.env != agent.env_id:
            raise ValueError(f"task {task.title} is one of {task.env}; the agent was trained on {agent.env_id}")
    if card.settings != own_settings(agent):
        raise ValueError(f"settings {brief(card.settings)} are not those of the agent, {own_settings(agent)}")
    return tasks


def _looks_like(name: str, other: str) -> bool:
    """Whether two names differ by nothing but case, spaces and punctuation."""
    one, two = (re.sub(r"[\W_]", "", text.casefold()) for text in (name, other))
    return one == two
