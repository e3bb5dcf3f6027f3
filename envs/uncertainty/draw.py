"""What a policy does not know of its robot: true masses, friction, latency, noise and payload, drawn for each episode.

Each setting is a number, or a range ``[low, high]`` from which a value is drawn at every reset from the episode's seed
(domain randomisation). What is true of an episode lies in the environment's record, for rewards, tests and privileged
critics; a policy does not observe it, and `Task.arm` stays the nominal arm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator

from envs.physics.rigid_bodies import whole_multiple
from envs.uncertainty.kernels import DELAY, FRICTION, LONGEST_DELAY, PLACE_TRUE
from planners.checks import LARGEST, is_number
from planners.compiled.calls import Kernel
from planners.robot.arm import Arm
from planners.typing import Array


def _fits(number: Any) -> bool:
    """Whether it is a number of at most `LARGEST`; NaN is not."""
    return is_number(number) and abs(float(number)) <= LARGEST


def _number_or_range(value: Any) -> Any:
    value = value.tolist() if isinstance(value, np.ndarray) and value.ndim == 1 else value  # as datasets hold it
    numbers = value if isinstance(value, list | tuple) and len(value) == 2 else [value]
    if not all(_fits(number) for number in numbers):
        raise ValueError("must be a finite number, or a range [low, high] of them")
    if numbers[0] > numbers[-1]:
        raise ValueError(f"a range is [low, high]; turn it round: [{numbers[1]:g}, {numbers[0]:g}]")
    return value


def _within(low: float, high: float) -> AfterValidator:
    def check(value: Any) -> Any:
        if min(ends(value)) < low or max(ends(value)) > high:
            raise ValueError(f"must be from {low:g} to {high:g}")
        return value

    return AfterValidator(check)


Number = Annotated[float | tuple[float, float], BeforeValidator(_number_or_range)]
"""A number, or the ends of the range from which it is drawn for each episode."""
MassError = Annotated[Number, _within(-0.9, 9.0)]
Payload = Annotated[Number, _within(0.0, 10.0)]
Positive = Annotated[Number, _within(0.0, 1e6)]

DRAWN = (
    "payload",
    "viscous_friction",
    "coulomb_friction",
    "latency",
    "encoder_noise",
    "velocity_noise",
    "camera_noise",
)
"""Settings of which an episode has one value; each is a field of an environment's record, beside ``mass_scale``."""


def ends(value: Number | None) -> tuple[float, float]:
    """Lowest and highest value of a setting."""
    return value if isinstance(value, tuple) else (value or 0.0, value or 0.0)


class Uncertainty:
    """Draws what is true of an episode, and writes it into the record of an environment.

    Args:
        config: the task's settings.
        arm: the nominal arm, without payload.

    Raises:
        ValueError: for a latency that is no multiple of the physics step, or longer than `LONGEST_DELAY` periods; and
            for what the closed form does not know.
    """

    def __init__(self, config: Any, arm: Arm) -> None:
        self._arm, self._period, self._step = arm, config.control_period, config.physics_step
        given = {name: getattr(config, name, 0.0) for name in DRAWN}
        if given["velocity_noise"] is None:
            given["velocity_noise"] = tuple(end / self._period for end in ends(given["encoder_noise"]))
        self.ends = {name: ends(value) for name, value in given.items()}
        self.mass_error = ends(config.mass_error)
        for end in {config.latency} if isinstance(config.latency, float) else set():
            if end:
                whole_multiple("latency", end, "physics_step", config.physics_step)
        soonest, latest = (end / self._step for end in self.ends["latency"])
        self._delays = math.ceil(soonest - 1e-9), math.floor(latest + 1e-9)
        if self._delays[0] > self._delays[1]:
            raise ValueError(
                f"latency {config.latency} s holds no multiple of the physics_step, {self._step:g} s; widen the range"
            )
        longest = LONGEST_DELAY * config.control_period
        if max(self.ends["latency"]) > longest * (1.0 + 1e-9):
            raise ValueError(
                f"latency {config.latency} s is longer than {LONGEST_DELAY} control periods, {longest:g} s; "
                "shorten it, or choose a longer control_period"
            )
        if config.physics == "closed_form" and self.kernels():
            raise ValueError(
                'physics "closed_form" has no mass_error, friction, latency or range of payloads; leave them out, or '
                'choose physics="pymunk"'
            )

    def _any(self, *names: str) -> bool:
        return any(self.ends[name] != (0.0, 0.0) for name in names)

    @cached_property
    def random(self) -> bool:
        """Whether an episode needs random numbers for it besides the key of its noise."""
        return any(low != high for low, high in (*self.ends.values(), self.mass_error))

    @cached_property
    def noisy(self) -> bool:
        """Whether a policy observes noise."""
        return self._any("encoder_noise", "velocity_noise", "camera_noise")

    @cached_property
    def own_bodies(self) -> bool:
        """Whether an episode's links are not the nominal ones with one payload."""
        low, high = self.ends["payload"]
        return self.mass_error != (0.0, 0.0) or low != high

    def kernels(self) -> dict[str, Kernel]:
        """The kernels that these settings need, by the field of the model record that has the address."""
        wanted = {
            "delay_kernel": (self._any("latency"), DELAY),
            "friction_kernel": (self._any("viscous_friction", "coulomb_friction"), FRICTION),
            "place_kernel": (self.own_bodies, PLACE_TRUE),
        }
        return {name: kernel for name, (used, kernel) in wanted.items() if used}

    def draw(self, generators: Sequence[np.random.Generator], *, key: bool) -> list[tuple[Array, int] | None]:
        """Numbers in [0, 1) and the key of the noise of an episode per generator, after the start was drawn.

        Args:
            generators: of the episodes; nothing is drawn from them where nothing is random.
            key: whether the task needs a key if there is noise.
        """
        if not self.random and not (key and self.noisy):
            return [None] * len(generators)
        count = len(DRAWN) + self._arm.n_joints
        return [(generator.random(count), int(generator.integers(2**63))) for generator in generators]

    def write(self, record: Any, drawn: tuple[Array, int] | None) -> None:
        """Write what is true of an episode; of its numbers only those are used that have a range."""
        if drawn is None and record["mass_scale"][0] > 0.0:
            return  # the same in every episode, and written for the first one
        numbers, key = drawn or (np.zeros(len(DRAWN) + self._arm.n_joints), 0)
        for (name, (low, high)), share in zip(self.ends.items(), numbers.tolist()[: len(DRAWN)], strict=True):
            record[name] = low + share * (high - low)
        low, high = self.mass_error
        record["mass_scale"] = 1.0 + low + numbers[len(DRAWN) :] * (high - low)
        fewest, most = self._delays
        record["latency_steps"] = min(most, max(fewest, round(float(record["latency"]) / self._step)))
        record["latency"] = float(record["latency_steps"]) * self._step
        record["noise_key"] = key
        if self.own_bodies:
            self.write_bodies(record)

    def load(self, record: Any) -> None:
        """Give a running episode these settings' payload, the nearest one of a range."""
        low, high = self.ends["payload"]
        record["payload"] = min(high, max(low, float(record["payload"])))
        if self.own_bodies:
            self.write_bodies(record)

    def write_bodies(self, record: Any) -> None:
        """Write the mass properties of the links that an episode's mass error and payload give."""
        scale = record["mass_scale"]
        arm = replace(
            self._arm,
            masses=tuple((scale * self._arm.masses).tolist()),
            inertias=tuple((scale * self._arm.inertias).tolist()),
        ).with_payload(float(record["payload"]))
        record["masses"], record["inertias"], record["com"] = arm.masses, arm.inertias, arm.coms
