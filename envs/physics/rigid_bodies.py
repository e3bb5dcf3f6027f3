"""From joint torques to motion: arms as rigid bodies joined by pivots in Pymunk, one space per environment.

Three choices make Pymunk a good manipulator simulator (``python -m tools.physics_fidelity`` measures the effect):

* ``error_bias = 0`` on every pivot. The default makes joints soft, and a soft joint dissipates energy.
* Chipmunk moves positions before it updates velocities, so after a step the velocity belongs to time t and the
  position to t - h/2. Positions are therefore written half a step back and read half a step ahead.
* Joints are initialised again at every reset: a used joint would start the next episode with its old impulses.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np
import pymunk
from numba import njit

from envs.batch.records import Records
from envs.physics import chipmunk, snapshot
from planners.compiled.calls import call, copy_array, inlined
from planners.robot.arm import Arm
from planners.typing import Array

PYMUNK_ERROR_BIAS = 0.9**60
"""Pymunk's default: share of a joint error that remains after one second."""


MOST_STEPS = 1_000_000
"""Most physics steps of a control period, and control periods of an episode."""


LONGEST_DELAY = 8
"""Most control periods by which a torque may come late."""


def arm_fields(n_joints: int) -> list[tuple[Any, ...]]:
    """Fields of an environment's record for the physics: joint state, and addresses of Chipmunk objects.

    What is true of an episode and not of the nominal arm follows (`envs.uncertainty.draw`): each link's factor of mass,
    the mass properties that it gives together with the payload (kg, kg m^2, m; where the settings ask for them),
    friction (N m s/rad and N m), latency (s and physics steps), the standard deviations of noise (rad, rad/s, m) and
    its key. The last commands and the torque that has arrived serve the latency.
    """
    return [
        ("q", "f8", (n_joints,)),
        ("qd", "f8", (n_joints,)),
        ("space", "i8"),
        ("links", "i8", (n_joints,)),
        ("joints", "i8", (n_joints,)),
        ("ground", "i8"),
        ("mass_scale", "f8", (n_joints,)),
        ("payload", "f8"),
        ("masses", "f8", (n_joints,)),
        ("inertias", "f8", (n_joints,)),
        ("com", "f8", (n_joints,)),
        ("viscous_friction", "f8"),
        ("coulomb_friction", "f8"),
        ("latency", "f8"),
        ("latency_steps", "i8"),
        ("substep", "i8"),
        ("commands", "f8", (LONGEST_DELAY + 1, n_joints)),
        ("delayed", "f8", (n_joints,)),
        ("encoder_noise", "f8"),
        ("velocity_noise", "f8"),
        ("camera_noise", "f8"),
        ("noise_key", "u8"),
    ]


def arm_constants(
    arm: Arm, control_period: float, physics_step: float, *, pymunk_defaults: bool = False
) -> dict[str, Any]:
    """What the kernels of the physics read from the model record.

    Args:
        arm: the arm with the payload that it holds.
        control_period: time for which a torque is held, s.
        physics_step: time of one Chipmunk step, s.
        pymunk_defaults: leave out the first two choices above, to measure their effect.

    Raises:
        ValueError: if the control period is no integer multiple of the physics step.
    """
    return {
        "lengths": arm.lengths,
        "coms": arm.coms,
        "base": arm.base,
        "physics_step": physics_step,
        "substeps": whole_multiple("control_period", control_period, "physics_step", physics_step),
        "position_lag": 0.0 if pymunk_defaults else 0.5 * physics_step,
        "error_bias": PYMUNK_ERROR_BIAS if pymunk_defaults else 0.0,
        "delay_kernel": 0,
        "friction_kernel": 0,
        "measure_kernel": 0,
    }


def model_record(constants: Mapping[str, Any]) -> Records:
    """The array of one record that all environments share: sequences as float64, single numbers in their own type."""
    arrays = {name: np.asarray(value) for name, value in constants.items()}
    fields = [(name, np.dtype("f8") if array.ndim else array.dtype, array.shape) for name, array in arrays.items()]
    record = np.zeros(1, np.dtype(fields, align=True))
    for name, array in arrays.items():
        record[name] = array
    return record


class NoWorld:
    """What a batch without Pymunk has in place of a `World`: nothing beside its records.

    Args:
        count: number of environments.
    """

    def __init__(self, count: int) -> None:
        self.shape = count, 0

    def place(self, batch: Records, model: Records, index: int) -> None:
        """An arm is where its record has it."""

    def save(self) -> Array:
        """No numbers."""
        return np.empty(self.shape)

    def load(self, numbers: Array) -> None:
        """Nothing to continue from."""


