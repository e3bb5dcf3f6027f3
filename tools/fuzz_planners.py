"""Random problems for every planner and variant, with the promises of each motion recomputed by other means.

``python -m tools.fuzz_planners --problems 1000 --seed 0`` draws random arms of 1 to 6 links, limits (also of jerk, and
joint ranges that are not around 0), targets of each kind, moving starts, obstacles, gravity, payloads and options, and
degenerate cases: the start as the goal, straight elbows, the rim of the reach, tiny and huge horizons and limits. Every
variant gets the same number of problems, `planners.plan` (``any``) too; ``inputs`` replaces arguments and options by
wrong ones. A motion is checked on a dense grid of `Trajectory.at` with code of `tools.fuzzing.promises` only. A share
of the problems is planned again later, for the same bits; where a refusal says how much time is enough, that time is
tried.

For each variant the command prints how many problems were solved, refused (by reason) or not taken, and every broken
promise and unexpected exception with the number of its problem, which ``--only`` repeats. With ``--out`` the records
are kept in a file, and a later run with the same file goes on where the last one stopped.
"""

from __future__ import annotations

import gc
import hashlib
import json
import math
import resource
import signal
import time
import traceback
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

import planners
from planners import Infeasible, MotionProblem, Trajectory, capabilities
from planners.files import whole_file
from planners.robot.limits import LIMIT_KINDS
from tools.fuzzing import wrong_inputs
from tools.fuzzing.problems import draw, draw_options
from tools.fuzzing.promises import broken_promises

SLOW = 5.0
"""CPU time of a plan that is a fault, s."""

HOPELESS = 30.0
"""CPU time after which a plan is interrupted, s."""

TURN = 10.0
"""CPU time that a variant gets before the next one's turn, s."""

WARMING = 4
"""Problems of each variant that are planned first, without a record."""

AGAIN = 16
"""Every so many problems one is planned twice, with another one in between."""

ENOUGH = 1.001
"""Time that is tried where a refusal says how much is enough, as a multiple of it."""

ANY, INPUTS = "any", "inputs"

Case = tuple[capabilities.Variant | None, MotionProblem, dict[str, Any]]


@dataclass
class Fuzz:
    """Options of the command."""

    problems: int = 200
    """for each variant"""
    seed: int = 0
    planner: str | None = None
    """only these, as in ``dpct/timing,apf,any,inputs``"""
    first: int = 0
    """number of the first problem"""
    only: int | None = None
    """only the problem of this number, with the traceback of an exception"""
    out: Path | None = None
    """file of records, to go on with later"""
    seconds: float = math.inf
    """stop after so long, with the records so far"""


@dataclass
class Record:
    """What became of the problems of a variant, those before number ``next``."""

    next: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest: float = 0.0
    slowest_problem: int = -1
    seconds: float = 0.0


def run(options: Fuzz) -> dict[str, Record]:
    """Give every variant its problems; the records by ``planner/variant``."""
    entries: dict[str, capabilities.Variant | None] = {
        f"{planner}/{name}".rstrip("/"): entry for (planner, name), entry in sorted(capabilities.VARIANTS.items())
    }
    entries |= {ANY: None, INPUTS: None}
    wanted = options.planner.split(",") if options.planner else [*entries]
    chosen = {key: entry for key, entry in entries.items() if {key, key.split("/")[0]} & {*wanted}}
    stored = _load(options)
    records = {key: stored.get(key, Record(options.first)) for key in chosen}
    end, stop = options.first + options.problems, time.monotonic() + options.seconds
    for key in chosen:
        for number in range(WARMING):  # compiles, or reads what is compiled
            _attempt(_case(_generator(options.seed, key, number), chosen[key]))
    if options.only is not None:
        records, end = {key: Record(options.only) for key in chosen}, options.only + 1
    while any(record.next < end for record in records.values()) and time.monotonic() < stop:
        for key, record in records.items():
            until = record.seconds + TURN
            while record.next < end and record.seconds < until and time.monotonic() < stop:
                _next(key, chosen[key], options, record)
            gc.collect()
            if options.out is not None:
                _store(options, stored | records)
    return records


def _next(key: str, entry: capabilities.Variant | None, options: Fuzz, record: Record) -> None:
    """Draw and try the next problem of a record."""
    number, show = record.next, options.only is not None
    if options.out is not None:  # then the process may end here, because the campaign can go on
        signal.setitimer(signal.ITIMER_PROF, HOPELESS)
    record.next += 1
    generator = _generator(options.seed, key, number)
    began = time.process_time()
    if key == INPUTS:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            outcome, faults = wrong_inputs.attempt(generator)
        spent = time.process_time() - began
    else:
        case = _case(generator, entry)
        began = time.process_time()
        outcome, faults, result, spent = _attempt(case, show=show)
        if spent > SLOW:
            spent = min(spent, _attempt(case)[3])  # without what the first attempt had to compile
        if number % AGAIN == 0:
            _attempt(_case(_generator(options.seed, "between", number), entry))
            if _attempt(case)[2] != result:
                faults.append("the same problem, planned again, gives other bits")
    if options.out is not None:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    record.outcomes[outcome] += 1
    if spent > SLOW:
        faults.append(f"takes {spent:.1f} s")
    record.faults += [f"{options.seed}, {number}: {fault}" for fault in faults]
    record.seconds += time.process_time() - began
    if spent > record.slowest:
        record.slowest, record.slowest_problem = spent, number


def _generator(seed: int, key: str, number: int) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(key.encode()), number])


