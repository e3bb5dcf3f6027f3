"""How the policies of a report differ: each has a colour of its own, or a shape of its own in that colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from agents.report.results_file import Results, TaskScores

COLORS = 10
"""How many colours there are."""
SHAPES = 4
"""How many kinds of points and of lines there are, each with a shade of the colour: a full circle and a line, an empty
circle and dashes, a full square and dots, an empty square and both dashes and dots."""


@dataclass(frozen=True)
class Look:
    """How a policy is drawn, by the number of its colour and of its shape."""

    color: int
    shape: int = 0

    @property
    def classes(self) -> str:
        """Its classes in the style sheet of the page."""
        return f"p{self.color} v{self.shape}"


def policy_looks(files: Sequence[tuple[str, Results]], tasks: Sequence[TaskScores]) -> dict[str, Look]:
    """The look of each policy, the same in every task, in the order of the files.

    No two are the same as long as there are enough. A policy that has been renamed has the colour of the one whose name
    it had.
    """
    looks: dict[str, Look] = {}
    free: list[Look] = []
    named = [each for _, results in files for task in results.results for each in task.policies]
    for policy in [*named, *(each for task in tasks for each in task.policies)]:
        if policy.policy not in looks:
            free = free or [Look(color, shape) for shape in range(SHAPES) for color in range(COLORS)]
            other = looks.get(policy.original or "")
            look = next((each for each in free if other is not None and each.color == other.color), free[0])
            free.remove(look)
            looks[policy.policy] = look
    return looks
