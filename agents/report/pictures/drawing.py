"""Parts of charts as SVG elements: axes, lines, whiskers, arrows, labels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from agents.report.axes import Axis, tick_text
from agents.report.markup import Node, node
from agents.report.pictures.labels import Label, Point
from planners.typing import Array

WIDTH = 400.0
"""Of every chart, in units of the picture; about a pixel each on a small screen."""
CHARACTER = 6.4
"""Width of a character of a label."""
_LONGEST = 26  # characters of a label


def figure(title: str, description: str, height: float, parts: Sequence[Node]) -> Node:
    """A chart of its parts."""
    texts = node("title", title), node("desc", description)
    return node("svg", *texts, *parts, viewBox=f"0 0 {WIDTH:g} {height:g}", role="group", aria_label=title)


def write(text: str, x: float, y: float, anchor: str, kind: str) -> Node:
    """A text; ``anchor`` is start, middle or end, ``kind`` its class."""
    return node("text", text, x=x, y=y, text_anchor=anchor, class_=kind)


def title_of(text: str) -> Node:
    """What a browser shows as a tooltip of an element."""
    return node("title", text)


def shortened(label: str) -> str:
    """A label with an ellipsis in the middle if it is long."""
    half = (_LONGEST - 1) // 2
    return label if len(label) <= _LONGEST else f"{label[:half]}\u2026{label[-half:]}"


def label_room(labels: Sequence[str]) -> float:
    """Width that labels need at the left, with a margin."""
    return 16.0 + CHARACTER * max((len(shortened(label)) for label in labels), default=0)


def x_axis(axis: Axis, top: float, bottom: float, title: str) -> Iterator[Node]:
    """A horizontal axis with grid lines, ticks and its title below."""
    room = (axis.end - axis.start) / 46.0
    for tick in axis.ticks(max(2, min(5, round(room)))):
        x = axis.place(tick)
        yield node("line", x1=x, x2=x, y1=top, y2=bottom, class_="grid")
        yield write(tick_text(tick), x, bottom + 14.0, "middle", "tick")
    if title:
        yield write(title, (axis.start + axis.end) / 2.0, bottom + 30.0, "middle", "small")


def y_axis(axis: Axis, across: Axis, *, percent: bool = False) -> Iterator[Node]:
    """A vertical axis with grid lines and ticks."""
    for tick in axis.ticks(5):
        y = axis.place(tick)
        yield node("line", x1=across.start, x2=across.end, y1=y, y2=y, class_="grid")
        text = f"{100.0 * tick:.0f} %" if percent else tick_text(tick)
        yield write(text, across.start - 6.0, y + 4.0, "end", "tick")


def reference_line(axis: Axis, value: float, name: str, top: float, bottom: float, said: str) -> Iterator[Node]:
    """A vertical line at a value, with its name above."""
    x = axis.place(value)
    yield node("line", title_of(said), x1=x, x2=x, y1=top - 6.0, y2=bottom, class_=f"reference {name}")
    yield write(name, min(x, WIDTH - 0.5 * CHARACTER * len(name)), top - 10.0, "middle", "small")


def whisker(x1: float, x2: float, y1: float, y2: float) -> Node:
    """An interval."""
    return node("line", x1=x1, x2=x2, y1=y1, y2=y2, class_="whisker")


def point(x: float, y: float, shape: int) -> Node:
    """A circle or a square; the style sheet makes every other shape an empty one."""
    if shape < 2:
        return node("circle", cx=x, cy=y, r=5.0, class_="dot")
    return node("rect", x=x - 4.5, y=y - 4.5, width=9.0, height=9.0, class_="dot")


def arrow(x: float, y: float, turn: float) -> Node:
    """A triangle at the edge for what lies beyond; it points to the right, turned clockwise by so many degrees."""
    return node(
        "path", d="M7 0L-4 -5.5L-4 5.5Z", transform=f"translate({x:.1f} {y:.1f}) rotate({turn:g})", class_="dot"
    )


def steps(axis: Axis, across: Axis, values: Array, high: Array, low: Array | None = None) -> str:
    """The path of a step function, from share 0 to the end of the axis; with ``low`` the band between two of them."""
    upper = list(_corners(axis, across, values, high))
    if low is None:
        return _path(upper)
    return _path([*upper, *reversed(list(_corners(axis, across, values, low)))]) + "Z"


def _corners(axis: Axis, across: Axis, values: Array, shares: Array) -> Iterator[tuple[float, float]]:
    """Where the steps begin and end; in the order of ``values``, which may descend."""
    last = across.place(0.0)
    descending = len(values) > 1 and values[0] > values[-1]
    yield (axis.end if descending else axis.start), last
    for value, share in zip(values.tolist(), shares.tolist(), strict=True):
        x = axis.place(value)
        yield x, last
        last = across.place(share)
        yield x, last
    yield (axis.start if descending else axis.end), last


def _path(points: Sequence[tuple[float, float]]) -> str:
    kept = [f"{x:.4g} {y:.4g}" for x, y in points]
    return "M" + "L".join(text for place, text in enumerate(kept) if place == 0 or text != kept[place - 1])


def label_size(name: str) -> Point:
    """Width and height of the label of a point."""
    return 7.0 * len(shortened(name)), 13.0


def labelled(name: str, x: float, label: Label) -> Iterator[Node]:
    """The label of a point at ``x`` in its place, and the line to the point if there is one."""
    if label.line is not None:
        (x1, y1), (x2, y2) = label.line
        yield node("line", x1=x1, y1=y1, x2=x2, y2=y2, class_="leader")
    left, top, right, bottom = label.box
    place, anchor = (left, "start") if left >= x else (right, "end") if right <= x else ((left + right) / 2.0, "middle")
    yield write(shortened(name), place, (top + bottom) / 2.0 + 4.0, anchor, "label")
