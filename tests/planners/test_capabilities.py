"""What every variant declares, who is named where it does not fit, and a share of the campaign that checks it."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import envs
import planners
from envs.experts import expert_names
from planners import (
    PLANAR_3R,
    SCARA_50CM,
    Arm,
    FixedHand,
    FixedJoints,
    Infeasible,
    JointLimits,
    MotionProblem,
    MovingHand,
    Obstacle,
    Trajectory,
    dpct,
)
from planners.capabilities import VARIANTS, Takes
from planners.promises import require_solved, target_error
from tools.fuzz_planners import Fuzz, Record, run
from tools.fuzzing.promises import broken_promises

SMOOTH = JointLimits(torque=(10.0, 4.0), velocity=2.0, acceleration=6.0)
CHECKED = ("dpct/optimal", "dpct/free", "dpct/timing", "dpct/torque", "lagrange/via", "quintic", "trapezoid", "any")


def move(arm: Arm = SCARA_50CM, limits: JointLimits = SMOOTH, **changes: object) -> MotionProblem:
    n = arm.n_joints
    start, goal = np.full(n, 0.3), np.linspace(0.6, 0.9, n)
    problem = MotionProblem(arm, start, FixedJoints(goal), 4.0, limits=limits.for_joints(n))
    return replace(problem, **changes)  # type: ignore[arg-type]


def found(record: Record) -> list[str]:
    """What a campaign found, but for processor time, which is the machine's and the compiler's."""
    return [fault for fault in record.faults if not re.search(r": takes [\d.]+ s$", fault)]


@pytest.mark.parametrize("label", CHECKED)
def test_a_share_of_the_campaign_finds_no_broken_promise(label: str) -> None:
    record = run(Fuzz(problems=12, seed=2, planner=label))[label]
    assert found(record) == []
    assert record.outcomes["solved"] > 0
    assert sum(record.outcomes.values()) == 12


@pytest.mark.parametrize(
    ("label", "seed", "number"),
    [
        ("dpct/timing", 7, 20860),  # arrives late, and leaves a joint's range with more time too
        ("dpct/timing", 7, 56617),  # would take 41 hours, and is not quite at rest then
        ("dpct/timing", 7, 64623),  # the torque is largest between four evaluations
        ("dpct/torque", 7, 13606),  # late, and joints that move beside the path need more time than the path does
        ("dpct/torque", 7, 13684),
        ("apf/field", 7, 9000),
        ("apf/field", 7, 64557),  # a moving target is met within 1 mm at the samples, and not between them
        ("dpct/paper", 7, 1312),  # a start in motion was no refusal of a motion, but an error of the arguments
        ("lagrange/optimal", 7, 105),  # late, and with a thousandth more than the time named too
        ("lagrange/optimal", 7, 438),  # the time named led to a motion with a jump
        ("lagrange/optimal", 7, 267),  # rounding of the angles turns torques between two samples
        ("trapezoid", 11, 50),  # late, and leaves a joint's range while it brakes
    ],
)
def test_problems_that_once_broke_a_promise_in_the_campaign(label: str, seed: int, number: int) -> None:
    assert found(run(Fuzz(seed=seed, planner=label, only=number))[label]) == []


def test_wrong_shapes_types_and_values_are_refused_by_name() -> None:
    record = run(Fuzz(problems=150, seed=2, planner="inputs"))["inputs"]
    assert found(record) == []
    assert set(record.outcomes) == {"refused", "accepted"}


def test_the_records_of_two_runs_add_up(tmp_path: Path) -> None:
    out = tmp_path / "records.json"
    run(Fuzz(problems=3, planner="quintic", out=out))
    again = run(Fuzz(problems=6, planner="quintic,trapezoid", out=out))
    assert again["quintic"].next == again["trapezoid"].next == 6
    whole = run(Fuzz(problems=6, planner="quintic"))["quintic"]
    assert again["quintic"].outcomes == whole.outcomes


@pytest.mark.parametrize(
    ("variant", "option", "value"),
    [
        ("optimal", "stages", 20.0),
        ("optimal", "stages", True),
        ("optimal", "allow_reverse", 1),
        ("optimal", "time_weight", "0.5"),
        ("timing", "margin", np.array([0.1, 0.2])),
        ("timing", "contact", ["refuse"]),
        ("torque", "stages", 2**70),
    ],
)
def test_an_option_of_another_type_is_refused_by_name(variant: str, option: str, value: object) -> None:
    with pytest.raises(ValueError, match=f"{option} .* must be"):
        dpct.plan(move(), variant=variant, **{option: value})


def test_numbers_of_numpy_are_options_too() -> None:
    plain = dpct.plan(move(), variant="timing", margin=0.05)
    given = dpct.plan(move(), variant="timing", margin=np.array(0.05))
    np.testing.assert_array_equal(plain.q, given.q)


def test_the_campaign_notices_a_motion_that_breaks_its_promises() -> None:
    problem = move(obstacles=(Obstacle(SCARA_50CM.forward_kinematics([0.5, 0.5]), np.zeros(2), 0.05),))
    motion = planners.trapezoid.plan(replace(problem, obstacles=()))
    promising = VARIANTS["trapezoid", ""]
    assert broken_promises(replace(problem, obstacles=()), motion, promising) == []
    weaker = replace(problem, limits=JointLimits(torque=1e-3, velocity=0.1, acceleration=0.1).for_joints(2))
    broken = " ".join(broken_promises(replace(weaker, target=FixedJoints(np.ones(2)), horizon=0.1), motion, promising))
    for word in ("torque", "velocity", "acceleration", "touches an obstacle", "takes", "from the target"):
        assert word in broken


def test_a_ride_that_leaves_its_target_between_the_samples_is_refused() -> None:
    """Straight in joint space from place to place, the hand takes a chord's arc where the belt is straight."""
    belt = MovingHand([0.3, 0.4], [0.2, 0.0])
    t = np.array([0.0, 0.7, 1.4])
    places = np.array([SCARA_50CM.inverse_kinematics(place)[0] for place in belt.at(t)[0]])
    problem = MotionProblem(SCARA_50CM, places[0], belt, 2.0, limits=JointLimits().for_joints(2))
    slopes = np.gradient(places, t, axis=0)
    motion = planners.sampled_trajectory(problem, t, places, slopes, 0.0 * places, planner="x", rendezvous_time=0.0)
    inside = np.linspace(0.0, 1.4, 2001)
    away = np.hypot(*(SCARA_50CM.forward_kinematics(motion.at(inside)[0]) - belt.at(inside)[0]).T)
    error, unit = target_error(problem, motion)
    assert unit == "m"
    assert error == pytest.approx(away.max(), rel=1e-3)
    assert error > 1e-3
    with pytest.raises(Infeasible, match=r"from the target; 0\.001 m is allowed"):
        require_solved("x", problem, motion, 1e-3, "")
    require_solved("x", problem, motion, 1.001 * error, "")


