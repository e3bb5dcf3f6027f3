"""`planarm train`: train an agent with PPO, SAC or TD3, or continue a run."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

import envs
from agents.console import INTERRUPTED, catch_interrupt, note, progress_bar
from agents.training.recipe import TrainingConfig
from agents.yaml_config import load_config

if TYPE_CHECKING:
    from agents.training.learning_curves import Row
    from agents.training.run import TrainingRun


@dataclass(frozen=True)
class TrainOptions:
    """Train an agent with PPO, SAC or TD3 of Stable-Baselines3; needs pip install "planarm[rl]".

    A configuration of your own is a YAML file with at least `env`, an id or `my_module:MyTask-v0` for a task that your
    module registers; docs/agents/configs.md lists all settings. Settings of the environment are below env_config, and
    arm= is short for env_config.arm=. Ctrl-C stops the run. --resume continues it from its last checkpoint, also after
    a crash, and imports your module again if the task is of one.

    For example:

        $ planarm train ppo/ConveyorTrack-v0 --seed 1
        $ planarm train sac/ConveyorTrack-v0 device=cpu threads=2
        $ planarm train mine.yaml gamma=0.99 warm_start.episodes=512 --out runs/mine
        $ planarm train ppo/ConveyorTrack-v0 arm=my_arm.yaml env_config.horizon=4.0
        $ planarm train --resume runs/mine
    """

    config: tyro.conf.Positional[str | None] = None
    """Name of a shipped configuration (in configs/), or a path to a YAML file of the same form."""
    changes: tyro.conf.Positional[tuple[str, ...]] = ()
    """key=value for each setting to change; dots lead into nested ones, values are YAML."""
    level: str | None = None
    """Difficulty level of the environment, from the task's card, in place of those of the configuration; for several,
    levels=[two_discs,fast]."""
    seed: int | None = None
    """Seed of all random number generators of the run; that of the configuration, 0, if left out."""
    total_steps: int | None = None
    """Control steps of all environments together; those of the configuration if left out."""
    out: Path | None = None
    """Folder of the run; by default runs/ENV-DATE-seedN."""
    resume: Path | None = None
    """Folder of a run to continue; none of its settings can be changed."""

    def resolve(self) -> TrainingConfig:
        """The configuration with the changes of the command line."""
        if self.config is None:
            raise ValueError("name a configuration, such as ppo/ConveyorTrack-v0, or a run to --resume")
        named = [f"{name}={value}" for name in ("seed", "total_steps") if (value := getattr(self, name)) is not None]
        changes = [f"env_config.{change}" if change.startswith("arm=") else change for change in self.changes]
        return self._at_level(load_config(self.config, TrainingConfig), [*changes, *named])

    def _at_level(self, config: TrainingConfig, changes: Sequence[str]) -> TrainingConfig:
        """A configuration with changes, at the level; what is changed has precedence."""
        if self.level is None:
            return config.overridden(changes)
        settings, options = envs.task_card(config.env_id).at_level(self.level, {}, {})
        if options:
            return config.overridden([f"levels=[{self.level}]", *changes])
        levelled = [f"env_config.{name}={json.dumps(value)}" for name, value in settings.items()]
        whole = [change for change in changes if change.partition("=")[0].strip() == "env_config"]
        single = [change for change in changes if change not in whole]
        own = config.overridden(whole)
        given = own.env_config if whole else {}
        levelled = [change for name, change in zip(settings, levelled, strict=True) if name not in given]
        return own.overridden([*levelled, "levels=[]", *single])

    def make_run(self) -> TrainingRun:
        """The run to continue, or a new one."""
        if self.resume is not None:
            if (
                self.config is not None
                or self.level is not None
                or self.seed is not None
                or self.total_steps is not None
                or self.out is not None
            ):
                raise ValueError("--resume takes no other options: a run keeps the settings that it began with")
            return _runs().resume(self.resume)
        config = self.resolve()
        name = f"{config.env_id}-{datetime.now():%Y%m%d-%H%M%S}-seed{config.seed}"
        return _runs().begin(self.out or Path("runs") / name, config, shlex.join(["planarm", *sys.argv[1:]]))


def run(options: TrainOptions) -> int:
    """Train; the exit code."""
    training = options.make_run()
    if remark := training.config.remark:
        note(remark, "yellow")
    if code := _train_with_bar(training):
        command = shlex.join(["planarm", "train", "--resume", str(training.folder)])
        note(f"stopped; continue{f' from {training.steps:,} steps' if training.steps else ''}: {command}")
        return code
    best = training.folder / "best.safetensors"
    note(f"{training.steps:,} steps; the best agent {'is' if best.exists() else 'was (it is missing now)'} {best}")
    return 0


def _runs() -> type[TrainingRun]:
    try:
        from agents.training.run import TrainingRun
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f'training needs pip install "planarm[rl]" ({error})') from None
    return TrainingRun


def _train_with_bar(training: TrainingRun) -> int:
    """Train until all is done, or Ctrl-C or SIGTERM stops it; the exit code."""
    from agents.training.run import Watcher

    bar = progress_bar("steps, {task.fields[rate]}/s", transient=False, more="{task.fields[scores]}")
    task = bar.add_task("beginning", total=training.config.total_steps, rate="-", scores="")

    def step(steps: int) -> None:
        speed = bar.tasks[0].speed
        bar.update(task, completed=steps, rate=f"{speed:,.0f}" if speed else "-")

    def evaluated(row: Row) -> None:
        bar.update(task, scores=_scores(row))
        if bar.disable:
            note(f"{row['steps']:,} steps, {row['seconds']:.0f} s: {_scores(row)}")

    with suppress(KeyboardInterrupt), catch_interrupt(at_once=True) as interrupts, bar:
        watcher = Watcher(
            begin=lambda line: bar.update(task, description=line),
            step=step,
            evaluated=evaluated,
            stop=lambda: bool(interrupts),  # where Python could not raise the KeyboardInterrupt, as in a destructor
        )
        if training.train(watcher):
            return 0
    return (interrupts or [INTERRUPTED])[0]


def _scores(row: Row) -> str:
    """The agent's success and return, beside the best baseline's on the same seeds if there is one."""
    expert = row.get("expert")
    if expert is None:
        return f"success {row['success']:.0%}, return {row['return']:.3f}"
    return (
        f"success {row['success']:.0%} ({expert} {row['expert_success']:.0%}), "
        f"return {row['return']:.3f} ({expert} {row['expert_return']:.3f})"
    )
