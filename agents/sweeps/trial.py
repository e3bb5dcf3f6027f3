"""A trial in a worker: the training run in its folder, begun or continued."""

from __future__ import annotations

import time
from collections.abc import Callable

from agents.sweeps.sweep import ABOUT, Task, Trial, rows_so_far
from agents.training.folder import InUse
from agents.training.learning_curves import Row, merit
from agents.training.run import TrainingRun, Watcher

PATIENCE = 60.0  # s that a worker waits for the last one of its trial to leave the folder
_REFUSED = -1e9  # merit of a trial that cannot be trained


def run_trial(task: Task, report: Callable[[Row], object]) -> None:
    """Train a trial to its end from its last checkpoint, if it has one, or else from the beginning.

    Args:
        task: what to do.
        report: called with what `scored` makes of the row of each checkpoint, those of before among them. A trial that
            cannot be trained reports an ``error`` and is over: it would fail again.

    Raises:
        OSError: if this node does not see the folder.
        ValueError: if another process trains in the folder, and does not leave it.
    """
    task.place.enter()
    if not (task.sweep / ABOUT).is_file():
        raise OSError(f"this node sees no {task.sweep / ABOUT}: the folder of a sweep must be on shared storage")
    try:
        for row in rows_so_far(task.folder):
            report(scored(row, task.trial))
        if not task.ended:
            _train(task, report)
    except InUse:
        raise
    except ValueError as error:
        report({"steps": 0, "merit": _REFUSED, "error": str(error)})


def scored(row: Row, trial: Trial) -> Row:
    """A row as it is reported, with its ``merit``: a single number that orders trials by success, then by return.

    Two shares of success differ by at least one episode; the return moves the merit by less than half of that.
    """
    success, value = merit(row)
    tie = value / (1.0 + abs(value)) / (4.0 * trial.config.evaluation_episodes)
    numbers = {name: item for name, item in row.items() if isinstance(item, (int, float))}
    return {"steps": row["steps"], "merit": success + tie, "row": numbers}


def _train(task: Task, report: Callable[[Row], object]) -> None:
    watcher = Watcher(evaluated=lambda row: report(scored(row, task.trial)))
    patience = time.monotonic() + PATIENCE
    while True:
        try:
            _run_in(task).train(watcher)
            return
        except InUse:
            if time.monotonic() > patience:
                raise
            time.sleep(1.0)


def _run_in(task: Task) -> TrainingRun:
    """The run in the trial's folder; a new one if there is none, or it was lost before its first file was whole."""
    folder = task.folder
    if (folder / "run.json").is_file():
        return TrainingRun.resume(folder)
    (folder / "config.yaml").unlink(missing_ok=True)
    return TrainingRun.begin(folder, task.trial.config, task.command)