def test_a_problem_outside_is_refused_at_once_with_the_variants_that_can() -> None:
    moving = move(target=MovingHand(np.array([0.5, 0.5]), np.array([0.1, 0.0])))
    with pytest.raises(ValueError, match=r"dpct .timing. goes to a target of kind joints or hand.*dpct .optimal.* can"):
        dpct.plan(moving, variant="timing")
    jerky = move(limits=replace(SMOOTH, jerk=(50.0, 50.0)))
    with pytest.raises(ValueError, match=r"dpct .torque. keeps no jerk limits; .*dpct .optimal.* can"):
        dpct.plan(jerky, variant="torque")
    with pytest.raises(ValueError, match=r"needs a finite velocity limit of every joint"):
        dpct.plan(move(limits=JointLimits(torque=5.0)), variant="timing")
    one = MotionProblem(Arm("lever", [0.5], [1.0]), np.zeros(1), moving.target, 3.0)
    with pytest.raises(ValueError, match=r"dpct .optimal. takes 2 or 3 links, and lever has 1; no variant can"):
        dpct.plan(one)


@pytest.mark.parametrize("n", range(1, 7))
@pytest.mark.parametrize("variant", ["optimal", "torque", "timing"])
def test_dpct_moves_one_to_six_links_to_joints_and_to_a_hand_position(n: int, variant: str) -> None:
    arm = Arm("chain", np.linspace(0.3, 0.2, n), np.linspace(2.0, 1.0, n))
    limits = JointLimits(torque=80.0, velocity=3.0, acceleration=20.0, angle=[(-0.5, 2.0)] * n)
    problem = move(arm, limits)
    hand = FixedHand(arm.forward_kinematics(np.linspace(0.6, 0.9, n)))
    for target in (problem.target, hand):
        motion = dpct.plan(replace(problem, target=target), variant=variant)
        assert motion.limit_ratio <= 1.0 + 1e-6
        assert motion.problem.target is target
        np.testing.assert_allclose(arm.forward_kinematics(motion.q[-1]), hand.position, atol=1e-6)
        assert (motion.q >= -0.5).all()
        assert (motion.q <= 2.0).all()


