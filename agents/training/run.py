"""A training run: a folder on the disk, and segments between whose ends nothing is carried but what a checkpoint holds.

At the start of every segment all generators are seeded from the run's seed and the segment's number, and every
environment begins an episode. So a run that is resumed goes on bit for bit as if it had never been stopped.
"""

from __future__ import annotations

import csv
import io
import random
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import gymnasium as gym
import numpy as np
import torch
import yaml
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure

import envs
from agents.evaluation.evaluate import Evaluation, evaluate
from agents.files import whole_file, write_json, write_text
from agents.policies.agent import ACTION_SETTINGS, FORMAT, Agent, describe_layout, layout_of, save_agent
from agents.provenance import machine, versions
from agents.training.amortise import amortise
from agents.training.ppo import SegmentedPPO, agent_tensors, fine_elements
from agents.training.recipe import EVALUATION_SEED, TrainingConfig
from agents.training.vec_env import NativeVecEnv
from agents.training.warm_start import clone_expert
from agents.training.whole_episodes import WholeEpisodes
from agents.yaml_config import load_experiment
from envs.experts import expert_names
from envs.settings import refuse_unknown

TRAINING_SEEDS = 2**31
"""Environments learn from seeds in [2**31, 2**32); evaluations use lower ones."""

Row = dict[str, Any]
RL_DISTRIBUTIONS = ("stable-baselines3", "torch", "safetensors")


@dataclass
class Watcher:
    """Who looks on: each attribute is called as the run goes along.

    Attributes:
        begin: with a line about what begins.
        step: with the number of control steps so far.
        evaluated: with the new row of metrics.csv.
        stop: whether to end after the current control step.
    """

    begin: Callable[[str], object] = lambda line: None
    step: Callable[[int], object] = lambda steps: None
    evaluated: Callable[[Row], object] = lambda row: None
    stop: Callable[[], bool] = lambda: False


@dataclass
class TrainingRun:
    """A run in a folder.

    Attributes:
        folder: everything it writes.
        config: what it does.
        rows: of metrics.csv so far.
        steps: control steps at the last checkpoint.
        seconds: of training up to there, without evaluations.
    """

    folder: Path
    config: TrainingConfig
    rows: list[Row] = field(default_factory=list)
    steps: int = 0
    seconds: float = 0.0

    @classmethod
    def begin(cls, folder: Path, config: TrainingConfig, command: str) -> TrainingRun:
        """A new run in a new folder.

        Raises:
            ValueError: if the folder already holds something, or the configuration asks for what there is not.
        """
        _check(config)
        if folder.exists() and any(folder.iterdir()):
            raise ValueError(f"{folder} is not empty: choose another --out, or go on there with --resume {folder}")
        origin = {"command": command, "seed": config.seed}
        write_json(folder / "run.json", {**origin, "versions": versions(RL_DISTRIBUTIONS), "machine": machine()})
        write_text(folder / "config.yaml", yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False))
        return cls(folder, config)

    @classmethod
    def resume(cls, folder: Path) -> TrainingRun:
        """The run in a folder, as it was at its last checkpoint.

        Raises:
            ValueError: if there is no run.
        """
        return cls(folder, load_experiment(str(folder / "config.yaml"), TrainingConfig))

    @property
    def finished(self) -> bool:
        """Whether all steps are done."""
        return self.steps >= self.config.total_steps

    def train(self, watcher: Watcher | None = None) -> bool:
        """Go on until all steps are done, or the watcher stops it; whether they are done."""
        watcher = watcher or Watcher()
        torch.set_num_threads(1)  # a second thread costs far more in synchronisation than it brings to so small a net
        layout = layout_of(self.config.env, self.config.env_config)
        with closing(_make_batch(self.config)) as env:
            model = SegmentedPPO(self.config, env, layout)
            model.set_logger(configure(str(self.folder / "tensorboard"), ["tensorboard"]))
            self._restore(model)
            baseline = self._baseline(watcher)
            if not self.rows and not self._warm_start(model, baseline, watcher):
                return False
            while not self.finished:
                if not self._segment(model, env, baseline, watcher):
                    return False
        return True

    def _warm_start(self, model: SegmentedPPO, baseline: Row, watcher: Watcher) -> bool:
        """Clone an expert or amortise, if the configuration says so, and write the first checkpoint; as `_segment`."""

        def go_on(line: str) -> bool:
            watcher.begin(line)
            return not watcher.stop()

        before = perf_counter()
        seed_everything(self.config.seed, 0)
        for begin in (clone_expert, amortise):
            if not begin(model.policy, self.config, _env_seed(self.config.seed, 0), go_on):
                return False
        self.seconds += perf_counter() - before
        self._checkpoint(model, baseline, watcher)
        return True

    def _segment(self, model: SegmentedPPO, env: NativeVecEnv, baseline: Row, watcher: Watcher) -> bool:
        """Train up to the next checkpoint and write it; False, and no checkpoint, if the watcher stopped it."""
        number, before = 1 + self.steps // self.config.segment_steps, perf_counter()
        seed_everything(self.config.seed, number)
        env.seed(_env_seed(self.config.seed, number))
        model._last_obs = None  # so that learn begins with new episodes
        watcher.begin("training")
        goal = min(number * self.config.segment_steps, self.config.total_steps)
        callback = _Watching(watcher)
        model.learn(goal - self.steps, callback=callback, log_interval=1, reset_num_timesteps=False)
        if callback.stopped:
            save_agent(self._agent(model), self.folder / "last.safetensors")
            return False
        self.steps = model.num_timesteps
        self.seconds += perf_counter() - before
        self._checkpoint(model, baseline, watcher)
        return True

    def _checkpoint(self, model: SegmentedPPO, baseline: Row, watcher: Watcher) -> None:
        """Evaluate and write everything; the checkpoint last, because with it the segment counts as done."""
        watcher.begin("evaluating")
        agent = self._agent(model)
        scores = summary(self._evaluate(agent))
        agent = Agent({**agent.document, "scores": scores}, agent.tensors)
        best_before = max((_merit(row) for row in self.rows), default=(-1.0, 0.0))
        row = {"steps": self.steps, "seconds": round(self.seconds, 3), **scores, **baseline}
        self.rows.append(row)
        save_agent(agent, self.folder / "last.safetensors")
        if _merit(row) > best_before:
            save_agent(agent, self.folder / "best.safetensors")
        write_text(self.folder / "metrics.csv", _as_csv(self.rows))
        for name, value in scores.items():
            model.logger.record(f"evaluation/{name}", value)
        model.logger.dump(self.steps)
        with whole_file(self.folder / "checkpoint.pt") as draft:
            torch.save(self._state(model), draft)
        watcher.evaluated(row)

    def _state(self, model: SegmentedPPO) -> dict[str, Any]:
        return {
            "policy": model.policy.state_dict(),
            "optimizer": model.policy.optimizer.state_dict(),
            "steps": self.steps,
            "updates": model._n_updates,
            "seconds": self.seconds,
            "rows": self.rows,
        }

    def _restore(self, model: SegmentedPPO) -> None:
        path = self.folder / "checkpoint.pt"
        if not path.exists():
            return
        state = torch.load(path, weights_only=True)
        model.policy.load_state_dict(state["policy"])
        model.policy.optimizer.load_state_dict(state["optimizer"])
        model.num_timesteps, model._n_updates = state["steps"], state["updates"]
        self.steps, self.seconds, self.rows = state["steps"], state["seconds"], state["rows"]

    def _agent(self, model: SegmentedPPO) -> Agent:
        config = self.config
        document = {
            "format": FORMAT,
            "env": config.env,
            "env_config": config.env_config,
            **describe_layout(layout_of(config.env, config.env_config)),
            "activation": config.activation,
            "hidden": list(config.hidden),
            "training": {
                "config": config.model_dump(mode="json"),
                "seed": config.seed,
                "steps": model.num_timesteps,
                "seconds": round(self.seconds, 1),
            },
            "versions": versions(RL_DISTRIBUTIONS),
        }
        return Agent(document, agent_tensors(model.policy))

    def _evaluate(self, policy: Agent | str) -> Evaluation:
        """On seeds never trained on; experts act in the environment's own control mode."""
        seeds = EVALUATION_SEED + np.arange(self.config.evaluation_episodes)
        settings = dict(self.config.env_config)
        if isinstance(policy, str):
            settings = {name: value for name, value in settings.items() if name not in ACTION_SETTINGS}
        return evaluate(policy, self.config.env, seeds, env_config=settings)

    def _baseline(self, watcher: Watcher) -> Row:
        """The best expert's row on the evaluation's seeds."""
        if self.rows:
            return {name: value for name, value in self.rows[0].items() if name.startswith("expert")}
        scores = {}
        for name in self.config.baselines:
            watcher.begin(f"evaluating {name}")
            scores[name] = summary(self._evaluate(name))
        best = max(scores, key=lambda name: _merit(scores[name]))
        return {"expert": best, **{f"expert_{name}": value for name, value in scores[best].items()}}


