"""The physics of boom, arm and bucket: centres of mass off the links' axes, friction, lag, and a changing load.

The bodies, joints and steps are those of `envs.physics.rigid_bodies`. Here a body's frame is its link's frame, with the
origin at its joint, and Chipmunk stores the centre of mass in it: a load moves it, but neither frame nor joint.
In closed form (`envs.physics.closed_form`) the load is part of the equations, and the lag is solved exactly.
"""

from __future__ import annotations

import math
from typing import Any

from envs.physics import chipmunk
from envs.physics.closed_form import PLACE_NOTHING, integrate, read_links, vector, write_joints
from envs.physics.packs import WIDTH, reals
from envs.physics.rigid_bodies import arriving, read_joint_state, remove_joints, renew_joint, step_physics
from planners.compiled.calls import Kernel, call, inlined, new_array, private
from planners.excavator.machine import EXCAVATOR
from planners.excavator.plane import JOINTS, planar_bodies

N_JOINTS = 3

LAG = 0.030
"""Time constant of the drives on level 2, s."""

ENV_FIELDS: list[tuple[Any, ...]] = [
    ("load", "f8"),
    ("load_inertia", "f8"),
    ("load_offset", "f8", (2,)),
    ("friction_scale", "f8"),
    ("bucket_com", "f8", (2,)),
    ("drive_torque", "f8", (N_JOINTS,)),
]
"""Fields of an environment's record for the physics: current load (mass, inertia, offset of its centre) and drives."""


def machine_constants(physics_step: float, lag: float) -> dict[str, Any]:
    """What the kernels read from the model record: the machine, and the decay of the drives' lag, s.

    ``lag_left`` is what remains of a difference of torques after a physics step, ``half_lag`` after half of one, and
    ``lag_mean`` its mean over the step.
    """
    bodies = planar_bodies(EXCAVATOR)
    steps = physics_step / lag if lag > 0.0 else math.inf
    return {
        "body_masses": bodies.masses,
        "body_coms": bodies.coms,
        "body_inertias": bodies.inertias,
        "load_com": bodies.payload_com,
        "tip_place": bodies.tip,
        "friction": EXCAVATOR.drives[JOINTS, 1],
        "lag_left": math.exp(-steps),
        "half_lag": math.exp(-0.5 * steps),
        "lag_mean": -math.expm1(-steps) / steps if lag > 0.0 else 0.0,
    }


def place_links(env: Any, model: Any) -> None:
    """Place the bodies of an environment, payload included, at ``env.q`` and ``env.qd``, with fresh joints."""
    n = env.q.shape[0]
    for i in range(n - 1):
        chipmunk.body_set_mass(env.links[i], env.mass_scale[i] * model.body_masses[i])
        chipmunk.body_set_moment(env.links[i], env.mass_scale[i] * model.body_inertias[i])
        chipmunk.body_set_center_of_gravity(env.links[i], model.body_coms[i, 0], model.body_coms[i, 1])
    _fill_bucket(env, model)
    phi = w = vx = vy = 0.0
    x, y = model.base[0], model.base[1]
    for i in range(n):
        phi += env.q[i]
        w += env.qd[i]
        com_x, com_y = model.body_coms[i, 0], model.body_coms[i, 1]
        if i == n - 1:
            com_x, com_y = env.bucket_com[0], env.bucket_com[1]
        length = model.lengths[i]
        earlier = phi - w * model.position_lag
        cos_now, sin_now = math.cos(phi), math.sin(phi)
        chipmunk.body_set_angle(env.links[i], earlier)
        chipmunk.body_set_angular_velocity(env.links[i], w)
        chipmunk.body_set_position(env.links[i], x, y)
        along, across = com_x * cos_now - com_y * sin_now, com_x * sin_now + com_y * cos_now
        chipmunk.body_set_velocity(env.links[i], vx - w * across, vy + w * along)
        x += length * math.cos(earlier)
        y += length * math.sin(earlier)
        vx -= length * w * sin_now
        vy += length * w * cos_now
    remove_joints(env)
    for i in range(n):
        renew_joint(env, model, i, model.lengths[i - 1] if i > 0 else 0.0, 0.0)


@inlined
def change_load(env: Any, model: Any) -> None:
    """Change the load of the moving bucket to ``env.load`` and ``env.load_inertia``."""
    bucket = env.links[env.q.shape[0] - 1]
    x, y = chipmunk.body_get_position(bucket)
    vx, vy = chipmunk.body_get_velocity(bucket)
    old_x, old_y = env.bucket_com[0], env.bucket_com[1]
    _fill_bucket(env, model)
    # The centre of mass has moved in the frame: keep the frame in place, and give the centre its own velocity.
    chipmunk.body_set_position(bucket, x, y)
    phi, w = chipmunk.body_get_angle(bucket), chipmunk.body_get_angular_velocity(bucket)
    phi += w * model.position_lag
    dx, dy = env.bucket_com[0] - old_x, env.bucket_com[1] - old_y
    along, across = dx * math.cos(phi) - dy * math.sin(phi), dx * math.sin(phi) + dy * math.cos(phi)
    chipmunk.body_set_velocity(bucket, vx - w * across, vy + w * along)


