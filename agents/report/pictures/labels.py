"""Where the labels of points stand: beside their points, or where there is room, with a line to the point."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

Point = tuple[float, float]
Box = tuple[float, float, float, float]  # two opposite corners: the lesser x and y, then the greater

_GAP = 9.0  # from the middle of a point to its label
_CLEARLY = 0.6  # a label is at most so many times as far from its own point as from any other


@dataclass(frozen=True)
class Label:
    """A place for a label."""

    box: Box
    line: tuple[Point, Point] | None  # from the point to the label, if the label is not clearly that of the point


def place_labels(points: Sequence[Point], sizes: Sequence[Point], area: Box, taken: Sequence[Box]) -> list[Label]:
    """A place in ``area`` for the label of each point, over no other label, no point and nothing else.

    Args:
        points: where they are.
        sizes: width and height of their labels.
        area: where labels may stand.
        taken: where something else is.
    """
    occupied = [*taken, *(_around(point, 6.0) for point in points)]
    labels: list[Label] = []
    for place, (point, size) in enumerate(zip(points, sizes, strict=True)):
        others = [*points[:place], *points[place + 1 :]]
        label = _free(point, others, size, area, occupied)
        labels.append(label)
        occupied.append(label.box)
        if label.line is not None:
            occupied += _along(label.line)
    return labels


def _free(point: Point, others: Sequence[Point], size: Point, area: Box, occupied: Sequence[Box]) -> Label:
    """The nearest free place; right of the point if there is none."""
    near = list(_near(point, size))
    for box in near:
        if _within(box, area) and not _meets(box, occupied):
            distance = _distance(point, box)
            if all(distance <= _CLEARLY * _distance(other, box) for other in others):
                return Label(box, None)
    far = sorted(_grid(size, area), key=lambda box: _distance(point, box))
    free = [box for box in far if _distance(point, box) > _GAP and not _meets(box, occupied)]
    dots = [_around(other, 4.0) for other in others]
    for obstacles in (occupied, dots, []):
        for box in free:
            line = point, _nearest(point, box)
            own = _around(point, 6.0)
            if not any(_meets(part, obstacles) for part in _along(line) if not _overlap(part, own)):
                return Label(box, line)
    return Label(near[0], None)


def _near(point: Point, size: Point) -> Iterator[Box]:
    """The places that touch a point: right, left, above, below, and between these."""
    (x, y), (width, height) = point, size
    rows = (y - height / 2.0, y - height, y, y - height - 3.0, y + 3.0)
    for bottom in rows:
        for left in (x + _GAP, x - _GAP - width):
            yield left, bottom, left + width, bottom + height
    for bottom in (y - _GAP - height, y + _GAP):
        for share in (0.5, 0.25, 0.75, 0.0, 1.0):
            left = x - share * width
            yield left, bottom, left + width, bottom + height


def _grid(size: Point, area: Box) -> Iterator[Box]:
    """Places all over an area."""
    (width, height), (left, bottom, right, top) = size, area
    for row in range(int((top - bottom - height) / 4.0) + 1):
        for column in range(int((right - left - width) / 10.0) + 1):
            x, y = left + 10.0 * column, bottom + 4.0 * row
            yield x, y, x + width, y + height


def _around(point: Point, radius: float) -> Box:
    return point[0] - radius, point[1] - radius, point[0] + radius, point[1] + radius


def _along(line: tuple[Point, Point]) -> list[Box]:
    """Small boxes along a line."""
    (x1, y1), (x2, y2) = line
    count = max(1, math.ceil(math.hypot(x2 - x1, y2 - y1) / 3.0))
    shares = [number / count for number in range(count)]
    return [_around((x1 + share * (x2 - x1), y1 + share * (y2 - y1)), 1.0) for share in shares]


def _nearest(point: Point, box: Box) -> Point:
    """The point of a box that is nearest."""
    return min(max(point[0], box[0]), box[2]), min(max(point[1], box[1]), box[3])


def _distance(point: Point, box: Box) -> float:
    return math.dist(point, _nearest(point, box))


def _within(box: Box, area: Box) -> bool:
    return box[0] >= area[0] and box[1] >= area[1] and box[2] <= area[2] and box[3] <= area[3]


def _meets(box: Box, others: Sequence[Box]) -> bool:
    return any(_overlap(box, other) for other in others)


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
