"""A training run: an algorithm in segments, with a checkpoint after each.

All state crosses a segment boundary through the checkpoint: every segment begins new episodes, and seeds all generators
from the run's seed and the segment's number. A run that was stopped and resumed therefore ends bit for bit like one
that was not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter

import gymnasium as gym
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure

import envs
from agents.datasets.read import check_dataset
from agents.environments import import_env
from agents.policies.files import layout_of, save_agent
from agents.training import devices
from agents.training.algorithms import make_model
from agents.training.algorithms.segmented import Segmented, fine_elements
from agents.training.batches import training_batch
from agents.training.batches.estimates import check_estimates
from agents.training.checkpoint import RunState, load_checkpoint, make_agent, save_checkpoint
from agents.training.folder import alone_in, check_files, check_origin, write_origin
from agents.training.learning_curves import Row
from agents.training.recipe import OffPolicyConfig, PPOConfig, TrainingConfig
from agents.training.replay import demonstrate
from agents.training.scores import baseline_columns, best_baseline, score, score_baselines
from agents.training.seeding import env_seed, seed_everything
from agents.training.vec_env import NativeVecEnv
from agents.training.warm_start.amortise import amortise, check_motions
from agents.training.warm_start.dagger import dagger
from agents.training.warm_start.forecasts import check_forecasts, fit_forecasts
from agents.training.warm_start.stage import Stage
from agents.yaml_config import load_config
from envs.experts import expert_names
from envs.settings import refuse_unknown
from planners import arm_document, load_arm


@dataclass
class Watcher:
    """Callbacks of a run."""

    begin: Callable[[str], object] = lambda line: None  # called with a line about what begins
    step: Callable[[int], object] = lambda steps: None  # called with the number of control steps so far
    evaluated: Callable[[Row], object] = lambda row: None  # called with the new row of metrics.csv
    stop: Callable[[], bool] = lambda: False  # says whether to end the run after the current control step

    def report(self, line: str) -> bool:
        """Report a line; return whether to continue."""
        self.begin(line)
        return not self.stop()


@dataclass
class TrainingRun:
    """A run in a folder."""

    folder: Path  # of everything that it writes
    config: TrainingConfig
    state: RunState = field(default_factory=RunState)  # at the last checkpoint
    identity: str = field(default="", init=False)  # as in its checkpoints

    @classmethod
    def begin(cls, folder: Path, config: TrainingConfig, command: str) -> TrainingRun:
        """A new run in a new folder.

        Its settings name the device and the threads that ``auto`` means here, and hold the arm itself, if another than
        the task's own is given.

        Raises:
            ValueError: if the folder is not empty, or the configuration names something that does not exist.
        """
        import_env(config.env)
        config = with_fingerprint(with_arm_document(devices.resolved(config)))
        devices.use(config)
        layout = layout_of(config.env_id, config.env_config)
        fine_elements(config, layout)
        config.check_levels()
        if isinstance(config, PPOConfig) and config.forecasts:
            check_forecasts(config)
        if isinstance(config, PPOConfig) and config.estimates:
            check_estimates(config)
        refuse_unknown(config.baselines or (), expert_names(config.env_id), "expert")
        if isinstance(config, PPOConfig) and config.amortise:
            with closing(gym.make_vec(config.env_id, num_envs=1, **config.env_config)) as batch:
                check_motions(batch)
        if (teacher := config.teacher) and teacher.expert is not None:
            with closing(gym.make(config.env_id, **config.env_config)) as env:
                envs.make_expert(teacher.expert, env)
        write_origin(folder, config, command)
        return cls(folder, config)

    @classmethod
    def resume(cls, folder: Path) -> TrainingRun:
        """The run in a folder, as it was at its last checkpoint; a ValueError if there is none."""
        if not folder.is_dir():
            raise ValueError(f"no folder {folder}" if not folder.exists() else f"{folder} is no folder of a run")
        check_files(folder)
        config = load_config(str(folder / "config.yaml"), TrainingConfig)
        check_origin(folder, config)
        return cls(folder, config)

    @property
    def steps(self) -> int:
        """Control steps at the last checkpoint."""
        return self.state.steps

    @property
    def finished(self) -> bool:
        """Whether all steps are done."""
        return self.steps >= self.config.total_steps

    def train(self, watcher: Watcher | None = None) -> bool:
        """Train until all steps are done or the watcher stops it; whether they are done.

        Raises:
            ValueError: if another process trains in the folder, a file in it is damaged, or the weights diverge.
        """
        watcher, config = watcher or Watcher(), devices.resolved(self.config)
        import_env(config.env)
        devices.use(config)
        layout = layout_of(config.env_id, config.env_config)
        with alone_in(self.folder), _refusing_size(config), closing(self._environments()) as env:
            self.identity = check_origin(self.folder, self.config)
            model = make_model(config, env, layout, config.device)
            model.set_logger(configure(str(self.folder / "tensorboard"), ["tensorboard"]))
            self.state = load_checkpoint(self.folder, self.identity, model)
            if not self.state.rows:
                with_fingerprint(config)  # refuses a dataset that has changed
                if not self._warm_start(model, env, watcher):
                    return False
            baseline = baseline_columns(self.state.rows[0])
            while not self.finished:
                if not self._segment(model, env, baseline, watcher):
                    return False
        return True

    def _environments(self) -> NativeVecEnv:
        return NativeVecEnv(training_batch(self.config))

    def _warm_start(self, model: Segmented, env: NativeVecEnv, watcher: Watcher) -> bool:
        """Score the baselines, learn from an expert or a cost as configured, write the first checkpoint; as `_segment`.

        A run that is stopped here goes on from the last round of it.
        """
        config, first = self.config, env_seed(self.config.seed, 0)
        stage = Stage(self.folder / "warm_start.pt", self.identity, watcher.report)
        scores = score_baselines(config, stage.load("baselines") or {}, watcher.begin, partial(stage.save, "baselines"))
        seed_everything(config.seed, 0)
        if isinstance(config, PPOConfig):
            model.policy.to("cpu")
            with self._refusing_divergence(model):
                for warm_start in (dagger, amortise, fit_forecasts):
                    if not warm_start(model.policy, config, first, stage):
                        return False
            model.policy.to(model.device)
        elif isinstance(config, OffPolicyConfig) and config.demonstrations:
            env.seed(first)
            if not demonstrate(config.demonstrations, env, model.replay_buffer, watcher.report):
                return False
        self._checkpoint(model, RunState(0, stage.elapsed()), best_baseline(scores), watcher)
        stage.finish()
        return True

    def _segment(self, model: Segmented, env: NativeVecEnv, baseline: Row, watcher: Watcher) -> bool:
        """Train up to the next checkpoint and write it; False, without a checkpoint, if the watcher stopped it."""
        number, before = 1 + self.steps // self.config.segment_steps, perf_counter()
        seed_everything(self.config.seed, number)
        env.seed(env_seed(self.config.seed, number))
        model.action_space.seed(env_seed(self.config.seed, number))  # random actions before SAC and TD3 learn
        model._last_obs = None  # so that learn begins with new episodes
        watcher.begin("training")
        goal = min(number * self.config.segment_steps, self.config.total_steps)
        callback = _WatcherCallback(watcher)
        try:
            with self._refusing_divergence(model):
                model.learn(goal - self.steps, callback=callback, log_interval=1, reset_num_timesteps=False)
            if callback.stopped:
                self._leave(model)
                return False
            reached = RunState(model.num_timesteps, self.state.seconds + perf_counter() - before, self.state.rows)
            self._checkpoint(model, reached, baseline, watcher)
        except KeyboardInterrupt:
            self._leave(model)
            raise
        return True

    def _leave(self, model: Segmented) -> None:
        """Write the agent as it is between two checkpoints."""
        save_agent(make_agent(model, self.state.seconds), self.folder / "last.safetensors")

    @contextmanager
    def _refusing_divergence(self, model: Segmented) -> Iterator[None]:
        """Raise a ValueError that says so if the networks' weights or outputs become NaN or infinite."""
        error: Exception | None = None
        try:
            yield
        except (ValueError, RuntimeError) as raised:
            error = raised
        # Distributions of torch refuse parameters that are not finite or not positive, each with all of its values.
        # Steps beyond float32 are a RuntimeError.
        said = str(error)
        beyond = said.startswith("Expected parameter") or "without overflow" in said or "log_std of an agent" in said
        if not model.finite() or beyond:
            raise ValueError(
                f"training diverged between {self.steps:,} and {model.num_timesteps:,} steps: the networks are not "
                "finite any more; begin again with a lower learning_rate, smaller gains in fine, or the default of "
                "log_std, clip_range and the weights"
            ) from None
        if error is not None:
            raise error

    def _checkpoint(self, model: Segmented, state: RunState, baseline: Row, watcher: Watcher) -> None:
        """Evaluate the agent and write everything; then ``state``, with a row more, is that of the run."""
        watcher.begin("evaluating")
        with self._refusing_divergence(model):
            scores = score(make_agent(model, state.seconds), self.config)
        row = {"steps": state.steps, "seconds": round(state.seconds, 3), **scores, **baseline}
        state = replace(state, rows=[*state.rows, row])
        for name, value in scores.items():
            model.logger.record(f"evaluation/{name}", value)
        model.logger.dump(state.steps)
        with self._refusing_divergence(model):
            save_checkpoint(self.folder, self.identity, model, state, make_agent(model, state.seconds, scores))
        self.state = state
        watcher.evaluated(row)


