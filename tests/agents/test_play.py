"""What `planarm play` plays: sessions driven by messages, without a browser."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents.play.actor import YOU
from agents.play.session import Choice, Message, Session, catalogue

TASKS = ("ConveyorTrack-v0", "ExcavatorPayload-v0", "MinTorqueMove-v0", "ObstacleDodge-v0")


@pytest.fixture
def session() -> Iterator[Session]:
    made = Session()
    yield made
    made.close()


def chosen(session: Session, env: str, *policies: str, **more: Any) -> dict[str, Any]:
    described = session.take(Message(do="choose", choice=Choice(env=env, policies=policies, **more)))
    assert described is not None
    return described


def played(session: Session, seconds: float) -> list[dict[str, Any]]:
    for _ in range(round(seconds / 0.05)):
        session.advance(0.05)
    policies = json.loads(json.dumps(session.frame(), allow_nan=False))["policies"]
    assert isinstance(policies, list)
    return policies


def hand(policy: dict[str, Any]) -> Any:
    return np.array(policy["scene"]["joints"][-1])


@pytest.mark.parametrize("env", TASKS)
def test_every_policy_of_every_task_plays(session: Session, env: str) -> None:
    (task,) = [each for each in catalogue() if each["env"] == env]
    for first in range(0, len(task["policies"]), 3):
        names = task["policies"][first : first + 3]
        chosen(session, env, *names)
        for policy, name in zip(played(session, 0.3), names, strict=True):
            assert policy["name"] == name
            assert policy["ended"] or policy["scene"]["time"] == pytest.approx(0.3)


def test_an_undisturbed_episode_ends_as_elsewhere(session: Session) -> None:
    chosen(session, "ConveyorTrack-v0", "dpct", "follower")
    dpct, follower = played(session, 3.1)
    assert (dpct["success"], follower["success"]) == (True, False)
    assert dpct["outcome"] == "settled at 1.72 s"


@pytest.mark.parametrize(
    ("env", "name", "digits"),
    [
        ("ConveyorTrack-v0", "dpct", r"\d\.\d\d s"),
        ("ExcavatorPayload-v0", "kalman", r"\d\.\d mm"),
        ("MinTorqueMove-v0", "lagrange", r"\d+ %"),
        ("ObstacleDodge-v0", "apf", r"\d\.\d\d s"),
    ],
)
def test_the_best_known_value_is_written_as_the_verdict(session: Session, env: str, name: str, digits: str) -> None:
    chosen(session, env, name)
    bound = session.best_known()
    assert bound is not None
    assert re.fullmatch(f"best known {digits}", bound())
    (policy,) = played(session, 20.0)
    assert policy["ended"]
    assert re.search(digits, policy["outcome"])


@pytest.mark.parametrize("name", ["lagrange", "follower"])
def test_a_part_that_is_dragged_is_followed(session: Session, name: str) -> None:
    chosen(session, "ConveyorTrack-v0", name)
    played(session, 1.0)
    session.take(Message(do="change", key="part", point=(0.2, 1.6)))
    (policy,) = played(session, 2.9)
    assert policy["changed"]
    assert np.hypot(*(hand(policy) - policy["points"]["part"][0])) < 2e-3


def test_dpct_says_why_it_has_no_motion(session: Session) -> None:
    chosen(session, "ConveyorTrack-v0", "dpct")
    played(session, 1.0)
    session.take(Message(do="change", key="part", point=(0.2, 1.4)))
    (policy,) = played(session, 0.2)
    assert "for a motion within the limits" in policy["refusal"]


def test_the_belt_changes_its_speed(session: Session) -> None:
    chosen(session, "ConveyorTrack-v0", "apf")
    played(session, 0.5)
    session.take(Message(do="change", key="belt_speed", number=-0.1))
    (before,) = played(session, 0.0)
    (after,) = played(session, 1.0)
    assert after["points"]["part"][0][0] - before["points"]["part"][0][0] == pytest.approx(-0.1, abs=1e-3)


@pytest.mark.parametrize("name", ["lagrange", "dpct", "agent"])
def test_a_new_goal_begins_a_new_move_from_rest(session: Session, name: str) -> None:
    chosen(session, "MinTorqueMove-v0", name)
    played(session, 0.1)
    session.take(Message(do="change", key="goal", point=(-0.4, 0.4)))
    (policy,) = played(session, 4.0)
    assert policy["ended"]
    assert policy["success"]
    np.testing.assert_allclose(hand(policy), [-0.4, 0.4], atol=0.02)


def test_a_goal_out_of_reach_is_refused_and_the_episode_goes_on(session: Session) -> None:
    chosen(session, "MinTorqueMove-v0", "lagrange")
    with pytest.raises(ValueError, match="cannot be at"):
        session.take(Message(do="change", key="goal", point=(5.0, 0.0)))
    (policy,) = played(session, 2.0)
    assert policy["success"]


def test_a_goal_out_of_reach_is_refused_by_all_while_the_arms_move(session: Session) -> None:
    chosen(session, "MinTorqueMove-v0", "lagrange", "apf", "dpct")
    before = played(session, 0.1)
    with pytest.raises(ValueError, match="cannot be at"):
        session.take(Message(do="change", key="goal", point=(-5.0, 3.0)))
    assert [policy["changed"] for policy in before] == [policy["changed"] for policy in played(session, 0.0)]
    after = played(session, 0.1)
    assert [policy["scene"]["time"] for policy in after] == [pytest.approx(0.2)] * 3
    assert [policy["success"] for policy in played(session, 3.0)] == [True] * 3


def test_discs_and_goals_move_and_the_fields_answer(session: Session) -> None:
    chosen(session, "ObstacleDodge-v0", "apf")
    played(session, 0.3)
    session.take(Message(do="change", key="disc", point=(0.9, 0.9)))
    session.take(Message(do="change", key="goal", point=(-0.5, -0.5)))
    session.take(Message(do="change", key="radius", number=0.05))
    (policy,) = played(session, 0.0)
    np.testing.assert_allclose(policy["points"]["disc"], [[0.9, 0.9]], atol=1e-3)
    (policy,) = played(session, 4.0)
    assert policy["success"]
    assert policy["scene"]["obstacles"][0][2] == 0.05
    np.testing.assert_allclose(hand(policy), [-0.5, -0.5], atol=0.03)


@pytest.mark.parametrize(("env", "name"), [("ConveyorTrack-v0", "apf"), ("MinTorqueMove-v0", "lagrange")])
def test_the_payload_changes_while_the_arm_moves(session: Session, env: str, name: str) -> None:
    described = chosen(session, env, name)
    (control,) = [each for each in described["controls"] if each["key"] == "payload"]
    (before,) = played(session, 0.3)
    session.take(Message(do="change", key="payload", number=0.9 * control["span"][1]))
    (after,) = played(session, 0.0)
    assert after["scene"]["joints"] == before["scene"]["joints"]
    assert (before["numbers"]["payload"], after["numbers"]["payload"]) == (0.0, 0.9 * control["span"][1])
    session.take(Message(do="change", key="payload", number=0.0))
    (loaded,) = played(session, 0.2)
    assert loaded["scene"]["time"] == pytest.approx(0.5)
    with pytest.raises(ValueError, match="must be from 0 to"):
        session.take(Message(do="change", key="payload", number=9.0))


def test_a_payload_makes_the_arm_miss(session: Session) -> None:
    chosen(session, "MinTorqueMove-v0", "lagrange")
    session.take(Message(do="change", key="payload", number=0.45))
    (policy,) = played(session, 4.0)
    assert policy["ended"]
    assert not policy["success"]


def test_the_bucket_is_filled_while_it_moves(session: Session) -> None:
    chosen(session, "ExcavatorPayload-v0", "adaptive")
    played(session, 1.0)
    session.take(Message(do="change", key="payload", number=321.0))
    (policy,) = played(session, 0.1)
    assert policy["scene"]["bucket"] == pytest.approx(321.0 / 350.0, abs=1e-3)


def test_the_hand_follows_the_mouse(session: Session) -> None:
    chosen(session, "ObstacleDodge-v0", YOU)
    session.take(Message(do="change", key="disc", point=(1.2, 1.2)))
    session.take(Message(do="mouse", point=(0.3, -0.6)))
    (policy,) = played(session, 2.0)
    np.testing.assert_allclose(hand(policy), [0.3, -0.6], atol=0.02)


def test_time_can_be_stopped_stepped_and_slowed(session: Session) -> None:
    chosen(session, "ConveyorTrack-v0", "follower")
    session.take(Message(do="pause"))
    assert played(session, 1.0)[0]["scene"]["time"] == 0.0
    session.take(Message(do="step"))
    assert played(session, 1.0)[0]["scene"]["time"] == 0.02
    session.take(Message(do="run"))
    session.take(Message(do="speed", number=0.5))
    assert played(session, 1.0)[0]["scene"]["time"] == pytest.approx(0.52)


def test_a_level_is_that_of_its_own_task() -> None:
    made = Session(levels={"ObstacleDodge-v0": "fast"})
    try:
        for env in ("ObstacleDodge-v0", "ConveyorTrack-v0"):
            chosen(made, env, "apf")
        (played_now,) = made._played
        assert played_now.task.env_id == "ConveyorTrack-v0"
    finally:
        made.close()


def test_what_cannot_be_chosen_leaves_the_old_episode(session: Session) -> None:
    chosen(session, "ConveyorTrack-v0", "follower")
    for wrong in (
        Choice(env="ConveyorTrack-v1", policies=("dpct",)),
        Choice(env="ConveyorTrack-v0", policies=("nobody",)),
        Choice(env="ExcavatorPayload-v0", policies=("adaptive",), arm="SCARA_1M"),
        Choice(env="ConveyorTrack-v0", policies=("dpct",), scenario="cycle"),
    ):
        with pytest.raises(ValueError, match=r"\w"):
            session.take(Message(do="choose", choice=wrong))
    assert played(session, 0.5)[0]["scene"]["time"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("env", "other", "complaint"),
    [
        (("ConveyorTrack-v0", {}), ("ConveyorTrack-v0", {"horizon": 4.0}), "more than the payload"),
        (("ConveyorTrack-v0", {}), ("MinTorqueMove-v0", {}), "another task"),
        (("ExcavatorPayload-v0", {}), ("ExcavatorPayload-v0", {}), "a machine of its own"),
    ],
)
def test_episodes_that_do_not_fit_are_not_taken_over(env: Any, other: Any, complaint: str) -> None:
    tasks: list[Any] = [gym.make(name, **settings).unwrapped for name, settings in (env, other)]
    with pytest.raises(ValueError, match=complaint):
        tasks[0].task.take_over(tasks[1].task)


@pytest.mark.skipif(os.name != "posix", reason="sends the signals of a shell")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_the_command_with_its_exit_code(number: signal.Signals, code: int) -> None:
    command = [sys.executable, "-m", "planarm", "play", "MinTorqueMove-v0", "--policies", "follower", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        assert server.stdout.readline().startswith("playing at ")
        server.send_signal(number)
        _, said = server.communicate(timeout=20)
    assert server.returncode == code
    assert "Traceback" not in said
