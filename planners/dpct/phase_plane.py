"""The search of the published DPCT algorithm: backward dynamic programming over a grid of the phase plane.

Compiled; :mod:`planners.dpct.paper` has the equations, numbered as in the paper, and the public door.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from planners.compiled.calls import private
from planners.robot.arm import Arm
from planners.typing import Array


class Tables(NamedTuple):
    """f', f'' and the coefficients of eq 12 (with weight) at the stages, each ``(N1 + 1, n)``."""

    slope: Array
    curvature: Array
    inertia: Array
    centripetal: Array
    static: Array


def tabulate(arm: Arm, m11_slip: tuple[float, float], q: Array, slope: Array, curvature: Array) -> Tables:
    """Tables of the stages, at joint angles ``q`` (all ``(N1 + 1, n)``); see ``Reading`` on the slip."""
    still = np.zeros_like(q)
    static = arm.inverse_dynamics(q, still, still)
    inertia = arm.inverse_dynamics(q, still, slope) - static
    centripetal = arm.inverse_dynamics(q, slope, curvature) - static
    excess = m11_slip[0] + m11_slip[1] * np.cos(q[:, 1])
    inertia[:, 0] += excess * slope[:, 0]
    centripetal[:, 0] += excess * curvature[:, 0]
    return Tables(slope, curvature, inertia, centripetal, static)


@private
def _step_duration(stage: int, rate: float, next_rate: float, dr: float, exact: bool) -> float:
    """Eq 26, or the time constant acceleration takes; inf where the hand would never get to the next stage."""
    if exact:
        return 2.0 * dr / (rate + next_rate) if rate + next_rate > 0.0 else np.inf
    if rate > 0.0:
        return dr / rate
    return dr / next_rate if stage == 0 and next_rate > 0.0 else np.inf


@njit(cache=True, nogil=True)
def search(
    tables: Tables,
    bounds: Array,
    rates: Array,
    target_state: int,
    offset: float,
    end: float,
    exact: bool,
    price_wait: bool,
) -> tuple[Array, Array, Array]:
    """Backward search over the phase plane (eq 25 to 35).

    Args:
        tables: derivatives and coefficients at the stages.
        bounds: limits of torque, velocity, acceleration and jerk, ``(4, n)``.
        rates, target_state: x2 of the states, ``(N2 + 1,)``, 1/s, and Nt.
        offset, end: x~1 at time 0, and t_f, s.
        exact, price_wait: see :class:`planners.dpct.paper.Reading`.

    Returns:
        J*, clock and number of the best next state of every node, each ``(N1 + 1, N2 + 1)``; J* is inf for dead ends.
    """
    slope, curvature, inertia, centripetal, static = tables
    stages, joints = slope.shape[0] - 1, slope.shape[1]
    states = rates.shape[0]
    dr = 1.0 / stages
    belt_rate = rates[target_state]
    cost = np.full((stages + 1, states), np.inf)
    clock = np.full((stages + 1, states), np.nan)
    following = np.full((stages + 1, states), -1)
    joint_acceleration = np.zeros((stages + 1, states, joints))  # of the best step from a node (eq 32)
    cost[stages, target_state], clock[stages, target_state] = 0.0, end
    joint_acceleration[stages, target_state] = curvature[stages] * belt_rate**2  # beyond the line the hand rides on
    for i in range(stages - 1, -1, -1):
        for j in range(states if i > 0 else 1):
            for k in range(states):
                dt = _step_duration(i, rates[j], rates[k], dr, exact)
                if not (np.isfinite(cost[i + 1, k]) and np.isfinite(dt)):
                    continue
                now = clock[i + 1, k] - dt  # eq 27
                step_cost = dt * ((i * dr - offset - belt_rate * now) ** 2 + (rates[j] - belt_rate) ** 2)  # eq 28
                if i == 0 and price_wait and now > 0.0:
                    part = offset + belt_rate * now
                    step_cost += (part**3 - offset**3) / (3.0 * belt_rate) + belt_rate**2 * now  # eq 18 at rest
                if step_cost + cost[i + 1, k] >= cost[i, j]:
                    continue
                rate_change = (rates[k] - rates[j]) / dt
                allowed = True
                for joint in range(joints):
                    tau = inertia[i, joint] * rate_change + centripetal[i, joint] * rates[j] ** 2 + static[i, joint]
                    qd = slope[i, joint] * rates[j]
                    qdd = (slope[i + 1, joint] * rates[k] - qd) / dt
                    jerk = (joint_acceleration[i + 1, k, joint] - qdd) / dt  # eq 33, with the stored best next step
                    allowed = (
                        allowed
                        and abs(tau) <= bounds[0, joint]  # eq 3
                        and abs(qd) <= bounds[1, joint]  # eq 4'
                        and abs(qdd) <= bounds[2, joint]  # eq 5'
                        and abs(jerk) <= bounds[3, joint]  # eq 6'
                    )
                if allowed:
                    cost[i, j] = step_cost + cost[i + 1, k]  # eq 30
                    clock[i, j], following[i, j] = now, k
            best = following[i, j]
            if best >= 0:
                dt = clock[i + 1, best] - clock[i, j]
                joint_acceleration[i, j] = (slope[i + 1] * rates[best] - slope[i] * rates[j]) / dt
    return cost, clock, following
