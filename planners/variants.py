"""Choice of a planner's variant by name, with its options."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from planners.problem import MotionProblem, Trajectory


def require_choice(name: str, value: object, allowed: Iterable[object]) -> None:
    """Raise ValueError if an option is none of those allowed."""
    if value not in allowed:
        raise ValueError(f"{name} {value!r} must be one of {', '.join(map(repr, allowed))}")


def plan_variant(
    planners: Mapping[Any, Callable[..., Trajectory]], variant: str, problem: MotionProblem, options: Mapping[str, Any]
) -> Trajectory:
    """Plan a motion with one of the planners, by the name of its variant and with its options.

    Raises:
        Infeasible: if no motion solves the problem, with the reason.
        ValueError: if the variant or an option is unknown, or an option is out of range.
    """
    require_choice("variant", variant, planners)
    planner = planners[variant]
    allowed = [name for name in inspect.signature(planner).parameters if name != "problem"]
    unknown = sorted(set(options) - set(allowed))
    if unknown:
        raise ValueError(f"variant {variant!r} has no option {', '.join(unknown)}; it has {', '.join(allowed)}")
    return planner(problem, **options)
