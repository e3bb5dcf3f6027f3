"""Parameters of the field that dodges discs, and the best values known."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planners.checks import checked_count, require_finite

GAINS_FILE = Path(__file__).with_name("gains.json")
"""The tuned gains and how they were found."""

STEP = 0.05
"""Time step of the look-ahead, s."""

INSTANTS = [("travel", "f8"), ("settling", "f8"), ("margin", "f8"), ("closeness", "f8"), ("collision", "f8")]
"""The instants of the look-ahead, `STEP` apart: time for which a disc's velocity acts since the last instant, less than
`STEP` as it decays, s; time for which the change of its velocity is still missing, s (see `planners.apf.dodge.discs`);
wanted clearance, m; cost of a metre less, s/m; cost of a collision, s."""


@dataclass(frozen=True)
class DodgeGains:
    """Parameters of the field and of the look-ahead. Costs are in seconds.

    Attributes:
        horizon: of the look-ahead, s.
        margin, margin_growth: wanted clearance now, m, and its growth with the time ahead, m/s.
        closeness, closeness_memory: cost of a metre less for a second, 1/m, and its decay with the time ahead, s.
        collision, collision_memory: cost of a collision, s, and its decay with the time ahead, s.
        success: reward of holding the goal long enough within the horizon, s.
        evade: strength of every well but the goal's, as a share of the acceleration limits.
        push, push_elbow: displacement of wells in the first joint, rad, and its factor in the second.
        detour: duration of a detour, s.
        constancy: reward of continuing the last detour, s.
        elbow: least advantage of the other elbow for a change, s.
        retreat: swing of the first joint in a retreat, rad.
        corner, corner_reach, corner_room: cost of a first joint blocked between its range limit and a disc at
            `nearest`, s; largest distance of such a disc from the base, m; distance to the range limit below which it
            counts, rad.
        lag: time constant of the discs' changes of velocity, s.
        confidence: time constant with which the predicted velocity of a disc decays, s.
        nearest, farthest: least and largest distance of discs from the base, m.
    """

    horizon: float = 1.2
    margin: float = 0.03
    margin_growth: float = 0.03
    closeness: float = 300.0
    closeness_memory: float = 0.4
    collision: float = 20.0
    collision_memory: float = 0.6
    success: float = 0.5
    evade: float = 0.85
    push: float = 0.8
    push_elbow: float = 1.5
    detour: float = 0.3
    constancy: float = 0.05
    elbow: float = 0.3
    retreat: float = 2.4
    corner: float = 3.0
    corner_reach: float = 0.9
    corner_room: float = 1.2
    lag: float = 0.2
    confidence: float = 1.5
    nearest: float = 0.0
    farthest: float = math.inf

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if name != "farthest" or value != math.inf:
                require_finite(name, value, sign="not negative")
        for name in ("horizon", "closeness_memory", "collision_memory", "lag", "confidence", "corner_room"):
            if getattr(self, name) == 0.0:
                raise ValueError(f"{name} must be positive")
        if self.horizon > 5.0:
            raise ValueError(f"horizon = {self.horizon} s must be at most 5 s: discs are not predicted further ahead")
        if not 0.0 < self.evade <= 1.0:
            raise ValueError(f"evade = {self.evade} must be a share of the limits, in (0, 1]")
        if not self.nearest < min(self.corner_reach, self.farthest):
            raise ValueError(f"nearest = {self.nearest} m must be less than corner_reach and farthest")


def as_record(gains: DodgeGains) -> Any:
    """The gains for compiled code: a record with the same fields, float64."""
    return np.array([tuple(asdict(gains).values())], dtype=[(field.name, "f8") for field in fields(gains)])[0]


def look_ahead_steps(gains: DodgeGains) -> int:
    """Number of steps of the look-ahead, `STEP` apart."""
    return round(gains.horizon / STEP)


def make_instants(gains: DodgeGains) -> NDArray[Any]:
    """The instants of the look-ahead: an array of `INSTANTS`, ``(steps,)``."""
    t = STEP * np.arange(1, look_ahead_steps(gains) + 1)
    instants = np.zeros(len(t), INSTANTS)
    instants["travel"] = np.diff(gains.confidence * -np.expm1(-t / gains.confidence), prepend=0.0)
    instants["settling"] = np.diff(gains.lag * -np.expm1(-t / gains.lag), prepend=0.0)
    instants["margin"] = gains.margin + gains.margin_growth * t
    instants["closeness"] = STEP * gains.closeness * np.exp(-t / gains.closeness_memory)
    instants["collision"] = gains.collision * np.exp(-t / gains.collision_memory)
    return instants


@cache
def tuned_gains(discs: int = 1) -> DodgeGains:
    """The best gains known for ObstacleDodge-v0 with so many discs; see ``tools/tune_apf.py``."""
    checked_count("discs", discs, least=0)
    stored = json.loads(GAINS_FILE.read_text())
    return DodgeGains(**(stored["gains"] | (stored["several_discs"] if discs > 1 else {})))
