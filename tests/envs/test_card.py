"""Cards declare what environments do, and a user's own package registers a task with its card."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from envs.card import TaskCard
from envs.conveyor_track.env import ConveyorTrack
from envs.experts import expert_names, is_expert

ROOT = Path(__file__).parents[2]

every_env = pytest.mark.parametrize("env_id", envs.env_ids())

USERS_TASK = '''
import math
import sys
from typing import Any

import numpy as np
from numba import njit

import envs
from envs.card import Metric, Picture, TaskCard
from envs.experts import PlanningExpert
from envs.observation import Entry, Layout
from envs.physics.actuation import apply_action
from envs.physics.episode import begin_episode, finish_observation, sum_reward
from envs.settings import Settings
from envs.task import Task, TaskSettings
from planners import SCARA_1M, FixedJoints, MotionProblem, quintic


@njit
def reset_env(batch, model, index):
    env, shared = batch[index], model[0]
    begin_episode(env, shared)
    observe(env, shared)


@njit
def advance_batch(batch, model, first, last):
    shared = model[0]
    for index in range(first, last):
        env = batch[index]
        apply_action(env, shared, env.action)
        env.step += 1
        observe(env, shared)
        env.truncated = env.step >= shared.horizon_steps
        env.success = env.truncated and env.error <= shared.tolerance
        env.reward_terms[0] = -env.error * shared.control_period
        sum_reward(env)


@njit
def observe(env, shared):
    seen = env.seen
    env.error = 0.0
    for i in range(2):
        env.error = max(env.error, abs(env.goal[i] - env.q[i]))
    seen.joint_position[:] = env.q
    seen.joint_velocity[:] = env.qd
    seen.joint_acceleration[:] = env.qdd
    seen.goal[:] = env.goal
    seen.time_left = (shared.horizon_steps - env.step) * shared.control_period
    finish_observation(env, shared)


class Config(TaskSettings):
    """Settings.

    Attributes:
        tolerance: largest error of a joint angle at the end that counts as success, rad.
    """

    tolerance: float = 0.01


class Reach(Task):
    env_id = "UserReach-v0"
    config_type = Config
    options_type = Settings
    kernels = sys.modules[__name__]
    layout = Layout(
        (
            Entry("joint_position", (2,), math.pi, 4.0, "rad", "angles"),
            Entry("joint_velocity", (2,), 1.0, 20.0, "rad/s", "velocities"),
            Entry("joint_acceleration", (2,), 1.0, 100.0, "rad/s^2", "accelerations"),
            Entry("goal", (2,), math.pi, 4.0, "rad", "angles to reach"),
            Entry("time_left", (), 1.0, 60.0, "s", "until the end"),
        )
    )
    reward_terms = ("error",)
    gauges = ("torque",)
    view = (-1.2, 1.2, -1.2, 1.2)

    def __init__(self, config: Config, num_envs: int) -> None:
        super().__init__(config, SCARA_1M, num_envs, [("goal", "f8", (2,)), ("error", "f8")], {})

    def draw(self, generators: Any, options: Any) -> list[Any]:
        return [generator.uniform(-1.0, 1.0, 2) for generator in generators]

    def write_start(self, env_index: int, start: Any) -> None:
        self.batch[env_index]["q"], self.batch[env_index]["goal"] = 0.5, 0.5 + 0.3 * start

    def outcome(self, record: Any) -> dict[str, Any]:
        return {"angle_error": float(record["error"])}

    def motion_problem(self, observation: Any) -> MotionProblem:
        seen = self.layout.parse(observation)
        return self._problem(seen, FixedJoints(seen["goal"]))

    def picture(self, record: Any) -> dict[str, Any]:
        return {"target": self.arm.forward_kinematics(record["goal"])}


envs.register(
    "UserReach-v0",
    Reach,
    TaskCard(
        metrics=(Metric("angle_error", "error (rad)", primary=True),),
        experts={"quintic": lambda task: PlanningExpert(task, quintic.plan)},
        picture=Picture(
            "error (rad)",
            measure=lambda record: float(record["error"]),
            outcome=lambda info, duration: f"{info['angle_error']:.3f} rad",
            target=lambda task, record: task.arm.forward_kinematics(record["goal"]),
        ),
    ),
)
'''

USE = """
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np

