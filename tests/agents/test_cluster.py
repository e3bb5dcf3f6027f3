"""A Ray cluster of two nodes on this machine, one of which is killed: ``pytest -m cluster``."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.cluster

RECIPE = """\
env: MinTorqueMove-v0
env_config: {horizon: 0.5}
total_steps: 1600
num_envs: 4
rollout_steps: 10
batch_size: 40
epochs: 1
hidden: [8]
checkpoint_steps: 80
evaluation_episodes: 3
baselines: []
"""


POLICY = """\
import time
from pathlib import Path

import numpy as np
import ray


class Policy:
    made = 0

    def __init__(self, env):
        Policy.made += 1
        self.size = env.action_space.shape[-1]
        doomed = Path("doomed")
        here = ray.get_runtime_context().get_node_id() if ray.is_initialized() else ""
        while Policy.made > 5 and doomed.exists() and doomed.read_text() == here:
            Path("reached").touch()
            time.sleep(0.1)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full((len(observation), self.size), 0.1), state
"""
"""On the doomed node it waits for its end in the middle of a share, after it has finished some."""

LIMIT = 3600.0  # s, against a process that hangs; no machine needs as long


@dataclass
class TwoNodes:
    """A cluster of a head and a second node.

    Attributes:
        address: of the head.
        second: identity of the second node.
        kill: kills the second node with all that runs there, and starts another like it.
    """

    address: str
    second: str
    kill: Callable[[], None]


@contextmanager
def two_nodes(head: int, second: int) -> Iterator[TwoNodes]:
    """A cluster whose nodes have so many processors."""
    from agents.cluster import load_ray

    load_ray()
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": head, "include_dashboard": False})
    node = cluster.add_node(num_cpus=second)

    def kill() -> None:
        cluster.remove_node(node, allow_graceful=False)
        cluster.add_node(num_cpus=second)

    try:
        yield TwoNodes(cluster.address, node.node_id, kill)
    finally:
        cluster.shutdown()


@pytest.fixture(autouse=True)
def _not_behind_everything_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray gives its workers a niceness of 15: beside a busy process they would get next to nothing."""
    monkeypatch.setenv("RAY_worker_niceness", "0")


def planarm(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "planarm", *arguments]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def finish(process: subprocess.Popen[str]) -> str:
    with process:
        try:
            printed, _ = process.communicate(timeout=LIMIT)
        finally:
            process.kill()  # if it takes too long
    assert process.returncode == 0, printed
    return printed


def wait_for(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + LIMIT
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
    with two_nodes(head=0, second=2) as cluster:
        over = ("--over", "seed=0..1", "--address", cluster.address, "--out", "sweep")
        process = planarm(tmp_path, "sweep", "tiny.yaml", *over)
        wait_for(lambda: any(trials.glob("*/checkpoint.pt")), process)
        cluster.kill()
        wait_for(lambda: 'workers_lost": 1' in (tmp_path / "sweep" / "results.json").read_text(), process)
        process.kill()  # as if the machine of the command, the head, were lost
        process.communicate()
    with two_nodes(head=0, second=2) as cluster:
        finish(planarm(tmp_path, "sweep", "--resume", "sweep", "--address", cluster.address))
    for seed in (0, 1):
        alone = f"alone-{seed}"
        finish(planarm(tmp_path, "train", "tiny.yaml", "--seed", str(seed), "--out", alone))
        for name in ("last.safetensors", "best.safetensors"):
            weights = (trials / f"{seed}-seed={seed}" / name).read_bytes()
            assert weights == (tmp_path / alone / name).read_bytes()


def test_a_benchmark_loses_nothing_with_a_node(tmp_path: Path) -> None:
    (tmp_path / "waiting.py").write_text(POLICY)
    arguments = ["benchmark", "--episodes", "60", "--bound-episodes", "20", "--num-envs", "3", "--replays", "2"]
    arguments += ["--tasks", "ConveyorTrack-v0", "MinTorqueMove-v0", "--policies", "waiting:Policy"]
    arguments += ["lagrange", "follower", "agent", "--json"]
    finish(planarm(tmp_path, *arguments, "one.json"))
    with two_nodes(head=1, second=1) as cluster:
        (tmp_path / "doomed").write_text(cluster.second)
        process = planarm(tmp_path, *arguments, "many.json", "--address", cluster.address)
        wait_for((tmp_path / "reached").exists, process)
        cluster.kill()
        finish(process)
    one, many = (json.loads((tmp_path / name).read_text()) for name in ("one.json", "many.json"))
    assert without_times(many) == without_times(one)
