"""`planarm sweep`: train with many settings, side by side on one machine or a cluster of Ray."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro

from agents.cluster import LOCAL, connected, load_ray, processors_of_nodes
from agents.commands.curves import chosen_metrics, final_scores, read_curves
from agents.console import INTERRUPTED, catch_interrupt, note, progress_bar, say
from agents.sweeps.axes import combinations, parse_axes, value_text
from agents.tables import Table
from agents.training.learning_curves import Curve
from agents.training.recipe import TrainingConfig
from agents.yaml_config import load_config, refuse_twice

if TYPE_CHECKING:
    from agents.sweeps.results import SweepResults
    from agents.sweeps.sweep import Sweep, Trial


@dataclass(frozen=True)
class SweepOptions:
    """Train with many settings, side by side on Ray; needs pip install "planarm[rl,cluster]".

    Each trial is a run of planarm train in FOLDER/trials, all of one environment. A trial takes as many processors as
    its setting threads says (by default one, and for PPO two from minibatches of 256 samples on); as many trials run at
    once as fit. One whose worker dies goes on from its last checkpoint, on another node if need be. After Ctrl-C, or if
    the whole cluster is lost, --resume goes on with everything; the results are the same to the bit as without
    interruption.

    --over takes values with commas between them, 0..4 for all integers from 0 to 4, 0.9..0.99 for an interval to draw
    from, and 1e-4..1e-2:log for one in which the logarithm is uniform. Trials are all combinations. --samples N takes N
    of them at random; with an interval, it draws N points, each combined with all values of the other settings.

    FOLDER/results.csv has a line a trial, the best first, and FOLDER/results.json all scores; both are kept up to date.
    The best agent of a trial is FOLDER/trials/NAME/best.safetensors.

    For example:

        $ planarm sweep ppo/ConveyorTrack-v0 --over seed=0..4
        $ planarm sweep ppo/ConveyorTrack-v0 --over seed=0..4 learning_rate=1e-4,3e-4 --dry-run
        $ planarm sweep mine.yaml total_steps=1000000 --over learning_rate=1e-4..1e-2:log --samples 20 --scheduler asha
        $ planarm sweep sac/ConveyorTrack-v0 --over seed=0..9 --address auto --out /shared/sac
        $ planarm sweep --resume /shared/sac --address auto
        $ planarm curves /shared/sac/trials/* --by learning_rate --plot curves.png
    """

    config: tyro.conf.Positional[str | None] = None
    """Name of a shipped configuration (in configs/), or a path to a YAML file of the same form."""
    changes: tyro.conf.Positional[tuple[str, ...]] = ()
    """key=value for each setting that all trials have in common; dots lead into nested ones, values are YAML."""
    over: tuple[str, ...] = ()
    """key=values for each setting to vary: seed=0..4, learning_rate=1e-4,3e-4, gamma=0.9..0.999."""
    samples: int | None = None
    """Number of points to draw; without it all combinations."""
    draw_seed: int = 0
    """Seed of the draws."""
    scheduler: Literal["grid", "asha"] = "grid"
    """grid trains every trial to its end; asha ends those that fall behind the others at the same steps."""
    grace_steps: int | None = None
    """Control steps that asha gives every trial; by default up to the second checkpoint after the warm start."""
    reduction: float = 3.0
    """asha lets one of so many trials go on, at grace_steps, reduction * grace_steps, and so on."""
    retries: int = 3
    """How often a trial whose worker dies goes on; -1 for any number."""
    address: str = LOCAL
    """local for this machine; auto for the Ray cluster that it belongs to; host:port of a cluster's head."""
    processors: int | None = None
    """Processors of this machine that a local sweep takes; by default all."""
    out: Path | None = None
    """Folder of the sweep, on storage that all nodes share; by default runs/sweep-ENV-DATE."""
    resume: Path | None = None
    """Folder of a sweep to go on with; only --address, --processors and --retries may be given with it."""
    dry_run: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print the trials, check their settings, and run none."""
    wide: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print every column, however narrow the terminal is."""

    def wanted(self) -> tuple[TrainingConfig, list[dict[str, Any]]]:
        """The recipe, and what each trial changes of it; a ValueError for an unknown setting or an impossible value."""
        if self.config is None:
            raise ValueError("name a configuration, such as ppo/ConveyorTrack-v0, or a sweep to --resume")
        changes = [f"env_config.{change}" if change.startswith("arm=") else change for change in self.changes]
        base = load_config(self.config, TrainingConfig).overridden(changes)
        refuse_twice([each.partition("=")[0] for each in (*changes, *self.over)], "setting")
        return base, combinations(parse_axes(self.over), self.samples, self.draw_seed)

    def trials(self) -> list[Trial]:
        """The trials that the options describe."""
        from agents.sweeps.sweep import make_trials

        return make_trials(*self.wanted())

    def sweep(self) -> Sweep:
        """The sweep to go on with, or a new one, which is not yet written."""
        from agents.sweeps.sweep import Plan, Sweep, check_asha

        if self.retries < -1:
            raise ValueError(f"retries {self.retries} must be at least 0, or -1 for any number")
        if self.resume is not None:
            free = ("address", "processors", "retries", "resume", "wide")
            fields = self.__dataclass_fields__.items()
            given = [name for name, field in fields if name not in free and getattr(self, name) != field.default]
            if given:
                names = ", ".join(given)
                raise ValueError(f"--resume keeps the settings that the sweep began with: leave out {names}")
            sweep = Sweep.read(self.resume)
            return replace(sweep, plan=replace(sweep.plan, retries=self.retries))
        trials = self.trials()
        if self.scheduler == "asha":
            plan = replace(check_asha(trials, self.grace_steps, self.reduction), retries=self.retries)
        elif self.grace_steps is not None:
            raise ValueError("--grace-steps is about --scheduler asha: give that too, or leave it out")
        else:
            plan = Plan(retries=self.retries)
        folder = self.out or Path("runs") / f"sweep-{trials[0].config.env_id}-{datetime.now():%Y%m%d-%H%M%S}"
        return Sweep(folder, trials, plan, shlex.join(["planarm", *sys.argv[1:]]))


def run(options: SweepOptions) -> int:
    """Run the sweep and print its results; the exit code."""
    if options.resume is None:
        options.wanted()  # what is wrong with it can be said without the libraries of training
    try:
        import_module("agents.training.run")
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f'training needs pip install "planarm[rl]" ({error})') from None
    sweep = options.sweep()
    if options.dry_run:
        trials_table(sweep).show(wide=options.wide)
        return 0
    if options.resume is None:
        sweep.check_new()
    load_ray()
    from agents.sweeps.results import SweepResults

    results = SweepResults(sweep)
    code = 0 if results.finished else _run_with_bar(results, options)
    results.table().show(wide=options.wide)
    if (means := over_seeds(results)) is not None:
        means.show(wide=options.wide)
    _show_best(results)
    note(f"wrote {sweep.folder}/results.csv and results.json; learning curves: {curves_command(sweep)}")
    failed = [record for record in results.records.values() if record.state == "failed"]
    for record in failed:
        note(f"trial {record.trial.name} failed: {record.error}", "red")
    if code or failed:
        note(f"{'stopped; ' if code else ''}go on: {_resume_command(sweep, options)}")
    return code or (1 if failed else 0)


def _resume_command(sweep: Sweep, options: SweepOptions) -> str:
    """The command that goes on with a sweep in the way in which it was run."""
    words = ["planarm", "sweep", "--resume", str(sweep.folder), "--address", options.address]
    if options.processors is not None:
        words += ["--processors", str(options.processors)]
    if options.retries != SweepOptions.retries:
        words += ["--retries", str(options.retries)]
    return shlex.join(words)


def trials_table(sweep: Sweep) -> Table:
    """What would be run, a row a trial."""
    rows = [
        (
            trial.name,
            *(value_text(trial.values.get(key, "")) for key in sweep.keys),
            f"{trial.config.total_steps:,}",
            str(trial.config.threads),
            trial.config.device,
        )
        for trial in sweep.trials
    ]
    count = f"{len(rows)} {'trial' if len(rows) == 1 else 'trials'}"
    headers = ("folder", *sweep.keys, "steps", "processors", "device")
    caption = f"{sum(trial.config.total_steps for trial in sweep.trials):,} control steps together. None was run."
    return Table(f"{sweep.trials[0].config.env_id}: {count}", headers, rows, caption, text_columns=1 + len(sweep.keys))


def _run_with_bar(results: SweepResults, options: SweepOptions) -> int:
    """Run the trials that are not over; the exit code. Nothing is written where Ray cannot run them."""
    from agents.sweeps.tuning import run_trials

    most = max(int(record.trial.config.threads) for record in results.records.values())
    total = sum(record.trial.config.total_steps for record in results.records.values())
    bar = progress_bar("steps", transient=False, more="{task.fields[best]}")
    with connected(options.address, options.processors) as ray:
        nodes = processors_of_nodes(ray)
        if most > max(nodes, default=0):
            raise ValueError(
                f"a trial takes {most} processors (threads), but no node has more than {max(nodes, default=0)}: set "
                "threads=1, or take larger nodes"
            )
        if options.resume is None:
            results.sweep.write()
        places = f"{len(nodes)} {'node' if len(nodes) == 1 else 'nodes'} with {sum(nodes)} processors"
        note(f"{len(results.records)} trials in {results.sweep.folder}, on {places}")
        task = bar.add_task("beginning", total=total, best="")
        with suppress(KeyboardInterrupt), catch_interrupt(at_once=True) as interrupts, bar:

            def heard(line: str) -> None:
                if interrupts:  # where Python could not raise the KeyboardInterrupt, as in a callback from C
                    raise KeyboardInterrupt
                if line:
                    note(line, "yellow")
                best = results.ranked[0].best
                scores = f"best: success {best['success']:.0%}, return {best['return']:.3f}" if best else ""
                bar.update(task, completed=results.steps, description=_states(results), best=scores)

            run_trials(results, heard)
            return 0
        return (interrupts or [INTERRUPTED])[0]


def _states(results: SweepResults) -> str:
    """How many trials are in each state."""
    states = [record.state for record in results.records.values()]
    return ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states))


def _show_best(results: SweepResults) -> None:
    best = results.ranked[0]
    if best.best is not None:
        folder = results.sweep.folder_of(best.trial)
        say(f"Best trial: {best.trial.name}; its agent is {folder}/best.safetensors.")


def over_seeds(results: SweepResults) -> Table | None:
    """Means over the seeds, the best settings first; None unless seeds are swept together with something else."""
    sweep = results.sweep
    keys = [key for key in sweep.keys if key != "seed"]
    if not keys or "seed" not in sweep.keys:
        return None
    trials = {sweep.folder_of(trial): trial for trial in sweep.trials}
    curves, _ = read_curves(list(trials))
    groups: dict[str, list[Curve]] = {}
    for curve in curves:
        values = trials[curve.folder].values
        groups.setdefault(", ".join(f"{key}={value_text(values.get(key))}" for key in keys), []).append(curve)
    if not curves:
        return None
    groups = dict(sorted(groups.items(), key=lambda group: _mean_merit(group[1]), reverse=True))
    return final_scores(f"{curves[0].config.env_id}, over seeds", groups, chosen_metrics(curves, ()))


def _mean_merit(curves: Sequence[Curve]) -> tuple[float, float]:
    """Means of success and return at the runs' best checkpoints."""
    success, returns = (
        float(np.mean([curve.columns[name][curve.best] for curve in curves])) for name in ("success", "return")
    )
    return success, returns


def curves_command(sweep: Sweep) -> str:
    """The command that draws the learning curves."""
    key = next((key for key in sweep.keys if key != "seed"), "seed")
    return f"planarm curves {shlex.quote(str(sweep.folder))}/trials/* --by {key} --plot curves.png"
