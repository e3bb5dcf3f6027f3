"""The compiled kernels of ExcavatorPayload: how a lane begins, advances, is scored and observed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from envs.excavator_payload.noise import add_noise
from envs.excavator_payload.reference import HIGHEST, LOOKAHEAD, LOWEST, reference_at
from envs.excavator_payload.world import N_JOINTS, advance_links, change_load, place_links, tip_of
from envs.physics.actuation import command, finish_period
from envs.physics.episode import clear_episode, finish_observation, sum_reward
from planners.excavator.newton_euler import torque_lane
from planners.typing import Array

RESIDUAL_SHARE = np.array([0.4, 0.4, 0.3])
"""Of the torque limits, what an action of 1 adds in residual mode."""

FASTEST = 6.0
"""Joint velocity at which an episode ends as failed, rad/s."""
STRAY = math.radians(30.0)
"""How far outside the box of the waypoints a joint may be before it ends as failed, rad."""


LANE_FIELDS: list[tuple[Any, ...]] = [
    ("payload", "f8"),
    ("payload_inertia", "f8"),
    ("pick_step", "i8"),
    ("drop_step", "i8"),
    ("noise_seed", "u8"),
    ("reference", "f8", (3, N_JOINTS)),
    ("measured", "f8", (2, N_JOINTS)),
    ("error_integral", "f8", (N_JOINTS,)),
    ("held_action", "f8", (N_JOINTS,)),
    ("leg", "i8"),
    ("tip", "f8", (2,)),
    ("wanted_tip", "f8", (2,)),
    ("tip_error", "f8"),
    ("judged_after", "i8"),
    ("judged_steps", "i8"),
    ("tip_squares", "f8"),
    ("tip_max", "f8"),
    ("joint_squares", "f8"),
    ("waypoint_error", "f8"),
    ("torque_l1", "f8"),
]
"""What a lane's record holds for this task, beside its physics and its reference."""


MODEL_FIELDS: list[tuple[Any, ...]] = [
    ("noise", "f8", (2,)),
    ("residual", "?"),
    ("bandwidth", "f8", (N_JOINTS,)),
    ("damping", "f8", (N_JOINTS,)),
    ("judged_after", "i8"),
    ("settling_steps", "i8"),
    ("rms_tolerance", "f8"),
    ("peak_tolerance", "f8"),
    ("step_reward", "f8"),
    ("reward_distance", "f8"),
    ("smoothness_weight", "f8"),
    ("failure_penalty", "f8"),
]
"""What the model record holds for this task: the controller under a residual, and how episodes are scored."""


@njit(cache=True, nogil=True)
def reset_lane(lanes: Any, model: Any, index: int) -> None:
    """Begin an episode in one lane whose reference, payload and noise are already set.

    The drives begin with what holds the empty machine in its posture, which tells nothing of a load.
    """
    lane, shared = lanes[index], model[0]
    lane.q[:] = lane.waypoints[0]
    clear_episode(lane)
    _hold(lane, lane.pick_step == 0)
    place_links(lane, shared)
    still = np.zeros(N_JOINTS)
    torque_lane(_chain(shared), np.zeros(10), lane.q, still, still, still, lane.tau)
    lane.drive_torque[:] = lane.tau
    for i in range(N_JOINTS):
        lane.held_action[i] = 0.0 if shared.residual else lane.tau[i] / shared.limits[0, i]
    lane.leg = 1
    lane.error_integral[:] = 0.0
    lane.judged_after = shared.judged_after
    lane.judged_steps = 0
    lane.tip_squares = lane.tip_max = lane.joint_squares = lane.waypoint_error = lane.torque_l1 = 0.0
    _measure(lane, shared)
    _observe(lane, shared)


@njit(cache=True, nogil=True)
def advance_lanes(lanes: Any, model: Any, first: int, last: int) -> None:
    """Advance lanes ``first`` to ``last - 1`` by one control period under their ``action``."""
    shared = model[0]
    for index in range(first, last):
        lane = lanes[index]
        if lane.step == lane.drop_step or (lane.step == lane.pick_step and lane.step > 0):
            _hold(lane, lane.step == lane.pick_step)
            change_load(lane, shared)
            lane.judged_after = max(lane.judged_after, lane.step + shared.settling_steps)
        change = _command(lane, shared)
        advance_links(lane, shared)
        finish_period(lane, shared)
        lane.step += 1
        for i in range(N_JOINTS):
            lane.torque_l1 += shared.control_period * abs(lane.tau[i])
            lane.error_integral[i] += shared.control_period * (lane.reference[0, i] - lane.measured[0, i])
        _measure(lane, shared)
        _judge(lane)
        lane.terminated = _ran_away(lane)
        lane.truncated = lane.step >= shared.horizon_steps and not lane.terminated
        lane.success = lane.truncated and _within(lane, shared)
        lane.reward_terms[0] = shared.step_reward * (1.0 - min(1.0, lane.tip_error / shared.reward_distance))
        lane.reward_terms[1] = -shared.step_reward * shared.smoothness_weight * change
        lane.reward_terms[2] = -shared.failure_penalty if lane.terminated else 0.0
        sum_reward(lane)
        _observe(lane, shared)


@njit(cache=True, nogil=True)
def _chain(shared: Any) -> tuple[Array, Array, Array, Array]:
    """The empty machine as a controller knows it."""
    return (shared.chain_frames, shared.chain_gravity, shared.chain_inertia, shared.chain_drives)


