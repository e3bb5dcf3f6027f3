"""The table of solvable starts of ConveyorTrack-v0.

``python -m tools.conveyor_starts`` solves every node of the grid of `envs.conveyor_track.table` by DPCT, within 97 %
of all limits, stores the rendezvous times, and solves drawn starts within the full limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from rich.progress import track

from envs.conveyor_track import starts, table
from envs.conveyor_track.belt import Demands, axes_of, why_unsolvable
from planners.typing import Array

NODES = (9, 9, 4, 6)
AXES = axes_of(Demands(3.0, 0.5), 1.0, NODES)
HORIZON = 6.0  # how far ahead to plan, s: the longest horizon that the table serves
CHECKS = 2000  # number of drawn starts to solve at the end


def build(path: Path, axes: Mapping[str, Array]) -> float:
    """Solve the grid with these nodes and store the table; the share of nodes with a solution."""
    solved = table.solve(axes, Demands(HORIZON, 0.0))
    arrays = {"rendezvous_time": solved.rendezvous_time, "rides_until": solved.rides_until, **axes}
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]
    return float(np.isfinite(solved.rendezvous_time).mean())


def main() -> None:
    """Solve the grid, store the table, and check it."""
    solved = build(Path(table.__file__).with_name(table.TABLE), AXES)
    demands = Demands(3.0, 0.5)
    drawn = starts.draw_starts([np.random.default_rng(0)] * CHECKS, {}, demands)
    failed = [start for start in track(drawn, "solving drawn starts") if why_unsolvable(start, demands)]
    print(f"{solved:.1%} of the nodes solved")
    print(f"{CHECKS - len(failed)} of {CHECKS} drawn starts solved within the full limits")
    for start in failed[:10]:
        print(start, why_unsolvable(start, demands))


if __name__ == "__main__":
    main()
