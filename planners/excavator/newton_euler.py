"""Recursive Newton-Euler equations of a chain of revolute joints in two velocities, compiled.

``tau = M(q) qdd_r + C(q, qd) qd_r + g(q) + Ia qdd_r + b qd_r``, with a Coriolis matrix for which ``dM/dt - 2 C`` is
skew, as the adaptive law of J.-J. E. Slotine and W. Li ("On the Adaptive Control of Robot Manipulators", 1987) needs.
With ``qd_r = qd`` it is inverse dynamics. In spatial vectors (R. Featherstone, "Rigid Body Dynamics Algorithms", 2008)
the wrench that moves a body of inertia I is

    f = I a_r + (v x* (I v_r) + v_r x* (I v) - I (v x v_r)) / 2

which is linear in the ten inertial parameters of the body. These are ``(m, m c_x, m c_y, m c_z, I_xx, I_xy, I_xz, I_yy,
I_yz, I_zz)``: mass, first moments and moments of inertia about the origin of the link's own frame, products with the
sign they have in the inertia matrix.

A chain is the tuple ``(frames, gravity, inertia, drives)``:

- ``frames``: ``(n, 4)``, of each link ``a``, ``d`` (m), ``sin alpha`` and ``cos alpha`` (standard Denavit-Hartenberg);
- ``gravity``: ``(3,)``, its acceleration in the frame of the base, m/s^2;
- ``inertia``: ``(n, 10)``, the parameters above;
- ``drives``: ``(n, 2)``, inertia of each drive at its joint (kg m^2) and viscous friction (N m s/rad).

``load`` ``(10,)`` are the same parameters of a body carried by the last link, in its frame. The rows of ``motion``
``(n, 6, 3)`` are angular and linear velocity, reference velocity and reference acceleration of a link in its frame.
"""

from __future__ import annotations

import math

from planners.compiled.calls import clear_array, new_array, private
from planners.robot.dynamics import solve_mass_matrix
from planners.typing import Array

Vector = tuple[float, float, float]
Chain = tuple[Array, Array, Array, Array]


@private
def torque_single(chain: Chain, load: Array, q: Array, qd: Array, qd_r: Array, qdd_r: Array, tau: Array) -> None:
    """Joint torques (N m) of one row, written to ``tau``: see the module."""
    n = q.shape[0]
    frames, gravity, inertia, drives = chain
    turns, motion, wrench = new_array(n, 2), new_array(n, 6, 3), new_array(n, 6)
    clear_array(wrench)
    _turn(q, turns)
    _move(frames, gravity, turns, qd, qd_r, qdd_r, motion)
    for i in range(n):
        _add_wrench(inertia[i], motion[i], wrench[i])
    _add_wrench(load, motion[n - 1], wrench[n - 1])
    _project(frames, turns, wrench, tau)
    for i in range(n):
        tau[i] += drives[i, 0] * qdd_r[i] + drives[i, 1] * qd_r[i]


@private
def regressor_single(
    chain: Chain, basis: Array, q: Array, qd: Array, qd_r: Array, qdd_r: Array, columns: Array
) -> None:
    """Torques (N m) that each load of ``basis`` ``(p, 10)`` adds, written to ``columns`` ``(n, p)``."""
    n = q.shape[0]
    frames, gravity, _, _ = chain
    turns, motion, wrench, tau = new_array(n, 2), new_array(n, 6, 3), new_array(n, 6), new_array(n)
    clear_array(wrench)
    _turn(q, turns)
    _move(frames, gravity, turns, qd, qd_r, qdd_r, motion)
    for k in range(basis.shape[0]):
        for i in range(6):
            wrench[n - 1, i] = 0.0
        _add_wrench(basis[k], motion[n - 1], wrench[n - 1])
        _project(frames, turns, wrench, tau)
        for i in range(n):
            columns[i, k] = tau[i]


