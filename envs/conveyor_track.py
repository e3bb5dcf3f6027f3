"""ConveyorTrack: bring the hand of a SCARA arm onto a part that rides on a conveyor belt, and ride with it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numba import njit
from pydantic import Field

from envs import chipmunk
from envs.actuation import apply_action
from envs.arm_env import PlanarArmEnv, PlanarArmVectorEnv
from envs.conveyor_starts import PAPER_START, Demands, Start, draw_starts, require_solvable
from envs.observation import Entry, Layout, Observation
from envs.rendering import Belt, Scene
from envs.settings import Settings
from envs.task import Options, Task, TaskSettings
from envs.world import place_arm
from planners import SCARA_1M, MotionProblem, MovingHand
from planners.kinematics import hand_state_lane, two_link_branch
from planners.typing import Array

LINE_LENGTH = 0.5
"""Length of the paper's path, X_h(t_f) - X_h(t_0), m: the unit of its position r in the index J of eq 18."""

MAX_ERROR = 1000.0
"""Tracking error, in tolerances, from which on the progress term sees no difference: 1 m, 2 m/s by default."""


class ConveyorTrackConfig(TaskSettings):
    """Settings of ConveyorTrack-v0, beside those of every task.

    Attributes:
        belt_acceleration: of the belt along its direction, m/s^2.
        position_tolerance: largest distance between hand and part that counts as settled, m.
        velocity_tolerance: largest relative velocity that counts as settled, m/s.
        hold_time: how long at the end of the episode the hand must be settled for a success, s.
        limit_tolerance: share by which a limit may be exceeded before it counts as broken.
        limit_penalty: cost of one control period in which a limit is broken by little; by 100 % or more it is twice that.
    """

    horizon: float = Field(3.0, gt=0.0, le=60.0)
    control_period: float = Field(0.02, gt=0.0)
    physics_step: float = Field(0.002, gt=0.0)
    payload: float = Field(0.0, ge=0.0, le=10.0)
    belt_acceleration: float = Field(0.0, ge=-1.0, le=1.0)
    position_tolerance: float = Field(1e-3, gt=0.0)
    velocity_tolerance: float = Field(2e-3, gt=0.0)
    hold_time: float = Field(0.5, gt=0.0)
    limit_tolerance: float = Field(0.02, ge=0.0)
    limit_penalty: float = Field(2.0, ge=0.0)


class ConveyorTrackOptions(Settings):
    """Options of ``reset``: what is left out is drawn (``"random"``) or the paper's (``"paper"``).

    Attributes:
        scenario: ``"random"`` or ``"paper"``.
        belt_speed: at the start, along +x, m/s.
        offset: D of eq 2: how far the hand starts ahead of the part, m.
        line_height: y of the belt, m.
        hand_x: x of the hand at the start, m.
        elbow: sign of the elbow angle at the start, ``"+"`` or ``"-"``.
    """

    scenario: Literal["random", "paper"] = "random"
    belt_speed: float | None = None
    offset: float | None = None
    line_height: float | None = None
    hand_x: float | None = None
    elbow: Literal["+", "-"] | None = None


LAYOUT = Layout(
    (
        Entry("joint_position", 2, math.pi, 4.0, "rad", "angles of the joints"),
        Entry("joint_velocity", 2, 0.2, 50.0, "rad/s", "their velocities"),
        Entry("joint_acceleration", 2, 0.3, 100.0, "rad/s^2", "their mean accelerations over the last control period"),
        Entry("hand", 2, 1.0, 4.0, "m", "position of the hand, from the base"),
        Entry("part", 2, 1.0, 8.0, "m", "position of the part, from the base"),
        Entry("part_error", 2, 0.1, 80.0, "m", "from the hand to the part"),
        Entry("part_velocity", 2, 0.2, 50.0, "m/s", "velocity of the part"),
        Entry("part_acceleration", 2, 0.2, 50.0, "m/s^2", "acceleration of the part"),
        Entry("time_left", 1, 3.0, 20.0, "s", "until the episode ends"),
        Entry("settled", 1, 1.0, 1.0, "-", "share of the episode for which the hand has been settled without a break"),
    )
)
"""What an observation of ConveyorTrack-v0 holds."""


