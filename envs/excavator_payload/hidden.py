"""Hidden quantities of an episode of ExcavatorPayload: payload, when the bucket holds it, and friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from planners.excavator import EXCAVATOR
from planners.typing import Array

OFFSET = np.array([0.10, 0.08])
"""Largest drawn offset of the payload's centre along either axis of the bucket, m."""
FRICTION_SCALE = (0.7, 1.5)
"""Range of the factor on the joints' friction."""
PICK, DROP = (0.25, 5.0 / 12.0), (2.0 / 3.0, 0.75)
"""When level 2 picks up and drops the payload, shares of the episode: 3 to 5 s and 8 to 9 s of 12 s."""


class Hidden(NamedTuple):
    """Payload (kg), offset of its centre (m), factor on the friction, and the steps of picking up and dropping.

    A payload present from the beginning has pick step 0; one that stays to the end has drop step -1.
    """

    payload: float
    offset: Array
    friction_scale: float
    pick_step: int
    drop_step: int

    def write(self, record: Any) -> None:
        """Write it into an environment's record."""
        record["payload"], record["load_offset"], record["friction_scale"] = self[:3]
        record["pick_step"], record["drop_step"] = self[3:]
        record["payload_inertia"] = payload_inertia(self.payload)


@dataclass(frozen=True)
class HiddenDraw:
    """Distribution of the hidden quantities.

    Attributes:
        lightest, heaviest: range of the payload, kg.
        steps: control periods of an episode.
        changes: whether the payload is picked up and dropped during the episode.
    """

    lightest: float
    heaviest: float
    steps: int
    changes: bool

    def draw(
        self,
        generator: np.random.Generator,
        payload: float | None = None,
        offset: tuple[float, float] | None = None,
        friction_scale: float | None = None,
    ) -> Hidden:
        """Draw those of an episode; the numbers drawn from the generator do not depend on what is given."""
        mass, x, y, friction, pick, drop = generator.random(6).tolist()
        return Hidden(
            _between((self.lightest, self.heaviest), mass) if payload is None else payload,
            OFFSET * (2.0 * np.array([x, y]) - 1.0) if offset is None else np.array(offset),
            _between(FRICTION_SCALE, friction) if friction_scale is None else friction_scale,
            max(1, round(_between(PICK, pick) * self.steps)) if self.changes else 0,
            max(1, round(_between(DROP, drop) * self.steps)) if self.changes else -1,
        )


def payload_inertia(mass: float) -> float:
    """Moment of inertia of a payload about its centre, kg m^2."""
    return float(mass * EXCAVATOR.payload.gyration_square(mass))


def _between(ends: tuple[float, float], share: float) -> float:
    return ends[0] + share * (ends[1] - ends[0])
