"""A Ray cluster of two nodes on this machine, one of which is killed: ``pytest -m cluster``."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.cluster

RECIPE = """\
env: MinTorqueMove-v0
env_config: {horizon: 0.5}
total_steps: 4000
num_envs: 4
rollout_steps: 10
batch_size: 40
epochs: 1
hidden: [8]
checkpoint_steps: 80
evaluation_episodes: 3
baselines: []
"""


@contextmanager
def two_nodes() -> Iterator[tuple[str, Callable[[], None]]]:
    """The address of a cluster whose second node has the processors, and what kills that and starts another."""
    from agents.cluster import load_ray

    load_ray()
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    second = cluster.add_node(num_cpus=1)

    def kill() -> None:
        cluster.remove_node(second, allow_graceful=False)
        cluster.add_node(num_cpus=1)

    try:
        yield cluster.address, kill
    finally:
        cluster.shutdown()


def planarm(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "planarm", *arguments]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def finish(process: subprocess.Popen[str]) -> str:
    with process:
        try:
            printed, _ = process.communicate(timeout=400)
        finally:
            process.kill()  # if it takes too long
    assert process.returncode == 0, printed
    return printed


def wait_for(condition: Callable[[], bool], process: subprocess.Popen[str], seconds: float = 200.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < end
        time.sleep(0.05)


def without_times(value: Any) -> Any:
    if isinstance(value, dict):
        times = ("_seconds", "_ms", "_us")
        kept = {name: item for name, item in value.items() if not name.endswith(times)}
        return {name: without_times(item) for name, item in kept.items() if name not in ("command", "started")}
    return [without_times(item) for item in value] if isinstance(value, list) else value


def test_a_sweep_loses_nothing_with_a_node_or_its_head(tmp_path: Path) -> None:
    (tmp_path / "tiny.yaml").write_text(RECIPE)
    trials = tmp_path / "sweep" / "trials"
    with two_nodes() as (address, kill):
        over = ("--over", "seed=0..1", "--address", address, "--out", "sweep")
        process = planarm(tmp_path, "sweep", "tiny.yaml", *over)
        wait_for(lambda: len(list(trials.glob("*/checkpoint.pt"))) == 2, process)
        kill()
        wait_for(lambda: 'workers_lost": 1' in (tmp_path / "sweep" / "results.json").read_text(), process)
        process.kill()  # as if the machine of the command, the head, were lost
        process.communicate()
    with two_nodes() as (address, _):
        finish(planarm(tmp_path, "sweep", "--resume", "sweep", "--address", address))
    for seed in (0, 1):
        alone = f"alone-{seed}"
        finish(planarm(tmp_path, "train", "tiny.yaml", "--seed", str(seed), "--out", alone))
        for name in ("last.safetensors", "best.safetensors"):
            weights = (trials / f"{seed}-seed={seed}" / name).read_bytes()
            assert weights == (tmp_path / alone / name).read_bytes()


def test_a_benchmark_loses_nothing_with_a_node(tmp_path: Path) -> None:
    arguments = ["benchmark", "--episodes", "60", "--bound-episodes", "20", "--num-envs", "3", "--replays", "2"]
    arguments += ["--tasks", "ConveyorTrack-v0", "MinTorqueMove-v0", "--json"]
    finish(planarm(tmp_path, *arguments, "one.json"))
    with two_nodes() as (address, kill):
        process = planarm(tmp_path, *arguments, "many.json", "--address", address)
        time.sleep(float(os.environ.get("PLANARM_KILL_AFTER", "12")))  # in mid-benchmark
        assert process.poll() is None
        kill()
        finish(process)
    one, many = (json.loads((tmp_path / name).read_text()) for name in ("one.json", "many.json"))
    assert without_times(many) == without_times(one)