class ConveyorTrack(Task):
    """The conveyor-tracking task over a batch of lanes; `ConveyorTrackEnv` documents it."""

    env_id: ClassVar[str] = "ConveyorTrack-v0"
    layout: ClassVar[Layout] = LAYOUT
    reward_terms: ClassVar[tuple[str, ...]] = ("progress", "settling", "limits")
    config: ConveyorTrackConfig

    def __init__(self, config: ConveyorTrackConfig, n_lanes: int) -> None:
        super().__init__(
            config,
            SCARA_1M,
            n_lanes,
            extra_lane=[
                ("part", "i8"),
                ("part_position", "f8", (2,)),
                ("part_velocity", "f8", (2,)),
                ("part_acceleration", "f8", (2,)),
                ("hand", "f8", (2,)),
                ("hand_velocity", "f8", (2,)),
                ("belt_start", "f8", (2,)),
                ("settled_steps", "i8"),
                ("error", "f8"),
                ("velocity_error", "f8"),
                ("steady_state_error", "f8"),
                ("lq_cost", "f8"),
                ("peak_torque", "f8"),
            ],
            extra_model=[
                ("position_tolerance", "f8"),
                ("velocity_tolerance", "f8"),
                ("limit_tolerance", "f8"),
                ("limit_penalty", "f8"),
                ("hold_steps", "i8"),
            ],
        )
        for name in ("position_tolerance", "velocity_tolerance", "limit_tolerance", "limit_penalty"):
            self.model[name] = getattr(config, name)
        self.model["hold_steps"] = self._whole_periods("hold_time", config.hold_time)
        if config.hold_time > config.horizon:
            raise ValueError(f"hold_time {config.hold_time} s is longer than the horizon {config.horizon} s; shorten it")
        self._demands = Demands(config.horizon, config.hold_time, config.belt_acceleration, config.payload)

    @classmethod
    def make(cls, config: Mapping[str, Any], n_lanes: int) -> ConveyorTrack:
        """The task from settings by name; unknown names are refused."""
        return cls(ConveyorTrackConfig.parse(config, f"{cls.env_id} setting"), n_lanes)

    def reset_lanes(self, lanes: Sequence[int], generators: Sequence[np.random.Generator], options: Options) -> None:
        """Begin an episode in some lanes; see `ConveyorTrackOptions`.

        Raises:
            ValueError: for unknown options, or values for which no motion keeps all limits; nothing has changed then.
        """
        chosen = ConveyorTrackOptions.parse(options, f"{self.env_id} option")
        starts = self._starts(generators, chosen)
        for lane, start in zip(lanes, starts, strict=True):
            record = self.lanes[lane]
            record["hand"] = start.hand_x, start.line_height
            record["part_position"] = start.hand_x - start.offset, start.line_height
            record["part_velocity"] = start.belt_speed, 0.0
            record["part_acceleration"] = self.config.belt_acceleration, 0.0
            _reset_lane(self.lanes, self.model, lane, start.elbow)

    def advance_slice(self, first: int, last: int) -> None:
        """Advance lanes ``first`` to ``last - 1`` by one control period."""
        _advance_lanes(self.lanes, self.model, first, last)

    def episode_info(self, lane: int) -> dict[str, Any]:
        """Settling time, errors, J of eq 18, peak torque and limit ratios of a lane's episode."""
        record = self.lanes[lane]
        settled = int(record["settled_steps"])
        since = int(record["step"]) - settled + 1
        return {
            "settling_time": since * self.config.control_period if settled else math.inf,
            "steady_state_error": float(record["steady_state_error"]),
            "lq_cost": float(record["lq_cost"]),
            "peak_torque": float(record["peak_torque"]),
            **self.limit_info(lane),
        }

    def hand_goal(self, seen: dict[str, Array]) -> tuple[Array, Array, Array]:
        """The part: position, velocity and acceleration, each ``(..., 2)``."""
        return seen["part"] + self.arm.base_array, seen["part_velocity"], seen["part_acceleration"]

    def motion_problem(self, observation: Observation) -> MotionProblem:
        """Meet the part within the time left, from the observed joint state."""
        seen = self.layout.parse(observation)
        return MotionProblem(
            arm=self.arm,
            q=seen["joint_position"],
            qd=seen["joint_velocity"],
            qdd=seen["joint_acceleration"],
            target=MovingHand(*self.hand_goal(seen)),
            horizon=max(float(seen["time_left"][0]), self.config.control_period),
        )

    @property
    def view(self) -> tuple[float, float, float, float]:
        """Stretch of the plane a frame shows, m."""
        return (-1.5, 1.3, -0.25, 2.1)

    def scene(self, lane: int, trail: Sequence[Any]) -> Scene:
        """What a frame of this lane shows."""
        record = self.lanes[lane]
        period = self.config.control_period
        start, part = record["belt_start"], record["part_position"]
        error, velocity_error = float(record["error"]), float(record["velocity_error"])
        ratios = self.limit_info(lane)["limit_ratios"]
        settled = int(record["settled_steps"]) > 0
        return Scene(
            joints=self.arm.joint_positions(record["q"]),
            torque_ratios=record["tau"] / np.array(self.arm.limits.torque),
            time=int(record["step"]) * period,
            horizon=self.config.horizon,
            title=self.env_id,
            part=part.copy(),
            belt=Belt(start=np.array([-1.4, part[1]]), end=np.array([1.2, part[1]]), travel=float(part[0] - start[0])),
            trail=np.array(trail),
            status=(
                ("position error", f"{1e3 * error:.2f} mm", error <= self.config.position_tolerance),
                ("velocity error", f"{1e3 * velocity_error:.2f} mm/s", velocity_error <= self.config.velocity_tolerance),
                ("settled", f"{int(record['settled_steps']) * period:.2f} s", settled),
            ),
            limit_gauges=tuple((kind, ratios[kind]) for kind in ("velocity", "acceleration", "jerk")),
            settled=settled,
        )

    def _starts(self, generators: Sequence[np.random.Generator], options: ConveyorTrackOptions) -> list[Start]:
        """One start a generator: drawn or given, and solvable in either case."""
        given = options.model_dump(exclude={"scenario"}, exclude_none=True)
        if "elbow" in given:
            given["elbow"] = 1.0 if given["elbow"] == "+" else -1.0
        if options.scenario == "paper":
            start = PAPER_START._replace(**given)
            require_solvable(start, self._demands)
            return [start] * len(generators)
        return draw_starts(generators, given, self._demands)


