"""MinTorqueMove: move a three-link arm from rest to rest in a given time with as little torque as possible."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from envs.arms import angle_bound, arm_of, quickness, require_limits, require_observed, scale_of, scaled_view
from envs.environment import PlanarArmEnv
from envs.min_torque_move import kernels
from envs.min_torque_move.moves import MOST_SHARE, Move, random_move
from envs.observation import Entry, Layout, Observation
from envs.physics.actuation import ControlMode
from envs.settings import Settings
from envs.task import LimitSettings, Task, whole_periods
from planners import PLANAR_3R, FixedJoints, Infeasible, MotionProblem, lagrange, quintic
from planners.control import Gains
from planners.motion.time_laws import SHAPES
from planners.robot.arm import Arm

Angles = tuple[float, ...]

LEAST_TURN = 1e-6
"""Rotation of a joint, rad, below which a move is none: it takes no torque in a horizontal plane."""


class MinTorqueMoveConfig(LimitSettings):
    """Settings of MinTorqueMove-v0.

    Attributes:
        horizon: longest move that is drawn, s.
        angle_tolerance: largest error of a joint angle at the end that counts as reached, rad.
        velocity_tolerance: largest joint velocity at the end that counts as at rest, rad/s.
        miss_penalty: cost of ending just outside the tolerances; twice that where far outside.
    """

    control_mode: Literal["torque", "motion"] = "torque"
    control_period: float = Field(0.005, gt=0.0)
    physics_step: float = Field(0.001, gt=0.0)
    angle_tolerance: float = Field(0.02, gt=0.0)
    velocity_tolerance: float = Field(0.05, gt=0.0)
    miss_penalty: float = Field(2.0, ge=0.0)


class MinTorqueMoveOptions(Settings):
    """Options of ``reset``: what is left out is drawn (``"random"``) or the paper's (``"paper"``).

    Attributes:
        scenario: ``"random"`` or ``"paper"``: 0 -> 1 rad with joint 1, the others at 0, in 1 s.
        start: joint angles at the start, rad.
        goal: joint angles to reach, rad.
        duration: time for the move, s; a multiple of the control period.
        torque_share: part of the torque limits that the quintic needs in a drawn move, which decides its time; drawn
            from 0.3 to 0.9 where left out. It is looked at in 33 moments; between them the torque is up to 2 % larger.
    """

    scenario: Literal["random", "paper"] = "random"
    start: Angles | None = None
    goal: Angles | None = None
    duration: float | None = Field(None, gt=0.0)
    torque_share: float | None = Field(None, ge=0.1, le=MOST_SHARE)


def paper_move(arm: Arm) -> Move:
    """The move of the paper's examples, but from rest to rest: joint 1 turns by 1 rad in 1 s."""
    return Move(np.zeros(arm.n_joints), np.eye(arm.n_joints)[0], 1.0)


def layout_of(arm: Arm) -> Layout:
    """What an observation of MinTorqueMove-v0 holds with an arm; scales follow from its limits and torques."""
    joints, most = (arm.n_joints,), float(arm.limits.array("torque").max())
    speed = 5.0 * math.sqrt(scale_of(arm, "acceleration", PLANAR_3R))
    strength = 20.0 * scale_of(arm, "acceleration", PLANAR_3R)
    return Layout(
        (
            Entry("joint_position", joints, math.pi, angle_bound(arm), "rad", "angles of the joints"),
            Entry("joint_velocity", joints, speed, 20.0, "rad/s", "their velocities"),
            Entry(
                "joint_acceleration",
                joints,
                strength,
                100.0,
                "rad/s^2",
                "their mean accelerations over the last period",
            ),
            Entry("goal", joints, math.pi, angle_bound(arm), "rad", "angles to reach"),
            Entry("goal_error", joints, 1.0, max(20.0, _widest(arm)), "rad", "from the angles to the goal"),
            Entry("torque_limit", joints, most, 10.0, "N m", "largest torque of each joint"),
            Entry("time_left", (), 1.0, 60.0, "s", "until the move must be done"),
            Entry(
                "quintic_torque",
                (),
                0.5 * most,
                100.0,
                "N m",
                "summed absolute torque of the quintic, mean over the move",
            ),
        )
    )


def _widest(arm: Arm) -> float:
    """Width of the widest joint range that is finite, rad."""
    widths = 2.0 * arm.limits.angle_half
    return float(widths[np.isfinite(widths)].max(initial=0.0))


def moving_arm(config: MinTorqueMoveConfig) -> Arm:
    """The arm of the settings without its jerk limits: torques may jump."""
    arm = arm_of(config, PLANAR_3R)
    return replace(arm, limits=replace(arm.limits, jerk=(math.inf,) * arm.n_joints))


LAYOUT = layout_of(PLANAR_3R)
"""What an observation of MinTorqueMove-v0 holds with its own arm."""

