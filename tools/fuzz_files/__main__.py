"""Damaged files for everything that planarm reads as data: refused in a sentence, at once, without running code.

``python -m tools.fuzz_files --seconds 600 --seed 0`` writes arms, experiments, benchmarks, settings, agents,
trajectories and run folders with values, structures, texts or bytes changed, and reads them. Each must be read or
refused with a ValueError of one line that names the file, within a second of the processor, in bounded memory, with no
module imported and no process started. It prints counts for each kind, and each fault with its number, which ``--only``
repeats with the traceback.
"""

from __future__ import annotations

import resource
import time
import traceback
from dataclasses import dataclass

import tyro

from tools.fuzz_files.checks import Outcome, check, watch
from tools.fuzz_files.readers import READERS

MOST_MEMORY_MIB = 4096
"""Address space beyond which allocations fail."""


@dataclass
class Fuzz:
    """Options of the command."""

    seconds: float = 60.0
    """of the processor, shared equally by all kinds of file"""
    seed: int = 0
    kind: str | None = None
    """only this one: arm, experiment, benchmark, changes, agent, submission, trajectory, run or checkpoint"""
    only: int | None = None
    """only the file of this number, with the traceback"""


def main() -> int:
    """Run the campaign; 1 if something was found."""
    options = tyro.cli(Fuzz, prog="python -m tools.fuzz_files", description=__doc__)
    watch()
    size = MOST_MEMORY_MIB << 20
    resource.setrlimit(resource.RLIMIT_AS, (size, resource.getrlimit(resource.RLIMIT_AS)[1]))
    found = 0
    kinds = [options.kind] if options.kind else list(READERS)
    for kind in kinds:
        counts, faults, slowest, number = {"read": 0, "refused": 0}, list[str](), 0.0, options.only or 0
        until = time.process_time() + options.seconds / len(kinds)
        while time.process_time() < until:
            outcome: Outcome = check(kind, options.seed, number)
            counts["refused" if outcome.refused else "read"] += 1
            slowest = max(slowest, outcome.seconds)
            if outcome.fault:
                faults.append(f"{number}: {outcome.fault}")
                if options.only is not None and outcome.error is not None:
                    traceback.print_exception(outcome.error)
            if options.only is not None:
                break
            number += 1
        found += len(faults)
        print(
            f"{kind}: {counts['read']:,} read, {counts['refused']:,} refused, {len(faults)} faults; slowest "
            f"{slowest:.2f} s; peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0:.0f} MiB",
            flush=True,
        )
        for fault in faults[:20]:
            print(f"    {fault}")
    return int(found > 0)


if __name__ == "__main__":
    raise SystemExit(main())