def test_the_top_level_plan_takes_a_planner_that_can() -> None:
    assert isinstance(planners.plan(move()), Trajectory)
    blocked = move(obstacles=(Obstacle(SCARA_50CM.forward_kinematics([0.45, 0.45]), np.zeros(2), 0.03),))
    assert planners.plan(blocked).clearance >= 0.0
    # neither a straight line nor its timing passes this disc
    parked = move(q=np.array([-0.6, 0.6]), target=FixedJoints(np.array([0.8, 0.6])), horizon=3.0)
    disc = Obstacle(SCARA_50CM.forward_kinematics([0.1, 0.6]), np.zeros(2), 0.04)
    assert planners.plan(replace(parked, obstacles=(disc,))).planner == "lagrange (via)"
    with pytest.raises(Infeasible, match=r"^collision: dpct .timing.: .*; also tried lagrange .via.: late, dpct"):
        planners.plan(replace(parked, obstacles=(disc,), horizon=0.2))
    upright = replace(PLANAR_3R, gravity=9.81)
    assert planners.plan(move(upright, PLANAR_3R.limits)).limit_ratio <= 1.0 + 1e-6


HAND_VARIANTS = [key for key, entry in VARIANTS.items() if "hand" in entry.takes]


@pytest.mark.parametrize(("planner", "variant"), HAND_VARIANTS)
@pytest.mark.parametrize("n", [1, 2])
def test_an_orientation_that_the_arm_cannot_choose_is_refused(planner: str, variant: str, n: int) -> None:
    arm = Arm("chain", [0.25] * n, [1.0] * n, limits=SCARA_50CM.limits.for_joints(2) if n == 2 else None)
    problem = MotionProblem(arm, np.full(n, 0.3), FixedHand(arm.forward_kinematics(np.full(n, 0.6)), -3.0), 5.0)
    with pytest.raises(ValueError, match=r"cannot choose that of the hand; leave it out|takes 2 links"):
        planners.plan(problem, planner, variant)


def test_a_motion_that_ends_with_another_orientation_is_refused() -> None:
    start, goal = np.full(3, 0.3), np.array([0.6, 0.7, 0.9])
    hand = PLANAR_3R.forward_kinematics(goal)
    motion = dpct.plan(MotionProblem(PLANAR_3R, start, FixedHand(hand, float(goal.sum())), 4.0))
    other = replace(motion.problem, target=FixedHand(hand, float(goal.sum()) + 0.5))
    turned = replace(other, target=FixedHand(hand, float(goal.sum()) + 2.0 * np.pi))
    assert target_error(other, motion) == (pytest.approx(0.5), "rad")
    assert target_error(turned, motion)[0] < 1e-6
    with pytest.raises(Infeasible, match=r"ends 0\.5 rad from the target"):
        require_solved("x", other, motion, 1e-6, "")
    promising = VARIANTS["dpct", "optimal"]
    assert broken_promises(turned, motion, promising) == []
    assert "ends 0.5 from the target" in broken_promises(other, motion, promising)