class _Watching(BaseCallback):  # type: ignore[misc]
    """Tells the watcher of every control step, and lets it stop the run."""

    def __init__(self, watcher: Watcher) -> None:
        super().__init__()
        self.watcher = watcher
        self.stopped = False

    def _on_step(self) -> bool:
        self.watcher.step(self.num_timesteps)
        self.stopped = self.watcher.stop()
        return not self.stopped


def summary(evaluation: Evaluation) -> dict[str, float]:
    """Shares of what is true or false, the mean return, medians of all else."""
    scores = {"success": float(evaluation.success.mean()), "return": float(evaluation.returns.mean())}
    for name, values in evaluation.metrics.items():
        if name != "is_success" and "/" not in name:
            scores[name] = float(values.mean() if values.dtype == bool else np.nanmedian(values))
    return scores


def seed_everything(seed: int, segment: int) -> None:
    """Put every generator of this process into the state with which a segment begins; the warm start is number 0."""
    state = _segment_state(seed, segment)
    random.seed(int(state[0]))
    np.random.seed(int(state[1]))  # noqa: NPY002  # Stable-Baselines3 draws minibatches from the global generator
    torch.manual_seed(int(state[2]))


def _env_seed(seed: int, segment: int) -> int:
    """Seed of a segment's first environment; the next environment has the next."""
    return TRAINING_SEEDS + int(_segment_state(seed, segment)[3]) % (2**31 - 2**20)


def _segment_state(seed: int, segment: int) -> NDArray[Any]:
    return np.random.SeedSequence([seed, segment]).generate_state(4)


def _check(config: TrainingConfig) -> None:
    """Raise a ValueError for what the configuration names and is not there, before anything is written."""
    fine_elements(config, layout_of(config.env, config.env_config))
    refuse_unknown(config.baselines, expert_names(config.env), "expert")
    if config.warm_start:
        with closing(gym.make(config.env, **config.env_config)) as env:
            envs.make_expert(config.warm_start.expert, env)


def _make_batch(config: TrainingConfig) -> NativeVecEnv:
    env = gym.make_vec(config.env, num_envs=config.num_envs, **config.env_config)
    return NativeVecEnv(WholeEpisodes(env) if config.whole_episodes else env)


def _merit(row: Row) -> tuple[float, float]:
    """Success first, then the return."""
    return row["success"], row["return"]


def _as_csv(rows: list[Row]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
