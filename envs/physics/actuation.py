"""From action to joint torques: the control modes and torque limits; and the measured use of the joint limits.

`envs.physics.rigid_bodies` turns the torques into motion.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from envs.physics.closed_form import MOVE_ARMS, PLACE_NOTHING
from envs.physics.rigid_bodies import advance, arriving, place_arm, read_joint_state, step_physics
from planners.compiled.calls import Kernel, call, call_real, copy_array, inlined
from planners.control.joint_limits import (
    TORQUE_SHARE,
    VELOCITY_SHARE,
    project_off_limit,
    scale_into_torque,
    smooth_bounds,
    stoppable_velocities,
    worst_excess,
)
from planners.control.tracking import held_torque_single
from planners.robot.arm import Arm
from planners.robot.dynamics import mass_matrix_single
from planners.robot.limits import LIMIT_KINDS as LIMIT_KINDS
from planners.typing import Array

ControlMode = Literal["torque", "acceleration", "jerk", "velocity"]
CONTROL_MODES: tuple[ControlMode, ...] = ("torque", "acceleration", "jerk", "velocity")
_PROJECTIONS = 60


def actuation_env_fields(n_joints: int) -> list[tuple[Any, ...]]:
    """Fields of an environment's record: commands and effects of the last period, and the worst ratios so far."""
    return [
        ("share", "f8", (n_joints,)),
        ("tau", "f8", (n_joints,)),
        ("qdd", "f8", (n_joints,)),
        ("commanded_qdd", "f8", (n_joints,)),
        ("qd_before", "f8", (n_joints,)),
        ("qdd_before", "f8", (n_joints,)),
        ("limit_ratios", "f8", (len(LIMIT_KINDS),)),
        ("limit_ratio", "f8"),
        ("peak_torque", "f8"),
    ]


def actuation_constants(arm: Arm, control_mode: ControlMode) -> dict[str, Any]:
    """What the kernels below read from the model record, for the nominal arm (without its unknown payload).

    Raises:
        ValueError: if the control mode needs a limit that the arm lacks.
    """
    scale = action_scale(arm, control_mode)
    if not np.isfinite(scale).all():
        raise ValueError(
            f'control_mode "{control_mode}" scales actions by the {control_mode} limits, but {arm.name} has {scale}'
        )
    coupling, weight = arm.chain_constants
    return {
        "coupling": coupling,
        "weight": weight,
        "limits": [arm.limits.array(kind) for kind in LIMIT_KINDS],
        "angle_middle": arm.limits.angle_middle,
    }


def action_scale(arm: Arm, control_mode: ControlMode) -> Array:
    """Physical value of an action of 1, ``(n,)``: N m, rad/s^2, rad/s^3 or rad/s."""
    return arm.limits.array(control_mode) * (VELOCITY_SHARE if control_mode == "velocity" else 1.0)


@inlined
def apply_action(env: Any, model: Any, action: Array) -> float:
    """Advance one environment by one control period under an action in [-1, 1] (clipped), ``(n,)``.

    Returns:
        The worst |value| / limit of this period over all joints and kinds of limit.
    """
    command(env, model, action)
    advance(env, model, env.tau)
    return finish_period(env, model)


@inlined
def move_arms(batch: Any, model: Any, first: int, last: int, steps: int) -> None:
    """Move the arms of environments ``first`` to ``last - 1``, at most ``pack``, by so many steps under ``env.tau``."""
    shared = model[0]
    if shared.closed_form:
        call(shared.physics_kernel, batch, model, first, last, steps)
    else:
        for index in range(first, last):
            env = batch[index]
            for _ in range(steps):
                step_physics(env, shared, arriving(env, shared, env.tau))
            read_joint_state(env, shared)


@inlined
def command(env: Any, model: Any, action: Array) -> None:
    """Turn an action in [-1, 1] (clipped), ``(n,)``, into the torques ``env.tau`` of the next period."""
    share = env.share
    for i in range(share.shape[0]):
        share[i] = min(1.0, max(-1.0, action[i]))
    copy_array(env.qd_before, env.qd)
    copy_array(env.qdd_before, env.qdd)
    call(model.command_kernel, env, model)


@inlined
def finish_period(env: Any, model: Any) -> float:
    """Update mean accelerations, peak torque and limit ratios after the physics; returns the period's worst ratio."""
    worst: float = call_real(model.finish_kernel, env, model)
    return worst


@inlined
def _keep_torque_limits(env: Any, model: Any) -> None:
    tau, limits = env.tau, model.limits
    for i in range(tau.shape[0]):
        limit = limits[0, i]
        tau[i] = min(limit, max(-limit, tau[i]))


