"""What no policy is told of an episode of ExcavatorPayload: the load, when the bucket holds it, and the friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from planners.excavator import EXCAVATOR
from planners.typing import Array

OFFSET = np.array([0.10, 0.08])
"""How far the centre of a load is drawn from where it should be, along either axis of the bucket, m."""
FRICTION_SCALE = (0.7, 1.5)
"""Between which the factor on the joints' friction is drawn."""
PICK, DROP = (0.25, 5.0 / 12.0), (2.0 / 3.0, 0.75)
"""When a load that changes hands is picked up and dropped, shares of the episode: 3 to 5 s and 8 to 9 s of 12 s."""


class Hidden(NamedTuple):
    """Load (kg), shift of its centre (m), factor on the friction, and the steps at which it is picked up and dropped.

    A load that is there from the beginning is picked up at step 0, one that stays to the end is dropped at step -1.
    """

    payload: float
    offset: Array
    friction_scale: float
    pick_step: int
    drop_step: int

    def write(self, record: Any) -> None:
        """Make it that of an environment's record."""
        record["payload"], record["load_offset"], record["friction_scale"] = self[:3]
        record["pick_step"], record["drop_step"] = self[3:]
        record["payload_inertia"] = self.payload * EXCAVATOR.payload.gyration_square(self.payload)


@dataclass(frozen=True)
class HiddenDraw:
    """The distribution of what is hidden.

    Attributes:
        lightest, heaviest: loads, kg.
        steps: control periods of an episode.
        changes_hands: whether the load is picked up and dropped on the way.
    """

    lightest: float
    heaviest: float
    steps: int
    changes_hands: bool

    def draw(
        self,
        generator: np.random.Generator,
        payload: float | None = None,
        offset: tuple[float, float] | None = None,
        friction_scale: float | None = None,
    ) -> Hidden:
        """Draw an episode's; what is given is not drawn, but as many numbers are asked for."""
        mass, x, y, friction, pick, drop = generator.random(6).tolist()
        return Hidden(
            _between((self.lightest, self.heaviest), mass) if payload is None else payload,
            OFFSET * (2.0 * np.array([x, y]) - 1.0) if offset is None else np.array(offset),
            _between(FRICTION_SCALE, friction) if friction_scale is None else friction_scale,
            max(1, round(_between(PICK, pick) * self.steps)) if self.changes_hands else 0,
            max(1, round(_between(DROP, drop) * self.steps)) if self.changes_hands else -1,
        )


def _between(ends: tuple[float, float], share: float) -> float:
    return ends[0] + share * (ends[1] - ends[0])