class World:
    """The Pymunk spaces of a batch of environments, one arm in each.

    It cannot be copied or pickled, because a copy would have the same bodies: make another, and `load` into it.

    Args:
        arm: the arm with the payload that it holds.
        batch: environment records with `arm_fields`; the addresses are filled in.
    """

    def __init__(self, arm: Arm, batch: Records) -> None:
        self._spaces: list[pymunk.Space] = []  # a space keeps its C structs, to which the addresses point, alive
        for env in batch:
            space = pymunk.Space()
            space.gravity = (0.0, -arm.gravity)
            links = [pymunk.Body(mass, inertia) for mass, inertia in zip(arm.masses, arm.inertias, strict=True)]
            space.add(*links)
            # `place_arm` sets anchors and error bias.
            parents = [space.static_body, *links[:-1]]
            joints = [pymunk.PivotJoint(*pair, (0.0, 0.0), (0.0, 0.0)) for pair in zip(parents, links, strict=True)]
            space.add(*joints)
            env["space"] = chipmunk.address(space._space)
            env["ground"] = chipmunk.address(space.static_body._body)
            env["links"] = [chipmunk.address(link._body) for link in links]
            env["joints"] = [chipmunk.address(joint._constraint) for joint in joints]
            self._spaces.append(space)
        self._addresses = batch["space"].copy(), batch["links"].copy(), batch["joints"].copy()
        # Pymunk cannot free a space while the interpreter unloads its modules; the finalizer runs before that.
        weakref.finalize(self, self._spaces.clear)

    def place(self, batch: Records, model: Records, index: int) -> None:
        """Place the bodies of one environment as its record has them."""
        place_arm_of(batch, model, index)

    @property
    def shape(self) -> tuple[int, int]:
        """Of what `save` returns: spaces, and numbers of each."""
        spaces, bodies, joints = self._addresses
        return len(spaces), snapshot.numbers_of(bodies.shape[1], joints.shape[1])

    def save(self) -> Array:
        """All that the next step depends on: a row of numbers for each space.

        Raises:
            RuntimeError: if the installed Pymunk keeps its numbers elsewhere.
        """
        if not snapshot.layout_is_known():
            raise RuntimeError(
                f"Pymunk {pymunk.version} keeps its bodies in another form than planarm knows, so that no state can be "
                'saved or copied; install a tested one: pip install "pymunk>=7.3,<8"'
            )
        numbers = np.empty(self.shape)
        snapshot.save(*self._addresses, numbers)
        return numbers

    def load(self, numbers: Array) -> None:
        """Continue from what `save` returned, of this world or of one with the same arms."""
        if numbers.shape != self.shape:
            raise ValueError(f"expected numbers of shape {self.shape}, found {numbers.shape}")
        snapshot.load(*self._addresses, np.ascontiguousarray(numbers))

    def __reduce__(self) -> NoReturn:
        raise TypeError("a World cannot be copied or pickled; copy or pickle the environment or the task that has it")


def whole_multiple(name: str, seconds: float, step_name: str, step: float) -> int:
    """How many steps a named time takes.

    Raises:
        ValueError: if that is not a whole number, or more than `MOST_STEPS`.
    """
    count = seconds / step if step > 0.0 else 0.0
    if count > MOST_STEPS:
        raise ValueError(
            f"{name} {seconds} s takes more than {MOST_STEPS} steps of {step_name} {step} s; "
            f"choose a {step_name} of {seconds / MOST_STEPS:.3g} s or more"
        )
    if round(count) < 1 or abs(count - round(count)) > 1e-6:
        whole = max(1, round(count))
        raise ValueError(
            f"{name} {seconds} s is no multiple of {step_name} {step} s; "
            f"choose a {name} of {whole * step:g} s or a {step_name} of {seconds / whole:.6g} s"
        )
    return round(count)


@njit(cache=True, nogil=True)
def place_arm(env: Any, model: Any) -> None:
    """Place the bodies of an environment at ``env.q`` and ``env.qd``, with fresh joints."""
    place_with(env, model, model.coms)


