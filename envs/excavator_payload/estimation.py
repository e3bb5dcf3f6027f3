"""The estimate of the expert `kalman` inside ExcavatorPayload: what is given to it, and the mode that adds to it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from envs.excavator_payload.hidden import OFFSET
from envs.excavator_payload.kernels import RESIDUAL_SHARE
from envs.excavator_payload.reference import empty_machine
from envs.excavator_payload.world import LAG, N_JOINTS
from envs.observation import Entry
from envs.uncertainty.draw import Uncertainty
from planners.compiled.calls import Kernel, copy_array
from planners.excavator.filter_model import ANGLES, FRICTION, VELOCITIES
from planners.excavator.kalman import FilterSettings, estimate_and_control, replace_command

LEAST_SPREAD = 1.0
"""Least standard deviation of the payload's mass before the first sample, kg."""

ENTRIES = (
    Entry("estimated_torque", (3,), 1.0, 1.0, "-", "of the controller to which the action adds, shares of the limits"),
    Entry("estimated_error", (3,), 0.01, 50.0, "rad", "reference minus estimated angle"),
    Entry("estimated_rate", (3,), 0.1, 50.0, "rad/s", "velocity of the reference minus estimated velocity"),
    Entry("estimated_payload", (), 350.0, 2.0, "kg", "estimated mass of the payload"),
    Entry("payload_deviation", (), 100.0, 2.0, "kg", "standard deviation of that estimate"),
    Entry("estimated_friction", (), 1.0, 5.0, "-", "logarithm of the estimated factor on the friction"),
)
"""What is observed besides in control mode "estimated"."""


def filter_settings(config: Any, uncertainty: Uncertainty) -> FilterSettings:
    """What the environment states of itself: noise, lag, and the distributions of payloads, masses and latency."""
    soonest, latest = uncertainty.ends["latency"]
    # On level 2 the bucket is empty at first.
    lightest = 0.0 if config.level == 2 else config.lightest
    return FilterSettings(
        period=config.control_period,
        noise=(uncertainty.ends["encoder_noise"][1], uncertainty.ends["velocity_noise"][1]),
        lag=LAG if config.level == 2 else 0.0,
        mass=(0.5 * (lightest + config.payload), max(LEAST_SPREAD, (config.payload - lightest) / math.sqrt(12.0))),
        shift=(OFFSET[0] / math.sqrt(3.0), OFFSET[1] / math.sqrt(3.0)),
        masses=max(abs(end) for end in uncertainty.mass_error) / math.sqrt(3.0),
        latency=(0.5 * (soonest + latest), (latest - soonest) / math.sqrt(12.0), latest),
    )


def _estimate(env: Any, model: Any) -> None:
    """Take the sample of this step into the estimate, and observe it with the torque of its controller."""
    samples, tau, own, known = np.empty((7, N_JOINTS)), np.empty(N_JOINTS), env.estimate, model.filter
    for i in range(N_JOINTS):
        samples[0, i], samples[1, i] = env.measured[0, i], env.measured[1, i]
        for order in range(3):
            samples[2 + order, i] = env.reference[order, i]
        samples[5, i], samples[6, i] = -model.limits[0, i], model.limits[0, i]
    if env.step == 0:
        for k in range(own.shape[0]):
            own[k] = math.nan
    frames, gravity, inertia, drives = empty_machine(model)
    chain = frames.copy(), gravity.copy(), inertia.copy(), drives.copy()  # arrays of the kind that the filter makes
    estimate_and_control(known, chain, samples, own, tau)
    copy_array(env.estimated_tau, tau)
    seen = env.seen
    for i in range(N_JOINTS):
        seen.estimated_torque[i] = tau[i] / model.limits[0, i]
        seen.estimated_error[i] = env.reference[0, i] - own[ANGLES + i]
        seen.estimated_rate[i] = env.reference[1, i] - own[VELOCITIES + i]
    seen.estimated_payload = own[0]
    seen.payload_deviation = math.sqrt(max(0.0, own[known.size]))
    seen.estimated_friction = own[FRICTION]


def _add_to_estimated(env: Any, model: Any) -> None:
    """Write the torques of the estimate's controller plus the action's, within the limits."""
    tau = np.empty(N_JOINTS)
    for i in range(N_JOINTS):
        limit = model.limits[0, i]
        wanted = env.estimated_tau[i] + RESIDUAL_SHARE[i] * limit * min(1.0, max(-1.0, env.action[i]))
        tau[i] = env.tau[i] = min(limit, max(-limit, wanted))
    replace_command(model.filter, env.estimate, tau)


ESTIMATE, ADD_TO_ESTIMATED = Kernel(_estimate, error_model="numpy"), Kernel(_add_to_estimated)
