"""What DPCT refuses to plan, and what it says then."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from dpct_cases import HAND, conveyor

from planners import PLANAR_3R, SCARA_1M, FixedHand, FixedJoints, Infeasible, MotionProblem, MovingHand, dpct
from planners.motion.line import reduce_to_line
from planners.motion.rides import ride_windows


def refusal(problem: MotionProblem, **options: Any) -> Infeasible:
    with pytest.raises(Infeasible) as caught:
        dpct.plan(problem, **options)
    return caught.value


def test_too_fast_a_belt_names_the_limit() -> None:
    limits = replace(SCARA_1M.limits, velocity=(0.05, 0.05))
    answer = refusal(conveyor(speed=0.2, limits=limits, horizon=5.0))
    assert answer.reason == "no_window"
    assert f"joint {answer.details['joint'] + 1} follows" in answer.message
    ratio = answer.details["ratio"]
    for factor, rides in ((1.001, True), (0.999, False)):  # of the limits that just allow the ride at its easiest
        raised = replace(limits, velocity=(factor * ratio * 0.05,) * 2)
        windows = ride_windows(reduce_to_line(conveyor(speed=0.2, limits=raised, horizon=5.0)))
        assert any(window.opens < 5.0 for window in windows) == rides


def test_lateness_gives_the_time_there_was() -> None:
    answer = refusal(conveyor(lead=-0.2, speed=0.1, horizon=2.0))
    assert answer.reason == "late"
    assert answer.details["closes"] == 2.0
    assert "2 s" in answer.message
    assert dpct.plan(conveyor(lead=-0.2, speed=0.1, horizon=3.0)).rendezvous_time > 2.0
    assert "at 1 s" in refusal(conveyor(), rendezvous_time=1.0).message


def test_windows_that_miss_the_time_asked_for() -> None:
    problem = conveyor(lead=0.0, horizon=6.0)
    opens = ride_windows(reduce_to_line(problem))[0].opens
    assert opens > 0.1
    answer = refusal(problem, rendezvous_time=0.5 * opens)
    assert answer.reason == "no_window"
    assert refusal(replace(problem, horizon=0.5 * opens)).reason == "no_window"


@pytest.mark.parametrize(
    ("problem", "reason", "message"),
    [
        (replace(conveyor(), target=MovingHand(HAND + np.array([0.0, 0.03]), [0.2, 0.0])), "start", "0.03 m beside"),
        (conveyor(qd=np.array([0.1, 0.0])), "start", "across the line"),
        (replace(conveyor(), target=MovingHand(HAND, [0.2, 0.0], [0.0, 0.1])), "unreachable", "straight motions"),
        (replace(conveyor(), target=MovingHand(HAND + np.array([4.0, 0.0]), [0.2, 0.0])), "unreachable", "never"),
        (replace(conveyor(), target=FixedHand(HAND + np.array([2.5, 0.0]))), "unreachable", "leaves the reach"),
        (replace(conveyor(), target=FixedJoints([0.0, 1.0]), qd=np.array([0.0, 0.1])), "start", "straight joint path"),
    ],
)
def test_other_refusals(problem: MotionProblem, reason: str, message: str) -> None:
    answer = refusal(problem)
    assert answer.reason == reason
    assert message in answer.message


def test_a_start_beyond_the_limits_is_refused() -> None:
    problem = conveyor()
    jacobian = SCARA_1M.jacobian(problem.q)
    fast = replace(problem, qd=np.linalg.solve(jacobian, [0.5, 0.0]))
    assert refusal(fast).reason == "start"


def test_a_weight_that_cannot_be_held_is_refused() -> None:
    arm = replace(PLANAR_3R, gravity=9.81)
    weak = replace(arm.limits, torque=(1.0, 1.0, 1.0))
    start = np.array([0.5 * np.pi, 0.0, 0.0])  # upright, no torque needed
    answer = refusal(MotionProblem(arm, start, FixedJoints([0.0, 0.0, 0.0]), 3.0, limits=weak))
    assert answer.reason == "limits"


def test_a_joint_angle_limit_ends_the_line() -> None:
    start = np.array([0.3, 0.9])
    limits = replace(SCARA_1M.limits, angle=(0.6, np.inf))
    answer = refusal(MotionProblem(SCARA_1M, start, FixedJoints([0.8, 0.9]), 6.0, limits=limits))
    assert answer.reason == "limits"
    plan = dpct.plan(MotionProblem(SCARA_1M, start, FixedJoints([0.55, 0.9]), 6.0, limits=limits))
    assert 0.9 < plan.limit_ratios["angle"] <= 1.0


@pytest.mark.parametrize(
    "options",
    [
        {"variant": "best"},
        {"speed": 1.0},
        {"elbow": "up"},
        {"rendezvous_time": 4.0},
        {"time_weight": -1.0},
        {"stages": 3},
    ],
)
def test_unknown_or_impossible_options_are_named(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=str(next(iter(options)))):
        dpct.plan(conveyor(), **options)