def ignoring(problem: MotionProblem) -> Trajectory:
    """A planner that forgets limits and obstacles."""
    return planners.quintic.plan(replace(problem, limits=JointLimits().for_joints(2), obstacles=()))


def elsewhere(problem: MotionProblem) -> Trajectory:
    """A planner that begins in another posture."""
    return planners.quintic.plan(replace(problem, q=problem.q + 0.1))


@pytest.fixture
def registered() -> Iterator[Callable[..., None]]:
    yield lambda plan, takes=None: planners.register("stub", plan, takes)
    VARIANTS.pop(("stub", ""), None)


def test_a_motion_is_checked_against_the_problem_that_was_asked(registered: Callable[..., None]) -> None:
    fast, disc = move(horizon=0.5), Obstacle(SCARA_50CM.forward_kinematics([0.45, 0.6]), np.zeros(2), 0.02)
    registered(ignoring)
    motion = planners.plan(fast, "stub")
    assert motion.problem is fast
    assert motion.limit_ratio > 1.0
    registered(ignoring, {"joints": Takes()})
    with pytest.raises(Infeasible, match=r"limits: the motion of stub takes joint"):
        planners.plan(fast, "stub")
    with pytest.raises(Infeasible, match=r"collision: the motion of stub touches"):
        planners.plan(move(obstacles=(disc,)), "stub")
    assert planners.plan(move(), "stub").limit_ratio <= 1.0
    registered(elsewhere, {"joints": Takes()})
    with pytest.raises(Infeasible, match=r"start: the motion of stub begins 0\.1 rad from the start"):
        planners.plan(move(), "stub")


def test_what_a_planner_takes_may_be_given_by_generators(registered: Callable[..., None]) -> None:
    takes = Takes(links=(n for n in (1, 2)), keeps=(kind for kind in planners.robot.limits.LIMIT_KINDS))  # type: ignore[arg-type]
    registered(ignoring, {"joints": takes})
    assert [planners.plan(move(), "stub").duration for _ in range(2)] == [4.0, 4.0]


def test_no_motion_without_a_promise_is_the_answer_where_no_planner_is_named(registered: Callable[..., None]) -> None:
    def fails(problem: MotionProblem) -> Trajectory:
        raise KeyError("own")

    for own in (ignoring, fails):
        registered(own)
        with pytest.raises(Infeasible):
            planners.plan(move(target=FixedHand([9.0, 9.0])))
    with pytest.raises(KeyError, match="own"):
        planners.plan(move(), "stub")


def test_what_only_a_planner_without_promises_takes_is_not_planned_unnamed(registered: Callable[..., None]) -> None:
    six = Arm("six", [0.2] * 6, [1.0] * 6)
    registered(ignoring)
    with pytest.raises(ValueError, match=r"no planner takes this problem: .*stub promises no solution"):
        planners.plan(MotionProblem(six, np.zeros(6), MovingHand([0.5, 0.5], [0.1, 0.0]), 2.0))


def test_any_callable_plans(registered: Callable[..., None]) -> None:
    class Planner:
        __hash__ = None  # type: ignore[assignment]

        def __call__(self, problem: MotionProblem, share: float = 1.0) -> Trajectory:
            return ignoring(problem)

    def strange(problem: "Nowhere") -> Trajectory:  # type: ignore[name-defined]  # noqa: F821, UP037
        return ignoring(problem)

    for own in (functools.partial(ignoring), Planner(), strange):
        registered(own)
        assert planners.plan(move(), "stub").planner
    registered(Planner())
    with pytest.raises(ValueError, match="option share 'x' must be a number"):
        planners.plan(move(), "stub", share="x")


