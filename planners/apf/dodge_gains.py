"""What shapes the field that dodges discs, and the best values known."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

GAINS_FILE = Path(__file__).with_name("dodge_gains.json")
"""The tuned gains and how they were found."""


@dataclass(frozen=True)
class DodgeGains:
    """What shapes the field and the look-ahead. Times are also the currency of costs.

    Attributes:
        horizon: how far ahead is looked, s.
        margin, margin_growth: clearance that is wanted now, m, and by how much more per second ahead, m/s.
        closeness, closeness_memory: cost of a metre less for a second, 1/m, and how it fades with the time ahead, s.
        collision, collision_memory: cost of a collision, s, and how it fades, s.
        success: what a goal held long enough within the horizon is worth, s.
        evade: strength of every well but the goal's, as a share of the acceleration limits.
        push, push_elbow: how far wells are displaced, rad: in the first joint, and times that in the second.
        detour: how long a detour lasts, s.
        constancy: what going on with the last detour is worth, s.
        elbow: what the other elbow has to be better by, s.
        retreat: how far the first joint swings in a retreat, rad.
        corner, corner_reach, corner_room: cost of being cornered by a disc at `nearest`, s; the distance of a disc from
            the base from which on it can corner, m; and the room for the first joint below which it counts, rad.
        lag: time constant with which discs take on a velocity, s.
        confidence: for how long a velocity is believed, s.
        nearest, farthest: how near to the base and how far from it discs are known to go, m.
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
        for field in fields(self):
            value = getattr(self, field.name)
            if not value >= 0.0 or (math.isinf(value) and field.name != "farthest"):
                raise ValueError(f"{field.name} = {value} must be a number that is not negative")
        for name in ("horizon", "closeness_memory", "collision_memory", "lag", "confidence", "corner_room"):
            if getattr(self, name) == 0.0:
                raise ValueError(f"{name} must be positive")
        if self.horizon > 5.0:
            raise ValueError(f"horizon = {self.horizon} s; nothing is known of discs so far ahead, look at most 5 s")
        if not 0.0 < self.evade <= 1.0:
            raise ValueError(f"evade = {self.evade} must be a share of the limits, in (0, 1]")
        if not self.nearest < min(self.corner_reach, self.farthest):
            raise ValueError(f"nearest = {self.nearest} m must be less than corner_reach and farthest")


@cache
def as_record(gains: Any) -> Any:
    """The numbers of a dataclass of gains as the kernels want them: a record with its fields, float64."""
    record = np.zeros(1, dtype=[(field.name, "f8") for field in fields(gains)])[0]
    for field in fields(gains):
        record[field.name] = getattr(gains, field.name)
    return record


@cache
def tuned_gains() -> DodgeGains:
    """The best gains known for ObstacleDodge-v0; see ``tools/tune_apf.py``."""
    return DodgeGains(**json.loads(GAINS_FILE.read_text())["gains"])
