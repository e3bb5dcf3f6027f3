"""The table of solvable starts of ConveyorTrack-v0.

``python -m tools.conveyor_starts`` solves every node of the grid of `envs.conveyor_track.starts` by DPCT, within 97 %
of all limits, stores the rendezvous times, and solves drawn starts within the full limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.progress import track

from envs.conveyor_track import starts
from envs.conveyor_track.starts import AXES, ELBOWS, MARGIN, Demands, Start
from planners import Infeasible, UnreachableTarget, dpct
from planners.typing import Array

HORIZON = 6.0  # how far ahead to plan, s: the longest horizon that the table serves
CHECKS = 2000  # number of drawn starts to solve at the end


def build(path: Path, axes: Mapping[str, Array]) -> float:
    """Solve the grid with these nodes, as `AXES`, and store the table; the share of nodes with a solution."""
    shape = (*(len(nodes) for nodes in axes.values()), len(ELBOWS))
    rendezvous, rides = np.full(shape, np.inf), np.zeros(shape)
    for index in track(list(np.ndindex(shape)), "solving the grid"):
        values = [nodes[i] for nodes, i in zip(axes.values(), index[:-1], strict=True)]
        problem = starts.problem_of(Start._make([*values, ELBOWS[index[-1]]]), Demands(HORIZON, 0.0))
        try:
            plan = dpct.plan(replace(problem, limits=problem.joint_limits.scaled(MARGIN)))
        except (Infeasible, UnreachableTarget):
            continue
        rendezvous[index], rides[index] = plan.rendezvous_time, min(plan.rides_until, HORIZON)
    np.savez_compressed(path, rendezvous_time=rendezvous, rides_until=rides, **axes)  # type: ignore[arg-type]
    return float(np.isfinite(rendezvous).mean())


def main() -> None:
    """Solve the grid, store the table, and check it."""
    solved = build(Path(starts.__file__).with_name(starts.TABLE), AXES)
    demands = Demands(3.0, 0.5)
    drawn = starts.draw_starts([np.random.default_rng(0)] * CHECKS, {}, demands)
    failed = [start for start in track(drawn, "solving drawn starts") if starts.why_unsolvable(start, demands)]
    print(f"{solved:.1%} of the nodes solved")
    print(f"{CHECKS - len(failed)} of {CHECKS} drawn starts solved within the full limits")
    for start in failed[:10]:
        print(start, starts.why_unsolvable(start, demands))


if __name__ == "__main__":
    main()
