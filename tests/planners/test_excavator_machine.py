"""Parameters of the excavator, and what no machine can have."""

from __future__ import annotations

import dataclasses
import math
import re

import pytest

from planners.excavator import (
    EXCAVATOR,
    ChainGeometry,
    Link,
    PayloadShape,
)


def test_payloads_are_percentages_of_the_rated_load() -> None:
    assert [EXCAVATOR.payload.mass(percent) for percent in (0, 2, 10)] == pytest.approx([0.0, 70.0, 350.0])
    ball = 4.0 / 3.0 * math.pi * 0.5**3 * 1800.0
    assert EXCAVATOR.payload.gyration_square(ball) == pytest.approx(0.4 * 0.5**2)
    with pytest.raises(ValueError, match="payload mass -1"):
        EXCAVATOR.payload.gyration_square(-1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda: ChainGeometry(1.0, 0.0, 1.0, 0.0, 0.0, 1.0), "a2 0.0 must be finite and positive"),
        (lambda: ChainGeometry(1.0, 1.0, math.nan, 0.0, 0.0, 1.0), "a3 nan must be finite"),
        (lambda: Link(-1.0, (0, 0, 0), (1, 1, 1), 1.0, 1.0), "mass of a link -1.0 must"),
        (lambda: Link(1.0, (0, 0), (1, 1, 1), 1.0, 1.0), "com of a link has shape (2,)"),  # type: ignore[arg-type]
        (lambda: Link(1.0, (0, 0, 0), (1, 1, 3), 1.0, 1.0), "no rigid body has moments"),
        (lambda: dataclasses.replace(EXCAVATOR, links=EXCAVATOR.links[:4]), "4 links; the chain has 5"),
        (lambda: dataclasses.replace(EXCAVATOR, gravity=math.inf), "gravity inf must be finite"),
        (lambda: PayloadShape(density=0.0), "density 0.0 kg/m^3 must be finite and positive"),
        (lambda: PayloadShape(rated_load=-1.0), "rated_load -1.0 kg must be finite and positive"),
    ],
)
def test_impossible_machines_are_refused(change: object, message: str) -> None:
    assert callable(change)
    with pytest.raises(ValueError, match=re.escape(message)):
        change()
