"""Settings that tasks have in common."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from envs.arms import ArmSetting
from envs.physics.rigid_bodies import whole_multiple
from envs.settings import Settings
from envs.uncertainty.draw import MassError, Payload, Positive


class TaskSettings(Settings):
    """Settings that every task has; the kernels find the numbers among them in the model record.

    Attributes:
        control_mode: what an action means.
        control_period: time for which an action is held, s.
        physics: ``"pymunk"``, or ``"closed_form"`` for the exact equations of motion by Runge-Kutta 4.
        physics_step: time of one step of the physics, s.
        horizon: length of an episode, s.
        payload: unknown point mass at the hand, kg; like the next six a number, or a range [low, high] of which each
            episode has its own value (docs/environments/uncertainty.md).
        mass_error: share by which the links are heavier than the arm that policies know; from a range each link has its
            own.
        viscous_friction: friction of each joint by its velocity, N m s/rad.
        coulomb_friction: dry friction of each joint, N m.
        latency: time by which a commanded torque comes late, s; whole physics steps, at most 8 control periods.
        encoder_noise: standard deviation of the observed joint angles, rad.
        velocity_noise: standard deviation of the observed joint velocities, rad/s; ``encoder_noise`` over the control
            period when left out.
        arm: the robot; a preset's name, an `Arm`, the path of a file or a mapping (`planners.load_arm`); the task's own
            when left out.
        gravity: along -y, m/s^2; 0 for a horizontal plane, 9.81 for a vertical one; the arm's own when left out.
        info_terms: whether there is an info at every step; without, only where an episode ends, and steps cost less.
    """

    control_mode: str = "torque"
    control_period: float = Field(0.02, gt=0.0)
    physics: Literal["pymunk", "closed_form"] = "pymunk"
    physics_step: float = Field(0.002, gt=0.0)
    horizon: float = Field(3.0, gt=0.0, le=60.0)
    payload: Payload = 0.0
    mass_error: MassError = 0.0
    viscous_friction: Positive = 0.0
    coulomb_friction: Positive = 0.0
    latency: Positive = 0.0
    encoder_noise: Positive = 0.0
    velocity_noise: Positive | None = None
    arm: ArmSetting | None = None
    gravity: float | None = Field(None, ge=0.0, le=30.0)
    info_terms: bool = True


class LimitSettings(TaskSettings):
    """Settings of tasks whose reward has a term for broken joint limits.

    Attributes:
        limit_tolerance: share by which a limit may be exceeded before it counts as broken.
        limit_penalty: cost of one control period in which a limit is broken; twice that where by 100 % or more.
    """

    limit_tolerance: float = Field(0.005, ge=0.0)
    limit_penalty: float = Field(2.0, ge=0.0)


def whole_periods(config: TaskSettings, name: str, seconds: float) -> int:
    """A named time, s, in control periods; ValueError if it is no multiple of them, or longer than the horizon."""
    count = whole_multiple(name, seconds, "control_period", config.control_period)
    if count > whole_multiple("horizon", config.horizon, "control_period", config.control_period):
        raise ValueError(f"{name} {seconds} s is longer than the horizon {config.horizon} s; change one of them")
    return count