VIEW = (-0.95, 0.95, -0.9, 0.9)
"""Part of the plane that a frame shows with its own arm, m."""


class MinTorqueMove(Task):
    """The minimal-torque move over a batch of environments; `MinTorqueMoveEnv` documents it."""

    env_id = "MinTorqueMove-v0"
    config_type = MinTorqueMoveConfig
    options_type = MinTorqueMoveOptions
    kernels: ClassVar[Any] = kernels
    default_arm = PLANAR_3R
    physics = ("pymunk", "closed_form")
    layout = LAYOUT
    reward_terms = ("effort", "goal", "limits")
    outcomes: ClassVar = {
        "torque_l1": "PI1, the integral of the summed absolute torques, N m s; NaN for a move cut short",
        "torque_l2": "PI2, the integral of the summed squared torques, N^2 m^2 s; NaN for a move cut short",
        "quintic_ratio": "PI1 over that of the quintic; NaN for a move cut short",
        "angle_error": "largest error of a joint angle, rad",
        "velocity_error": "largest joint velocity, rad/s",
        "peak_torque": "largest torque of any joint, N m",
    }
    gauges = ("angle",)
    view = VIEW
    config: MinTorqueMoveConfig

    def __init__(self, config: MinTorqueMoveConfig, num_envs: int) -> None:
        arm, gains = moving_arm(config), Gains.sampled(config.control_period)
        require_limits(arm, ["torque"], self.env_id)
        self.layout = layout_of(arm)
        self.view = scaled_view(VIEW, arm, PLANAR_3R)
        constants = {
            "whole_motion": config.control_mode == "motion",
            "position_gain": gains.position,
            "velocity_gain": gains.velocity,
        }
        own = {"motion_kernel": kernels.FOLLOW_MOTION if config.control_mode == "motion" else None}
        super().__init__(config, arm, num_envs, kernels.env_fields(arm.n_joints), constants, kernels=own)

    @classmethod
    def fit(cls, config: MinTorqueMoveConfig) -> MinTorqueMoveConfig:
        """A longer horizon for arms that turn more slowly than the task's own."""
        if config.arm is None or "horizon" in config.model_fields_set:
            return config
        slower = max(1.0, 1.0 / quickness(moving_arm(config), PLANAR_3R))
        periods = math.ceil(slower * config.horizon / config.control_period - 1e-6)
        return config.model_copy(update={"horizon": min(60.0, periods * config.control_period)})

    @staticmethod
    def action_size(config: Any, arm: Arm) -> int:
        """Numbers in an action: one torque per joint, or all coefficients of a motion."""
        return arm.n_joints * (SHAPES if config.control_mode == "motion" else 1)

    @staticmethod
    def actuation_mode(config: Any) -> ControlMode:
        """Torque: the kernels follow a motion by torques."""
        return "torque"

    def draw(self, generators: Sequence[np.random.Generator], options: MinTorqueMoveOptions) -> list[Move]:
        """One feasible move per generator, drawn or given."""
        return [self._move(generator, options) for generator in generators]

    def write_start(self, record: Any, start: Move) -> None:
        """Write start, goal and duration of a move."""
        record["q"], record["goal"] = start.start, start.goal
        record["duration_steps"] = round(start.duration / self.config.control_period)

    def outcome(self, record: Any) -> dict[str, Any]:
        """Torque spent, its ratio to the quintic's, and errors at the end."""
        spent = {"torque_l1": record["torque_l1"], "torque_l2": record["torque_l2"]}
        spent["quintic_ratio"] = record["torque_l1"] / record["quintic_l1"]
        if not record["terminated"]:  # cut short: nothing to compare with a whole move
            spent = dict.fromkeys(spent, math.nan)
        return {name: float(spent[name] if name in spent else record[name]) for name in self.outcomes}

    def motion_problem(self, observation: Observation) -> MotionProblem:
        """Come to rest at the goal when the time is over, from the observed joint state."""
        seen = self.layout.parse(observation)
        return self._problem(seen, FixedJoints(seen["goal"]))

    def picture(self, record: Any) -> dict[str, Any]:
        """The goal, errors, and the torque spent so far over the quintic's."""
        angle, velocity = float(record["angle_error"]), float(record["velocity_error"])
        ratio = float(record["torque_l1"] / record["quintic_l1"])
        return {
            "horizon": int(record["duration_steps"]) * self.config.control_period,
            "target": self.arm.forward_kinematics(record["goal"]),
            "status": (
                ("angle error", f"{angle:.3f} rad", angle <= self.config.angle_tolerance),
                ("velocity", f"{velocity:.3f} rad/s", velocity <= self.config.velocity_tolerance),
                ("torque / quintic's", f"{100.0 * ratio:.0f} %", ratio <= 1.0),
            ),
        }

    def _move(self, generator: np.random.Generator, options: MinTorqueMoveOptions) -> Move:
        """A move drawn or given, and one that can be made in either case."""
        given = options.model_dump(exclude={"scenario", "torque_share"}, exclude_none=True)
        for name in given.keys() & {"start", "goal"}:
            given[name] = np.array(given[name])
            if given[name].shape != (self.arm.n_joints,):
                raise ValueError(
                    f"{name} has {len(given[name])} joint angles; {self.arm.name} needs {self.arm.n_joints}"
                )
        self._require_observable(given)
        share, fixed = options.torque_share, "the paper's" if options.scenario == "paper" else "duration"
        if share is not None and (fixed != "duration" or fixed in given):
            raise ValueError(f"torque_share {share:g} decides the time of a move, and so does {fixed}; leave one out")
        if options.scenario == "random" and len(given) < len(Move._fields):
            move = random_move(generator, self.arm, self.config.control_period, self.config.horizon, share, given)
        else:
            move = (paper_move(self.arm) if options.scenario == "paper" else Move(**given))._replace(**given)
            self._require_observable(move._asdict())
            self._require_possible(move)
        if not self.arm.gravity and float(np.abs(move.goal - move.start).max()) < LEAST_TURN:
            raise ValueError(
                f"start and goal are both {move.goal.tolist()} rad: no torque is needed, in whose units effort is paid"
            )
        return move

    def _require_observable(self, parts: Mapping[str, Any]) -> None:
        """ValueError for ends that observations do not hold, or a time that is no multiple of the control period."""
        for name in ("start", "goal"):
            if name in parts:
                require_observed(self.arm, name, parts[name])
        if "duration" in parts:
            whole_periods(self.config, "duration", parts["duration"])

    def _require_possible(self, move: Move) -> None:
        problem = MotionProblem(self.arm, move.start, FixedJoints(move.goal), move.duration)
        with suppress(Infeasible):
            quintic.plan(problem)
            return
        try:
            lagrange.plan(problem)
        except Infeasible as error:
            raise ValueError(
                f"no motion within the limits goes from {move.start.tolist()} to {move.goal.tolist()} rad in "
                f"{move.duration:g} s: {error}"
            ) from None