@private
def mass_matrix_single(chain: Chain, load: Array, q: Array, m: Array) -> None:
    """Mass matrix of one row, drives included, kg m^2, written to ``m`` ``(n, n)``.

    Column j holds the torques that accelerate joint j, and with it the links behind, by 1 rad/s^2.
    """
    n = q.shape[0]
    frames, _, inertia, drives = chain
    turns, wrench, bodies = new_array(n, 2), new_array(n, 6), inertia.copy()
    clear_array(wrench)
    for i in range(load.shape[0]):
        bodies[n - 1, i] += load[i]
    _turn(q, turns)
    for j in range(n - 1, -1, -1):
        alpha, a = _axis(frames[j]), _cross(_axis(frames[j]), _arm(frames[j]))
        for i in range(j, n):
            if i > j:
                alpha = _inwards(frames[i], turns[i], alpha)
                a = _sum(_inwards(frames[i], turns[i], a), _cross(alpha, _arm(frames[i])))
            moment, force = _momentum(bodies[i], alpha, a)
            for k in range(3):
                wrench[i, k], wrench[i, 3 + k] = moment[k], force[k]
        _project(frames, turns, wrench, m[j])
        m[j, j] += drives[j, 0]


@private
def acceleration_single(chain: Chain, load: Array, q: Array, qd: Array, tau: Array, qdd: Array) -> None:
    """Joint accelerations (rad/s^2) of one row under torques ``tau``, written to ``qdd``."""
    n = q.shape[0]
    bias, nothing, m = new_array(n), new_array(n), new_array(n, n)
    clear_array(nothing)
    torque_single(chain, load, q, qd, qd, nothing, bias)
    mass_matrix_single(chain, load, q, m)
    for i in range(n):
        qdd[i] = tau[i] - bias[i]
    solve_mass_matrix(m, qdd)


@private
def _turn(q: Array, turns: Array) -> None:
    for i in range(q.shape[0]):
        turns[i, 0], turns[i, 1] = math.sin(q[i]), math.cos(q[i])


@private
def _move(frames: Array, gravity: Array, turns: Array, qd: Array, qd_r: Array, qdd_r: Array, motion: Array) -> None:
    """Velocities and reference accelerations of every link, from the base outwards."""
    rest = (0.0, 0.0, 0.0)
    w, v, w_r, v_r, alpha = rest, rest, rest, rest, rest
    a = (-gravity[0], -gravity[1], -gravity[2])  # gravity as an upward acceleration of the base
    for i in range(qd.shape[0]):
        axis, arm = _axis(frames[i]), _arm(frames[i])
        lever = _cross(axis, arm)
        w = _sum(_inwards(frames[i], turns[i], w), _scale(qd[i], axis))
        w_r = _sum(_inwards(frames[i], turns[i], w_r), _scale(qd_r[i], axis))
        v = _sum(_inwards(frames[i], turns[i], v), _cross(w, arm))
        v_r = _sum(_inwards(frames[i], turns[i], v_r), _cross(w_r, arm))
        alpha = _inwards(frames[i], turns[i], alpha)
        a = _sum(_inwards(frames[i], turns[i], a), _cross(alpha, arm))
        alpha = _sum(alpha, _sum(_scale(qdd_r[i], axis), _scale(qd_r[i], _cross(w, axis))))
        swing = _sum(_cross(w, lever), _cross(v, axis))
        a = _sum(a, _sum(_scale(qdd_r[i], lever), _scale(qd_r[i], swing)))
        for k in range(3):
            motion[i, 0, k], motion[i, 1, k] = w[k], v[k]
            motion[i, 2, k], motion[i, 3, k] = w_r[k], v_r[k]
            motion[i, 4, k], motion[i, 5, k] = alpha[k], a[k]


