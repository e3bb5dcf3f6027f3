"""How much is compiled before the first step of an environment, and what tasks share."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

import envs  # noqa: F401

COUNTED = """
from numba.core import event

class Counter(event.Listener):
    count = 0
    def on_start(self, one): self.count += 1
    def on_end(self, one): pass

counter = Counter()
event.register("numba:compile", counter)
import envs, gymnasium as gym
env = gym.make("ConveyorTrack-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
print(counter.count)
env.step(env.action_space.sample())
env.reset(seed=1)
print(counter.count)
"""


def test_few_functions_are_compiled_before_the_first_step(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "-c", COUNTED]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    first, later = map(int, done.stdout.split())
    assert 10 < first <= 26
    assert later == first


def kernels(env_id: str, **settings: Any) -> dict[str, int]:
    model = gym.make(env_id, **settings).unwrapped.task._batch.model  # type: ignore[attr-defined]
    return {name: int(model[name][0]) for name in model.dtype.names if name.endswith("_kernel")}


def test_tasks_with_as_many_joints_share_the_kernels_of_the_arm() -> None:
    conveyor, dodge = kernels("ConveyorTrack-v0"), kernels("ObstacleDodge-v0")
    own = conveyor.pop("relative_kernel"), dodge.pop("second_arm_kernel")
    assert own == (0, 0)
    assert dodge == conveyor
    unused = {"delay_kernel", "friction_kernel", "measure_kernel", "physics_kernel"}
    assert {name for name, address in conveyor.items() if not address} == unused
    move = kernels("MinTorqueMove-v0")
    assert set(conveyor.values()) & set(move.values()) == {0}
    assert move["finish_kernel"] == kernels("ExcavatorPayload-v0")["finish_kernel"]


@pytest.mark.parametrize("mode", ["acceleration", "jerk"])
def test_a_control_mode_has_a_command_of_its_own(mode: str) -> None:
    torque, other = kernels("ConveyorTrack-v0"), kernels("ConveyorTrack-v0", control_mode=mode)
    assert {name for name in torque if torque[name] != other[name]} == {"command_kernel"}


def test_one_environment_compiles_the_kind_of_path_that_it_draws_and_a_batch_both() -> None:
    def compiled(task: Any) -> set[str]:
        numbers = task._starts._numbers
        return {name for name in ("legs_kernel", "wander_kernel") if numbers[name][0]}

    env, batch = gym.make("ObstacleDodge-v0"), gym.make_vec("ObstacleDodge-v0", 2)
    env.reset(seed=0, options={"obstacle_kind": "wander"})
    assert compiled(env.unwrapped.task) == {"wander_kernel"}  # type: ignore[attr-defined]
    env.reset(options={"obstacle_kind": "passes"})
    batch.reset(seed=0, options={"obstacle_kind": "wander"})
    both = {"legs_kernel", "wander_kernel"}
    assert compiled(env.unwrapped.task) == compiled(batch.unwrapped.task) == both  # type: ignore[attr-defined]


def test_addresses_are_not_public() -> None:
    task = gym.make("ConveyorTrack-v0").unwrapped.task  # type: ignore[attr-defined]
    assert not [name for name in task.model.dtype.names if name.endswith("_kernel")]
    assert not {"space", "links", "table"} & set(task.batch.dtype.names)
