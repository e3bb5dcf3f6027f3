"""`planarm evaluate`: one policy on one task, alone or beside others."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

import envs
from agents.console import note
from agents.environments import import_env, is_in_module
from agents.evaluation.benchmark import Benchmark
from agents.evaluation.benchmark_config import BenchmarkConfig
from agents.policies.agent import ACTION_SETTINGS, Agent
from agents.policies.files import load_agent
from agents.policies.lookup import find_policy, is_shipped
from agents.report.outputs import ScoreOutputs, run_and_print
from agents.training.recipe import TrainingConfig
from agents.yaml_config import assigned, load_config
from envs.experts import is_expert


@dataclass(frozen=True)
class EvaluateOptions(ScoreOutputs):
    """Score a policy: an expert, an agent that was trained here, a model of Stable-Baselines3, or one of your own.

    The same seed begins the same episode for every policy, so that --against compares in pairs. A policy of your own
    training is scored in the settings that it was trained in, unless --level or --settings changes them, and all others
    with it; the table then says so. The agents of planarm are scored in the task's own settings: give --level.

    For example:

        $ planarm evaluate apf --env ObstacleDodge-v0 --episodes 1000
        $ planarm evaluate runs/mine --against dpct apf
        $ planarm evaluate my_module:make_policy --env ConveyorTrack-v0 --against dpct --options belt_speed=0.2
        $ planarm evaluate dpct+adaptive --env ConveyorTrack-v0 --against dpct --settings payload=0.3
        $ planarm evaluate lagrange --env MinTorqueMove-v0 --level latency --against dpct
        $ planarm evaluate model.zip --env ConveyorTrack-v0 --settings control_mode=jerk --allow-code
    """

    policy: tyro.conf.Positional[str]
    """Name of an expert, with +adaptive to estimate the payload; agent for the one that comes with planarm; the path
    of a run, an agent or a .zip; or module:name for your own planner, policy, or function that makes one."""
    env: str | None = None
    """Id of the environment, module:id for your own; may be left out for agents trained here, whose files name it."""
    episodes: int = 100
    """How many."""
    seed: int = 0
    """Seed of the first episode; each further episode has the next."""
    against: tuple[str, ...] = ()
    """Policies to compare with, on the same episodes."""
    level: str | None = None
    """Difficulty level, from the task's card (docs/benchmark/levels.md)."""
    settings: tuple[str, ...] = ()
    """key=value for each setting of the environment to change from its default."""
    options: tuple[str, ...] = ()
    """key=value for each option of the reset, such as belt_speed=0.2 or scenario=paper."""
    num_envs: int = 256
    """Episodes that run at once."""
    allow_code: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load a Stable-Baselines3 .zip, and the statistics beside it, although any code in them is run."""

    def resolve(self) -> Benchmark:
        """The evaluation as a benchmark of one task."""
        env_id = self._env_id()
        named = find_policy(self.policy, env_id, allow_code=self.allow_code)
        at_level, _ = envs.task_card(env_id).at_level(self.level, {}, {})
        others = {*ACTION_SETTINGS, *at_level}
        carried = {name: value for name, value in named.carried.items() if name not in others}
        settings = {
            "episodes": self.episodes,
            "bound_episodes": 0,
            "seed": self.seed,
            "num_envs": self.num_envs,
            "policies": (self.policy, *self.against),
            "tasks": [
                {
                    "env": env_id,
                    "level": self.level,
                    "env_config": {**carried, **assigned({}, self.settings)},
                    "options": assigned({}, self.options),
                }
            ],
        }
        if self.replays is not None:
            settings["replays"] = self.replays
        levels = named.policy.levels if isinstance(named.policy, Agent) and named.own else ()
        if levels and self.level is None:
            note(f"{named.name} was trained at {', '.join(levels)}; these are other episodes: give --level", "yellow")
        config = BenchmarkConfig.parse(settings, "evaluation setting")
        return Benchmark(config, compared=(named.name,), allow_code=self.allow_code)

    def _env_id(self) -> str:
        if self.env is not None:
            env_id = import_env(self.env)
            envs.task_card(env_id)  # raises for an unknown id
            return env_id
        if self.policy.endswith(".zip") and not Path(self.policy).is_file():
            raise ValueError(f"no file {self.policy}")
        names_none = is_expert(self.policy) or is_in_module(self.policy) or self.policy.endswith(".zip")
        if names_none or is_shipped(self.policy):
            raise ValueError(f"no environment: give --env, one of {', '.join(envs.env_ids())}")
        try:
            return load_agent(Path(self.policy)).env_id
        except ValueError as error:
            config = Path(self.policy) / "config.yaml"
            named = load_config(str(config), TrainingConfig).env if config.is_file() else ""
            if is_in_module(named):
                raise ValueError(f"{error}; its task is one of your own: give --env {named}") from None
            raise


def run(options: EvaluateOptions) -> int:
    """Evaluate and print; the exit code."""
    return run_and_print(options.resolve(), options)