@private
def _add_wrench(body: Array, motion: Array, wrench: Array) -> None:
    """Add moment and force of a body in a link's motion ``(6, 3)`` to ``wrench`` ``(6,)``."""
    w, v, w_r, v_r = _vector(motion[0]), _vector(motion[1]), _vector(motion[2]), _vector(motion[3])
    spin = _scale(-0.5, _cross(w, w_r))
    drift = _scale(-0.5, _sum(_cross(w, v_r), _cross(v, w_r)))
    moment, force = _momentum(body, _sum(_vector(motion[4]), spin), _sum(_vector(motion[5]), drift))
    angular, linear = _momentum(body, w, v)
    angular_r, linear_r = _momentum(body, w_r, v_r)
    turning = _sum(_sum(_cross(w, angular_r), _cross(v, linear_r)), _sum(_cross(w_r, angular), _cross(v_r, linear)))
    pushing = _sum(_cross(w, linear_r), _cross(w_r, linear))
    for k in range(3):
        wrench[k] += moment[k] + 0.5 * turning[k]
        wrench[3 + k] += force[k] + 0.5 * pushing[k]


@private
def _project(frames: Array, turns: Array, wrench: Array, tau: Array) -> None:
    """Joint torques of the links' wrenches ``(n, 6)``, from the tip inwards."""
    moment, force = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(tau.shape[0] - 1, -1, -1):
        pull, turn = (wrench[i, 3], wrench[i, 4], wrench[i, 5]), (wrench[i, 0], wrench[i, 1], wrench[i, 2])
        force = _sum(force, pull)
        moment = _sum(_sum(moment, turn), _cross(_arm(frames[i]), force))
        tau[i] = frames[i, 2] * moment[1] + frames[i, 3] * moment[2]  # about the joint's axis
        moment, force = _outwards(frames[i], turns[i], moment), _outwards(frames[i], turns[i], force)


@private
def _momentum(body: Array, w: Vector, v: Vector) -> tuple[Vector, Vector]:
    """Angular momentum about the frame's origin and linear momentum at angular velocity ``w`` and velocity ``v``."""
    h = (body[1], body[2], body[3])
    turning = (
        body[4] * w[0] + body[5] * w[1] + body[6] * w[2],
        body[5] * w[0] + body[7] * w[1] + body[8] * w[2],
        body[6] * w[0] + body[8] * w[1] + body[9] * w[2],
    )
    return _sum(turning, _cross(h, v)), _sum(_scale(body[0], v), _cross(w, h))


@private
def _axis(frame: Array) -> Vector:
    """Axis of a link's joint, in the link's frame."""
    return (0.0, frame[2], frame[3])


@private
def _arm(frame: Array) -> Vector:
    """From a link's joint to the origin of its frame, in that frame."""
    return (frame[0], frame[1] * frame[2], frame[1] * frame[3])


@private
def _inwards(frame: Array, turn: Array, u: Vector) -> Vector:
    """A vector of the frame before, in the frame of a link."""
    sin_twist, cos_twist = frame[2], frame[3]
    along, across = turn[1] * u[0] + turn[0] * u[1], turn[1] * u[1] - turn[0] * u[0]
    return (along, cos_twist * across + sin_twist * u[2], cos_twist * u[2] - sin_twist * across)


@private
def _outwards(frame: Array, turn: Array, u: Vector) -> Vector:
    """A vector of the frame of a link, in the frame before."""
    sin_twist, cos_twist = frame[2], frame[3]
    across = cos_twist * u[1] - sin_twist * u[2]
    height = sin_twist * u[1] + cos_twist * u[2]
    return (turn[1] * u[0] - turn[0] * across, turn[0] * u[0] + turn[1] * across, height)


@private
def _vector(array: Array) -> Vector:
    return (array[0], array[1], array[2])


@private
def _sum(u: Vector, v: Vector) -> Vector:
    return (u[0] + v[0], u[1] + v[1], u[2] + v[2])


@private
def _scale(factor: float, u: Vector) -> Vector:
    return (factor * u[0], factor * u[1], factor * u[2])


@private
def _cross(u: Vector, v: Vector) -> Vector:
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
