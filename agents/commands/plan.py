"""`planarm plan`: plan one motion of an arm without any environment; list the planners and what they take."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from agents.commands.outputs import write_picture
from agents.console import note, say
from agents.environments import import_before
from agents.figures.film import require_recordable
from agents.tables import Table
from agents.yaml_config import assigned
from envs.settings import refuse_unknown
from planners import (
    Arm,
    FixedHand,
    FixedJoints,
    MotionProblem,
    MovingHand,
    Obstacle,
    Trajectory,
    arm_names,
    load_arm,
    plan,
)
from planners.capabilities import VARIANTS, capability_rows
from planners.goals import goal_postures
from planners.problem import Target
from planners.robot.limits import LIMIT_KINDS
from planners.typing import Array

FPS, WIDTH = 25, 720
"""Of a film: frames a second, and pixels across."""

HEADERS = ("planner", "variant", "target", "links", "obstacles", "keeps limits of", "arrives")


@dataclass(frozen=True)
class PlanOptions:
    """Plan a motion of an arm from rest, and print its duration, worst loads and clearance.

    Without --planner the planners that can are tried in turn. --list says which planner and variant takes which arm,
    target and obstacle.

    For example:

        $ planarm plan --list
        $ planarm plan --arm SCARA_50CM --start 0.2 1.5 --to-joints 1.2 0.8 --horizon 2
        $ planarm plan --arm my.yaml --planner dpct --variant timing --start 0 1 --to 0.4 0.4 --obstacle 0.5 0.5 0.08
        $ planarm plan --arm SCARA_1M --start-hand -0.8 1.732 --to -0.9 1.732 --moving 0.2 0 --csv out.csv
    """

    arm: str | None = None
    """Name of an arm (see --list) or a YAML or JSON file of one."""
    start: tuple[float, ...] | None = None
    """Joint angles at the start, rad."""
    start_hand: tuple[float, float] | None = None
    """Position of the hand at the start instead, m; in the posture closest to the stretched arm."""
    to: tuple[float, float] | None = None
    """Position to bring the hand to, m."""
    to_joints: tuple[float, ...] | None = None
    """Joint angles to reach instead, rad."""
    orientation: float | None = None
    """Direction of the last link at the target, rad; open when left out."""
    moving: tuple[float, float] | None = None
    """Velocity of the target, m/s: the hand meets it and follows it."""
    horizon: float = 3.0
    """Time for the motion, s."""
    obstacle: tyro.conf.UseAppendAction[tuple[tuple[float, ...], ...]] = ()
    """A disc to avoid: x, y and radius, m, and its velocity if it moves, m/s; give one --obstacle for each."""
    payload: float = 0.0
    """Mass at the hand, kg."""
    gravity: float | None = None
    """Gravity along -y, m/s^2; the arm's own when left out."""
    planner: str | None = None
    """Name of a planner, or module:name of your own."""
    variant: str | None = None
    """Its variant; the default one when left out."""
    options: tuple[str, ...] = ()
    """key=value for options of the variant, such as objective=PI2."""
    csv: Path | None = None
    """Write the samples to this file as CSV."""
    save: Path | None = None
    """Write the trajectory to this file (.npz), for planners.Trajectory.load."""
    plot: Path | None = None
    """Draw angles, velocities, accelerations and torques to this file (.png, .svg or .pdf)."""
    animate: Path | None = None
    """Film the motion to this file (.gif or .mp4)."""
    dpi: int = 150
    """Resolution of the plot."""
    list: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print the arms, and what each planner and variant takes, and stop."""

    def problem(self) -> MotionProblem:
        """The motion problem; a ValueError if something is missing or contradicts."""
        if self.arm is None:
            raise ValueError(f"no arm: give --arm, one of {', '.join(arm_names())}, or a file")
        arm = self._arm(self.arm)
        discs = [_disc(values) for values in self.obstacle]
        return MotionProblem(
            arm, self._start(arm), self._target(), self.horizon, obstacles=tuple(discs), payload=self.payload
        )

    def _arm(self, source: str) -> Arm:
        arm = load_arm(source)
        return arm if self.gravity is None else replace(arm, gravity=self.gravity)

    def _start(self, arm: Arm) -> Array:
        if (self.start is None) == (self.start_hand is None):
            raise ValueError("give either --start, joint angles in rad, or --start-hand, x and y in m")
        if self.start_hand is None:
            return np.array(self.start)
        hand = FixedHand(np.array(self.start_hand))
        return goal_postures(MotionProblem(arm, np.zeros(arm.n_joints), hand, 1.0), hand, "best")[0]

    def _target(self) -> Target:
        if (self.to is None) == (self.to_joints is None):
            raise ValueError("give either --to, x and y of the hand in m, or --to-joints, joint angles in rad")
        for name in ("moving", "orientation"):
            other = "moving" if name == "orientation" and self.moving is not None else "to_joints"
            if getattr(self, name) is not None and getattr(self, other) is not None:
                raise ValueError(f"--{name} and --{other.replace('_', '-')} contradict: leave one of them out")
        if self.to is None:
            return FixedJoints(np.array(self.to_joints))
        if self.moving is not None:
            return MovingHand(np.array(self.to), np.array(self.moving))
        return FixedHand(np.array(self.to), self.orientation)


def run(options: PlanOptions) -> int:
    """Plan, print and write; the exit code."""
    if options.list:
        if options != PlanOptions(list=True):
            raise ValueError("--list prints what there is and stops: leave the other options out")
        _list()
        return 0
    problem = options.problem()
    if options.animate is not None:
        require_recordable(options.animate, fps=FPS, width=WIDTH)
    planner = None if options.planner is None else import_before(options.planner)
    if planner is not None:
        refuse_unknown([planner], {entry.planner for entry in VARIANTS.values()}, "planner")
    more = assigned({}, options.options)
    for name in ("problem", "planner", "variant"):
        if name in more:
            how = "--arm, --start, --to" if name == "problem" else f"--{name}"
            raise ValueError(f"{name} is no option of a variant; it is given by {how}")
    trajectory = plan(problem, planner, options.variant, **more)
    if options.csv is not None:
        trajectory.to_csv(options.csv)
        note(f"wrote {options.csv}")
    if options.save is not None:
        trajectory.save(options.save)
        note(f"wrote {options.save}")
    if options.plot is not None:
        write_picture(trajectory.plot(), options.plot, options.dpi)
    if options.animate is not None:
        trajectory.animate(options.animate, fps=FPS, width=WIDTH)
        note(f"wrote {options.animate}")
    _show(trajectory)
    return 0


def _disc(values: tuple[float, ...]) -> Obstacle:
    if len(values) not in (3, 5):
        raise ValueError(f"--obstacle {values} must be x, y and radius (m), or these and the velocity's x and y (m/s)")
    return Obstacle(np.array(values[:2]), np.array(values[3:] or (0.0, 0.0)), values[2])


def _show(trajectory: Trajectory) -> None:
    rows = [("duration", f"{trajectory.duration:.4g} s"), ("at the target", f"{trajectory.rendezvous_time:.4g} s")]
    for kind in LIMIT_KINDS:
        limited = np.isfinite(trajectory.problem.joint_limits.array(kind)).any()
        share = f"{100.0 * trajectory.limit_ratios[kind]:.4g} % of its limit"
        rows.append((f"worst {kind}", share if limited else "no limit"))
    if trajectory.problem.obstacles:
        rows.append(("least clearance", f"{1e3 * trajectory.clearance:.4g} mm"))
    rows += [("index that the planner minimises", f"{trajectory.cost:.5g}"), ("samples", str(len(trajectory.t)))]
    Table(f"{trajectory.problem.arm.name}, {trajectory.planner}", ("", "value"), rows).show()


def _list() -> None:
    Table("planners", HEADERS, capability_rows(), text_columns=len(HEADERS)).show()
    say(f"arms: {', '.join(arm_names())}; or a YAML or JSON file")
