"""The field that weighs several futures of a disc: what it takes for granted, what it hedges against, and limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from planners import PLANAR_3R, SCARA_50CM, Arm
from planners.apf.dodge import dodge_accelerations, new_memory, tuned_gains
from planners.apf.hedging import UNLIKELY, Futures, HedgeGains, leave_out_unlikely
from planners.apf.safety import STEP
from planners.typing import Array

ARM, LIMITS = SCARA_50CM, SCARA_50CM.limits
PERIOD, RADIUS = 0.02, 0.1
GAINS, HEDGE = replace(tuned_gains(), horizon=3.0), HedgeGains()
TOLD_ALL = replace(HEDGE, inertia=0.0)
AHEAD = STEP * np.arange(1, round(GAINS.horizon / STEP) + 1)
START, END = [-1.0, 0.8], [1.0, 0.8]
GOAL = ARM.forward_kinematics(END)
ASIDE = np.array([-1.2, 0.3])

Motion = Callable[[float], Array]
Act = Callable[[Array, Array, float, NDArray[Any]], Array]
"""Accelerations from angles, velocities, time and memory."""


def parked(place: Array) -> Motion:
    return lambda t: place


def seen(disc: Motion, t: float) -> tuple[Array, Array, Array]:
    """Place, velocity and radius of a disc, of one row."""
    return disc(t)[None, None], (disc(t + 1e-4) - disc(t))[None, None] / 1e-4, np.full((1, 1), RADIUS)


def hedged(disc: Motion, told: list[Motion], weights: list[float], hedge: HedgeGains = HEDGE) -> Act:
    """What a row does that sees a disc and is told where it may go."""

    def act(q: Array, qd: Array, t: float, memory: NDArray[Any]) -> Array:
        futures = np.array([[one(t + ahead) for ahead in AHEAD] for one in told])[None, :, :, None]
        row = q[None], qd[None], GOAL[None], *seen(disc, t)
        told_all = Futures(futures, np.array([weights]), hedge)
        return np.ravel(dodge_accelerations(ARM, GAINS, *row, memory, PERIOD, futures=told_all))

    return act


def plain(disc: Motion) -> Act:
    """What it does if it forecasts the disc by itself."""

    def act(q: Array, qd: Array, t: float, memory: NDArray[Any]) -> Array:
        row = q[None], qd[None], GOAL[None], *seen(disc, t)
        return np.ravel(dodge_accelerations(ARM, GAINS, *row, memory, PERIOD))

    return act


def drive(act: Act, seconds: float, start: list[float]) -> tuple[Array, Array]:
    """Angles and accelerations of perfect joints, ``(steps, 2)``."""
    memory, q, qd = new_memory(1, 1), np.array(start), np.zeros(2)
    rows = []
    for step in range(round(seconds / PERIOD)):
        qdd = act(q, qd, step * PERIOD, memory)
        q, qd = q + PERIOD * (qd + 0.5 * PERIOD * qdd), qd + PERIOD * qdd
        rows.append((q, qdd))
    return np.array([q for q, _ in rows]), np.array([qdd for _, qdd in rows])


def least_clearance(angles: Array, disc: Motion) -> float:
    """Of a motion from a moving disc, m."""
    return min(float(ARM.clearance(q, disc(PERIOD * step), RADIUS)) for step, q in enumerate(angles, 1))


def decide(told: list[Motion], weights: list[float], hedge: HedgeGains, qd: tuple[float, float] = (0.0, 0.0)) -> Array:
    """The first accelerations towards the goal with a disc that is seen at rest, aside."""
    return hedged(parked(ASIDE), told, weights, hedge)(np.array(START), np.array(qd), 0.0, new_memory(1, 1))


def straight(qd: tuple[float, float] = (0.0, 0.0)) -> Array:
    return plain(parked(ASIDE))(np.array(START), np.array(qd), 0.0, new_memory(1, 1))


@pytest.mark.parametrize("start", [START, [2.0, -1.0], [0.3, 1.8]])
@pytest.mark.parametrize("inertia", [0.0, 0.3, 1.0])
def test_told_what_the_field_forecasts_and_far_away_it_does_what_the_field_does(
    start: list[float], inertia: float
) -> None:
    place, velocity = np.array([-1.2, -0.1]), np.array([0.0, 0.05])

    def disc(t: float) -> Array:
        return place + t * velocity

    _, told = drive(hedged(disc, [disc], [1.0], replace(HEDGE, inertia=inertia)), 3.0, start)
    q, own = drive(plain(disc), 3.0, start)
    np.testing.assert_array_equal(told, own)
    np.testing.assert_allclose(ARM.forward_kinematics(q[-1]), GOAL, atol=1e-3)


def test_a_parked_disc_told_by_several_equal_futures_is_gone_round() -> None:
    middle = parked(ARM.forward_kinematics([0.0, 0.8]))
    q, _ = drive(hedged(middle, [middle] * 3, [0.5, 0.3, 0.2]), 6.0, START)
    assert least_clearance(np.linspace(START, END, 200), middle) < 0.0 < least_clearance(q, middle)
    assert np.hypot(*(ARM.forward_kinematics(q[-1]) - GOAL)) < 0.03


def head_on(t: float) -> Array:
    place: Array = ARM.forward_kinematics([0.0, 0.8]) + np.array([0.5 - 0.5 * t, 0.2])
    return place


IN_THE_WAY = parked(ARM.forward_kinematics([-0.6, 0.8]))


@pytest.mark.parametrize("chance", [0.0, 0.04, UNLIKELY])
def test_an_unlikely_future_changes_nothing(chance: float) -> None:
    """Whatever happens in it: at every instant of a motion that dodges a disc."""
    others: list[Motion] = [parked(ASIDE), IN_THE_WAY, lambda t: -head_on(t)]
    motions = [
        drive(hedged(head_on, [head_on, other], [1.0 - chance, chance], TOLD_ALL), 2.0, START)[1] for other in others
    ]
    np.testing.assert_array_equal(motions[1], motions[0])
    np.testing.assert_array_equal(motions[2], motions[0])
    _, alone = drive(hedged(head_on, [head_on], [1.0], TOLD_ALL), 2.0, START)
    np.testing.assert_allclose(motions[0], alone, atol=1e-9)
    _, untroubled = drive(plain(parked(ASIDE)), 2.0, START)
    assert np.abs(alone - untroubled).max() > 1.0


def test_with_all_inertia_what_is_told_does_not_matter() -> None:
    others, hedge = [parked(ASIDE), IN_THE_WAY], replace(HEDGE, inertia=1.0)
    motions = [drive(hedged(head_on, [other], [1.0], hedge), 2.0, START)[1] for other in others]
    np.testing.assert_array_equal(motions[0], motions[1])


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8).filter(lambda found: max(found) > 0.0))
def test_what_is_left_of_the_probabilities_sums_to_one(found: list[float]) -> None:
    weights = np.array(found) / sum(found)
    left = weights.copy()
    leave_out_unlikely(left)
    assert left.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_array_equal(left > 0.0, weights > UNLIKELY)
    kept = left > 0.0
    np.testing.assert_allclose(left[kept] / weights[kept], 1.0 / weights[kept].sum(), rtol=1e-12)


LATE = parked(ARM.forward_kinematics([0.9, 0.8]))
"""A disc that is met after a second on the straight way."""

SOON = parked(ARM.forward_kinematics([-0.45, 0.8]))
"""One that is met after 0.2 s by an arm that already moves."""

FAST = (2.0, 0.0)


def test_a_late_danger_costs_at_most_the_regret() -> None:
    """With no regret, until the futures part everything costs the same: straight on. With much, it is heeded."""
    for hedge in (replace(TOLD_ALL, regret=0.0), replace(TOLD_ALL, regret=0.0, recourse=0.0)):
        np.testing.assert_array_equal(decide([parked(ASIDE), LATE], [0.5, 0.5], hedge), straight())
    dear = decide([parked(ASIDE), LATE], [0.5, 0.5], replace(TOLD_ALL, regret=1e6))
    assert np.abs(dear - straight()).max() > 1.0
    np.testing.assert_array_equal(dear, decide([parked(ASIDE), LATE], [0.5, 0.5], replace(TOLD_ALL, recourse=1e6)))


def test_a_danger_before_the_futures_part_is_heeded_without_any_regret() -> None:
    careful = decide([parked(ASIDE), SOON], [0.5, 0.5], replace(TOLD_ALL, regret=0.0), FAST)
    assert careful[0] < -5.0
    careless = decide([parked(ASIDE), SOON], [0.5, 0.5], replace(TOLD_ALL, regret=0.0, recourse=0.0), FAST)
    np.testing.assert_array_equal(careless, straight(FAST))


@pytest.mark.parametrize(("chance", "heeded"), [(0.12, False), (0.5, True)])
def test_a_danger_is_heeded_from_the_alarm_on(chance: float, heeded: bool) -> None:
    answer = decide([parked(ASIDE), SOON], [1.0 - chance, chance], replace(TOLD_ALL, alarm=0.13), FAST)
    assert (np.abs(answer - straight(FAST)).max() > 1.0) == heeded


def test_a_disc_that_will_turn_into_the_way_is_avoided_by_one_that_is_told() -> None:
    """It stands aside for 0.3 s; the field by itself starts straight for the goal."""
    hand, way = ARM.forward_kinematics([0.1, 0.8]), np.array([1.0, 1.15])

    def disc(t: float) -> Array:
        place: Array = way + min(1.0, max(0.0, t - 0.3) / 0.25) * (hand - way)
        return place

    q, first = drive(hedged(disc, [disc, parked(way)], [0.9, 0.1]), 3.0, START)
    assert least_clearance(q, disc) > 0.0
    unaware, own = drive(plain(parked(way)), 3.0, START)
    assert least_clearance(unaware, disc) < 0.0
    assert np.abs(first[:10] - own[:10]).max() > 1.0


angle1, angle2, speed = st.floats(-2.8, 2.8), st.floats(-2.55, 2.55), st.floats(-2.4, 2.4)


@settings(max_examples=150, deadline=None)
@given(angle1, angle2, speed, speed, st.integers(1, 2), st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_accelerations_velocities_and_torques_keep_the_limits(
    q1: float, q2: float, v1: float, v2: float, discs: int, futures: int, seed: int
) -> None:
    q, qd, generator = np.array([q1, q2]), np.array([v1, v2]), np.random.default_rng(seed)
    places = generator.uniform(-1.0, 1.0, (1, futures, len(AHEAD), discs, 2))
    qdd = dodge_accelerations(
        ARM,
        GAINS,
        q[None],
        qd[None],
        ARM.forward_kinematics([0.3, 1.0])[None],
        generator.uniform(-1.0, 1.0, (1, discs, 2)),
        generator.uniform(-1.0, 1.0, (1, discs, 2)),
        np.full((1, discs), RADIUS),
        new_memory(1, discs),
        PERIOD,
        futures=Futures(places, generator.dirichlet(np.ones(futures))[None], HEDGE),
    )[0]
    assert (np.abs(qdd) <= np.array(LIMITS.acceleration) * (1 + 1e-12)).all()
    assert (np.abs(qd + PERIOD * qdd) <= np.array(LIMITS.velocity) + 1e-12).all()
    half = 0.5 * PERIOD
    tau = ARM.inverse_dynamics(q + half * (qd + 0.5 * half * qdd), qd + half * qdd, qdd)
    # Accelerations are scaled along a straight line; the torques along it bend by far less than this.
    assert (np.abs(tau) <= 1.002 * np.array(LIMITS.torque)).all()


def random_batch(rows: int, discs: int, futures: int = 3) -> dict[str, Array]:
    generator = np.random.default_rng(4)
    return {
        "q": generator.uniform(-2.2, 2.2, (rows, 2)),
        "qd": generator.uniform(-2.0, 2.0, (rows, 2)),
        "goal": ARM.forward_kinematics(generator.uniform(-2.2, 2.2, (rows, 2))),
        "positions": generator.uniform(-1.0, 1.0, (rows, discs, 2)),
        "velocities": generator.uniform(-1.0, 1.0, (rows, discs, 2)),
        "radii": np.full((rows, discs), RADIUS),
        "futures": generator.uniform(-1.0, 1.0, (rows, futures, len(AHEAD), discs, 2)),
        "weights": generator.dirichlet(np.ones(futures), rows),
    }


def hedged_batch(rows: dict[str, Array], memory: NDArray[Any], arm: Arm = ARM) -> Array:
    seen_envs: dict[str, Any] = {name: array for name, array in rows.items() if name not in ("futures", "weights")}
    futures = Futures(rows["futures"], rows["weights"], HEDGE)
    return dodge_accelerations(arm, GAINS, **seen_envs, memory=memory, period=PERIOD, futures=futures)


@pytest.mark.parametrize("discs", [1, 2])
def test_a_environment_of_a_batch_is_bit_for_bit_that_environment_alone(discs: int) -> None:
    rows = random_batch(12, discs)
    before = {name: array.copy() for name, array in rows.items()}
    memory, alone = new_memory(12, discs), [new_memory(1, discs) for _ in range(12)]
    for _ in range(3):
        batch = hedged_batch(rows, memory)
        for row in range(12):
            single = {name: array[row : row + 1] for name, array in rows.items()}
            np.testing.assert_array_equal(hedged_batch(single, alone[row])[0], batch[row])
            assert alone[row][0] == memory[row]
    for name, array in rows.items():
        np.testing.assert_array_equal(array, before[name])


def test_the_base_may_stand_anywhere() -> None:
    rows, shift = random_batch(8, 1), np.array([0.25, -0.5])
    moved = replace(ARM, base=(0.25, -0.5))
    np.testing.assert_array_equal(ARM.base_array, 0.0)
    elsewhere = {
        name: array + shift if name in ("goal", "positions", "futures") else array for name, array in rows.items()
    }
    here, there = hedged_batch(rows, new_memory(8, 1)), hedged_batch(elsewhere, new_memory(8, 1), moved)
    np.testing.assert_allclose(there, here, atol=1e-6)


@pytest.mark.parametrize(
    "wrong", [{"alarm": -0.1}, {"recourse": math.nan}, {"regret": math.inf}, {"inertia": 1.5}, {"inertia": -1.0}]
)
def test_gains_without_sense_are_refused(wrong: dict[str, float]) -> None:
    name, value = next(iter(wrong.items()))
    with pytest.raises(ValueError, match=f"{name} = {value}"):
        replace(HEDGE, **wrong)


@pytest.mark.parametrize(
    ("name", "cut"),
    [
        ("futures", np.s_[:, :, :-1]),
        ("futures", np.s_[:, :2]),
        ("futures", np.s_[:3]),
        ("weights", np.s_[0]),
        ("weights", np.s_[:, :2]),
        ("velocities", np.s_[:, 0]),
        ("goal", np.s_[:1]),
    ],
)
def test_shapes_that_do_not_fit_are_refused(name: str, cut: Any) -> None:
    rows = random_batch(4, 1)
    with pytest.raises(ValueError, match="shape"):
        hedged_batch({**rows, name: rows[name][cut]}, new_memory(4, 1))


@pytest.mark.parametrize("wrong", [-0.1, math.nan])
def test_probabilities_without_sense_are_refused(wrong: float) -> None:
    rows = random_batch(4, 1)
    rows["weights"][2, 1] = wrong
    with pytest.raises(ValueError, match="not negative"):
        hedged_batch(rows, new_memory(4, 1))


def test_the_likeliest_future_counts_however_unlikely_it_is() -> None:
    weights = np.full(30, 1.0 / 30.0)
    weights[7] *= 1.1
    leave_out_unlikely(weights)
    assert np.flatnonzero(weights).tolist() == [7]
    assert weights[7] == pytest.approx(1.0)


def test_memory_and_arms_that_do_not_fit_are_refused() -> None:
    rows = random_batch(4, 1)
    for memory in (new_memory(5, 1), new_memory(4, 2)):
        with pytest.raises(ValueError, match="shape"):
            hedged_batch(rows, memory)
    with pytest.raises(ValueError, match="two links"):
        hedged_batch(rows, new_memory(4, 1), PLANAR_3R)
