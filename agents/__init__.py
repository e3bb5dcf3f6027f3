"""Training, evaluation, the leaderboard and the `planarm` command: what learns and compares."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.agent import Agent, load_agent, save_agent
    from agents.evaluation import Evaluation, evaluate

__all__ = ["Agent", "Evaluation", "evaluate", "load_agent", "save_agent"]

_HOMES = {
    "Agent": "agents.agent",
    "Evaluation": "agents.evaluation",
    "evaluate": "agents.evaluation",
    "load_agent": "agents.agent",
    "save_agent": "agents.agent",
}


def __getattr__(name: str) -> Any:
    """Import what is public on first use: `planarm --help` must not wait for the physics."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
