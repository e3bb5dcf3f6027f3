"""The trials of a sweep on Ray Tune."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from time import monotonic
from typing import Any

from agents.cluster import Place
from agents.sweeps.results import SweepResults
from agents.sweeps.sweep import Task
from agents.training.folder import alone_in

_INTERVAL = 2.0  # s between two writings of the results while trials run


def run_trials(results: SweepResults, heard: Callable[[str], object]) -> None:
    """Run the trials that are not over, on the cluster that this process is connected to.

    The results are kept up to date, in memory and in the folder. Scores of trials that are over are reported again, so
    that ASHA compares with them.

    Args:
        results: of the sweep, as its folder has them.
        heard: called after every report of a trial, and when one loses its worker, with a line about it or "".

    Raises:
        ValueError: if another process runs a sweep in the folder.
    """
    from ray import tune

    sweep = results.sweep
    compared = sweep.plan.scheduler == "asha"
    records = [record for record in results.records.values() if compared or record.state != "done"]
    for record in records:
        if record.state == "failed":
            record.state, record.error = "waiting", ""
    place = Place.here()
    tasks = {
        record.trial.name: Task(
            record.trial,
            sweep.folder.absolute(),
            sweep.folder_of(record.trial).absolute(),
            sweep.command,
            record.state in ("done", "stopped"),
            place,
        )
        for record in records
    }
    with alone_in(sweep.folder):
        storage = sweep.folder.absolute() / "ray"
        shutil.rmtree(storage, ignore_errors=True)  # of a sweep that was interrupted; the runs hold all that counts
        try:
            if tasks:
                _tuner(tasks, results, storage, _recorder(tune, results, heard)).fit()
        finally:
            for record in records:
                if record.state == "running":  # interrupted
                    record.state = "waiting"
            with suppress(OSError):
                results.write()
            shutil.rmtree(storage, ignore_errors=True)


def _tuner(tasks: dict[str, Task], results: SweepResults, storage: Any, recorder: Any) -> Any:
    """Ray Tune over the tasks."""
    from ray import tune

    plan = results.sweep.plan
    scheduler = None
    if plan.scheduler == "asha":
        total = results.sweep.trials[0].config.total_steps
        scheduler = tune.schedulers.ASHAScheduler(
            time_attr="steps",
            metric="merit",
            mode="max",
            max_t=total,
            grace_period=plan.grace_steps,
            reduction_factor=plan.reduction,
        )
    resources = {name: _resources(task) for name, task in tasks.items()}
    trainable = tune.with_parameters(_train_in_worker, tasks=tasks)
    return tune.Tuner(
        tune.with_resources(trainable, lambda space: tune.PlacementGroupFactory([resources[space["trial"]]])),
        param_space={"trial": tune.grid_search(list(tasks))},
        tune_config=tune.TuneConfig(
            scheduler=scheduler,
            reuse_actors=True,  # importing torch takes longer than a short trial
            trial_name_creator=_name,
            trial_dirname_creator=_name,
        ),
        run_config=tune.RunConfig(
            name="tune",
            storage_path=str(storage),
            verbose=0,
            failure_config=tune.FailureConfig(max_failures=results.sweep.plan.retries),
            callbacks=[recorder],
        ),
    )


def _train_in_worker(space: dict[str, Any], tasks: dict[str, Task]) -> None:
    from ray import tune

    import_module("agents.sweeps.trial").run_trial(tasks[space["trial"]], tune.report)


def _resources(task: Task) -> dict[str, float]:
    """What a trial takes of a node: as many processors as PyTorch has threads, and the GPU if it trains there."""
    config = task.trial.config
    return {"CPU": float(config.threads), **({"GPU": 1.0} if config.device == "cuda" else {})}


def _name(trial: Any) -> str:
    return str(trial.config["trial"])


def _recorder(tune: Any, results: SweepResults, heard: Callable[[str], object]) -> Any:
    """A callback of Ray Tune that keeps the results."""
    written = 0.0

    def changed(line: str = "") -> None:
        nonlocal written
        if monotonic() - written > _INTERVAL:
            results.write()
            written = monotonic()
        heard(line)

    class Recorder(tune.Callback):  # type: ignore[misc]
        def __reduce__(self) -> Any:
            return tune.Callback, ()  # in Tune's own state, which nothing is restored from

        def on_trial_start(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
            record = results.records[_name(trial)]
            if record.state == "waiting":
                record.state = "running"
            changed()

        def on_trial_result(
            self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **info: Any
        ) -> None:
            record = results.records[_name(trial)]
            if error := result.get("error"):
                record.state, record.error = "failed", str(error)
                changed(f"trial {record.trial.name} failed: {error}")
                return
            record.add(result["row"])
            changed()

        def on_trial_complete(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
            record = results.records[_name(trial)]
            if record.state == "running":
                over = record.rows and record.rows[-1]["steps"] >= record.trial.config.total_steps
                record.state = "done" if over else "stopped"
            if record.state == "stopped":
                results.write()  # at once: unlike that of others, the end of this trial is not in its own folder
            changed()

        def on_trial_recover(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
            record = results.records[_name(trial)]
            record.losses += 1
            steps = int(record.rows[-1]["steps"]) if record.rows else 0
            changed(f"trial {record.trial.name} has lost its worker; it goes on from {steps:,} steps")

        def on_trial_error(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
            record = results.records[_name(trial)]
            record.state, record.error = "failed", "it has lost its workers, or its process has failed"
            changed(f"trial {record.trial.name} failed: {record.error}")

    return Recorder()
