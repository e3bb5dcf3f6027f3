"""A training run: PPO in segments, with a checkpoint after each.

All state crosses a segment boundary through the checkpoint: every segment begins new episodes, and seeds all generators
from the run's seed and the segment's number. A run that was stopped and resumed therefore ends bit for bit like one
that was not.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

import gymnasium as gym
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure

import envs
from agents.policies.files import layout_of, save_agent
from agents.training.amortise import amortise
from agents.training.checkpoint import RunState, load_checkpoint, make_agent, save_checkpoint, write_origin
from agents.training.dagger import dagger
from agents.training.learning_curves import Row
from agents.training.ppo import SegmentedPPO, fine_elements
from agents.training.recipe import TrainingConfig
from agents.training.scores import baseline_columns, score, score_baselines
from agents.training.seeding import env_seed, seed_everything
from agents.training.vec_env import NativeVecEnv
from agents.training.whole_episodes import WholeEpisodes
from agents.yaml_config import load_config
from envs.experts import expert_names
from envs.settings import refuse_unknown


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

    @classmethod
    def begin(cls, folder: Path, config: TrainingConfig, command: str) -> TrainingRun:
        """A new run in a new folder.

        Raises:
            ValueError: if the folder is not empty, or the configuration names something that does not exist.
        """
        fine_elements(config, layout_of(config.env, config.env_config))
        refuse_unknown(config.baselines or (), expert_names(config.env), "expert")
        if config.warm_start:
            with closing(gym.make(config.env, **config.env_config)) as env:
                envs.make_expert(config.warm_start.expert, env)
        write_origin(folder, config, command)
        return cls(folder, config)

    @classmethod
    def resume(cls, folder: Path) -> TrainingRun:
        """The run in a folder, as it was at its last checkpoint; a ValueError if there is none."""
        return cls(folder, load_config(str(folder / "config.yaml"), TrainingConfig))

    @property
    def steps(self) -> int:
        """Control steps at the last checkpoint."""
        return self.state.steps

    @property
    def finished(self) -> bool:
        """Whether all steps are done."""
        return self.steps >= self.config.total_steps

    def train(self, watcher: Watcher | None = None) -> bool:
        """Train until all steps are done or the watcher stops it; whether they are done."""
        watcher = watcher or Watcher()
        torch.set_num_threads(1)  # for so small a network, synchronising a second thread costs more than it saves
        layout = layout_of(self.config.env, self.config.env_config)
        batch = gym.make_vec(self.config.env, num_envs=self.config.num_envs, **self.config.env_config)
        with closing(NativeVecEnv(WholeEpisodes(batch) if self.config.whole_episodes else batch)) as env:
            model = SegmentedPPO(self.config, env, layout)
            model.set_logger(configure(str(self.folder / "tensorboard"), ["tensorboard"]))
            self.state = load_checkpoint(self.folder, model)
            if self.state.rows:
                baseline = baseline_columns(self.state.rows[0])
            else:
                baseline = score_baselines(self.config, watcher.begin)
                if not self._warm_start(model, baseline, watcher):
                    return False
            while not self.finished:
                if not self._segment(model, env, baseline, watcher):
                    return False
        return True

    def _warm_start(self, model: SegmentedPPO, baseline: Row, watcher: Watcher) -> bool:
        """Run DAgger or amortise if configured, and write the first checkpoint; as `_segment`."""
        before = perf_counter()
        seed_everything(self.config.seed, 0)
        for warm_start in (dagger, amortise):
            if not warm_start(model.policy, self.config, env_seed(self.config.seed, 0), watcher.report):
                return False
        self.state.seconds += perf_counter() - before
        self._checkpoint(model, baseline, watcher)
        return True

    def _segment(self, model: SegmentedPPO, env: NativeVecEnv, baseline: Row, watcher: Watcher) -> bool:
        """Train up to the next checkpoint and write it; False, without a checkpoint, if the watcher stopped it."""
        number, before = 1 + self.steps // self.config.segment_steps, perf_counter()
        seed_everything(self.config.seed, number)
        env.seed(env_seed(self.config.seed, number))
        model._last_obs = None  # so that learn begins with new episodes
        watcher.begin("training")
        goal = min(number * self.config.segment_steps, self.config.total_steps)
        callback = _WatcherCallback(watcher)
        model.learn(goal - self.steps, callback=callback, log_interval=1, reset_num_timesteps=False)
        if callback.stopped:
            save_agent(make_agent(model, self.state.seconds), self.folder / "last.safetensors")
            return False
        self.state.steps = model.num_timesteps
        self.state.seconds += perf_counter() - before
        self._checkpoint(model, baseline, watcher)
        return True

    def _checkpoint(self, model: SegmentedPPO, baseline: Row, watcher: Watcher) -> None:
        """Evaluate the agent and write everything."""
        watcher.begin("evaluating")
        state = self.state
        scores = score(make_agent(model, state.seconds), self.config)
        state.rows.append({"steps": state.steps, "seconds": round(state.seconds, 3), **scores, **baseline})
        for name, value in scores.items():
            model.logger.record(f"evaluation/{name}", value)
        model.logger.dump(state.steps)
        save_checkpoint(self.folder, model, state, make_agent(model, state.seconds, scores))
        watcher.evaluated(state.rows[-1])


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
