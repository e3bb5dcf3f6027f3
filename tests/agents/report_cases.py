"""Results of small and of large benchmarks, for the tests of reports."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from agents.evaluation.benchmark import Benchmark
from agents.evaluation.benchmark_config import BenchmarkConfig, configure
from planners.files import json_text

HOSTILE = "</script><script>document.title='taken'</script>mk[/b]$x_1&\"'"


class Still:
    """A policy that does nothing."""

    def predict(self, observation: Any, **kwargs: Any) -> tuple[Any, None]:
        return np.zeros((len(observation), 2)), None


def small_benchmark() -> dict[str, Any]:
    """Scores and replays of three policies on two tasks, as they are in a file of results."""
    settings = {
        "episodes": 6,
        "bound_episodes": 4,
        "num_envs": 8,
        "replays": 3,
        "policies": ["apf", HOSTILE, "random"],
        "tasks": [{"env": "ConveyorTrack-v0", "env_config": {"payload": 0.1}}, {"env": "ObstacleDodge-v0"}],
    }
    benchmark = Benchmark(BenchmarkConfig.parse(settings, "test"), given={HOSTILE: Still()})
    benchmark.fill(lambda text: None, lambda count: None)
    benchmark.record(lambda text: None, lambda count: None)
    made: dict[str, Any] = json.loads(json_text({"command": "planarm test", **benchmark.board.document()}))
    return made


def as_large_as_the_default(scored: dict[str, Any]) -> dict[str, Any]:
    """Results of the default benchmark's size, with random numbers, which cannot be compressed."""
    config, random = configure("benchmark", {}), np.random.default_rng(0)
    tasks = []
    for number, task in enumerate(config.tasks):
        source = scored["results"][number % 2]
        names = list(task.policies or config.policies)
        count = task.episodes or config.episodes
        replays = {**source["replays"], "seeds": list(range(min(count, config.replays))), "episodes": []}
        policies = []
        for name in names:
            scores = source["policies"][0]
            columns = {key: random.normal(size=count).tolist() for key in scores["episodes"]}
            columns |= {"seed": list(range(count)), "length": [150] * count, "is_success": [True] * count}
            policies.append({**scores, "policy": name, "episodes": columns})
            for seed in replays["seeds"]:
                replays["episodes"].append(_noise(source["replays"]["episodes"][0], name, seed, random))
        pairs = [{**source["pairs"][0], "policy": names[0], "against": name} for name in names[1:]]
        tasks.append({**source, "task": task.title, "policies": policies, "pairs": pairs, "replays": replays})
    return {**scored, "results": tasks}


def _noise(replay: dict[str, Any], name: str, seed: int, random: np.random.Generator) -> dict[str, Any]:
    """A replay with as many frames as there may be, all of whose numbers are noise."""
    frames = 150
    numbers = {path: " ".join(map(str, random.integers(-40, 40, frames))) for path in replay["numbers"]}
    texts = {path: "\n".join(f"{value:.2f} mm" for value in random.normal(size=frames)) for path in replay["texts"]}
    return {**replay, "policy": name, "seed": seed, "frames": frames, "numbers": numbers, "texts": texts}