@private
def _fill_bucket(env: Any, model: Any) -> None:
    """Give the last body the mass properties of bucket and load together."""
    last, (mass, inertia) = env.q.shape[0] - 1, loaded_bucket(env, model)
    chipmunk.body_set_mass(env.links[last], mass)
    chipmunk.body_set_moment(env.links[last], inertia)
    chipmunk.body_set_center_of_gravity(env.links[last], env.bucket_com[0], env.bucket_com[1])


@inlined
def loaded_bucket(env: Any, model: Any) -> tuple[float, float]:
    """Mass, kg, and inertia about its centre, kg m^2, of bucket and load together; the centre is written."""
    last = env.q.shape[0] - 1
    bucket = env.mass_scale[last] * model.body_masses[last]
    mass = bucket + env.load
    inertia = env.mass_scale[last] * model.body_inertias[last] + env.load_inertia
    apart = 0.0
    for axis in range(2):
        load_com = model.load_com[axis] + env.load_offset[axis]
        bucket_com = model.body_coms[last, axis]
        env.bucket_com[axis] = (bucket * bucket_com + env.load * load_com) / mass
        off = load_com - bucket_com
        apart += off * off
    inertia += bucket * env.load / mass * apart
    return mass, inertia


@inlined
def move_links(batch: Any, model: Any, first: int, last: int) -> None:
    """Advance environments ``first`` to ``last - 1``, at most ``pack``, by one control period under ``env.tau``."""
    shared = model[0]
    if shared.closed_form:
        call(shared.physics_kernel, batch, model, first, last, shared.substeps)
    else:
        for index in range(first, last):
            advance_links(batch[index], shared)


@inlined
def advance_links(env: Any, model: Any) -> None:
    """Advance one environment by one control period under the commanded torques ``env.tau``; updates q and qd.

    The drives follow the command with their lag; the friction of the joints is subtracted in every physics step.
    """
    n = env.q.shape[0]
    net = new_array(n)
    for _ in range(model.substeps):
        inner_speed = 0.0
        tau = arriving(env, model, env.tau)
        for i in range(n):
            speed = chipmunk.body_get_angular_velocity(env.links[i])
            short = env.drive_torque[i] - tau[i]
            env.drive_torque[i] = tau[i] + model.lag_left * short
            friction = env.friction_scale * model.friction[i] * (speed - inner_speed)
            net[i] = tau[i] + model.lag_mean * short - friction
            inner_speed = speed
        step_physics(env, model, net)
    read_joint_state(env, model)


def _move_links(batch: Any, model: Any, first: int, last: int, steps: int) -> None:
    """The same by the equations of motion, by so many physics steps."""
    shared = model[0]
    inertia, along, across, drag, tau, short = vector(), vector(), vector(), vector(), vector(), vector()
    phi, w = vector(), vector()
    read_links(batch, first, last, phi, w, tau)
    all_inertia, all_along, all_across, all_drag = reals(inertia), reals(along), reals(across), reals(drag)
    all_short = reals(short)
    for place in range(WIDTH):
        env = batch[min(first + place, last - 1)]
        (mass, about), com_x, com_y = loaded_bucket(env, shared), env.bucket_com[0], env.bucket_com[1]
        beyond = 0.0
        for k in range(N_JOINTS):
            i = N_JOINTS - 1 - k
            if k > 0:
                mass, about = shared.body_masses[i], shared.body_inertias[i]
                com_x, com_y = shared.body_coms[i, 0], shared.body_coms[i, 1]
            at, length = i * WIDTH + place, shared.lengths[i]
            all_inertia[at] = about + mass * (com_x * com_x + com_y * com_y) + beyond * length * length
            all_along[at], all_across[at] = mass * com_x + beyond * length, mass * com_y
            all_drag[at] = env.friction_scale * shared.friction[i]
            all_short[at] = env.drive_torque[i] - env.tau[i] if shared.half_lag > 0.0 else 0.0
            beyond += mass
    integrate(shared, steps, (inertia, along, across), (tau, short), drag, phi, w)
    write_joints(batch, first, last, phi, w)
    for index in range(first, last):
        for i in range(N_JOINTS):
            batch[index].drive_torque[i] = batch[index].tau[i] + all_short[i * WIDTH + index - first]


_PLACE, _MOVE = Kernel(place_links), Kernel(_move_links)


def machine_kernels(physics: str) -> dict[str, Kernel | None]:
    """The kernels with which the machine is placed and moved, as `envs.physics.actuation.arm_kernels` has an arm's."""
    exact = physics == "closed_form"
    return {"place_kernel": PLACE_NOTHING if exact else _PLACE, "physics_kernel": _MOVE if exact else None}


@private
def tip_of(model: Any, boom: float, arm: float, bucket: float, tip: Any) -> None:
    """Position of the tip of the tool at angles of the joints, written to ``tip`` ``(2,)``, m."""
    phi = boom
    x, y = model.base[0] + model.lengths[0] * math.cos(phi), model.base[1] + model.lengths[0] * math.sin(phi)
    phi += arm
    x += model.lengths[1] * math.cos(phi)
    y += model.lengths[1] * math.sin(phi)
    phi += bucket
    cos_phi, sin_phi = math.cos(phi), math.sin(phi)
    tip[0] = x + model.tip_place[0] * cos_phi - model.tip_place[1] * sin_phi
    tip[1] = y + model.tip_place[0] * sin_phi + model.tip_place[1] * cos_phi
