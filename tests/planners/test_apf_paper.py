"""The potential-field paper's planner: potential, joint velocities, and the motions they make."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from planners import PLANAR_3R, SCARA_50CM, FixedHand, FixedJoints, Infeasible, MotionProblem, MovingHand, Obstacle
from planners.apf.distance_table import DistanceTable
from planners.apf.hand_field import HandField, hand_velocity_single, joint_rates_single, make_field
from planners.apf.khatib import NEAREST_SHARE, Gains, make_gains, potential, wall
from planners.apf.paper import follow_field, plan_paper, posture
from planners.robot.kinematics import wrap
from planners.typing import Array

ARM = SCARA_50CM
LENGTHS, BASE = ARM.length_array, ARM.base_array
START, GOAL = np.array([-0.25, 0.9]), np.array([0.65, 0.1])
CROSSING = Obstacle(np.array([1.2, 0.0]), np.array([-0.75, 0.45]), 0.1)

compiled = settings(deadline=None)  # the first example waits for the compiler
positions = st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2)).map(np.array)


def problem(*discs: Obstacle, elbow: int = 0, **changes: Any) -> MotionProblem:
    fields = {"q": ARM.inverse_kinematics(START)[elbow], "target": FixedHand(GOAL), "horizon": 8.0, **changes}
    return MotionProblem(arm=fields.pop("arm", ARM), obstacles=discs, **fields)


def gradient_at(field: HandField, hand: Array, goal: Array, discs: Array, velocities: Array, radii: Array) -> Array:
    velocity = np.empty(2)
    hand_velocity_single(field, hand, np.zeros(2), goal, discs, velocities, radii, velocity)
    return -velocity


def total_potential(gains: Gains, hand: Array, discs: Array, radii: Array, norm: float = 2.0) -> float:
    bowl, walls = potential(gains, hand[None], GOAL, discs, radii, norm)
    return float(bowl[0] + walls[0])


# the potential


@pytest.mark.parametrize("square", [True, False])
def test_wall_is_the_equation(square: bool) -> None:
    gains = make_gains(1.0, 0.004, 0.3, square)
    height = 1.0 / 0.12 - 1.0 / 0.3
    expected = 0.5 * 0.004 * height**2 if square else 0.5 * (2.0 * 0.004 / 0.3) * height
    assert wall(gains, 0.12)[0] == pytest.approx(expected, rel=1e-12)
    assert wall(gains, 0.301)[0] == wall(gains, 0.301)[1] == 0.0


@pytest.mark.parametrize("square", [True, False])
@compiled
@given(hand=positions, discs=st.lists(positions, max_size=3), radius=st.floats(0.05, 0.3))
def test_gradient_is_the_slope_of_the_potential(square: bool, hand: Array, discs: list[Array], radius: float) -> None:
    field, step = make_field(square=square, distance="static"), 1e-6
    gains = field.gains
    centers, radii = np.array(discs).reshape(-1, 2), np.full(len(discs), radius)
    distances = np.hypot(*(hand - centers).T) - radii
    kinks = np.array([gains.influence, NEAREST_SHARE * gains.influence, -radius])  # no slope there, or none continuous
    assume(np.abs(distances[:, None] - kinks).min(initial=np.inf) > 1e-3)
    gradient = gradient_at(field, hand, GOAL, centers, np.zeros_like(centers), radii)
    for axis, shift in enumerate(step * np.eye(2)):
        ahead, behind = (total_potential(gains, hand + sign * shift, centers, radii) for sign in (1.0, -1.0))
        assert gradient[axis] == pytest.approx((ahead - behind) / (2.0 * step), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("norm", [1.0, 1.5, 4.0, np.inf])
def test_the_potential_takes_the_distance_in_the_p_norm(norm: float) -> None:
    field, disc, radii = make_field(distance="static", norm=norm), np.array([[0.3, 0.2]]), np.array([0.1])
    for hand in (np.array([0.55, 0.31]), np.array([0.21, -0.05]), np.array([0.5, 0.15])):
        distance = np.linalg.norm(hand - disc[0], norm) - 0.1
        bowl = 0.5 * field.gains.attraction * ((hand - GOAL) ** 2).sum()
        assert total_potential(field.gains, hand, disc, radii, norm) == pytest.approx(
            bowl + wall(field.gains, distance)[0]
        )
        gradient = gradient_at(field, hand, GOAL, disc, np.zeros((1, 2)), radii)
        for axis, shift in enumerate(1e-6 * np.eye(2)):
            ahead, behind = (total_potential(field.gains, hand + sign * shift, disc, radii, norm) for sign in (1, -1))
            assert gradient[axis] == pytest.approx((ahead - behind) / 2e-6, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("norm", [0.5, -1.0, math.nan])
def test_a_norm_below_one_is_refused(norm: float) -> None:
    with pytest.raises(ValueError, match="must be from 1 to inf"):
        make_field(norm=norm)


def test_the_printed_wall_pushes_at_once_and_khatibs_does_not() -> None:
    printed, khatib = make_gains(1.0, 0.004, 0.3, square=False), make_gains(1.0, 0.004, 0.3)
    assert wall(printed, 0.3)[1] == pytest.approx(-printed.repulsion / (2.0 * 0.3**2))
    assert wall(khatib, 0.3)[1] == 0.0
    assert wall(printed, 0.15)[1] == pytest.approx(wall(khatib, 0.15)[1])


@pytest.mark.parametrize("square", [True, False])
def test_a_shift_counts_as_distance(square: bool) -> None:
    field = make_field(square=square, distance=DistanceTable(np.array([[0.0, 0.0], [-0.15, -0.15]]), 1.0))
    hand, center, radii = np.array([0.4, 0.0]), np.zeros((1, 2)), np.array([0.1])
    gradient = gradient_at(field, hand, hand, center, np.array([[2.0, 0.0]]), radii)
    np.testing.assert_allclose(gradient, [wall(field.gains, 0.15)[1], 0.0], atol=1e-15)


@pytest.mark.parametrize("name", ["attraction", "repulsion", "influence"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_bad_gains_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        make_field(**{name: value})  # type: ignore[arg-type]


# joint velocities


@compiled
@given(q1=st.floats(-3.0, 3.0), q2=st.floats(0.11, 3.0), sign=st.sampled_from([-1.0, 1.0]), velocity=positions)
def test_joint_rates_move_the_hand_as_asked(q1: float, q2: float, sign: float, velocity: Array) -> None:
    q, rates = np.array([q1, sign * q2]), np.empty(2)
    joint_rates_single(LENGTHS, q, velocity, rates)
    np.testing.assert_allclose(ARM.jacobian(q) @ rates, velocity, atol=1e-9)


@compiled
@given(q1=st.floats(-3.0, 3.0), q2=st.floats(-0.1, 0.1), folded=st.booleans(), velocity=positions)
def test_joint_rates_are_bounded_near_the_singularity(q1: float, q2: float, folded: bool, velocity: Array) -> None:
    q, rates = np.array([q1, q2 + folded * math.pi]), np.empty(2)
    joint_rates_single(LENGTHS, q, velocity, rates)
    assert np.abs(rates).max() <= 60.0 * np.hypot(*velocity) + 1e-12
    assert velocity @ ARM.jacobian(q) @ rates >= -1e-12  # never against what is asked


def test_damping_sets_in_smoothly() -> None:
    q, step = np.array([0.3, math.asin(0.1)]), np.array([0.0, 1e-9])
    rates, beyond = np.empty(2), np.empty(2)
    joint_rates_single(LENGTHS, q - step, np.array([0.3, -0.4]), rates)
    joint_rates_single(LENGTHS, q + step, np.array([0.3, -0.4]), beyond)
    np.testing.assert_allclose(rates, beyond, rtol=1e-6)


# inverse kinematics


@pytest.mark.parametrize(("elbow", "branch"), [(1, 0), (-1, 1)])
def test_posture_with_two_argument_arc_tangents_is_the_inverse(elbow: int, branch: int) -> None:
    rng = np.random.default_rng(1)
    hands = ARM.forward_kinematics(rng.uniform(-2.6, 2.6, (200, 2)))
    np.testing.assert_allclose(
        wrap(posture(ARM.lengths, hands, elbow) - ARM.inverse_kinematics(hands)[:, branch]), 0.0, atol=1e-7
    )


def test_posture_as_printed_mirrors_the_first_joint() -> None:
    hand = ARM.forward_kinematics([0.4, 0.9])
    np.testing.assert_allclose(posture(ARM.lengths, hand), [0.4, 0.9], atol=1e-12)
    printed = posture(ARM.lengths, hand, as_printed=True)
    np.testing.assert_allclose(printed, [-0.4, 0.9], atol=1e-12)
    bent = posture(ARM.lengths, ARM.forward_kinematics([0.4, 2.0]), as_printed=True)
    assert bent[1] == pytest.approx(2.0 - math.pi)


def test_posture_out_of_reach_is_nan() -> None:
    assert np.isnan(posture(ARM.lengths, [1.2, 0.0])).all()


# motions


def test_without_discs_the_hand_goes_straight_and_slows_down_exponentially() -> None:
    motion = plan_paper(problem(), attraction=1.5)
    hand = ARM.forward_kinematics(motion.q)
    expected = GOAL + np.exp(-1.5 * motion.t)[:, None] * (START - GOAL)
    # explicit steps of 0.1 ms are first order
    np.testing.assert_allclose(hand, expected, atol=2e-4)
    assert motion.duration == pytest.approx(math.log(np.hypot(*(START - GOAL)) / 1e-3) / 1.5, abs=2e-3)
    assert motion.rendezvous_time == motion.cost == motion.duration


@pytest.mark.parametrize("square", [True, False])
@pytest.mark.parametrize("distance", ["table", "static"])
def test_a_crossing_disc_is_avoided(square: bool, distance: Any) -> None:
    motion = plan_paper(problem(CROSSING), square=square, distance=distance)
    assert np.hypot(*(ARM.forward_kinematics(motion.q[-1]) - GOAL)) <= 1e-3
    centers = CROSSING.position + motion.t[:, None] * CROSSING.velocity
    assert ARM.clearance(motion.q, centers, CROSSING.radius).min() > 0.1
    q, qd, _ = motion.at(1e-4 * np.arange(round(1e4 * motion.duration) + 1))
    np.testing.assert_allclose(np.diff(q, axis=0), 1e-4 * qd[:-1], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(motion.tau, ARM.inverse_dynamics(motion.q, motion.qd, motion.qdd), atol=1e-9)
    assert motion.limit_ratios["velocity"] > 1.0  # no limit plays a part


def test_the_table_keeps_the_hand_farther_from_an_approaching_disc() -> None:
    static, table = (follow_field(problem(CROSSING), make_field(distance=name)) for name in ("static", "table"))
    assert table.hand_clearance.min() > static.hand_clearance.min() + 0.05


def test_clearances_are_the_arms_and_the_hands() -> None:
    motion = follow_field(problem(CROSSING), make_field(), period=1e-3)
    centers = CROSSING.position + motion.t[:, None] * CROSSING.velocity
    np.testing.assert_allclose(motion.clearance, ARM.clearance(motion.q, centers, 0.1), atol=1e-12)
    hand = np.hypot(*(ARM.forward_kinematics(motion.q) - centers).T) - 0.1 - ARM.link_radius
    np.testing.assert_allclose(motion.hand_clearance, hand, atol=1e-12)


def test_a_joint_target_is_its_hand_position() -> None:
    q_goal = ARM.inverse_kinematics(GOAL)[0]
    by_joints, by_hand = plan_paper(problem(target=FixedJoints(q_goal))), plan_paper(problem())
    times = np.linspace(0.0, by_hand.duration, 500)
    np.testing.assert_allclose(by_joints.at(times)[0], by_hand.at(times)[0], atol=1e-9)


def test_a_base_elsewhere_moves_everything_along() -> None:
    away = np.array([3.0, -2.0])
    arm = replace(ARM, base=(3.0, -2.0))
    disc = Obstacle(CROSSING.position + away, CROSSING.velocity, CROSSING.radius)
    moved = plan_paper(problem(disc, arm=arm, target=FixedHand(GOAL + away)), period=1e-3)
    here, times = plan_paper(problem(CROSSING), period=1e-3), np.linspace(0.0, moved.duration, 500)
    np.testing.assert_allclose(moved.at(times)[0], here.at(times)[0], atol=1e-9)


def test_links_are_not_in_the_potential() -> None:
    disc = Obstacle(np.array([1.0, -0.3]), np.array([-0.5, 0.2]), 0.1)
    with pytest.raises(Infeasible, match="touches a disc") as raised:
        plan_paper(problem(disc))
    assert raised.value.reason == "collision"
    details: dict[str, Any] = raised.value.details
    assert details["clearance"] < 0.0 < 0.3 < details["hand_clearance"]
    assert 0.0 < details["time"] < 1.0


def test_a_gate_of_two_discs_is_a_local_minimum() -> None:
    gate = [Obstacle(np.array(center), np.zeros(2), 0.1) for center in ((0.51, 0.49), (0.25, 0.19))]
    with pytest.raises(Infeasible, match="stuck") as raised:
        plan_paper(problem(*gate, elbow=1), period=1e-3)
    assert raised.value.reason == "local_minimum"
    details: dict[str, Any] = raised.value.details
    assert details["time"] == pytest.approx(8.0)
    assert details["distance"] > 0.4
    assert details["clearance"] > 0.1


def test_a_disc_on_the_goal_keeps_the_hand_away() -> None:
    with pytest.raises(Infeasible) as raised:
        plan_paper(problem(Obstacle(np.array([0.78, 0.0]), np.zeros(2), 0.1), elbow=1), period=1e-3)
    assert raised.value.reason == "local_minimum"


def test_too_short_a_horizon_is_late() -> None:
    with pytest.raises(Infeasible, match="more time") as raised:
        plan_paper(problem(horizon=1.0))
    assert raised.value.reason == "late"


@pytest.mark.parametrize("period", [1e-3, 1e-4])
def test_the_printed_wall_makes_a_hand_chatter_that_is_pulled_against_it(period: float) -> None:
    goal, disc = np.array([0.35, 0.6]), Obstacle(np.array([0.74, 0.6]), np.zeros(2), 0.1)
    stuck = problem(disc, q=ARM.inverse_kinematics([0.2, 0.6])[0], target=FixedHand(goal), horizon=3.0)
    spread = []
    for square in (True, False):
        motion = follow_field(stuck, make_field(square=square, distance="static"), period=period)
        assert motion.outcome == "local_minimum"
        spread.append(np.ptp(np.einsum("sj,sj->s", ARM.jacobian(motion.q[-100:])[:, 0], motion.qd[-100:])))
    jump = -wall(make_field(square=False).gains, 0.3)[1]
    assert spread[0] < 0.01 < 0.9 * jump < spread[1] < 1.1 * jump


def test_a_hand_at_its_goal_stays() -> None:
    motion = plan_paper(problem(target=FixedHand(START)))
    assert len(motion.t) == 2
    np.testing.assert_allclose(motion.qd, 0.0, atol=1e-9)


def test_a_coarser_period_makes_nearly_the_same_motion() -> None:
    fine, coarse = (plan_paper(problem(CROSSING), period=period) for period in (1e-4, 1e-3))
    times = np.linspace(0.0, 4.0, 50)
    np.testing.assert_allclose(coarse.at(times)[0], fine.at(times)[0], atol=0.02)


def test_motions_repeat_bit_for_bit() -> None:
    first, second = (plan_paper(problem(CROSSING)) for _ in range(2))
    assert first.q.tobytes() == second.q.tobytes()


def test_an_unreachable_goal_is_infeasible() -> None:
    with pytest.raises(Infeasible) as raised:
        plan_paper(problem(target=FixedHand(np.array([1.2, 0.0]))))
    assert raised.value.reason == "unreachable"


@pytest.mark.parametrize(
    ("changes", "options", "words"),
    [
        ({"target": MovingHand(np.array([0.5, 0.5]), np.array([0.1, 0.0]))}, {}, "joints or hand, not moving hand"),
        ({"arm": PLANAR_3R, "q": np.zeros(3)}, {}, "takes 2 links"),
        ({}, {"period": 0.0}, "period"),
        ({}, {"period": 5.0}, "period"),
        ({}, {"period": 1e-7}, "longer period"),
        ({}, {"tolerance": 0.0}, "tolerance"),
        ({}, {"distance": "far"}, "distance"),
    ],
)
def test_bad_problems_and_options_are_refused(changes: dict[str, Any], options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        plan_paper(problem(**changes), **options)


def test_a_measuring_time_cannot_be_negative() -> None:
    with pytest.raises(ValueError, match="measuring_time"):
        follow_field(problem(), make_field(), measuring_time=-1.0)


@settings(compiled, max_examples=25)
@given(heading=st.floats(-math.pi, math.pi), speed=st.floats(0.0, 1.0), elbow=st.sampled_from([0, 1]))
def test_every_motion_ends_as_it_says(heading: float, speed: float, elbow: int) -> None:
    way = np.array([math.cos(heading), math.sin(heading)])
    disc = Obstacle(np.array([0.2, 0.5]) - 1.0 * way, speed * way, 0.1)
    motion = follow_field(problem(disc, elbow=elbow), make_field(), period=1e-3)
    distance = np.hypot(*(ARM.forward_kinematics(motion.q[-1]) - GOAL))
    assert (motion.clearance[:-1] >= 0.0).all()
    assert (motion.outcome == "collision") == (motion.clearance[-1] < 0.0)
    if motion.outcome == "reached":
        assert distance <= 1e-3
    elif motion.outcome != "collision":
        assert distance > 1e-3
        assert motion.t[-1] == pytest.approx(8.0)


@pytest.mark.parametrize("horizon", [1e5, 1e12])
def test_a_motion_ends_at_the_goal_long_before_a_long_horizon(horizon: float) -> None:
    short, long = plan_paper(problem()), plan_paper(problem(horizon=horizon))
    np.testing.assert_array_equal(long.t, short.t)
    np.testing.assert_array_equal(long.q, short.q)


def test_a_horizon_shorter_than_two_periods_is_late() -> None:
    with pytest.raises(Infeasible, match=r"late: at the horizon of 1\.6e-05 s"):
        plan_paper(problem(horizon=1.6e-5))
    with pytest.raises(ValueError, match="at most half the horizon"):
        plan_paper(problem(horizon=1.6e-5), period=1e-4)


def test_a_motion_that_never_ends_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planners.apf.paper._MOST_SAMPLES", 1000)
    with pytest.raises(Infeasible, match=r"after 0\.1 s, the last of 1000 samples, .* give a longer period"):
        plan_paper(problem())
