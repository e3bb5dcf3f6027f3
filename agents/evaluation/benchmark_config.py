"""What a benchmark runs: the settings of ``configs/benchmark.yaml``."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from envs.settings import Settings


class Published(Settings):
    """A published result, for its own row of the leaderboard.

    Attributes:
        source: where it was published.
        settling_time: s.
        note: differences that matter for the comparison.
    """

    source: str
    settling_time: float = Field(gt=0.0)
    note: str = ""


class BenchmarkTask(Settings):
    """One task of a benchmark.

    Attributes:
        env: id of the environment.
        name: title in the leaderboard; the id when left out.
        env_config: settings of the environment.
        options: of each reset.
        policies: those of this task, if not those of the benchmark.
        episodes: number of episodes, if not that of the benchmark.
        bound_episodes: number of episodes whose bound is computed, if not that of the benchmark.
        published: a figure from a paper, for its own row.
    """

    env: str
    name: str = ""
    env_config: dict[str, Any] = Field(default_factory=dict)
    options: dict[str, Any] = Field(default_factory=dict)
    policies: tuple[str, ...] | None = Field(None, min_length=1)
    episodes: int | None = Field(None, ge=1)
    bound_episodes: int | None = Field(None, ge=0)
    published: Published | None = None

    @property
    def title(self) -> str:
        """Its title in the leaderboard."""
        return self.name or self.env


class BenchmarkConfig(Settings):
    """A benchmark: every policy on every task, on the same seeds.

    Attributes:
        episodes: of each policy on each task.
        bound_episodes: number of episodes whose bound is computed.
        seed: of the first episode; each further episode has the next.
        num_envs: episodes that run at once.
        policies: names of experts, ``agent`` for the agent shipped for the environment, paths of runs and agents.
        tasks: on which they act.
    """

    episodes: int = Field(ge=1)
    bound_episodes: int = Field(ge=0)
    seed: int = Field(0, ge=0)
    num_envs: int = Field(256, ge=1)
    policies: tuple[str, ...] = Field(min_length=1)
    tasks: tuple[BenchmarkTask, ...] = Field(min_length=1)