def _case(generator: np.random.Generator, entry: capabilities.Variant | None) -> Case:
    """A problem for a variant; or, for the first variant that can, one that fits any."""
    if entry is not None:
        problem = draw(generator, entry)
        return entry, problem, draw_options(generator, entry, problem)
    promising = [entry for _, entry in sorted(capabilities.VARIANTS.items()) if entry.promises]
    return None, draw(generator, promising[int(generator.integers(0, len(promising)))]), {}


def _attempt(case: Case, *, show: bool = False) -> tuple[str, list[str], bytes, float]:
    """Plan and check one problem: what became of it, the faults, a digest of the result, and the plan's CPU time, s."""
    entry, problem, given = case
    before = _digest(*_arrays(problem))
    faults, outcome, result = [], "solved", b""
    try:
        with warnings.catch_warnings(), _timed() as spent:
            warnings.simplefilter("error")
            motion = planners.plan(problem) if entry is None else entry.plan(problem, **given)
    except Infeasible as refusal:
        outcome, result = refusal.reason, str(refusal).encode()
        faults = _untrue(case, refusal)
        if show:
            print(problem, given, refusal)
    except ValueError as refusal:
        outcome, result = "not taken", str(refusal).encode()
        if entry is not None and entry.objection(problem) is None:
            faults = [f"ValueError {refusal}"]
    except Exception as error:
        outcome, result = "exception", str(error).encode()
        faults = [f"{type(error).__name__} {error}"]
        if show:
            traceback.print_exc()
    else:
        result = _digest(motion.t, motion.q, motion.qd, motion.qdd, motion.tau, motion.cost, motion.rendezvous_time)
        faults = broken_promises(problem, motion, _by(motion) if entry is None else entry, given)
        samples = motion.t, motion.q, motion.qd, motion.qdd, motion.tau
        if any(np.shares_memory(one, other) for one in samples for other in _arrays(problem)):
            faults.append("shares memory with its problem")
        if show:
            print(problem, given, motion, faults)
    if _digest(*_arrays(problem)) != before:
        faults.append("changes its problem")
    return outcome, faults, result, sum(spent)


@contextmanager
def _timed() -> Iterator[list[float]]:
    """A list that holds the CPU time of the block afterwards, s."""
    spent: list[float] = []
    began = time.process_time()
    try:
        yield spent
    finally:
        spent.append(time.process_time() - began)


def _untrue(case: Case, refusal: Infeasible) -> list[str]:
    """What a refusal says that is not so: numbers that are none, or a least time that is not enough."""
    entry, problem, given = case
    faults = [f"message {refusal}"] if "nan" in str(refusal) or "inf " in str(refusal) else []
    enough = refusal.details.get("minimum_time")
    if not isinstance(enough, float) or entry is None or not entry.promises:
        return faults
    given = {name: value for name, value in given.items() if name != "rendezvous_time"}
    try:
        entry.plan(replace(problem, horizon=max(enough, problem.horizon) * ENOUGH), **given)
    except Infeasible as failure:
        if failure.reason != "collision":  # that is another matter
            faults.append(f"remedy: {refusal}; yet with {ENOUGH} times that: {failure}")
    return faults


def _interrupt(number: int, frame: object) -> None:
    raise TimeoutError(f"not planned within {HOPELESS:.0f} s")


def _by(motion: Trajectory) -> capabilities.Variant:
    """The variant that planned a motion."""
    entries = capabilities.VARIANTS.values()
    return next(entry for entry in entries if motion.planner.startswith(str(entry)))


def _arrays(problem: MotionProblem) -> list[Any]:
    """The arrays that a problem is made of."""
    target = [value for value in vars(problem.target).values() if isinstance(value, np.ndarray)]
    discs = [array for disc in problem.obstacles for array in (disc.position, disc.velocity)]
    limits = [problem.joint_limits.array(kind) for kind in LIMIT_KINDS]
    return [*problem.start, *target, *discs, *limits, problem.arm.length_array, problem.arm.base_array]


def _digest(*arrays: Any) -> bytes:
    sha = hashlib.sha256()
    for array in arrays:
        sha.update(np.ascontiguousarray(array, dtype=float).tobytes())
    return sha.digest()


def _load(options: Fuzz) -> dict[str, Record]:
    """The records of the seed in the file, if there is one."""
    if options.out is None or not options.out.exists():
        return {}
    document = json.loads(options.out.read_text()).get(str(options.seed), {})
    return {key: Record(**{**values, "outcomes": Counter(values["outcomes"])}) for key, values in document.items()}


def _store(options: Fuzz, records: Mapping[str, Record]) -> None:
    """Write the records of the seed, beside those of other seeds."""
    assert options.out is not None
    document = json.loads(options.out.read_text()) if options.out.exists() else {}
    document[str(options.seed)] = {key: vars(record) for key, record in records.items()}
    with whole_file(options.out) as draft:
        draft.write_text(json.dumps(document, indent=1))


def main() -> int:
    """Run the campaign and print its table; 1 if a promise was broken or an exception was unexpected."""
    options = tyro.cli(Fuzz)
    signal.signal(signal.SIGPROF, _interrupt)
    records = run(options)
    for label, record in records.items():
        counts = ", ".join(f"{count} {outcome}" for outcome, count in record.outcomes.most_common())
        slowest = f"slowest {record.slowest:.2f} s (problem {record.slowest_problem})"
        print(f"{label}: {counts}; {len(record.faults)} faults; {record.seconds:.1f} s, {slowest}")
        for fault in record.faults[:20]:
            print(f"    {fault}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"peak memory {peak:.0f} MiB")
    return int(any(record.faults for record in records.values()))


if __name__ == "__main__":
    raise SystemExit(main())