@inlined
def place_with(env: Any, model: Any, coms: Array) -> None:
    """Place the bodies of an environment whose links have these centres of mass, ``(n,)``, m along them."""
    n = env.q.shape[0]
    lag = model.position_lag
    phi = w = 0.0
    x, y = model.base[0], model.base[1]
    vx = vy = 0.0
    for i in range(n):
        phi += env.q[i]
        w += env.qd[i]
        earlier = phi - w * lag
        cos_earlier, sin_earlier = np.cos(earlier), np.sin(earlier)
        cos_now, sin_now = np.cos(phi), np.sin(phi)
        com, length = coms[i], model.lengths[i]
        link = env.links[i]
        chipmunk.body_set_angle(link, earlier)
        chipmunk.body_set_angular_velocity(link, w)
        chipmunk.body_set_position(link, x + com * cos_earlier, y + com * sin_earlier)
        chipmunk.body_set_velocity(link, vx - com * w * sin_now, vy + com * w * cos_now)
        x += length * cos_earlier
        y += length * sin_earlier
        vx -= length * w * sin_now
        vy += length * w * cos_now
    remove_joints(env)
    for i in range(n):
        outer_end = model.lengths[i - 1] - coms[i - 1] if i > 0 else 0.0
        renew_joint(env, model, i, outer_end, -coms[i])


@njit(cache=True, nogil=True)
def place_arm_of(batch: Any, model: Any, index: int) -> None:
    """Place the bodies of one environment of a batch as its record has them."""
    call(model[0].place_kernel, batch[index], model[0])


@inlined
def remove_joints(env: Any) -> None:
    """Remove the joints of one environment from its space.

    All are removed before the first is added again: Chipmunk fills a gap with the last joint, and the order of the
    joints changes the result.
    """
    for i in range(env.joints.shape[0]):
        chipmunk.space_remove_constraint(env.space, env.joints[i])


@inlined
def renew_joint(env: Any, model: Any, i: int, outer_end: float, inner_end: float) -> None:
    """Initialise joint ``i`` of one environment again and add it to the space.

    It pins the point ``outer_end`` on the x axis of the previous link (or the base) to ``inner_end`` on that of link
    ``i``, both in the frames of the bodies, m.
    """
    joint = env.joints[i]
    owner = chipmunk.constraint_get_user_data(joint)
    if i == 0:
        chipmunk.pivot_joint_init(joint, env.ground, env.links[0], model.base[0], model.base[1], inner_end, 0.0)
    else:
        chipmunk.pivot_joint_init(joint, env.links[i - 1], env.links[i], outer_end, 0.0, inner_end, 0.0)
    chipmunk.constraint_set_user_data(joint, owner)
    chipmunk.constraint_set_error_bias(joint, model.error_bias)
    chipmunk.space_add_constraint(env.space, joint)


@inlined
def advance(env: Any, model: Any, tau: Array) -> None:
    """Advance an environment by one control period under constant joint torques ``tau``, ``(n,)`` N m."""
    for _ in range(model.substeps):
        step_physics(env, model, arriving(env, model, tau))
    read_joint_state(env, model)


@inlined
def arriving(env: Any, model: Any, tau: Array) -> Array:
    """The torques that reach the joints in the next physics step: ``tau``, or with a latency those of before."""
    if model.delay_kernel == 0:
        return tau
    call(model.delay_kernel, env, model)
    delayed: Array = env.delayed
    return delayed


@inlined
def begin_commands(env: Any) -> None:
    """Let ``env.tau`` be what was commanded before the episode."""
    env.substep = 0
    for age in range(LONGEST_DELAY + 1):
        copy_array(env.commands[age], env.tau)


@inlined
def step_physics(env: Any, model: Any, tau: Array) -> None:
    """Advance the bodies of one environment by one physics step under joint torques ``tau``, ``(n,)`` N m."""
    n = env.q.shape[0]
    # Chipmunk clears the torques after every step.
    for i in range(n - 1):
        chipmunk.body_set_torque(env.links[i], tau[i] - tau[i + 1])
    chipmunk.body_set_torque(env.links[n - 1], tau[n - 1])
    if model.friction_kernel != 0:
        call(model.friction_kernel, env, model)
    chipmunk.space_step(env.space, model.physics_step)


@inlined
def read_joint_state(env: Any, model: Any) -> None:
    """Read q and qd of one environment off its bodies."""
    lag = model.position_lag
    inner_angle = inner_speed = 0.0
    for i in range(env.q.shape[0]):
        speed = chipmunk.body_get_angular_velocity(env.links[i])
        angle = chipmunk.body_get_angle(env.links[i]) + lag * speed
        env.q[i] = angle - inner_angle
        env.qd[i] = speed - inner_speed
        inner_angle, inner_speed = angle, speed