class _WatcherCallback(BaseCallback):  # type: ignore[misc]
    """Reports every control step to a watcher, and stops when it says so."""

    def __init__(self, watcher: Watcher) -> None:
        super().__init__()
        self.watcher = watcher
        self.stopped = False

    def _on_step(self) -> bool:
        self.watcher.step(self.num_timesteps)
        self.stopped = self.watcher.stop()
        return not self.stopped


@contextmanager
def _refusing_size(config: TrainingConfig) -> Iterator[None]:
    """Raise a ValueError instead of what NumPy and torch raise where memory is too small for a run."""
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "allocate memory" not in str(error):
            raise
        sizes = ("num_envs", "rollout_steps", "hidden", "batch_size", "buffer_size", "evaluation_episodes")
        given = ", ".join(f"{name} {getattr(config, name)}" for name in sizes if hasattr(config, name))
        raise ValueError(f"this machine has too little memory for {given}: take less of it") from None


def with_arm_document(config: TrainingConfig) -> TrainingConfig:
    """A recipe whose environment's settings hold the arm that they name, so that no file is needed to go on."""
    arm = config.env_config.get("arm")
    if arm is None:
        return config
    document = arm_document(load_arm(arm))
    return config.model_copy(update={"env_config": {**config.env_config, "arm": document}})


def with_fingerprint(config: TrainingConfig) -> TrainingConfig:
    """A recipe that holds the fingerprint of its dataset, if it has one; raises as `check_dataset`."""
    teacher = config.teacher
    if teacher is None or teacher.dataset is None:
        return config
    if len(config.conditions) > 1:
        raise ValueError(f"levels {', '.join(config.levels)} and dataset {teacher.dataset}: a dataset is of one level")
    found = check_dataset(teacher.dataset, config.env_id, *config.conditions[0], teacher.sha256)
    name = "warm_start" if isinstance(config, PPOConfig) else "demonstrations"
    return config.model_copy(update={name: teacher.model_copy(update={"sha256": found})})