@njit(cache=True, nogil=True)
def _reset_lane(lanes: Any, model: Any, index: int, elbow: float) -> None:
    """Begin an episode in one lane whose hand and part are already set: posture, bodies, counters, observation."""
    lane, shared = lanes[index], model[0]
    dx, dy = lane.hand[0] - shared.base[0], lane.hand[1] - shared.base[1]
    lane.q[0], lane.q[1] = two_link_branch(shared.lengths[0], shared.lengths[1], dx, dy, elbow)
    lane.qd[:] = 0.0
    lane.qdd[:] = 0.0
    lane.tau[:] = 0.0
    lane.commanded_qdd[:] = 0.0
    lane.limit_ratios[:] = 0.0
    lane.reward_terms[:] = 0.0
    lane.reward = 0.0
    lane.terminated = lane.truncated = lane.success = False
    lane.step = lane.settled_steps = 0
    lane.steady_state_error = lane.lq_cost = lane.peak_torque = 0.0
    lane.belt_start[:] = lane.part_position
    place_arm(lane, shared)
    chipmunk.body_set_position(lane.part, lane.part_position[0], lane.part_position[1])
    hand_state_lane(shared.lengths, shared.base, lane.q, lane.qd, lane.hand, lane.hand_velocity)
    _measure_errors(lane)
    _observe(lane, shared)


