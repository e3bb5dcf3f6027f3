"""ExcavatorPayload: track a motion with boom, arm and bucket while the bucket holds an unknown payload."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from envs.environment import PlanarArmEnv
from envs.excavator_payload import estimation, kernels, reference, world
from envs.excavator_payload.hidden import Hidden, HiddenDraw
from envs.excavator_payload.reference import Waypoints
from envs.observation import Entry, Layout, Observation
from envs.physics.actuation import ControlMode
from envs.settings import Settings
from envs.task import Task, TaskSettings, whole_periods
from envs.uncertainty.draw import Positive, Uncertainty
from planners import FixedJoints, MotionProblem
from planners.excavator.controllers import TYPICAL_PAYLOAD, make_controller
from planners.excavator.plane import planar_arm
from planners.typing import Array

Angles = tuple[float, float, float]

PLANNED_SHARE = 0.65
"""Share of the torque limits that a plan may use."""
FULL_REWARD = 10.0
"""Return of an episode without any error."""


class ExcavatorPayloadConfig(TaskSettings):
    """Settings of ExcavatorPayload-v0.

    Attributes:
        control_mode: ``"torque"``; ``"residual"`` to add to the torque of a controller for the empty bucket, or
            ``"estimated"`` to that of the expert ``kalman``, whose estimate is observed then.
        payload: heaviest drawn payload, kg.
        lightest: lightest drawn payload, kg; equal to ``payload`` for a known one.
        level: 1, or 2 for drives that lag by 30 ms and a payload that is picked up and dropped during the episode.
        rms_tolerance: largest root mean square of the tip error that counts as a success, m.
        peak_tolerance: largest tip error that counts as a success, m.
        reward_distance: tip error from which on the tracking reward is 0, m.
        smoothness_weight: cost of a change of the action by 1 in one step, in units of the reward of a perfect step.
        failure_penalty: cost of an episode that ends early because a joint left its range or was too fast.
    """

    control_mode: Literal["torque", "residual", "estimated"] = "torque"
    horizon: float = Field(12.0, gt=0.0, le=reference.LONGEST_HORIZON)
    payload: float = Field(350.0, ge=0.0, le=350.0)
    lightest: float = Field(0.0, ge=0.0)
    level: Literal[1, 2] = 1
    encoder_noise: Positive = 1e-4
    rms_tolerance: float = Field(5e-3, gt=0.0)
    peak_tolerance: float = Field(15e-3, gt=0.0)
    reward_distance: float = Field(0.1, gt=0.0)
    smoothness_weight: float = Field(0.01, ge=0.0)
    failure_penalty: float = Field(2.0, ge=0.0)

    @field_validator("lightest")
    @classmethod
    def _no_heavier_than_the_heaviest(cls, lightest: float, others: ValidationInfo) -> float:
        if lightest > others.data.get("payload", math.inf):
            raise ValueError(f"heavier than payload, which is {others.data['payload']} kg; raise that, or lower this")
        return lightest


Offset = Annotated[float, Field(ge=-1.0, le=1.0)]
"""Offset of a payload, m: a bucket is not larger."""


class ExcavatorPayloadOptions(Settings):
    """Options of ``reset``: what is left out is drawn.

    Attributes:
        scenario: ``"random"``, or ``"cycle"`` for the waypoints of `planners.excavator.motion.WORK_CYCLE`.
        payload: mass of the payload, kg.
        payload_offset: offset of its centre from the nominal place, in the frame of the bucket, m.
        friction_scale: factor on the joints' friction.
        waypoints: joint angles of the waypoints, rad; the episode starts at the first.
        arrival_times: time at which each waypoint after the first is due, s; as early as the limits allow by default.
    """

    scenario: Literal["random", "cycle"] = "random"
    payload: float | None = Field(None, ge=0.0, le=350.0)
    payload_offset: tuple[Offset, Offset] | None = None
    friction_scale: float | None = Field(None, ge=0.0, le=5.0)
    waypoints: tuple[Angles, ...] | None = None
    arrival_times: tuple[float, ...] | None = None


LAYOUT = Layout(
    (
        Entry("joint_position", (3,), math.pi, 4.0, "rad", "measured angles of boom, arm and bucket"),
        Entry("joint_velocity", (3,), 1.0, 20.0, "rad/s", "their measured velocities"),
        Entry("reference_error", (3,), 0.2, 20.0, "rad", "reference minus measured angle"),
        Entry("reference_velocity", (3,), 1.0, 5.0, "rad/s", "velocity of the reference"),
        Entry("reference_acceleration", (3,), 2.0, 10.0, "rad/s^2", "acceleration of the reference"),
        Entry("reference_ahead", (3, 3), 0.3, 20.0, "rad", "reference in 0.1, 0.2 and 0.4 s minus reference now"),
        Entry(
            "error_integral", (3,), 0.1, 200.0, "rad s", "control period times the sum of the errors observed before"
        ),
        Entry("last_torque", (3,), 1.0, 1.0, "-", "commanded in the last control period, shares of the torque limits"),
        Entry("waypoint", (3,), math.pi, 1.0, "rad", "angles of the next waypoint"),
        Entry("waypoint_time", (), 1.0, 10.0, "s", "until it is due"),
        Entry("time_left", (), 12.0, 5.0, "s", "until the episode ends"),
    )
)
"""What an observation of ExcavatorPayload-v0 holds."""


class Start(NamedTuple):
    """Start of an episode: the hidden quantities, the key of the noise, and waypoints or the numbers to draw them."""

    hidden: Hidden
    noise_key: int
    numbers: Array
    waypoints: Waypoints | None


def _gains(period: float, needed: bool) -> dict[str, Any]:
    """What the controller in residual mode adds its torque with; zero where it is not ``needed``."""
    if not needed:
        return {"bandwidth": np.zeros(world.N_JOINTS), "damping": np.zeros(world.N_JOINTS)}
    gains = make_controller("slotine-li", planar=True, period=period).settings
    return {"bandwidth": gains.bandwidth, "damping": gains.bandwidth * gains.inertia}


class ExcavatorPayload(Task):
    """Tracking with an unknown payload over a batch of environments; `ExcavatorPayloadEnv` documents it."""

    env_id = "ExcavatorPayload-v0"
    config_type = ExcavatorPayloadConfig
    options_type = ExcavatorPayloadOptions
    kernels: ClassVar[Any] = kernels
    physics = ("pymunk", "closed_form")
    layout = LAYOUT
    reward_terms = ("tracking", "smoothness", "failure")
    outcomes: ClassVar = {
        "success_easy": "whether the errors were within twice the tolerances",
        "tip_rms": "root mean square of the tip error when judged, m; inf after a failure and NaN if nothing was "
        "judged, like the next three",
        "tip_max": "largest tip error when judged, m",
        "joint_rms": "root mean square of the joints' errors when judged, rad",
        "waypoint_error": "largest distance of the tip from a waypoint when it was due, when judged, m",
        "payload_mass": "the payload, kg",
        "friction_scale": "the factor on the friction",
        "torque_l1": "integral of the summed absolute commanded torques, N m s",
        "peak_torque": "largest commanded torque of any joint, N m",
    }
    boolean_outcomes = ("success_easy",)
    gauges = ("velocity",)
    view = (-0.7, 4.3, -1.6, 3.6)
    measures = True
    config: ExcavatorPayloadConfig

    def __init__(self, config: ExcavatorPayloadConfig, num_envs: int) -> None:
        steps = whole_periods(config, "horizon", config.horizon)
        residual, estimated = config.control_mode == "residual", config.control_mode == "estimated"
        constants = {
            "residual": residual or estimated,
            "estimated": estimated,
            **_gains(config.control_period, residual),
            "judged_after": steps // 3,
            "settling_steps": steps // 6,
            "step_reward": FULL_REWARD / steps,
            **world.machine_constants(config.physics_step, world.LAG if config.level == 2 else 0.0),
            **reference.dynamics_constants(),
        }
        fields = world.ENV_FIELDS + reference.ENV_FIELDS + kernels.ENV_FIELDS
        own = {
            **world.machine_kernels(config.physics),
            "residual_kernel": kernels.ADD_TO_CONTROLLER if residual else None,
            "estimate_kernel": None,
        }
        arm = planar_arm()
        if estimated:
            settings = estimation.filter_settings(config, Uncertainty(config, arm))
            constants["filter"] = settings.record()[0]
            fields = [*fields, ("estimate", "f8", (settings.width,)), ("estimated_tau", "f8", (world.N_JOINTS,))]
            own |= {"residual_kernel": estimation.ADD_TO_ESTIMATED, "estimate_kernel": estimation.ESTIMATE}
            self.layout = Layout((*LAYOUT.entries, *estimation.ENTRIES))
        super().__init__(config, arm, num_envs, fields, constants, kernels=own)
        reference.write_kernels(self._batch.model)
        self._hidden = HiddenDraw(config.lightest, config.payload, steps, changes=config.level == 2)
        limits = self.arm.limits
        self._planning_limits = replace(limits, torque=tuple(PLANNED_SHARE * torque for torque in limits.torque))

    @staticmethod
    def actuation_mode(config: Any) -> ControlMode:
        """Torque: a residual is a torque, too."""
        return "torque"

    def draw(self, generators: Sequence[np.random.Generator], options: ExcavatorPayloadOptions) -> list[Start]:
        """One start per generator: hidden quantities, noise and reference, drawn or given."""
        given, shape = self._given_waypoints(options), reference.numbers_needed(self.config.horizon)
        own = options.payload, options.payload_offset, options.friction_scale
        if options.payload is not None and options.payload > self.config.payload:
            raise ValueError(
                f"payload {options.payload:g} kg is heavier than the heaviest, the setting payload of "
                f"{self.config.payload:g} kg; raise that"
            )
        return [
            Start(self._hidden.draw(generator, *own), int(generator.integers(2**63)), generator.random(shape), given)
            for generator in generators
        ]

    def write_start(self, record: Any, start: Start) -> None:
        """Write the hidden quantities, and the waypoints or those that the drawn numbers give."""
        start.hidden.write(record)
        record["noise_key"] = start.noise_key
        if start.waypoints is None:
            memory = self._batch
            reference.draw_reference(memory.records, memory.model, int(record["env_index"]), start.numbers)
        else:
            start.waypoints.write(record)

    def outcome(self, record: Any) -> dict[str, Any]:
        """Errors, torques, and the hidden payload and friction."""
        steps, failed = int(record["judged_steps"]), bool(record["terminated"])
        judged, unknown = steps > 0 and not failed, math.inf if failed else math.nan
        tip_rms = math.sqrt(record["tip_squares"] / steps) if judged else unknown
        tip_max = float(record["tip_max"]) if judged else unknown
        easy = tip_rms <= 2.0 * self.config.rms_tolerance and tip_max <= 2.0 * self.config.peak_tolerance
        return {
            "success_easy": easy,
            "tip_rms": tip_rms,
            "tip_max": tip_max,
            "joint_rms": math.sqrt(record["joint_squares"] / (steps * self.arm.n_joints)) if judged else unknown,
            "waypoint_error": float(record["waypoint_error"]) if judged else unknown,
            "payload_mass": float(record["payload"]),
            "friction_scale": float(record["friction_scale"]),
            "torque_l1": float(record["torque_l1"]),
            "peak_torque": float(record["peak_torque"]),
        }

    def motion_problem(self, observation: Observation) -> MotionProblem:
        """Come to rest at the next waypoint when it is due, from the state of the reference.

        The motion starts from the reference and not from the noisy measurements: a controller tracks it. The arm is
        `planners.excavator.plane.planar_arm`, in the same joint angles, with a payload of 175 kg; 35 % of its torque
        limits are kept for what it leaves out and for heavier payloads.
        """
        seen = self.layout.parse(observation)
        state = {
            "joint_position": seen["joint_position"] + seen["reference_error"],
            "joint_velocity": seen["reference_velocity"],
            "joint_acceleration": seen["reference_acceleration"],
            "time_left": seen["waypoint_time"],
        }
        target = FixedJoints(seen["waypoint"])
        return self._problem(state, target, limits=self._planning_limits, payload=TYPICAL_PAYLOAD)

    def hand_position(self, env_index: int) -> Array:
        """Position of the tip of the tool, ``(2,)``, m."""
        tip: Array = self._batch.record(env_index)["tip"].copy()
        return tip

    def picture(self, record: Any) -> dict[str, Any]:
        """The bucket and its payload, the reference of its tip, and the tip's errors."""
        joints = self.arm.joint_positions(record["q"])
        joints[-1] = record["tip"]
        error, judged = float(record["tip_error"]), int(record["judged_steps"])
        rms = math.sqrt(record["tip_squares"] / max(1, judged))
        return {
            "joints": joints,
            "target": record["wanted_tip"].copy(),
            "status": (
                ("tip error", f"{1e3 * error:.1f} mm", error <= self.config.peak_tolerance),
                (
                    "rms when judged",
                    f"{1e3 * rms:.1f} mm" if judged else "-",
                    judged > 0 and rms <= self.config.rms_tolerance,
                ),
                ("load", f"{float(record['load']):.0f} kg", True),
            ),
            "bucket": float(record["load"]) / reference.HEAVIEST,
            "ground": 0.0,
        }

    def _given_waypoints(self, options: ExcavatorPayloadOptions) -> Waypoints | None:
        if options.waypoints is None and options.arrival_times is not None:
            raise ValueError("arrival_times are given without waypoints; give both")
        if options.waypoints is not None:
            return reference.given_waypoints(self._batch.model, np.array(options.waypoints), options.arrival_times)
        return reference.work_cycle(self._batch.model, self.config.horizon) if options.scenario == "cycle" else None


