"""`planarm evaluate`: one policy on one task, alone or beside others."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

import envs
from agents.commands.benchmark import run_and_print
from agents.evaluation.benchmark import Benchmark
from agents.evaluation.benchmark_config import BenchmarkConfig
from agents.policies.files import load_agent
from agents.policies.lookup import SHIPPED, find_policy
from agents.yaml_config import assigned
from envs.experts import is_expert


@dataclass(frozen=True)
class EvaluateOptions:
    """Score a policy: an expert, an agent that was trained here, or a model of Stable-Baselines3.

    The same seed begins the same episode for every policy, so that --against compares in pairs.

    For example:

        $ planarm evaluate apf --env ObstacleDodge-v0 --episodes 1000
        $ planarm evaluate runs/mine --against dpct apf
        $ planarm evaluate dpct+adaptive --env ConveyorTrack-v0 --against dpct --settings payload=0.3
        $ planarm evaluate model.zip --env ConveyorTrack-v0 --settings control_mode=jerk --allow-code
    """

    policy: tyro.conf.Positional[str]
    """Name of an expert, with +adaptive to estimate the payload; agent for the one that comes with planarm; or the path
    of a run, an agent or a .zip."""
    env: str | None = None
    """Id of the environment; may be left out for planarm's own agents, whose files name it."""
    episodes: int = 100
    """How many."""
    seed: int = 0
    """Seed of the first episode; each further episode has the next."""
    against: tuple[str, ...] = ()
    """Policies to compare with, on the same episodes."""
    settings: tuple[str, ...] = ()
    """key=value for each setting of the environment to change from its default."""
    num_envs: int = 256
    """Episodes that run at once."""
    json: Path | None = None
    """Write every episode, with versions and seeds, to this file."""
    allow_code: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load a Stable-Baselines3 .zip although any code in it is run."""

    def resolve(self) -> Benchmark:
        """The evaluation as a benchmark of one task."""
        env_id = self._env_id()
        settings = {
            "episodes": self.episodes,
            "bound_episodes": 0,
            "seed": self.seed,
            "num_envs": self.num_envs,
            "policies": tuple(dict.fromkeys((self.policy, *self.against))),
            "tasks": [{"env": env_id, "env_config": assigned({}, self.settings)}],
        }
        config = BenchmarkConfig.parse(settings, "evaluation setting")
        name = find_policy(self.policy, env_id, allow_code=self.allow_code).name
        return Benchmark(config, compared=(name,), allow_code=self.allow_code)

    def _env_id(self) -> str:
        if self.env is not None:
            envs.task_card(self.env)  # raises for an unknown id
            return self.env
        if is_expert(self.policy) or self.policy == SHIPPED or self.policy.endswith(".zip"):
            raise ValueError(f"no environment: give --env, one of {', '.join(envs.env_ids())}")
        return load_agent(self.policy).env_id


def run(options: EvaluateOptions) -> int:
    """Evaluate and print; the exit code."""
    return run_and_print(options.resolve(), options.json)