@njit(cache=True, nogil=True)
def _advance_lanes(lanes: Any, model: Any, first: int, last: int) -> None:
    shared = model[0]
    for index in range(first, last):
        lane = lanes[index]
        progress_before = _progress(lane, shared)
        settled_before = lane.settled_steps
        cost_rate_before = _lq_cost_rate(lane)
        _set_belt_moving(lane, shared)
        worst_ratio = apply_action(lane, shared, lane.action)
        _read_part(lane, shared)
        hand_state_lane(shared.lengths, shared.base, lane.q, lane.qd, lane.hand, lane.hand_velocity)
        _measure_errors(lane)
        lane.step += 1
        lane.lq_cost += 0.5 * shared.control_period * (cost_rate_before + _lq_cost_rate(lane))
        for torque in lane.tau:
            lane.peak_torque = max(lane.peak_torque, abs(torque))
        lane.settled_steps = lane.settled_steps + 1 if _error_in_tolerances(lane, shared) <= 1.0 else 0
        if lane.step > shared.horizon_steps - shared.hold_steps:
            lane.steady_state_error = max(lane.steady_state_error, lane.error)
        lane.success = lane.settled_steps >= shared.hold_steps
        lane.truncated = lane.step >= shared.horizon_steps
        lane.reward_terms[0] = _progress(lane, shared) - progress_before
        lane.reward_terms[1] = (lane.settled_steps - settled_before) / shared.horizon_steps
        lane.reward_terms[2] = -shared.limit_penalty * _excess(worst_ratio, shared.limit_tolerance)
        lane.reward = lane.reward_terms[0] + lane.reward_terms[1] + lane.reward_terms[2]
        _observe(lane, shared)


@njit(cache=True, nogil=True)
def _set_belt_moving(lane: Any, shared: Any) -> None:
    """Give the part the belt's velocity in the middle of the period: exact for a constant acceleration."""
    half = 0.5 * shared.control_period
    chipmunk.body_set_velocity(
        lane.part,
        lane.part_velocity[0] + half * lane.part_acceleration[0],
        lane.part_velocity[1] + half * lane.part_acceleration[1],
    )


@njit(cache=True, nogil=True)
def _read_part(lane: Any, shared: Any) -> None:
    lane.part_position[0], lane.part_position[1] = chipmunk.body_get_position(lane.part)
    for axis in range(2):
        lane.part_velocity[axis] += shared.control_period * lane.part_acceleration[axis]


@njit(cache=True, nogil=True)
def _measure_errors(lane: Any) -> None:
    dx, dy = lane.part_position[0] - lane.hand[0], lane.part_position[1] - lane.hand[1]
    dvx, dvy = lane.part_velocity[0] - lane.hand_velocity[0], lane.part_velocity[1] - lane.hand_velocity[1]
    lane.error = math.sqrt(dx * dx + dy * dy)
    lane.velocity_error = math.sqrt(dvx * dvx + dvy * dvy)


@njit(cache=True, nogil=True)
def _error_in_tolerances(lane: Any, shared: Any) -> float:
    """The larger of position and velocity error, each in units of its tolerance: settled means at most 1."""
    return max(lane.error / shared.position_tolerance, lane.velocity_error / shared.velocity_tolerance)


@njit(cache=True, nogil=True)
def _progress(lane: Any, shared: Any) -> float:
    """0 where settled, -1 where the error is `MAX_ERROR` tolerances or more, and linear in its logarithm between."""
    error = min(MAX_ERROR, max(1.0, _error_in_tolerances(lane, shared)))
    return -math.log(error) / math.log(MAX_ERROR)


@njit(cache=True, nogil=True)
def _excess(ratio: float, tolerance: float) -> float:
    """0 where the limits are kept, 1 to 2 where one is broken."""
    return 0.0 if ratio <= 1.0 + tolerance else 1.0 + min(1.0, ratio - 1.0)


@njit(cache=True, nogil=True)
def _lq_cost_rate(lane: Any) -> float:
    """Integrand of eq 18, with lengths in units of the paper's path."""
    return (lane.error * lane.error + lane.velocity_error * lane.velocity_error) / (LINE_LENGTH * LINE_LENGTH)


@njit(cache=True, nogil=True)
def _observe(lane: Any, shared: Any) -> None:
    """Write the observation: the entries of `LAYOUT`, in its order."""
    out = lane.observation
    for axis in range(2):
        out[axis] = lane.q[axis] / shared.scales[axis]
        out[2 + axis] = lane.qd[axis] / shared.scales[2 + axis]
        out[4 + axis] = lane.qdd[axis] / shared.scales[4 + axis]
        out[6 + axis] = (lane.hand[axis] - shared.base[axis]) / shared.scales[6 + axis]
        out[8 + axis] = (lane.part_position[axis] - shared.base[axis]) / shared.scales[8 + axis]
        out[10 + axis] = (lane.part_position[axis] - lane.hand[axis]) / shared.scales[10 + axis]
        out[12 + axis] = lane.part_velocity[axis] / shared.scales[12 + axis]
        out[14 + axis] = lane.part_acceleration[axis] / shared.scales[14 + axis]
    out[16] = (shared.horizon_steps - lane.step) * shared.control_period / shared.scales[16]
    out[17] = lane.settled_steps / shared.horizon_steps
    for element in range(out.shape[0]):
        out[element] = min(shared.bounds[element], max(-shared.bounds[element], out[element]))


