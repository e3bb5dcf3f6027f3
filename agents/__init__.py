"""Training, evaluation, the leaderboard and the `planarm` command."""

from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.datasets.record import Recording, record_dataset
    from agents.evaluation.evaluate import evaluate
    from agents.evaluation.results import Evaluation
    from agents.evaluation.scoreboard import Scoreboard
    from agents.evaluation.scoring import compare
    from agents.evaluation.scoring import score_leaderboard as leaderboard
    from agents.policies.agent import Agent
    from agents.policies.export import export_agent
    from agents.policies.files import load_agent, save_agent
    from agents.training.vec_env import NativeVecEnv

__all__ = [
    "Agent",
    "Evaluation",
    "NativeVecEnv",
    "Recording",
    "Scoreboard",
    "compare",
    "evaluate",
    "export_agent",
    "leaderboard",
    "load_agent",
    "record_dataset",
    "save_agent",
]

_HOMES = {
    "Agent": "agents.policies.agent:Agent",
    "Evaluation": "agents.evaluation.results:Evaluation",
    "NativeVecEnv": "agents.training.vec_env:NativeVecEnv",
    "Recording": "agents.datasets.record:Recording",
    "Scoreboard": "agents.evaluation.scoreboard:Scoreboard",
    "compare": "agents.evaluation.scoring:compare",
    "evaluate": "agents.evaluation.evaluate:evaluate",
    "export_agent": "agents.policies.export:export_agent",
    "leaderboard": "agents.evaluation.scoring:score_leaderboard",
    "load_agent": "agents.policies.files:load_agent",
    "record_dataset": "agents.datasets.record:record_dataset",
    "save_agent": "agents.policies.files:save_agent",
}


def __dir__() -> list[str]:
    return [*globals(), *_HOMES, "__version__"]


def __getattr__(name: str) -> Any:
    """Import what is public on first use: `planarm --help` must not wait for the physics."""
    if name == "__version__":
        return metadata.version("planarm")
    if name in _HOMES:
        module, _, own = _HOMES[name].partition(":")
        return getattr(import_module(module), own)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