class MinTorqueMoveEnv(PlanarArmEnv):
    """Move a three-link arm from rest to rest in a given time with as little torque as possible.

    ## Description
    From L. P. Luo, S. W. Hwang and C. S. Han, "Trajectory planning for torque minimization of robot manipulators using
    the Lagrange interpolation method". The arm (`planners.PLANAR_3R`: 0.2, 0.4 and 0.2 m; 1, 2 and 1 kg) moves in the
    horizontal plane, or with `gravity=9.81` in a vertical one. The paper's own problem fixes no velocity at the ends
    and is ill-posed; here the move is from rest to rest, with limits of torque and joint ranges of +-150 deg on
    joints 2 and 3.

    ## Action space
    Numbers in [-1, 1]; larger ones are clipped, NaN is refused. `control_mode` says what they are:

    * `"torque"`: three torques, shares of (20, 10, 5) N m, for one control period.
    * `"motion"`: 14 coefficients for each joint in turn, in units of 5, 5/2, ... rad, which bend the quintic from start
      to goal (`planners.motion.time_laws`). The first action of an episode is the whole motion: computed torque tracks
      it to the end, and later actions are ignored. No expert acts in this mode.

    ## Rewards
    The sum of three terms:

    * `effort`: minus the integral of the summed absolute torques over the period, divided by that of a quintic over
      the whole move: an episode's sum is -1 for a move as good as the quintic.
    * `goal`: at the end, 0 within tolerance; otherwise minus `miss_penalty` x (1 to 2, by the logarithm of the error).
      Missing the goal costs at least 2, twice the effort of the quintic, so it never pays.
    * `limits`: for each control period outside a joint range, minus `limit_penalty` x (1 + excess, at most 2).

    ## Starting state
    `reset(options={"scenario": "paper"})` is the paper's move, (0, 0, 0) -> (1, 0, 0) rad in 1 s. Otherwise start,
    goal and duration are drawn, long moves and folded postures among them; the quintic takes at most 90 % of the torque
    limits and keeps the joint ranges, so each is solvable. `start`, `goal` and `duration` fix any of these, and the
    others are drawn to fit; `torque_share`, in place of `duration`, fixes the quintic's share of the limits. A move
    that the planners cannot solve, or that goes nowhere in a horizontal plane, is refused with the reason.

    ## Episode end
    Terminated when the duration is over: the task ends there, and the observation holds the time left.
    Success: every joint within 0.02 rad of the goal and at 0.05 rad/s or less.

    ## Difficulty
    Harder with `gravity=9.81` (a vertical plane), a `payload` (no policy observes it), tighter tolerances or another
    `arm`, of up to six links; in torque mode an episode has one decision per control period, in motion mode one in all.

    ## Version history
    * v0: the first version.
    """

    task_type = MinTorqueMove