class ConveyorTrackEnv(PlanarArmEnv):
    __doc__ = f"""Bring the hand of a two-link SCARA arm onto a part that rides on a conveyor belt, and ride with it.

    From T. H. Park, B. H. Lee and M. S. Ko, "Motion planning of a robot manipulator for conveyor tracking".
    The arm (`planners.SCARA_1M`: two 1 m, 1 kg rods) moves in the horizontal plane and starts at rest with its hand
    on the line of the belt, D metres ahead of the part.

    ## Action
    Two numbers in [-1, 1]; larger ones are clipped, NaN is refused. `control_mode` says what they scale:
    `"torque"` (0.5 and 0.2 N m), `"acceleration"` (0.3 rad/s^2) or `"jerk"` (2.3 and 2.0 rad/s^3). The last two go
    through inverse dynamics. Jerk is integrated and clipped so that the velocity, acceleration and jerk limits hold
    by construction. The torque limits are the actuator's own and always hold.

    ## Observation
    Each element is a physical value divided by a fixed scale, clipped at the bound.

{LAYOUT.table()}

    ## Reward
    The sum of three terms, which `info["reward_terms"]` holds:

    * `progress`: growth of -log(error) / log(1000), where error is the larger of position and velocity error in
      units of its tolerance, kept in [1, 1000]. Over an episode it adds up to what the end is better than the start.
    * `settling`: growth of the share of the episode for which the hand has been within tolerance without a break.
      Losing the part pays the share back, so the episode's sum is the share left after the settling time.
    * `limits`: for each control period in which a velocity, acceleration or jerk limit is broken by more than
      `limit_tolerance`, minus `limit_penalty` x (1 + excess, at most 2). One such period costs as much as settling
      at once could ever gain.

    Each step's reward is within [-6, 2]. Of two policies that keep the limits, the one that settles earlier gets the
    higher return.

    ## Start
    `reset(options={{"scenario": "paper"}})` is the paper's start: hand at (-0.8, 1.732) m, elbow +, D = 0.1 m, belt
    0.2 m/s. Otherwise belt speed, D, line height, hand position and elbow are drawn from cells of a grid whose
    corners DPCT has solved within 97 % of all limits (`envs.conveyor_starts`). `belt_speed`, `offset`,
    `line_height`, `hand_x` and `elbow` set any of these by hand; what DPCT cannot solve is refused with its reason.

    ## End
    Truncated after `horizon` (3 s). Never terminated. Success: position error at most 1 mm and velocity error at most
    2 mm/s over the last 0.5 s.

    ## Info
    | Key | When | Meaning |
    |---|---|---|
    | `is_success` | always | settled for at least `hold_time` up to now |
    | `reward_terms` | always | the three terms |
    | `settling_time` | at the end | from when on both errors stay within tolerance, s; inf if they do not |
    | `steady_state_error` | at the end | largest position error over the last `hold_time`, m |
    | `lq_cost` | at the end | J of eq 18, lengths in units of the paper's 0.5 m path |
    | `peak_torque` | at the end | largest torque of either joint, N m |
    | `limit_ratio` | at the end | worst value / limit of all kinds |
    | `limit_ratios` | at the end | worst value / limit of each kind |

    ## Arguments
    The fields of `ConveyorTrackConfig`: `control_mode`, `control_period`, `physics_step`, `horizon`, `payload`,
    `belt_acceleration`, `position_tolerance`, `velocity_tolerance`, `hold_time`, `limit_tolerance`, `limit_penalty`.

    ## Version history
    * v0: first version.
    """

    task_type = ConveyorTrack


class ConveyorTrackVectorEnv(PlanarArmVectorEnv):
    """ConveyorTrack-v0 over a batch of lanes; `ConveyorTrackEnv` documents the task."""

    task_type = ConveyorTrack