@pytest.mark.parametrize("result", [None, 3, "motion"])
def test_a_planner_that_returns_no_motion_is_named(registered: Callable[..., None], result: object) -> None:
    for takes in (None, {"joints": Takes()}):
        registered(lambda problem: result, takes)
        with pytest.raises(TypeError, match=f"stub returned {result!r}; a planner returns a Trajectory"):
            planners.plan(move(), "stub")


@pytest.mark.parametrize(
    ("plan", "takes", "message"),
    [
        (3, None, "the planner stub is 3"),
        (ignoring, {"joints": 3}, "takes of stub has 3 for 'joints'"),
        (ignoring, {"joint": Takes()}, "must map 'joints', 'hand' or 'moving hand' to Takes"),
        (ignoring, 3, "takes 3 of stub must map"),
    ],
)
def test_what_is_no_planner_is_not_registered(plan: Any, takes: Any, message: str) -> None:
    with pytest.raises(TypeError, match=message):
        planners.register("stub", plan, takes)
    assert ("stub", "") not in VARIANTS


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"links": 2}, r"links 2 must be several, as in \(2, 3\)"),
        ({"links": ()}, r"links \(\) must be one number of links or more"),
        ({"links": (0, 2)}, "links 0 must be a whole number"),
        ({"obstacles": "avoid"}, "obstacles 'avoid' must be one of 'avoided', 'checked'"),
        ({"keeps": "angle"}, r"keeps 'angle' must be several, as in \('velocity',\)"),
        ({"keeps": None}, "keeps None must be several"),
        ({"needs": ("velocity",), "keeps": ("angle",)}, "needs 'velocity' must be one of 'angle'"),
        ({"accelerating": "no"}, "accelerating 'no' must be one of True, False"),
        ({"needs": ("speed",)}, "needs 'speed' must be one of 'torque', 'velocity'"),
        ({"precision": math.nan}, "precision nan must be finite"),
        ({"arrives": "late"}, "arrives 'late' must be one of"),
    ],
)
def test_what_a_planner_takes_is_checked(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Takes(**given)


def test_no_own_planner_takes_the_name_of_a_policy() -> None:
    for env_id in envs.env_ids():
        for name in ("agent", *expert_names(env_id)):
            with pytest.raises(ValueError, match="choose another name"):
                planners.register(name, lambda problem: planners.quintic.plan(problem))


def test_only_the_joint_that_begins_beyond_a_limit_may_exceed_it() -> None:
    limits = JointLimits(torque=(10.0, 4.0), velocity=2.0, acceleration=20.0, angle=(2.8, 2.6))
    problem = MotionProblem(SCARA_50CM, [0.0, 1.0], FixedJoints([1.0, 2.5]), 0.97, qd=[3.0, 0.0], limits=limits)
    with pytest.raises(Infeasible, match=r"joint 2 to 1\.45 times its velocity limit"):
        planners.quintic.plan(problem)
    peak = np.abs(planners.quintic.plan(replace(problem, horizon=3.0)).at(np.linspace(0.0, 3.0, 999))[1]).max(axis=0)
    assert peak[0] == pytest.approx(3.0)
    assert peak[1] < 2.0


@pytest.mark.parametrize("name", ["dpct", "lagrange", "apf", "quintic", "trapezoid", None])
def test_a_target_outside_of_the_joint_ranges_is_named_at_once(name: str | None) -> None:
    problem = MotionProblem(SCARA_50CM, [0.2, 1.5], FixedJoints([1.2, 2.65]), 2.0)
    with pytest.raises(Infeasible, match=r"joint 2 at 2\.65 rad; the joint ranges are"):
        planners.plan(problem, name)
