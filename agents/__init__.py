"""Training, evaluation, the leaderboard and the `planarm` command."""

from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.evaluation.evaluate import Evaluation, evaluate
    from agents.policies.agent import Agent
    from agents.policies.files import load_agent, save_agent

__all__ = ["Agent", "Evaluation", "evaluate", "load_agent", "save_agent"]

_HOMES = {
    "Agent": "agents.policies.agent",
    "Evaluation": "agents.evaluation.evaluate",
    "evaluate": "agents.evaluation.evaluate",
    "load_agent": "agents.policies.files",
    "save_agent": "agents.policies.files",
}


def __getattr__(name: str) -> Any:
    """Import what is public on first use: `planarm --help` must not wait for the physics."""
    if name == "__version__":
        return metadata.version("planarm")
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
