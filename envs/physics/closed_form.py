"""From joint torques to motion by the exact equations, without Pymunk: Runge-Kutta 4 on the planar chain.

With absolute link angles ``phi_i = q_0 + ... + q_i``, the direction ``u_i`` of link i, its length ``L_i`` and its
static moment ``s_i`` (masses times levers, kg m, turned with the link) the Lagrange-Euler equations of a planar chain
are

    D_i phi''_i + sum_j (p_i . s_j) phi''_j + (p_i x s_j) phi'_j^2 + g s_i,x = T_i,    p_i = L_i u_i,   i < j

and the same with i and j exchanged, x the cross product; ``D_i`` is the inertia about the joint of what turns with link
i (kg m^2), and ``T_i = tau_i - tau_i+1``. They are those of `planners.robot.dynamics`, and allow centres of mass off a
link's axis. A pack of environments is advanced at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.physics.packs import WIDTH, memory, reals, sine_and_cosine, spread
from planners.compiled.calls import Kernel, inlined
from planners.robot.arm import Arm
from planners.robot.dynamics import chain_constants

MOST_JOINTS = 6
"""Joints of the longest arm whose motion this module computes."""

vector, matrix = memory(MOST_JOINTS), memory(MOST_JOINTS * MOST_JOINTS)


def closed_form_constants(arm: Arm, physics: str) -> dict[str, Any]:
    """What the kernels below and their callers read from the model record.

    Args:
        arm: the arm with the payload that it holds.
        physics: ``"pymunk"`` or ``"closed_form"``.

    Raises:
        ValueError: in closed form, for an arm with more than `MOST_JOINTS` joints.
    """
    coupling, moments = chain_constants(*map(np.asarray, (arm.lengths, arm.masses, arm.coms, arm.inertias)))
    exact = physics == "closed_form"
    if exact and arm.n_joints > MOST_JOINTS:
        raise ValueError(
            f'physics "closed_form" moves arms with up to {MOST_JOINTS} joints, and {arm.name} has {arm.n_joints} '
            'joints; choose physics "pymunk"'
        )
    return {
        "closed_form": exact,
        "pack": WIDTH if exact else 1,
        "gravity": arm.gravity,
        "chain_inertias": np.diag(coupling),
        "chain_moments": moments,
        "half_lag": 0.0,
    }


@inlined
def integrate(shared: Any, steps: int, bodies: Any, torques: Any, drag: Any, phi: Any, w: Any) -> None:
    """Advance link angles and velocities, packs of ``(n,)``, by so many steps, in place.

    Args:
        shared: the model record.
        steps: number of physics steps.
        bodies: inertias D, and static moments along and across the links, packs of ``(n,)``.
        torques: of the joints, and what they lag behind at the start, packs of ``(n,)``, N m.
        drag: viscous friction of the joints, packs of ``(n,)``, N m s/rad.
        phi, w: link angles, rad, and velocities, rad/s.
    """
    inertia, along, across = bodies
    tau, short = torques
    n, step = shared.lengths.shape[0], shared.physics_step
    shares, weights = (0.5 * step, 0.5 * step, step, 0.0), (step / 6.0, step / 3.0, step / 3.0, step / 6.0)
    decays = (1.0, shared.half_lag, shared.half_lag, shared.half_lag * shared.half_lag)
    a, v, rates, new_phi, new_w = vector(), vector(), vector(), vector(), vector()
    for _ in range(steps):
        for i in range(n):
            a[i] = new_phi[i] = phi[i]
            v[i] = new_w[i] = w[i]
        for stage in range(4):
            share, weight, decay = shares[stage], weights[stage], decays[stage]
            outer = spread(0.0)
            for k in range(n):
                i = n - 1 - k
                net = tau[i] + decay * short[i] - drag[i] * (v[i] - v[i - 1] if i > 0 else v[i])
                rates[i] = net - outer
                outer = net
            accelerate(shared, inertia, along, across, a, v, rates)
            for i in range(n):
                new_phi[i] = new_phi[i] + weight * v[i]
                new_w[i] = new_w[i] + weight * rates[i]
                a[i] = phi[i] + share * v[i]
                v[i] = w[i] + share * rates[i]
        for i in range(n):
            phi[i] = new_phi[i]
            w[i] = new_w[i]
            short[i] = decays[3] * short[i]


@inlined
def accelerate(shared: Any, inertia: Any, along: Any, across: Any, phi: Any, w: Any, rates: Any) -> None:
    """Angular accelerations of the links, rad/s^2, in place of the torques on them, N m; packs of ``(n,)``."""
    ends_x, ends_y, moments_x, moments_y, m = vector(), vector(), vector(), vector(), matrix()
    n = shared.lengths.shape[0]
    for i in range(n):
        sine, cosine = sine_and_cosine(phi[i])
        ends_x[i], ends_y[i] = shared.lengths[i] * cosine, shared.lengths[i] * sine
        moments_x[i] = along[i] * cosine - across[i] * sine
        moments_y[i] = along[i] * sine + across[i] * cosine
        rates[i] = rates[i] - shared.gravity * moments_x[i]
        m[i * n + i] = inertia[i]
    for i in range(n):
        for j in range(i + 1, n):
            m[i * n + j] = ends_x[i] * moments_x[j] + ends_y[i] * moments_y[j]
            swing = ends_y[i] * moments_x[j] - ends_x[i] * moments_y[j]
            rates[i] = rates[i] - swing * (w[j] * w[j])
            rates[j] = rates[j] + swing * (w[i] * w[i])
    # Elimination, from the base outwards, and substitution.
    for k in range(n):
        m[k * n + k] = 1.0 / m[k * n + k]
        for i in range(k + 1, n):
            factor = m[k * n + i] * m[k * n + k]
            rates[i] = rates[i] - factor * rates[k]
            for j in range(i, n):
                m[i * n + j] = m[i * n + j] - factor * m[k * n + j]
    for k in range(n):
        i = n - 1 - k
        total = rates[i]
        for j in range(i + 1, n):
            total = total - m[i * n + j] * rates[j]
        rates[i] = total * m[i * n + i]


@inlined
def read_links(batch: Any, first: int, last: int, phi: Any, w: Any, tau: Any) -> None:
    """Read link angles and velocities and joint torques of environments; the last one fills the pack."""
    all_phi, all_w, all_tau = reals(phi), reals(w), reals(tau)
    for place in range(WIDTH):
        env = batch[min(first + place, last - 1)]
        angle = speed = 0.0
        for i in range(env.q.shape[0]):
            angle += env.q[i]
            speed += env.qd[i]
            at = i * WIDTH + place
            all_phi[at], all_w[at], all_tau[at] = angle, speed, env.tau[i]


@inlined
def write_joints(batch: Any, first: int, last: int, phi: Any, w: Any) -> None:
    """Write joint angles and velocities from those of the links."""
    all_phi, all_w = reals(phi), reals(w)
    for index in range(first, last):
        env = batch[index]
        inner_angle = inner_speed = 0.0
        for i in range(env.q.shape[0]):
            angle, speed = all_phi[i * WIDTH + index - first], all_w[i * WIDTH + index - first]
            env.q[i] = angle - inner_angle
            env.qd[i] = speed - inner_speed
            inner_angle, inner_speed = angle, speed


@inlined
def read_chain(shared: Any, inertia: Any, along: Any, none: Any) -> None:
    """Read inertias and static moments of the arm that all have; ``none`` is 0 for all links."""
    for i in range(shared.lengths.shape[0]):
        none[i] = spread(0.0)
        inertia[i] = spread(shared.chain_inertias[i])
        along[i] = spread(shared.chain_moments[i])


def _move_arms(batch: Any, model: Any, first: int, last: int, steps: int) -> None:
    """Advance environments ``first`` to ``last - 1``, at most `WIDTH`, by so many steps under ``env.tau``."""
    shared = model[0]
    inertia, along, none, tau, phi, w = vector(), vector(), vector(), vector(), vector(), vector()
    read_links(batch, first, last, phi, w, tau)
    read_chain(shared, inertia, along, none)
    integrate(shared, steps, (inertia, along, none), (tau, none), none, phi, w)
    write_joints(batch, first, last, phi, w)


def _place_nothing(env: Any, model: Any) -> None:
    """An arm is where its record has it."""


MOVE_ARMS, PLACE_NOTHING = Kernel(_move_arms), Kernel(_place_nothing)
