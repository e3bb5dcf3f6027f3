"""The charts of a report as SVG: points with intervals, profiles, differences, and cost against score."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from agents.evaluation.compare import Pair
from agents.evaluation.statistics import Estimate
from agents.report.axes import Axis, span
from agents.report.markup import Node, episodes_link, node
from agents.report.numbers import Cost, Quantity, costs, profiled, profiles
from agents.report.pictures.drawing import (
    CHARACTER,
    WIDTH,
    arrow,
    figure,
    label_room,
    label_size,
    labelled,
    point,
    reference_line,
    shortened,
    steps,
    title_of,
    whisker,
    write,
    x_axis,
    y_axis,
)
from agents.report.pictures.labels import Box, Label, Point, place_labels
from agents.report.pictures.looks import Look
from agents.report.results_file import TaskScores
from agents.tables import percent_text

_ROW = 24.0


class Chart:
    """The charts of a task.

    Args:
        number: of the task in the page.
        task: its scores.
        looks: how each policy is drawn.
    """

    def __init__(self, number: int, task: TaskScores, looks: Mapping[str, Look]) -> None:
        self._number, self._task, self._looks = number, task, looks
        self._places = {each.policy: place for place, each in enumerate(task.policies)}

    def points(self, quantity: Quantity) -> Node:
        """A row a policy: its estimate with the interval, and the best known value as a line."""
        rows = [(each.policy, quantity.of(each)) for each in self._task.policies]
        shown = [(name, estimate) for name, estimate in rows if estimate is not None]
        lines = [value for value in (quantity.bound, quantity.published) if value is not None]
        if quantity.share:
            low, high = 0.0, 100.0
        else:
            low, high = span([(each.low, each.value, each.high) for _, each in shown], lines)
        texts = [quantity.text(estimate.value) for _, estimate in shown]
        left, right = label_room([name for name, _ in shown]), WIDTH - 22.0 - CHARACTER * max(map(len, texts))
        axis = Axis(low, high, left, right)
        top, bottom = 24.0, 24.0 + _ROW * len(shown)
        parts = [*x_axis(axis, top, bottom, "")]
        for value, name in ((quantity.bound, self._task.bound_name), (quantity.published, "paper")):
            if value is not None:
                parts += reference_line(axis, value, name, top, bottom, f"{name}: {quantity.text(value)}")
        for row, ((name, estimate), text) in enumerate(zip(shown, texts, strict=True)):
            y = top + _ROW * (row + 0.5)
            said = f"{name}: {quantity.title} {quantity.interval_text(estimate)}"
            parts.append(self._row(name, [name], quantity.column, said, axis, estimate, y, left, text))
        return figure(quantity.title, f"{quantity.title} of each policy with its 95 % interval", bottom + 36.0, parts)

    def differences(self, pairs: Sequence[Pair]) -> Node | None:
        """A row a pair: the median difference of the primary metric with its interval."""
        metric = self._task.primary
        if not pairs:
            return None
        quantity = Quantity(metric.key, metric.title, metric.factor) if metric else Quantity("return", "return")
        rows = []
        for pair in pairs:
            estimate = pair.returns if pair.metric is None else pair.metric
            rows.append((pair, estimate.times(quantity.factor)))
        low, high = span([(each.low, each.value, each.high) for _, each in rows], [0.0])
        names = [f"{pair.policy} \u2212 {pair.against}" for pair, _ in rows]
        left, right = label_room(names), WIDTH - 52.0
        axis = Axis(low, high, left, right)
        top, bottom = 26.0, 26.0 + _ROW * len(rows)
        parts = [*x_axis(axis, top, bottom, f"difference of {quantity.title}")]
        zero = axis.place(0.0)
        parts.append(node("line", x1=zero, x2=zero, y1=top, y2=bottom, class_="zero"))
        parts.append(write("better in", WIDTH - 6.0, top - 8.0, "end", "small"))
        lower = metric is not None and metric.lower_is_better
        sides = (("\u2190 first is better", -1, lower), ("first is better \u2192", 1, not lower))
        for text, side, applies in sides:
            if applies:
                parts.append(
                    write(text, left if side < 0 else right, top - 8.0, "start" if side < 0 else "end", "small")
                )
        for row, ((pair, estimate), name) in enumerate(zip(rows, names, strict=True)):
            y = top + _ROW * (row + 0.5)
            share = f"{percent_text(pair.improvement.value)} %"
            said = f"{name}: {quantity.interval_text(estimate)}; {pair.policy} is better in {share} of the episodes"
            two = [pair.policy, pair.against]
            parts.append(self._row(name, two, quantity.column, said, axis, estimate, y, left, share))
        return figure(
            "Paired differences", f"Differences of {quantity.title} on the same episodes", bottom + 36.0, parts
        )

    def profiles(self) -> Node | None:
        """A curve a policy: the share of episodes in which it is a success with this value or a better one."""
        curves, metric = profiles(self._task), self._task.primary
        values = [[float(value) for value in curve.values] for curve in curves]
        if metric is None or not any(values):
            return None
        flat = sorted(value for row in values for value in row)
        logarithmic = flat[0] > 0.0 and flat[-1] / flat[0] > 30.0
        low, high = (flat[0], flat[-1]) if logarithmic else span(values)
        if high <= low:
            low, high = low - (0.1 * abs(low) or 1.0), low + (0.1 * abs(low) or 1.0)
        axis, share = Axis(low, high, 40.0, WIDTH - 12.0, logarithmic), Axis(0.0, 1.0, 236.0, 12.0)
        parts = [*x_axis(axis, 12.0, 236.0, f"{metric.title}: \u03c4"), *y_axis(share, axis, percent=True)]
        sign, which = "\u2264" if metric.lower_is_better else "\u2265", profiled(self._task)
        for curve in curves:
            reference = curve.name == "best known" and curve is curves[-1] and curve.name not in self._places
            band, line = (
                steps(axis, share, curve.values, curve.low, curve.high),
                steps(axis, share, curve.values, curve.share),
            )
            reached = f"{percent_text(float(curve.share[-1]))} %" if len(curve.share) else "0 %"
            said = f"{curve.name}: a success with {metric.title} {sign} \u03c4 in at most {reached} of {which}"
            if reference:
                parts.append(node("path", title_of(said), d=line, class_="curve bound"))
                continue
            drawn = (
                node("path", d=band, class_="band") if len(self._task.seeds) > 1 else None,
                node("path", d=line, class_="hit"),
                node("path", d=line, class_="curve"),
            )
            parts.append(self._link([curve.name], metric.key, said, *drawn))
        title = f"Share of {which} with a success and {metric.title} {sign} \u03c4"
        return figure("Performance profile", title, 272.0, parts)

    def costs(self) -> Node:
        """A point a policy: time of an action against the primary metric."""
        quantity, shown = costs(self._task)
        lines = [] if quantity.bound is None else [quantity.bound]
        low, high = span([(each.score.low, each.score.value, each.score.high) for each in shown], lines)
        times = [each.action_us for each in shown if each.action_us > 0.0] or [1.0]
        bottom = 250.0 + 10.0 * max(0, len(shown) - 6)
        axis = Axis(min(times) / 1.8, max(times) * 1.8, 48.0, WIDTH - 12.0, logarithmic=True)
        score = Axis(low, high, bottom, 26.0)
        parts = [*x_axis(axis, 26.0, bottom, "time of an action, with planning (\u00b5s)"), *y_axis(score, axis)]
        parts.append(write(quantity.title, 6.0, 14.0, "start", "small"))
        taken: list[Box] = [(0.0, 0.0, 12.0 + CHARACTER * len(quantity.title), 18.0)]
        if quantity.bound is not None:
            y = score.place(quantity.bound)
            name = self._task.bound_name
            width = CHARACTER * len(name)
            taken += [(axis.start, y - 2.0, axis.end, y + 2.0), (axis.end - width, y - 16.0, axis.end, y)]
            parts.append(node("line", title_of(name), x1=axis.start, x2=axis.end, y1=y, y2=y, class_="reference"))
            parts.append(write(name, axis.end - 2.0, y - 4.0, "end", "small"))
        points = []
        for each in shown:
            value, x = each.score.value, axis.place(max(each.action_us, axis.low))
            y = score.place(value) if math.isfinite(value) else (score.end if quantity.lower_is_better else score.start)
            points.append((x, y))
            if score.shows(value) and not math.isnan(each.score.low):
                taken.append((x - 2.0, score.place(each.score.high), x + 2.0, score.place(each.score.low)))
        sizes = [label_size(each.policy.policy) for each in shown]
        labels = place_labels(points, sizes, (axis.start + 2.0, 4.0, WIDTH, bottom - 2.0), taken)
        parts += [self._cost(*given, quantity, score) for given in zip(shown, points, labels, strict=True)]
        title = f"{quantity.title} against the time of an action"
        return figure("Cost against score", title, bottom + 36.0, parts)

    def _cost(self, cost: Cost, place: Point, label: Label, quantity: Quantity, score: Axis) -> Node:
        """The point of a policy with its label."""
        name, estimate, (x, y) = cost.policy.policy, cost.score, place
        said = f"{name}: {quantity.title} {quantity.interval_text(estimate)}, {cost.action_us:.3g} \u00b5s an action"
        marks: list[Node | None] = []
        if score.shows(estimate.value):
            ends = [] if math.isnan(estimate.low) else [score.place(estimate.low), score.place(estimate.high)]
            marks += [whisker(x, x, *ends) if ends else None, point(x, y, self._looks[name].shape)]
        else:
            marks.append(arrow(x, y, -90 if y < 100.0 else 90))
        return self._link([name], quantity.column, said, *labelled(name, x, label), *marks)

    def _row(
        self,
        label: str,
        policies: Sequence[str],
        key: str,
        said: str,
        axis: Axis,
        estimate: Estimate,
        y: float,
        left: float,
        text: str,
    ) -> Node:
        """A row of a chart: label, interval, point, and a text at the right end; all of it leads to the episodes."""
        value = estimate.value
        parts = [
            node("rect", x=0.0, y=y - _ROW / 2.0, width=WIDTH, height=_ROW, class_="hit-row"),
            write(shortened(label), left - 8.0, y + 4.0, "end", "label"),
            write(text, WIDTH - 6.0, y + 4.0, "end", "value"),
        ]
        if math.isnan(value):
            parts.append(write("none", (axis.start + axis.end) / 2.0, y + 4.0, "middle", "small"))
        elif not axis.shows(value):
            parts.append(arrow(axis.place(value), y, 180 if value < axis.low else 0))
        else:
            if not math.isnan(estimate.low):
                parts.append(whisker(axis.place(estimate.low), axis.place(estimate.high), y, y))
            parts.append(point(axis.place(value), y, self._looks[policies[0]].shape))
        return self._link(policies, key, said, *parts)

    def _link(self, policies: Sequence[str], key: str, said: str, *parts: Node | None) -> Node:
        address = episodes_link(self._number, [self._places[name] for name in policies], key)
        classes = f"mark {self._looks[policies[0]].classes}"
        return node("a", *parts, href=address, class_=classes, aria_label=f"{said}; show the episodes", data_tip=said)