@njit(cache=True, nogil=True)
def _hold(lane: Any, loaded: bool) -> None:
    lane.load = lane.payload if loaded else 0.0
    lane.load_inertia = lane.payload_inertia if loaded else 0.0


@njit(cache=True, nogil=True)
def _command(lane: Any, shared: Any) -> float:
    """Turn the action into the torques of the next period; returns the square of its change."""
    command(lane, shared, lane.action)
    if shared.residual:
        _add_to_controller(lane, shared)
    change = 0.0
    for i in range(N_JOINTS):
        share = min(1.0, max(-1.0, lane.action[i]))
        change += (share - lane.held_action[i]) ** 2
        lane.held_action[i] = share
    return change


@njit(cache=True, nogil=True)
def _add_to_controller(lane: Any, shared: Any) -> None:
    """The controller's torques plus the action's, within the limits."""
    empty_bucket_torque(shared, lane.measured[0], lane.measured[1], lane.reference, lane.tau)
    for i in range(N_JOINTS):
        limit = shared.limits[0, i]
        wanted = lane.tau[i] + RESIDUAL_SHARE[i] * limit * min(1.0, max(-1.0, lane.action[i]))
        lane.tau[i] = min(limit, max(-limit, wanted))


@njit(cache=True, nogil=True)
def empty_bucket_torque(model: Any, q: Array, qd: Array, reference: Array, tau: Array) -> None:
    """Slotine and Li's controller for the empty bucket, without adaptation, written to ``tau`` ``(n,)``, N m."""
    qd_r, qdd_r = np.empty(N_JOINTS), np.empty(N_JOINTS)
    for i in range(N_JOINTS):
        qd_r[i] = reference[1, i] + model.bandwidth[i] * (reference[0, i] - q[i])
        qdd_r[i] = reference[2, i] + model.bandwidth[i] * (reference[1, i] - qd[i])
    torque_lane(_chain(model), np.zeros(10), q, qd, qd_r, qdd_r, tau)
    for i in range(N_JOINTS):
        tau[i] += model.damping[i] * (qd_r[i] - qd[i])


@njit(cache=True, nogil=True)
def _measure(lane: Any, shared: Any) -> None:
    """The reference now, what is measured of the joints, and how far the tip really is from where it should be."""
    reference_at(lane, shared, lane.step, lane.reference)
    lane.measured[0] = lane.q
    lane.measured[1] = lane.qd
    add_noise(lane.noise_seed, lane.step, shared.noise, lane.measured)
    tip_of(shared, lane.q, lane.tip)
    tip_of(shared, lane.reference[0], lane.wanted_tip)
    lane.tip_error = math.hypot(lane.tip[0] - lane.wanted_tip[0], lane.tip[1] - lane.wanted_tip[1])


@njit(cache=True, nogil=True)
def _judge(lane: Any) -> None:
    """Count this step, unless the load is still too new to be known."""
    judged = lane.step > lane.judged_after
    if judged:
        lane.judged_steps += 1
        lane.tip_squares += lane.tip_error * lane.tip_error
        lane.tip_max = max(lane.tip_max, lane.tip_error)
        for i in range(N_JOINTS):
            error = lane.reference[0, i] - lane.q[i]
            lane.joint_squares += error * error
    if lane.step == lane.due[lane.leg]:
        if judged:
            lane.waypoint_error = max(lane.waypoint_error, lane.tip_error)
        lane.leg = min(lane.leg + 1, lane.n_waypoints - 1)


@njit(cache=True, nogil=True)
def _within(lane: Any, shared: Any) -> bool:
    """Whether the judged errors are within the tolerances."""
    squares = shared.rms_tolerance * shared.rms_tolerance * lane.judged_steps
    return bool(lane.judged_steps > 0 and lane.tip_squares <= squares and lane.tip_max <= shared.peak_tolerance)


@njit(cache=True, nogil=True)
def _ran_away(lane: Any) -> bool:
    for i in range(N_JOINTS):
        inside = LOWEST[i] - STRAY <= lane.q[i] <= HIGHEST[i] + STRAY
        if not inside or abs(lane.qd[i]) > FASTEST:
            return True
    return False


@njit(cache=True, nogil=True)
def _observe(lane: Any, shared: Any) -> None:
    """Write the observation: the entries of the layout, in its order."""
    seen, ahead = lane.seen, np.empty((3, N_JOINTS))
    seen[0:3] = lane.measured[0]
    seen[3:6] = lane.measured[1]
    seen[6:9] = lane.reference[0] - lane.measured[0]
    seen[9:12] = lane.reference[1]
    seen[12:15] = lane.reference[2]
    for k in range(len(LOOKAHEAD)):
        reference_at(lane, shared, lane.step + LOOKAHEAD[k] / shared.control_period, ahead)
        seen[15 + 3 * k : 18 + 3 * k] = ahead[0] - lane.reference[0]
    seen[24:27] = lane.error_integral
    for i in range(N_JOINTS):
        seen[27 + i] = lane.tau[i] / shared.limits[0, i]
    seen[30:33] = lane.waypoints[lane.leg]
    seen[33] = max(0.0, (lane.due[lane.leg] - lane.step) * shared.control_period)
    seen[34] = (shared.horizon_steps - lane.step) * shared.control_period
    finish_observation(lane, shared)
