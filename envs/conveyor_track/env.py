"""ConveyorTrack: bring the hand of a SCARA arm to a part on a conveyor belt, and follow it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from envs.arms import angle_bound, arm_of, scale_of, scaled_view
from envs.conveyor_track import kernels
from envs.conveyor_track.belt import PAPER_START, Demands, Start, pace_of, placed, posture, require_solvable, side
from envs.conveyor_track.starts import draw_starts
from envs.environment import PlanarArmEnv
from envs.observation import Entry, Layout, Observation
from envs.physics.actuation import ControlMode
from envs.rendering import Belt
from envs.settings import Settings
from envs.task import LimitSettings, Task, whole_periods
from envs.uncertainty.draw import Number, Positive, ends
from planners import SCARA_1M, Arm, MotionProblem, MovingHand
from planners.typing import Array


class ConveyorTrackConfig(LimitSettings):
    """Settings of ConveyorTrack-v0.

    Attributes:
        belt_acceleration: acceleration of the belt along its direction, m/s^2.
        camera_noise: standard deviation of the observed position of the part, along either axis, m; that of its
            velocity is this over the control period.
        position_tolerance: largest distance between hand and part that counts as settled, m.
        velocity_tolerance: largest relative velocity that counts as settled, m/s.
        hold_time: time at the end of the episode for which the hand must be settled for a success, s.
        relative_motion: whether an observation also holds velocity and acceleration of the part relative to the hand.
            They follow from the other entries, and networks learn faster with them.
    """

    control_mode: ControlMode = "torque"
    belt_acceleration: float = Field(0.0, ge=-1.0, le=1.0)
    camera_noise: Positive = 0.0
    position_tolerance: float = Field(1e-3, gt=0.0)
    velocity_tolerance: float = Field(2e-3, gt=0.0)
    hold_time: float = Field(0.5, gt=0.0)
    relative_motion: bool = False


class ConveyorTrackOptions(Settings):
    """Options of ``reset``: what is left out is drawn (``"random"``) or the paper's (``"paper"``).

    A number may also be a range ``[low, high]``, from which each episode draws its own.

    Attributes:
        scenario: ``"random"`` or ``"paper"``.
        belt_speed: speed of the belt at the start, along +x, m/s.
        offset: D of eq 2, the lead of the hand over the part at the start, m.
        line_height: y coordinate of the belt, from the base, m.
        hand_x: x coordinate of the hand at the start, from the base, m.
        elbow: sign of the elbow angle at the start, ``"+"`` or ``"-"``.
        beside: y coordinate of the hand at the start less that of the belt, m; 0 where left out.
    """

    scenario: Literal["random", "paper"] = "random"
    belt_speed: Number | None = None
    offset: Number | None = None
    line_height: Number | None = None
    hand_x: Number | None = None
    elbow: Literal["+", "-"] | None = None
    beside: Number | None = None


def layout_of(arm: Arm, relative_motion: bool = False) -> Layout:
    """What an observation of ConveyorTrack-v0 holds with an arm; scales follow from its reach and its limits."""
    joints, size = (arm.n_joints,), arm.reach / SCARA_1M.reach
    speed, strength = (scale_of(arm, kind, SCARA_1M) for kind in ("velocity", "acceleration"))
    belt = size * max(1.0, pace_of(Demands(3.0, 0.5, arm=arm)))
    relative = (
        Entry("relative_velocity", (2,), 0.2 * belt, 100.0, "m/s", "velocity of the part relative to the hand"),
        Entry(
            "relative_acceleration",
            (2,),
            0.3 * size * strength,
            1000.0,
            "m/s^2",
            "acceleration of the part less the mean acceleration of the hand over the last period",
        ),
    )
    return Layout(
        (
            Entry("joint_position", joints, math.pi, angle_bound(arm), "rad", "angles of the joints"),
            Entry("joint_velocity", joints, 0.2 * speed, 50.0, "rad/s", "their velocities"),
            Entry(
                "joint_acceleration",
                joints,
                0.3 * strength,
                100.0,
                "rad/s^2",
                "their mean accelerations over the last period",
            ),
            Entry("hand", (2,), size, 4.0, "m", "position of the hand, from the base"),
            Entry("part", (2,), size, 8.0, "m", "position of the part, from the base"),
            Entry("part_error", (2,), 0.1 * size, 80.0, "m", "from the hand to the part"),
            Entry("part_velocity", (2,), 0.2 * belt, 50.0, "m/s", "velocity of the part"),
            Entry("part_acceleration", (2,), 0.2, 50.0, "m/s^2", "acceleration of the part"),
            Entry("time_left", (), 3.0, 20.0, "s", "until the episode ends"),
            Entry(
                "settled", (), 1.0, 1.0, "-", "share of the episode for which the hand has been settled without a break"
            ),
            *(relative if relative_motion else ()),
        )
    )


LAYOUT = layout_of(SCARA_1M)
"""What an observation of ConveyorTrack-v0 holds with its own arm."""

VIEW = (-1.5, 1.3, -0.25, 2.1)
"""Part of the plane that a frame shows with its own arm, m."""


class ConveyorTrack(Task):
    """The conveyor-tracking task over a batch of environments; `ConveyorTrackEnv` documents it."""

    env_id = "ConveyorTrack-v0"
    config_type = ConveyorTrackConfig
    options_type = ConveyorTrackOptions
    kernels: ClassVar[Any] = kernels
    default_arm = SCARA_1M
    physics = ("pymunk", "closed_form")
    layout = LAYOUT
    reward_terms = ("progress", "settling", "limits")
    outcomes: ClassVar = {
        "settling_time": "time from which on both errors stay within tolerance, s; inf if they do not",
        "steady_state_error": "largest position error over the last `hold_time`, m; NaN for an episode cut short",
        "lq_cost": "J of eq 18, lengths in units of the paper's 0.5 m path; NaN for an episode cut short",
        "peak_torque": "largest torque of any joint, N m",
    }
    gauges = ("velocity", "acceleration", "jerk")
    view = VIEW
    config: ConveyorTrackConfig

    def __init__(self, config: ConveyorTrackConfig, num_envs: int) -> None:
        constants = {"hold_steps": whole_periods(config, "hold_time", config.hold_time)}
        arm = arm_of(config, SCARA_1M)
        self.layout = layout_of(arm, config.relative_motion)
        self.view = scaled_view(VIEW, arm, SCARA_1M, mirrored=side(arm) < 0.0)
        own = {"relative_kernel": kernels.RELATIVE if config.relative_motion else None}
        super().__init__(config, arm, num_envs, kernels.ENV_FIELDS, constants, kernels=own)
        self._demands = Demands(
            config.horizon, config.hold_time, config.belt_acceleration, ends(config.payload)[0], arm
        )

    def draw(self, generators: Sequence[np.random.Generator], options: ConveyorTrackOptions) -> list[Start]:
        """One start per generator, drawn or given, for which DPCT has a motion within all limits."""
        given = options.model_dump(exclude={"scenario"}, exclude_none=True)
        if "elbow" in given:
            given["elbow"] = 1.0 if given["elbow"] == "+" else -1.0
        if options.scenario == "paper":
            pace = min(1.0, pace_of(self._demands._replace(payload=0.0))) if self.config.arm else 1.0
            given = {**placed(self.arm, PAPER_START, pace)._asdict(), **given}
            if not any(isinstance(value, tuple) for value in given.values()):
                start = Start(**given)
                require_solvable(start, self._demands)
                return [start] * len(generators)
        return draw_starts(generators, given, self._demands)

    def write_start(self, record: Any, start: Start) -> None:
        """Write the posture, the part's position and the belt's motion."""
        base = self.arm.base_array
        record["q"] = posture(self.arm, start)
        record["part_position"] = base + np.array([start.hand_x - start.offset, start.line_height])
        record["part_velocity"] = start.belt_speed, 0.0
        record["part_acceleration"] = self.config.belt_acceleration, 0.0

    def outcome(self, record: Any) -> dict[str, Any]:
        """Settling time, steady-state error, J of eq 18 and peak torque."""
        settled, whole = int(record["settled_steps"]), bool(record["step"] >= self.horizon_steps)
        return {
            "settling_time": self._seconds_held(record, settled) if settled else math.inf,
            "steady_state_error": float(record["steady_state_error"]) if whole else math.nan,
            "lq_cost": float(record["lq_cost"]) if whole else math.nan,
            "peak_torque": float(record["peak_torque"]),
        }

    def hand_goal(self, seen: dict[str, Array]) -> tuple[Array, Array, Array]:
        """The part: position, velocity and acceleration, each ``(..., 2)``."""
        return seen["part"] + self.arm.base_array, seen["part_velocity"], seen["part_acceleration"]

    def motion_problem(self, observation: Observation) -> MotionProblem:
        """Meet the part within the time left, from the observed joint state."""
        seen = self.layout.parse(observation)
        return self._problem(seen, MovingHand(*self.hand_goal(seen)))

    def picture(self, record: Any) -> dict[str, Any]:
        """The part on its belt, errors, and for how long the hand has been settled."""
        part, settled = record["part_position"], int(record["settled_steps"])
        error, velocity_error = float(record["error"]), float(record["velocity_error"])
        travel = float(part[0] - record["belt_start"][0])
        return {
            "part": part.copy(),
            "belt": self._belt(float(part[1]), travel),
            "status": (
                ("position error", f"{1e3 * error:.2f} mm", error <= self.config.position_tolerance),
                (
                    "velocity error",
                    f"{1e3 * velocity_error:.2f} mm/s",
                    velocity_error <= self.config.velocity_tolerance,
                ),
                ("settled", f"{settled * self.config.control_period:.2f} s", settled > 0),
            ),
            "settled": settled > 0,
        }

    def _belt(self, y: float, travel: float) -> Belt:
        size, x = self.arm.reach / SCARA_1M.reach, self.arm.base[0]
        ends = np.array([x - 1.4 * size, y]), np.array([x + 1.2 * size, y])
        return Belt(*ends, travel=travel, width=0.26 * size)


class ConveyorTrackEnv(PlanarArmEnv):
    """Bring the hand of a two-link SCARA arm to a part on a conveyor belt, and follow it.

    ## Description
    From T. H. Park, B. H. Lee and M. S. Ko, "Motion planning of a robot manipulator for conveyor tracking".
    The arm (`planners.SCARA_1M`: two 1 m, 1 kg rods) moves in the horizontal plane and starts at rest with its hand
    on the line of the belt, D metres ahead of the part.

    ## Action space
    Numbers in [-1, 1], one per joint; larger ones are clipped, NaN is refused. `control_mode` says what they scale:
    `"torque"` (0.5 and 0.2 N m), `"acceleration"` (0.3 rad/s^2), `"jerk"` (2.3 and 2.0 rad/s^3) or `"velocity"`
    (99.8 % of 0.2 rad/s, at the end of the period). The last three go through inverse dynamics. In jerk mode the
    velocity, acceleration and jerk limits hold by construction, in velocity mode all but the jerk limits. The actuators
    keep the torque limits in every mode.

    ## Observation space
    With `relative_motion=True` the last four numbers are velocity (unit 0.2 m/s) and acceleration (0.3 m/s^2) of the
    part relative to the hand, `relative_velocity` and `relative_acceleration`.

    ## Rewards
    The sum of three terms:

    * `progress`: increase of -log(error) / log(1000), where error is the larger of position and velocity error in
      units of its tolerance, clipped to [1, 1000]. Its sum over an episode is the improvement from start to end.
    * `settling`: increase of the share of the episode for which the hand has been within tolerance without a break.
      Losing the part takes the share back, so the episode's sum is the share left after the settling time.
    * `limits`: for each control period in which a velocity, acceleration or jerk limit is broken by more than
      `limit_tolerance`, minus `limit_penalty` x (1 + excess, at most 2). One such period costs as much as settling
      immediately could gain.

    Each step's reward is within [-6, 2]. Of two policies that keep the limits, the one that settles earlier gets the
    higher return.

    ## Starting state
    `reset(options={"scenario": "paper"})` is the paper's start: hand at (-0.8, 1.732) m, elbow +, D = 0.1 m, belt
    0.2 m/s. Otherwise belt speed (0.05 to 0.25 m/s), D (-0.2 to 0.2 m), line height (1.5 to 1.8 m), hand position (x
    from -0.8 to -0.3 m) and elbow are drawn, from cells of a grid whose corners DPCT has solved within 97 % of all
    limits (`envs.conveyor_track.starts`). `belt_speed`, `offset`, `line_height`, `hand_x` and `elbow` fix any of these,
    or give another range, and `beside` starts the hand beside the belt's line; a start that DPCT cannot solve is
    refused with its reason.

    ## Episode end
    Truncated after `horizon` (3 s). Never terminated. Success: position error at most 1 mm and velocity error at most
    2 mm/s over the last 0.5 s.

    ## Difficulty
    In jerk mode the limits hold by construction; in torque mode a policy has to keep them itself. Harder with a
    `payload` (no policy observes it), a `belt_acceleration`, tighter tolerances, a longer `hold_time` or another `arm`.

    ## Version history
    * v0: the first version.
    """

    task_type = ConveyorTrack
