"""What is known of arm, sensors and latency before a filter of `planners.control.observer` sees its first sample."""

from __future__ import annotations

from dataclasses import dataclass

from planners.checks import checked_count, float_vector, require_finite, require_shape


@dataclass(frozen=True)
class ObserverSettings:
    """What is known of arm, sensors and latency before the first sample.

    Attributes:
        period: between two samples, s.
        steps: steps of the simulation in a period.
        unmodelled: standard deviation of what the model leaves out of a period's mean acceleration, rad/s^2, as if
            independent in each period; for an error that lasts over several periods, several times its size.
        late: least and largest number of steps by which a command comes late.
        noise: standard deviations of measured angles (rad) and velocities (rad/s).
        masses: standard deviation of the share by which links are heavier than the nominal ones.
        alike: whether that share is the same for all links.
        payload: standard deviation of the payload, kg.
        friction: standard deviations of viscous (N m s/rad) and dry friction (N m).
        likely_friction: what they are around.
    """

    period: float
    steps: int
    unmodelled: float
    late: tuple[int, int] = (0, 0)
    noise: tuple[float, float] = (0.0, 0.0)
    masses: float = 0.0
    alike: bool = False
    payload: float = 0.0
    friction: tuple[float, float] = (0.0, 0.0)
    likely_friction: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        require_finite("period", self.period, "s", "positive")
        checked_count("steps", self.steps)
        for name in ("unmodelled", "masses", "payload"):
            require_finite(name, getattr(self, name), "", "not negative")
        for name in ("noise", "friction", "likely_friction"):
            float_vector(name, getattr(self, name), 2, "not negative")
        require_shape("late", self.late, (2,))
        least, most = (checked_count("late", steps, ", of steps", 0) for steps in self.late)
        if least > most:
            raise ValueError(f"late {self.late} must be the least number of steps and then the largest")

    @property
    def waiting(self) -> int:
        """Periods over which commands can be on their way."""
        return -(-self.late[1] // self.steps)