class ExcavatorPayloadEnv(PlanarArmEnv):
    """Track a motion with boom, arm and bucket of an excavator that holds an unknown payload.

    ## Description
    After "A Study on Motion Control and Kinematics Analysis of Articulated Manipulator Attachment for Excavator". The
    machine is the attachment of `planners.excavator` in its vertical plane: boom 2.45 m, arm 1.40 m, bucket with its
    tip 0.65 m from its joint; 270, 165 and 180 kg; the base of the boom 0.9 m above the ground. Joint angles are those
    of the attachment's joints 2 to 4. Centres of mass are off the links' axes, and the joints have viscous friction
    (1200, 700 and 250 N m s/rad).

    Hidden in every episode: the payload (0 to 350 kg, uniform), the offset of its centre in the bucket (up to 0.10 m
    and 0.08 m along either axis), and a factor of 0.7 to 1.5 on the friction. The tip error of a controller for the
    empty bucket is 10 to 50 cm with a heavy payload.

    ## Action space
    Three numbers in [-1, 1]; larger ones are clipped, NaN is refused. `control_mode` says what they are:

    * `"torque"`: shares of the torque limits, 45, 22 and 10 kN m.
    * `"residual"`: shares of 18, 8.8 and 3 kN m, added to the torque of Slotine and Li's controller for the empty
      bucket, without adaptation (`planners.control.SlotineLi`); the sum is clipped at the limits.
    * `"estimated"`: the same shares, added to the torque of the expert `kalman`, which runs inside the environment. Its
      torque and its estimate are observed besides, 12 more numbers: `envs.excavator_payload.estimation.ENTRIES`.

    ## Observation space
    Angles and velocities have noise (standard deviations 1e-4 rad and 5e-3 rad/s; `encoder_noise=0` for none). At
    the start `last_torque` is the torque that holds the empty machine.

    ## Starting state
    At rest at the first waypoint of the reference: quintics from rest to rest through waypoints drawn in boom
    [-10, 55], arm [-110, -40] and bucket [-20, 70] deg. Each segment takes 1 to 1.5 times the larger of 1.2 s
    and the time at 85 % of the speed limits (0.7, 0.8 and 1.6 rad/s); it is drawn again where inverse dynamics with 350
    kg need more than 85 % of a torque limit.
    `reset(options={"scenario": "cycle"})` repeats the lifting cycle of `planners.excavator.motion.WORK_CYCLE`;
    `waypoints` and `arrival_times` set the motion, and `payload`, `payload_offset` and `friction_scale` the hidden
    quantities. A motion that the machine cannot make with 350 kg is refused with the reason.

    ## Rewards
    The sum of three terms. An episode without any error is worth 10, which its steps share equally:

    * `tracking`: a step's share times 1 - error / `reward_distance` (0.1 m), not below 0; the error is the distance of
      the true tip of the bucket from the reference's.
    * `smoothness`: minus a step's share times `smoothness_weight` x the square of the change of the action.
    * `failure`: minus `failure_penalty` (2) where the episode ends early. The remaining steps could cost at most 1.2,
      so a failure never pays.

    ## Difficulty
    `level=2`: the drives follow the commanded torque with a lag of 30 ms, and the bucket is empty at first, picks the
    payload up at a time drawn from 3 to 5 s, and drops it between 8 and 9 s (in proportion for another `horizon`).
    Easier in residual mode, without `encoder_noise`, or with a payload that is known: `lightest` equal to `payload`.

    ## Episode end
    Truncated after `horizon` (12 s). Terminated, as a failure, where a joint is faster than 6 rad/s or 30 deg outside
    the range of the waypoints. Success: over the last two thirds of the episode (after 4 s) the root mean square of the
    tip error is at most 5 mm, and the largest at most 15 mm. On level 2 the sixth of the episode (2 s) after a change
    of the payload does not count either.

    ## Version history
    * v0: the first version.
    """

    task_type = ExcavatorPayload
