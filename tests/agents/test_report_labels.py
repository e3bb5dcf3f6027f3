"""The labels of points in the charts of a report."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from agents.report.pictures.labels import Box, Point, place_labels

AREA = (50.0, 4.0, 400.0, 300.0)


def overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def distance(point: Point, box: Box) -> float:
    return float(np.hypot(*(max(box[i] - point[i], 0.0, point[i] - box[i + 2]) for i in (0, 1))))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("spread", [0.0, 5.0, 30.0, 120.0])
def test_labels_are_apart_and_clearly_those_of_their_points(seed: int, spread: float) -> None:
    random = np.random.default_rng(seed)
    points = [(float(x), float(y)) for x, y in np.clip(random.normal((200.0, 60.0), spread, (12, 2)), 60.0, 290.0)]
    sizes = [(float(width), 13.0) for width in random.uniform(30.0, 170.0, 12)]
    line = (50.0, 148.0, 400.0, 152.0)
    labels = place_labels(points, sizes, AREA, [line])
    for one, other in combinations(labels, 2):
        assert not overlap(one.box, other.box)
    for number, (label, point) in enumerate(zip(labels, points, strict=True)):
        assert not overlap(label.box, line)
        assert AREA[0] <= label.box[0]
        assert label.box[2] <= AREA[2]
        others = [distance(other, label.box) for place, other in enumerate(points) if place != number]
        if label.line is None:
            assert distance(point, label.box) < min(others)
        else:
            assert label.line[0] == point
            assert distance(label.line[1], label.box) == 0.0


def test_a_label_with_room_stands_right_of_its_point() -> None:
    (label,) = place_labels([(100.0, 100.0)], [(40.0, 13.0)], AREA, [])
    assert label.line is None
    assert 100.0 < label.box[0] < 112.0
    (label,) = place_labels([(390.0, 100.0)], [(40.0, 13.0)], AREA, [])
    assert label.box[2] < 390.0
