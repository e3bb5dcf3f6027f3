"""The folder of a submission, written: an agent from any source, and a card to fill in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from agents.policies.agent import Agent
from agents.policies.export import export_agent
from agents.policies.files import save_agent
from agents.policies.lookup import find_policy
from agents.submissions.card import CARDS, FORMAT
from agents.submissions.folder import WEIGHTS, leaderboard_config, own_settings
from planners.files import write_text

_HEAD = "# The card of a submission. docs/benchmark/submit.md says what its lines are.\n"


def agent_from(source: str, env_id: str, settings: Mapping[str, Any], *, allow_code: bool) -> Agent:
    """An agent from the path of a run, of an agent, or of a model of Stable-Baselines3, or the shipped one.

    Args:
        source: as `agents.policies.lookup.find_policy` takes it.
        env_id: the environment that it was trained on.
        settings: those of the environment that a model was trained in, which its zip does not say.
        allow_code: whether to load such a zip.

    Raises:
        ValueError: if there is no such policy, or it is no network that can be exported.
    """
    named = find_policy(source, env_id, allow_code=allow_code)
    if isinstance(named.policy, Agent):
        if settings:
            raise ValueError(f"{source} says itself in which settings it was trained: leave --settings out")
        return named.policy
    if not source.endswith(".zip"):
        raise ValueError(f"{source} is code: a submission is a network, of a run, an agent or a .zip")
    if assumption := named.assumption(env_id, settings):
        raise ValueError(f"{assumption}, such as --settings control_mode=jerk")
    return export_agent(named.policy, env_id, env_config=settings)


def write_submission(
    agent: Agent, folder: Path, name: str, authors: Sequence[str], licence: str, training: str
) -> None:
    """Write an agent and, unless there is one, a card without claims, in which empty entries are to be filled in."""
    tasks = [task.title for task in leaderboard_config().tasks if task.env == agent.env_id]
    if not tasks:
        raise ValueError(f"{agent.env_id} is no environment of the leaderboard: an agent for it cannot be submitted")
    save_agent(agent, folder / WEIGHTS)
    if any((folder / card).exists() for card in CARDS):
        return
    trained = agent.document.get("training")
    known = trained if isinstance(trained, dict) else {}
    card = {
        "format": FORMAT,
        "name": name,
        "authors": list(authors),
        "tasks": tasks,
        "settings": own_settings(agent),
        "training": training,
        "steps": known.get("steps", 0),
        "seconds": known.get("seconds", 0.0),
        "licence": licence,
        "link": None,
    }
    write_text(folder / CARDS[0], _HEAD + yaml.safe_dump(card, sort_keys=False, allow_unicode=True, width=120))
