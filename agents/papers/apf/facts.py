"""What the potential-field paper leaves out or gets wrong, with the numbers that show it."""

from __future__ import annotations

import timeit
from collections.abc import Iterator

import numpy as np
from scipy.optimize import brentq

from agents.papers.report import Fact
from planners import MotionProblem
from planners.apf.hand_field import joint_rates_single, make_field
from planners.apf.khatib import Gains, wall
from planners.apf.paper import PERIOD, follow_field, posture

CONTROL_PERIOD = 0.02  # s, of a policy in the environment
_POSTURES = 10_000


def facts(problem: MotionProblem) -> Iterator[Fact]:
    """All facts, for the arm and the move of a problem."""
    # computing time of one sample of the planner
    field = make_field()
    samples = len(follow_field(problem, field).t)
    planner = min(timeit.repeat(lambda: follow_field(problem, field), number=1, repeat=20)) / samples
    yield Fact(
        f"A sample takes {1e6 * planner:.2f} us, clearances included; the paper's budget is {1e6 * PERIOD:.0f} us.",
        {"planner": planner, "published_budget": PERIOD},
    )

    # Eq 8 against Khatib's wall where the influence begins
    printed, khatib = make_field(square=False).gains, make_field().gains
    jumps = [-wall(gains, gains.influence)[1] for gains in (printed, khatib)]
    yield Fact(
        f"Eq 8 lacks the square of Khatib's wall. As printed, the velocity of the hand jumps by {jumps[0]:.3f} m/s "
        f"where a disc comes within rho_0 = {printed.influence:g} m; with the square by {jumps[1]:.3f}.",
        {"printed": jumps[0], "khatib": jumps[1]},
    )

    # Eq 14 and 15 as printed, and with arc tangents of two arguments
    arm, rng = problem.arm, np.random.default_rng(0)
    hands = arm.forward_kinematics(rng.uniform(-1.0, 1.0, (_POSTURES, 2)) * arm.limits.angle_half)
    errors, repaired = (
        np.hypot(*(arm.forward_kinematics(posture(arm.lengths, hands, as_printed=as_printed)) - hands).T)
        for as_printed in (True, False)
    )
    values = {
        "printed_within_1_mm": float((errors < 1e-3).mean()),
        "printed_median": float(np.median(errors)),
        "repaired_worst": float(repaired.max()),
    }
    yield Fact(
        f"Eq 14 and 15 as printed put the hand within 1 mm of its place in {100 * values['printed_within_1_mm']:.2f} % "
        f"of {_POSTURES} random postures, their median error is {values['printed_median']:.2f} m. With arc tangents of "
        "two arguments, and the fraction of the second one inverted, the worst error is rounding, below "
        f"{max(1e-12, values['repaired_worst']):.0e} m.",
        values,
    )

    # joint velocities for 1 m/s across the arm and along it as the arm stretches
    angles = [0.1, 0.01, 0.001, 0.0]
    exact, damped = [], []
    for angle in angles:
        q = np.array([0.0, angle])
        rates = np.empty(2)
        joint_rates_single(problem.arm.length_array, q, np.array([-1.0, 0.0]), rates)
        damped.append(float(np.abs(rates).max()))
        if angle:
            exact.append(float(np.abs(np.linalg.solve(problem.arm.jacobian(q), [-1.0, 0.0])).max()))
    yield Fact(
        "Eq 18 divides by sin(theta_2). To draw the hand in at 1 m/s the faster joint needs "
        + ", ".join(f"{rate:.0f}" for rate in exact)
        + " rad/s at theta_2 = "
        + ", ".join(f"{angle:g}" for angle in angles[:-1])
        + "; damped it gets "
        + ", ".join(f"{rate:.2f}" for rate in damped)
        + " there and at 0, where no joint velocity draws a stretched arm in.",
        {"theta_2": angles, "exact": exact, "damped": damped},
    )

    # the speed at time 0: eq 16 sets a velocity, so a hand at rest jumps to it
    motion = follow_field(problem, make_field())
    speed = float(np.hypot(*(problem.arm.jacobian(motion.q[0]) @ motion.qd[0])))
    ratio = float((np.abs(motion.qd[0]) / np.array(problem.joint_limits.velocity)).max())
    yield Fact(
        f"Eq 16 calls a velocity a force: the hand moves at {speed:.2f} m/s from the first sample on, whatever its "
        f"velocity before, and a joint at {ratio:.2f} times its limit. It then slows down with the distance left.",
        {"hand_speed": speed, "velocity_ratio": ratio},
    )

    # the loop of table and hand velocity, closed within one sample and over 10 ms
    changes = []
    for measuring_time in (0.0, 0.01):
        qd = follow_field(problem, make_field(), measuring_time=measuring_time).qd
        changes.append(float(np.abs(np.diff(qd, axis=0)).max()))
    yield Fact(
        "The table needs the hand's velocity, which follows from the table. With the velocity of the sample before, "
        f"the loop oscillates: a joint's velocity changes by up to {changes[0]:.0f} rad/s from one sample to the next. "
        f"Measured over 10 ms, by {changes[1]:.2f}.",
        {"last_sample": changes[0], "over_10_ms": changes[1]},
    )

    # how near a disc the steps of eq 16 are stable
    gains = make_field().gains
    nearest = {f"{1e3 * period:g} ms": stable_distance(gains, period) for period in (PERIOD, CONTROL_PERIOD)}
    yield Fact(
        "Sampling makes a steep wall unstable: the steps of eq 16 oscillate and grow where the second derivative of "
        "the potential exceeds 2 / period, which is nearer to a disc than "
        + " and ".join(f"{1e3 * distance:.0f} mm with {period}" for period, distance in nearest.items())
        + ".",
        nearest,
    )


def stable_distance(gains: Gains, period: float) -> float:
    """Distance from a resting disc below which Euler steps of Khatib's wall do not settle, m."""

    def excess(rho: float) -> float:
        curvature = gains.repulsion * (3.0 / rho**4 - 2.0 / (gains.influence * rho**3)) + gains.attraction
        return period * curvature - 2.0

    return float(brentq(excess, 1e-4, gains.influence))