def _command_torque(env: Any, model: Any) -> None:
    tau, share, limits = env.tau, env.share, model.limits
    for i in range(tau.shape[0]):
        limit = limits[0, i]
        tau[i] = min(limit, max(-limit, share[i] * limit))


def _command_acceleration(env: Any, model: Any) -> None:
    for i in range(env.q.shape[0]):
        env.commanded_qdd[i] = env.share[i] * model.limits[2, i]
    held_torque_single(model.coupling, model.weight, env.q, env.qd, env.commanded_qdd, model.control_period, env.tau)
    _keep_torque_limits(env, model)


def _command_jerk(env: Any, model: Any) -> None:
    """Integrate a joint jerk (shares of the limits) into the commanded accelerations, and find their torques.

    The accelerations stay within the bounds that keep every smoothness limit. Where they need too much torque, they are
    projected in turn onto each torque limit, which is linear in the accelerations, and back into the bounds.
    """
    n = env.q.shape[0]
    period = model.control_period
    lower, upper = np.empty(n), np.empty(n)
    for i in range(n):
        lower[i], upper[i] = smooth_bounds(
            env.qd[i], env.commanded_qdd[i], period, model.limits[1, i], model.limits[2, i], model.limits[3, i]
        )
        wanted = env.commanded_qdd[i] + env.share[i] * model.limits[3, i] * period
        env.commanded_qdd[i] = min(upper[i], max(lower[i], wanted))
    mass = np.empty((n, n))
    mass_matrix_single(model.coupling, env.q, mass)
    for _ in range(_PROJECTIONS):
        held_torque_single(model.coupling, model.weight, env.q, env.qd, env.commanded_qdd, period, env.tau)
        worst, excess = worst_excess(env.tau, model.limits[0])
        if excess == 0.0:
            break
        project_off_limit(mass[worst], excess, lower, upper, env.commanded_qdd)
    _keep_torque_limits(env, model)


def _command_velocity(env: Any, model: Any) -> None:
    """Find the torques that bring the joints to velocities (shares of the limits) by the end of the period.

    The acceleration and torque limits hold, so the velocity may not be reached. A joint brakes before the end of its
    range with half of its acceleration limit, which leaves torque for the others.
    """
    n = env.q.shape[0]
    period = model.control_period
    for i in range(n):
        speed, top, hardest = env.qd[i], VELOCITY_SHARE * model.limits[1, i], model.limits[2, i]
        slowest, fastest = stoppable_velocities(
            env.q[i] - model.angle_middle[i], speed, model.limits[4, i], 0.5 * hardest, period
        )
        wanted = min(fastest, max(slowest, env.share[i] * top))
        env.commanded_qdd[i] = min(hardest, max(-hardest, (wanted - speed) / period))
    state = model.coupling, model.weight, env.q, env.qd, period, model.limits[0]
    scale_into_torque(*state, TORQUE_SHARE, 1, env.commanded_qdd, env.tau)
    _keep_torque_limits(env, model)


def _finish_period(env: Any, model: Any) -> float:
    """Compare the period's values with the limits; keeps the episode's worst ratios, returns the period's worst.

    Acceleration is the change of velocity over the period divided by it, jerk the change of that acceleration. An angle
    is compared from the middle of its range.
    """
    worst, ratios, limits = 0.0, env.limit_ratios, model.limits
    for i in range(env.q.shape[0]):
        torque, speed = env.tau[i], env.qd[i]
        acceleration = (speed - env.qd_before[i]) / model.control_period
        env.qdd[i] = acceleration
        env.peak_torque = max(env.peak_torque, abs(torque))
        jerk = (acceleration - env.qdd_before[i]) / model.control_period
        values = torque, speed, acceleration, jerk, env.q[i] - model.angle_middle[i]
        for kind in range(len(LIMIT_KINDS)):
            ratio = abs(values[kind]) / limits[kind, i]
            worst = max(worst, ratio)
            ratios[kind] = max(ratios[kind], ratio)
    env.limit_ratio = max(env.limit_ratio, worst)
    return worst


_COMMANDS = {
    "torque": Kernel(_command_torque),
    "acceleration": Kernel(_command_acceleration),
    "jerk": Kernel(_command_jerk),
    "velocity": Kernel(_command_velocity),
}
_FINISH, _PLACE = Kernel(_finish_period), Kernel(place_arm.py_func)


def arm_kernels(control_mode: ControlMode, physics: str) -> dict[str, Kernel | None]:
    """The kernels with which an arm is placed and moved, by the field of the model record that has the address."""
    exact = physics == "closed_form"
    return {
        "command_kernel": _COMMANDS[control_mode],
        "finish_kernel": _FINISH,
        "place_kernel": PLACE_NOTHING if exact else _PLACE,
        "physics_kernel": MOVE_ARMS if exact else None,
    }
