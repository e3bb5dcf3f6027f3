"""Claimed scores: computed from episodes, and compared with those that come out."""

from __future__ import annotations

import hashlib
import math
import platform
from collections.abc import Iterator

import numpy as np

from agents.evaluation.results import Evaluation
from agents.evaluation.scoreboard import Scoreboard
from agents.evaluation.summarise import card_of, summarise
from agents.provenance import cpu, versions
from agents.submissions.card import Claim, Claims

ROUNDING = 1e-5
"""Share by which returns and metrics may differ on another platform."""
_COUNTED = ("episodes", "success", "steps")


def claims_of(board: Scoreboard) -> Claims:
    """The scores of the only policy of each task, as claims."""
    return Claims(
        platform=this_platform(), tasks={result.task.title: claim_of(result.evaluations[0]) for result in board.results}
    )


def claim_of(evaluation: Evaluation) -> Claim:
    """The scores of an evaluation.

    The digest is the SHA-256 of five arrays one after the other, each with one entry an episode, little-endian: seeds
    and lengths (int64), returns and the primary metric (float64), success (uint8).
    """
    primary, estimates = card_of(evaluation.env_id).primary, summarise(evaluation, bootstrap=False)
    metric = np.zeros(0) if primary is None else evaluation.metrics[primary.key]
    columns = (
        (evaluation.seeds, "<i8"),
        (evaluation.lengths, "<i8"),
        (evaluation.returns, "<f8"),
        (metric, "<f8"),
        (evaluation.success, "u1"),
    )
    content = b"".join(np.ascontiguousarray(column, dtype=kind).tobytes() for column, kind in columns)
    median = math.nan if primary is None else estimates[primary.key].value
    return Claim(
        episodes=len(evaluation.seeds),
        success=int(evaluation.success.sum()),
        steps=int(evaluation.lengths.sum()),
        returns=estimates["return"].value,
        metric="" if primary is None else primary.key,
        median=median if math.isfinite(median) else None,
        digest=hashlib.sha256(content).hexdigest(),
    )


def this_platform() -> dict[str, str]:
    """What decides how numbers are rounded here: system, processor and its model, and the libraries."""
    libraries = {name: version for name, version in versions().items() if name != "python"}
    here = {"system": platform.system(), "processor": platform.machine(), "cpu": cpu()}
    return {**here, **libraries}


def agreement(claimed: Claims | None, scored: Claims) -> str:
    """How claimed scores agree with those that come out, in a clause.

    On the platform that they were computed on they agree to the bit. Other processors and versions round differently:
    there numbers of episodes, successes and steps must be the same, returns and metrics to `ROUNDING`. What the claims
    leave out of their platform counts as equal to this one.

    Raises:
        ValueError: if they do not agree, with each difference.
    """
    if claimed is None:
        raise ValueError("the card claims no scores: planarm submit claim writes them into it")
    if set(claimed.tasks) != set(scored.tasks):
        raise ValueError(
            f"the card claims scores on {', '.join(claimed.tasks) or 'no task'}, not on {', '.join(scored.tasks)}: "
            "planarm submit claim writes them"
        )
    if differing := list(_differences(claimed, scored, 0.0)):
        here = scored.platform
        changed = [name for name in here if claimed.platform.get(name, here[name]) != here[name]]
        if not changed:
            raise ValueError(
                f"the claimed numbers do not come out on the platform that is claimed: {_joined(differing)}"
            )
        if differing := list(_differences(claimed, scored, ROUNDING)):
            raise ValueError(
                f"the claimed numbers do not come out, beyond what the rounding of another platform changes "
                f"({', '.join(changed)}): {_joined(differing)}"
            )
        return (
            f"come out to {ROUNDING:g} on another platform than the claimed one ({', '.join(changed)}), so that their "
            "digests are not confirmed"
        )
    return "come out to the bit"


def _joined(differences: list[str], most: int = 6) -> str:
    return "; ".join(differences[:most]) + (f"; and {len(differences) - most} more" if len(differences) > most else "")


def _differences(claimed: Claims, scored: Claims, rounding: float) -> Iterator[str]:
    """A clause for each number that differs by more than a share; digests count only without one."""
    for task, now in scored.tasks.items():
        before = claimed.tasks[task]
        names = (*_COUNTED, "metric", "returns", "median", *(() if rounding else ("digest",)))
        for name in names:
            old, new = getattr(before, name), getattr(now, name)
            close = name in ("returns", "median") and rounding and old is not None and new is not None
            if old != new and not (close and math.isclose(old, new, rel_tol=rounding)):
                yield f"{task}: {name} {old} is claimed, {new} is scored"