if __name__ == "__main__":
    env = gym.make("reach_task:UserReach-v0", render_mode="rgb_array")
    import agents
    import envs
    from agents.commands.rollout import RolloutOptions, run

    assert not [name for name in sys.modules if name.startswith("envs.conveyor_track")]
    expert = envs.make_expert("quintic", env)
    observation, _ = env.reset(seed=0)
    assert env.action_space.contains(expert.predict(observation)[0])
    assert env.render().ndim == 3
    vector = gym.make_vec("UserReach-v0", num_envs=3)
    np.testing.assert_array_equal(vector.reset(seed=0)[0][0], observation)
    workers = gym.vector.AsyncVectorEnv([lambda: gym.make("reach_task:UserReach-v0")], context="spawn")
    np.testing.assert_array_equal(workers.reset(seed=0)[0][0], observation)
    workers.close()
    evaluation = agents.evaluate("quintic", "UserReach-v0", range(4))
    assert evaluation.success.all() and (evaluation.metrics["angle_error"] < 0.01).all()
    assert not agents.evaluate("random", "UserReach-v0", range(4)).success.any()
    assert run(RolloutOptions(env="UserReach-v0", policy="quintic", record=Path("last.png"))) == 0
"""

TRAIN = """
from pathlib import Path

import reach_task

import agents
from agents.training.recipe import TrainingConfig
from agents.training.run import TrainingRun

small = {"total_steps": 800, "num_envs": 4, "rollout_steps": 50, "batch_size": 100, "evaluation_episodes": 2}
run = TrainingRun.begin(Path("run"), TrainingConfig.parse({"env": "UserReach-v0", **small}, "setting"), "a test")
run.train()
assert run.state.rows[-1]["expert"] == "quintic"
agent = agents.load_agent("run")
assert agents.evaluate(agent, "UserReach-v0", range(2)).lengths.all()
"""


def in_a_users_folder(folder: Path, program: str) -> None:
    """Run a program beside a user's own task, in a process of its own, outside the repository."""
    (folder / "reach_task.py").write_text(USERS_TASK)
    (folder / "use.py").write_text(program)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(folder)])}
    done = subprocess.run([sys.executable, "use.py"], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_users_package_brings_its_own_task(tmp_path: Path) -> None:
    in_a_users_folder(tmp_path, USE)
    assert (tmp_path / "last.png").stat().st_size > 0


@pytest.mark.rl
def test_an_agent_is_trained_for_a_users_task_beside_its_experts(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')
    in_a_users_folder(tmp_path, TRAIN)


@every_env
def test_an_episode_has_what_the_card_declares(env_id: str) -> None:
    card, env = envs.task_card(env_id), gym.make(env_id)
    names = {entry.name for entry in env.unwrapped.task.layout.entries}  # type: ignore[attr-defined]
    assert card.constant_entries <= names
    env.reset(seed=0)
    info: dict[str, Any] = {}
    while not info.keys() >= {"limit_ratio"}:
        info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))[-1]
    assert {metric.key for metric in card.metrics} <= info.keys()
    assert [metric for metric in card.metrics if metric.primary] == [card.primary]
    assert card.bound is None or card.bound.metric in info
    assert card.picture is not None
    task: Any = env.unwrapped.task  # type: ignore[attr-defined]
    assert np.shape(card.picture.target(task, task.batch[0])) == (2,)
    assert np.isfinite(card.picture.measure(task.batch[0]))
    assert isinstance(card.picture.outcome(info, 1.0), str)


@every_env
def test_the_first_control_mode_is_the_default(env_id: str) -> None:
    task: Any = gym.make(env_id).unwrapped.task  # type: ignore[attr-defined]
    assert envs.task_card(env_id).control_modes[0] == task.config.control_mode


def test_an_unknown_task_is_refused_with_the_nearest_id() -> None:
    with pytest.raises(ValueError, match='unknown environment "ConveyorTrak-v0"; did you mean "ConveyorTrack-v0"'):
        envs.task_card("ConveyorTrak-v0")


def test_a_task_is_registered_under_its_own_id() -> None:
    with pytest.raises(ValueError, match=r"ConveyorTrack\.env_id is 'ConveyorTrack-v0', not 'Belt-v0'"):
        envs.register("Belt-v0", ConveyorTrack, TaskCard((), {}))
    assert "Belt-v0" not in envs.env_ids()


def test_experts_are_those_of_the_cards() -> None:
    assert expert_names("ObstacleDodge-v0") == ["dpct", "lagrange", "apf", "follower", "random"]
    assert "dpct" not in expert_names("ExcavatorPayload-v0")
    assert is_expert("adaptive")
    assert not is_expert("agent")


def test_importing_envs_loads_no_card() -> None:
    code = "import sys, envs; print([name for name in sys.modules if name.startswith(('envs.experts', 'planners'))])"
    assert subprocess.check_output([sys.executable, "-c", code], cwd=ROOT, text=True) == "[]\n"
