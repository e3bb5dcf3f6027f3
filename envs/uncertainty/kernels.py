"""Between a commanded torque and the motion: true masses, latency and joint friction, and what sensors make of both.

The kernels are compiled and called only where the settings ask for them: their addresses in the model record are 0
otherwise. A policy's measurements are noise on the truth, which stays in the record: `observe_joints_noisily`.
"""

from __future__ import annotations

import math
from typing import Any

from envs.hashing import normal_pair
from envs.physics import chipmunk
from envs.physics.rigid_bodies import LONGEST_DELAY as LONGEST_DELAY
from envs.physics.rigid_bodies import place_with
from planners.compiled.calls import Kernel, copy_array, inlined
from planners.typing import Array

CREEP = 0.01
"""Joint velocity above which dry friction has its full torque, rad/s; below, it is proportional to the velocity."""


def _place_true(env: Any, model: Any) -> None:
    """Give the bodies the episode's masses, and place them at ``env.q`` and ``env.qd``, with fresh joints."""
    for i in range(env.q.shape[0]):
        chipmunk.body_set_mass(env.links[i], env.masses[i])
        chipmunk.body_set_moment(env.links[i], env.inertias[i])
    place_with(env, model, env.com)


def _delay(env: Any, model: Any) -> None:
    """Write the torques that reach the joints in the next physics step: those commanded ``latency_steps`` ago."""
    if env.substep == 0:  # a new command
        for age in range(LONGEST_DELAY, 0, -1):
            copy_array(env.commands[age], env.commands[age - 1])
        copy_array(env.commands[0], env.tau)
    missing = max(0, env.latency_steps - env.substep)
    copy_array(env.delayed, env.commands[(missing + model.substeps - 1) // model.substeps])
    env.substep = (env.substep + 1) % model.substeps


def _friction(env: Any, model: Any) -> None:
    """Take the friction of the joints off the torques of the bodies; it stops a joint at most, and never turns it."""
    inner_speed = inner_mobility = 0.0
    for i in range(env.q.shape[0]):
        speed = chipmunk.body_get_angular_velocity(env.links[i])
        mobility = 1.0 / chipmunk.body_get_moment(env.links[i])
        turning = speed - inner_speed
        dry = env.coulomb_friction * min(1.0, abs(turning) / CREEP)
        # Half of what would stop the two bodies if the other joints did not hold them, as their neighbours brake too.
        most = 0.5 * abs(turning) / ((mobility + inner_mobility) * model.physics_step)
        friction = math.copysign(min(most, env.viscous_friction * abs(turning) + dry), turning)
        chipmunk.body_set_torque(env.links[i], chipmunk.body_get_torque(env.links[i]) - friction)
        if i > 0:
            outward = chipmunk.body_get_torque(env.links[i - 1]) + friction
            chipmunk.body_set_torque(env.links[i - 1], outward)
        inner_speed, inner_mobility = speed, mobility


PLACE_TRUE, DELAY, FRICTION = Kernel(_place_true), Kernel(_delay), Kernel(_friction)


@inlined
def add_joint_noise(env: Any, model: Any) -> None:
    """Add the encoders' noise to ``q``, ``qd`` and ``qdd`` of a copy of an environment's record.

    Angles and velocities have independent normal noise in every period. The acceleration is the change of the measured
    velocity over the last period.
    """
    n = env.q.shape[0]
    for i in range(n):
        angle, velocity = normal_pair(env.noise_key, env.step * n + i)
        env.q[i] += env.encoder_noise * angle
        env.qd[i] += env.velocity_noise * velocity
        if env.step > 0:
            _, before = normal_pair(env.noise_key, (env.step - 1) * n + i)
            env.qdd[i] += env.velocity_noise * (velocity - before) / model.control_period


@inlined
def add_camera_noise(env: Any, step: int, place: int, places: int, position: Array, scale: float) -> None:
    """Add a camera's noise of a step, times ``scale``, to ``position`` ``(2,)``, a ``place`` of ``places``."""
    x, y = normal_pair(~env.noise_key, step * places + place)
    position[0] += scale * x
    position[1] += scale * y
