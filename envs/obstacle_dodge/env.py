"""ObstacleDodge: bring the hand to a goal and hold it there while a disc moves at random through the workspace."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from envs.arms import arm_of, scaled_view
from envs.environment import PlanarArmEnv
from envs.observation import Observation
from envs.obstacle_dodge import kernels
from envs.obstacle_dodge.closed_form import MOVE_AMONG_DISCS
from envs.obstacle_dodge.scale import layout_of, scale_of_task
from envs.obstacle_dodge.second_arm import DISCS, PER_LINK, SECOND_ARM, cover_radii
from envs.obstacle_dodge.starts import DodgeStarts, Episode, ObstacleDodgeOptions, paper_scenario
from envs.task import LimitSettings, Task, whole_periods
from envs.uncertainty.draw import Positive
from planners import SCARA_50CM, Arm, FixedHand, MotionProblem, Obstacle
from planners.typing import Array


class ObstacleDodgeConfig(LimitSettings):
    """Settings of ObstacleDodge-v0.

    Attributes:
        num_obstacles: number of discs; 0 only beside a second arm.
        second_arm: whether a second arm of the same kind moves in the same space, from rest to rest between random
            postures. It is observed as eight discs behind the others.
        observed_discs: number of discs for which an observation has room besides those of the second arm;
            `num_obstacles` when left out. In the places without a disc every entry is 0, also the radius.
        camera_noise: standard deviation of the observed positions of goal and discs, along either axis, m; that of the
            discs' velocities is this over the control period.
        tolerance: largest distance between hand and goal that counts as there, m.
        hold_time: time for which the hand must be there without a break for a success, s.
        clearance_margin: clearance below which the clearance term begins, m.
        clearance_weight: cost of a second with the arm all but touching a disc.
        collision_penalty: cost of a collision.
    """

    control_mode: Literal["torque", "acceleration", "velocity"] = "torque"
    horizon: float = Field(8.0, gt=0.0, le=60.0)
    physics_step: float = Field(0.0025, gt=0.0)
    second_arm: bool = False
    num_obstacles: int = Field(1, ge=0, le=4)
    observed_discs: int | None = Field(None, ge=1, le=4)
    camera_noise: Positive = 0.0
    tolerance: float = Field(0.03, gt=0.0)
    hold_time: float = Field(0.5, gt=0.0)
    clearance_margin: float = Field(0.1, gt=0.0)
    clearance_weight: float = Field(0.5, ge=0.0)
    collision_penalty: float = Field(2.0, ge=0.0)
    limit_penalty: float = Field(0.1, ge=0.0)

    @field_validator("num_obstacles")
    @classmethod
    def _something_to_avoid(cls, discs: int, others: ValidationInfo) -> int:
        if discs == 0 and not others.data.get("second_arm", False):
            raise ValueError("nothing to avoid; ask for 1 to 4 discs, or set second_arm=True")
        return discs

    @field_validator("observed_discs")
    @classmethod
    def _room_for_every_disc(cls, observed: int | None, others: ValidationInfo) -> int | None:
        if observed is not None and observed < others.data.get("num_obstacles", 1):
            raise ValueError(f"fewer than num_obstacles, which is {others.data['num_obstacles']}; raise it to that")
        return observed


def dodging_arm(config: ObstacleDodgeConfig) -> Arm:
    """The arm of the settings without its jerk limits: evading takes sudden accelerations."""
    arm = arm_of(config, SCARA_50CM)
    return replace(arm, limits=replace(arm.limits, jerk=(math.inf, math.inf)))


VIEW = (-1.42, 1.42, -1.42, 1.42)
"""Part of the plane that a frame shows with its own arm, m."""

WIDE_VIEW = (-1.7, 1.7, -1.7, 1.7)
"""The same with a second arm, m."""


class ObstacleDodge(Task):
    """The dodging task over a batch of environments; `ObstacleDodgeEnv` documents it."""

    env_id = "ObstacleDodge-v0"
    config_type = ObstacleDodgeConfig
    options_type = ObstacleDodgeOptions
    kernels: ClassVar[Any] = kernels
    default_arm = SCARA_50CM
    physics = ("pymunk", "closed_form")
    layout = layout_of(SCARA_50CM, 1)
    reward_terms = ("progress", "goal", "clearance", "collision", "limits")
    outcomes: ClassVar = {
        "collision": "whether the arm has touched a disc",
        "min_clearance": "least distance between the surfaces of arm and disc, m; negative in a collision",
        "time_to_goal": "time from which on the hand was at the goal, s; inf without success",
        "goal_distance": "from the hand to the goal, m",
    }
    boolean_outcomes = ("collision",)
    gauges = ("velocity", "acceleration")
    view = VIEW
    config: ObstacleDodgeConfig

    def __init__(self, config: ObstacleDodgeConfig, num_envs: int) -> None:
        arm = dodging_arm(config)
        self.scale = scale_of_task(arm)
        along = DISCS if config.second_arm else 0
        self.n_discs = config.num_obstacles + along
        self.layout = layout_of(arm, (config.observed_discs or config.num_obstacles) + along)
        self.view = scaled_view(WIDE_VIEW if config.second_arm else VIEW, arm, SCARA_50CM)
        samples = math.ceil(config.horizon / self.scale.path_step - 1e-6) + 1
        constants = {
            "link_radius": arm.link_radius,
            "hold_steps": whole_periods(config, "hold_time", config.hold_time),
            "path_step": self.scale.path_step,
            "path_samples": samples,
        }
        fields = kernels.env_fields(self.n_discs)
        shape = samples, self.n_discs, 2
        own = {
            "physics_kernel": MOVE_AMONG_DISCS if config.physics == "closed_form" else None,
            "second_arm_kernel": SECOND_ARM if config.second_arm else None,
        }
        super().__init__(config, arm, num_envs, fields, constants, table_shape=shape, kernels=own)
        acceleration = 0.5 * arm.limits.array("acceleration")
        self._planning_limits = replace(arm.limits, acceleration=tuple(acceleration.tolist()))
        self._cover_radii = cover_radii(arm)[:along]
        self._starts = DodgeStarts(
            arm, self._planning_limits, samples, config.num_obstacles, self.scale, config.second_arm
        )

    @classmethod
    def fit(cls, config: ObstacleDodgeConfig) -> ObstacleDodgeConfig:
        """Tolerance and clearance margin in the units of the arm, and the horizon in its unit of time."""
        if config.arm is None:
            return config
        length, time = scale_of_task(dodging_arm(config))
        periods = math.ceil(time * config.horizon / config.control_period - 1e-6)
        fitting = {
            "tolerance": length * config.tolerance,
            "clearance_margin": length * config.clearance_margin,
            "horizon": min(60.0, periods * config.control_period),
        }
        left_out = fitting.keys() - config.model_fields_set
        return config.model_copy(update={name: fitting[name] for name in left_out})

    def draw(self, generators: Sequence[np.random.Generator], options: ObstacleDodgeOptions) -> list[Episode]:
        """One posture, goal and set of disc paths per generator, drawn or given."""
        if options.scenario == "paper":
            given = options.model_dump(exclude={"scenario"}, exclude_none=True)
            scenario = {"scenario": "paper", **paper_scenario(self.scale), **given}
            options = ObstacleDodgeOptions.parse(scenario, f"{self.env_id} option")
        return self._starts.draw(generators, options)

    def write_start(self, record: Any, start: Episode) -> None:
        """Write posture, goal and disc paths."""
        record["q"], record["goal"] = start.start, start.goal
        free = self.config.num_obstacles
        record["radii"][:free], record["radii"][free:] = start.radius, self._cover_radii
        record["second_base"] = start.second_base
        self.write_table(record, start.path)

    def outcome(self, record: Any) -> dict[str, Any]:
        """Collision, clearance, time to the goal and distance from it."""
        arrival = self._seconds_held(record, int(record["held_steps"]))
        return {
            "collision": bool(record["collision"]),
            "min_clearance": float(record["min_clearance"]),
            "time_to_goal": arrival if record["success"] else math.inf,
            "goal_distance": float(record["distance"]),
        }

    def obstacle_path(self, env_index: int) -> Array:
        """Disc positions over the whole episode, at multiples of `Scale.path_step`, ``(samples, discs, 2)``, m.

        For bounds and pictures: no policy observes it.
        """
        return self.table(env_index)

    def second_arm(self, record: Any) -> Array:
        """Joints and hand of the second arm, ``(3, 2)``, m; ``(0, 2)`` without one. For pictures."""
        if not self.config.second_arm:
            return np.empty((0, 2))
        return np.concatenate(
            [[record["second_base"]], record["discs"][self.config.num_obstacles :][PER_LINK - 1 :: PER_LINK]]
        )

    def hand_goal(self, seen: dict[str, Array]) -> tuple[Array, Array, Array]:
        """The fixed goal: position, velocity and acceleration, each ``(..., 2)``."""
        position = seen["goal"] + self.arm.base_array
        return position, np.zeros_like(position), np.zeros_like(position)

    def motion_problem(self, observation: Observation) -> MotionProblem:
        """Come to rest at the goal within the time left; discs are predicted to keep their velocities.

        The problem's limits are the arm's with half of the acceleration: the rest is for evading.
        """
        seen = self.layout.parse(observation)
        positions = seen["obstacle"].reshape(-1, 2) + self.arm.base_array
        velocities = seen["obstacle_velocity"].reshape(-1, 2)
        discs = zip(positions, velocities, seen["obstacle_radius"].tolist(), strict=True)
        obstacles = tuple(Obstacle(*disc) for disc in discs if disc[2] > 0.0)  # 0: a place without a disc
        return self._problem(
            seen, FixedHand(self.hand_goal(seen)[0]), limits=self._planning_limits, obstacles=obstacles
        )

    def picture(self, record: Any) -> dict[str, Any]:
        """Goal and discs, distance, least clearance, and for how long the goal has been held."""
        distance, clearance = float(record["distance"]), float(record["min_clearance"])
        held = int(record["held_steps"]) * self.config.control_period
        free = self.config.num_obstacles
        discs = zip(record["discs"][:free].tolist(), record["radii"][:free].tolist(), strict=True)
        thick = self.arm.link_radius
        return {
            "target": record["goal"].copy(),
            "obstacles": tuple((x, y, radius) for (x, y), radius in discs),
            "second_arm": tuple((x, y, thick) for x, y in self.second_arm(record).tolist()),
            "status": (
                ("distance to goal", f"{1e3 * distance:.0f} mm", distance <= self.config.tolerance),
                ("least clearance", f"{1e3 * clearance:.0f} mm", clearance > 0.0),
                ("held", f"{held:.2f} s", bool(record["success"])),
            ),
        }


class ObstacleDodgeEnv(PlanarArmEnv):
    """Bring the hand to a goal and hold it there while a disc moves at random through the workspace.

    ## Description
    From T. H. Kim, M. S. Park, S. Y. Song and S. K. Hong, "Collision-free trajectory planning for SCARA robot". The
    paper protects the hand alone; here no part of the arm may touch a disc. The arm (`planners.SCARA_50CM`: two 0.5 m,
    2 kg rods, capsules of 45 mm radius) moves in the horizontal plane.

    ## Action space
    Two numbers in [-1, 1]; larger ones are clipped, NaN is refused. `control_mode` says what they scale: `"torque"`
    (10 and 4 N m), `"acceleration"` (9 and 16 rad/s^2, through inverse dynamics) or `"velocity"` (99.8 % of 2.4 rad/s
    at the end of the period, as nearly as the limits allow: all of them hold by construction).

    ## Observation space
    The entries of the discs, listed below for one, grow with `num_obstacles`. With `observed_discs=4` they have room
    for four discs whatever their number, so that one policy acts on every level: the places without a disc come last
    and hold 0, also as radius. A disc keeps its place for the whole episode, so that a policy can follow its motion;
    the nearest is not put first, since discs would change places as they pass each other.

    With `second_arm=True` eight more discs follow those of `num_obstacles`: four along each link of the second arm,
    from the base outwards, the last of each link at its outer end. With their radius, 77 mm, they cover the link.
    Planners avoid these discs; collisions are of the links themselves, capsules of 45 mm radius.

    ## Rewards
    The sum of five terms:

    * `progress`: decrease of the distance to the goal, as a share of the distance at the start.
    * `goal`: at success 1 plus the time left as a share of the horizon.
    * `clearance`: with less than `clearance_margin` (0.1 m) between arm and disc, minus `clearance_weight` per second,
      in proportion to the missing clearance.
    * `collision`: minus `collision_penalty` (2).
    * `limits`: for each control period in which a limit of velocity, acceleration or joint range is broken by more than
      `limit_tolerance`, minus `limit_penalty` x (1 + excess, at most 2).

    ## Starting state
    The posture at rest and the goal are drawn: elbow angles of 0.3 rad or more, the hand 0.4 m or more from its goal,
    which it can reach on the same side of the elbow. The disc (radius 0.1 m, 0.2 to 1 m/s, 0.32 to 1.3 m from the base)
    begins with 0.3 m or more between it and the arm, and the goal; it moves in legs between waypoints, in straight
    passes, or wanders, one third each, mostly aimed at where the arm would be if it moved straight to its goal
    (`envs.obstacle_dodge.paths`). The whole path is drawn at reset: a seed fixes it. `reset(options={"scenario":
    "paper"})` is a fixed crossing, as in the paper's figure 3. `start`, `goal`, `obstacle_kind`, `obstacle_speed`,
    `obstacle_radius` and `obstacle_paths` fix any of these.

    A second arm (`second_arm`) is of the same kind. Its base is 1.35 to 1.5 m away, so far that it cannot reach the
    base of the first, and at most 1 rad aside of a point through which the first arm would pass. It begins at rest,
    0.3 m or more from the first arm, and moves from rest to rest by quintic time laws at 40 to 90 % of its velocity
    limits. Four moves in five bring its hand within 0.15 m of a point of the first arm on its straight way to the goal.
    Every posture in which it rests is 0.15 m or more clear of the first arm at its goal: it may sweep over the goal but
    does not stay there. It neither sees the first arm nor collides with discs.

    ## Episode end
    Terminated by a collision: the surfaces of disc and arm, or of both arms, touch, measured after every physics step.
    Terminated by success: the hand within 0.03 m of the goal for 0.5 s without a break. Truncated after `horizon`
    (8 s).

    ## Difficulty
    Harder with a second arm (`second_arm`), more discs (`num_obstacles`), faster or larger ones (the options
    `obstacle_speed` and `obstacle_radius`), a `payload` (no policy observes it) or another `arm`. In velocity mode all
    limits hold by construction; in torque mode a policy has to keep them itself.

    ## Version history
    * v0: the first version.
    """

    task_type = ObstacleDodge
