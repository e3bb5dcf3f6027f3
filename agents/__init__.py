"""Evaluation, the leaderboard and the `planarm` command: what learns and compares stands on `envs` and `planners`."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.evaluation import Evaluation, evaluate

__all__ = ["Evaluation", "evaluate"]


def __getattr__(name: str) -> Any:
    """Import what is public on first use: `planarm --help` must not wait for the physics."""
    if name in __all__:
        from agents import evaluation

        return getattr(evaluation, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
