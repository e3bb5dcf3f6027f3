"""The tables of a report: those behind its charts, with a link from every number to its episodes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from agents.evaluation.compare import Pair
from agents.evaluation.statistics import Estimate
from agents.report.markup import Node, episodes_link, node
from agents.report.numbers import Quantity, profiles, quantiles, quantities
from agents.report.pictures.looks import Look
from agents.report.results_file import TaskScores
from agents.tables import number_text, percent_text

SHARES = (0.1, 0.25, 0.5, 0.75, 0.9)
"""Of the episodes, in the table of a performance profile."""


def scores_table(number: int, task: TaskScores, looks: Mapping[str, Look]) -> Node:
    """Everything about every policy: the table behind the points."""
    columns = quantities(task)
    heads = ["policy", *(column.title for column in columns), "plan (ms)", "action (\u00b5s)"]
    rows = []
    for place, policy in enumerate(task.policies):
        cells = [_name(policy.policy, looks)]
        for column in columns:
            estimate = column.of(policy)
            link = episodes_link(number, [place], column.column)
            cells.append(_number(estimate, column, link, precise=column.share or column.key == "return"))
        planning = 1e3 * policy.timing.planning_seconds / policy.timing.plans if policy.timing.plans else math.nan
        rows.append([*cells, _plain(planning), _plain(policy.action_us)])
    proven = f"lower bound{task.which_bounded}"
    for name, attribute in ((task.bound_name, "bound"), (proven, "proven"), ("paper", "published")):
        values = [getattr(column, attribute) for column in columns]
        if any(value is not None for value in values):
            known = [math.nan if value is None else value for value in values]
            rows.append(
                [node("td", name, class_="name muted"), *map(_plain, known), _plain(math.nan), _plain(math.nan)]
            )
    return _table(heads, rows)


def profile_table(number: int, task: TaskScores, looks: Mapping[str, Look]) -> Node | None:
    """The values that shares of the episodes reach: the table behind the profiles."""
    metric, curves = task.primary, profiles(task)
    if metric is None or not curves:
        return None
    heads = ["policy", *(f"{percent_text(share)} %" for share in SHARES)]
    quantity = Quantity(metric.key, metric.title)
    rows = []
    for place, curve in enumerate(curves):
        values = [Estimate(value, math.nan, math.nan) for value in quantiles(curve, SHARES)]
        link = episodes_link(number, [place], metric.key)
        known = place < len(task.policies)  # the last one may be the bound's
        cells = [_number(each, quantity, link, precise=False) if known else _plain(each.value) for each in values]
        rows.append([_name(curve.name, looks), *cells])
    return _table(heads, rows)


def differences_table(number: int, task: TaskScores, pairs: Sequence[Pair]) -> Node | None:
    """The differences in pairs."""
    if not pairs:
        return None
    metric = task.primary
    shown = Quantity(metric.key, metric.title, metric.factor) if metric else None
    places = {each.policy: place for place, each in enumerate(task.policies)}
    points, returns = Quantity("success", "success (points)", 100.0, source="is_success"), Quantity("return", "return")
    better = Quantity(shown.key if shown else "return", "better (%)", 100.0, share=True)
    heads = ["difference", points.title, *([shown.title] if shown else []), returns.title, better.title]
    rows = []
    for pair in pairs:
        both = [places[pair.policy], places[pair.against]]
        numbers = [(points, pair.success), *([(shown, pair.metric)] if shown and pair.metric else [])]
        numbers += [(returns, pair.returns), (better, pair.improvement)]
        cells = [
            _number(estimate.times(column.factor), column, episodes_link(number, both, column.column), precise=True)
            for column, estimate in numbers
        ]
        rows.append([node("td", f"{pair.policy} \u2212 {pair.against}", class_="name"), *cells])
    return _table(heads, rows)


def costs_table(number: int, task: TaskScores, looks: Mapping[str, Look]) -> Node:
    """Where the time of every policy goes."""
    heads = [
        "policy",
        "action (\u00b5s)",
        "planning (\u00b5s)",
        "the rest (\u00b5s)",
        "plans",
        "infeasible",
        "environment (\u00b5s)",
    ]
    rows = []
    for policy in task.policies:
        timing = policy.timing
        steps = 1e-6 * timing.env_steps
        parts = [policy.action_us, timing.planning_seconds / steps, timing.policy_seconds / steps]
        numbers = [*parts, float(timing.plans), float(timing.infeasible), timing.env_seconds / steps]
        cells = [_plain(value, f"{value:.0f}" if place in (3, 4) else None) for place, value in enumerate(numbers)]
        rows.append([_name(policy.policy, looks), *cells])
    return _table(heads, rows)


def _table(heads: Sequence[str], rows: Sequence[Sequence[Node]]) -> Node:
    """A table whose rows can be sorted by a click on a head."""
    head = node("tr", *(node("th", node("button", title, type="button"), scope="col") for title in heads))
    return node("table", node("thead", head), node("tbody", *(node("tr", *row) for row in rows)), class_="numbers")


def _name(policy: str, looks: Mapping[str, Look]) -> Node:
    look = looks.get(policy)
    dot = None if look is None else node("span", class_=f"chip {look.classes}", aria_hidden="true")
    return node("td", dot, policy, class_="name" if dot is not None else "name muted")


def _number(estimate: Estimate | None, column: Quantity, link: str, *, precise: bool) -> Node:
    """A number that leads to its episodes, with the interval behind it if it is precise, and in the exported file."""
    if estimate is None or math.isnan(estimate.value):
        shown = "\u2013" if estimate is not None else ""
        return node("td", node("a", shown, href=link) if shown else None, data_v="")
    ends = None if math.isnan(estimate.low) else f"({column.text(estimate.low)}, {column.text(estimate.high)})"
    label = node(
        "a", column.text(estimate.value), href=link, title=f"{column.interval_text(estimate)}: show the episodes"
    )
    low, high = (None, None) if ends is None else (repr(estimate.low), repr(estimate.high))
    small = node("small", f" {ends}") if precise and ends is not None else None
    return node("td", label, small, data_v=repr(estimate.value), data_low=low, data_high=high)


def _plain(value: float, text: str | None = None) -> Node:
    known = math.isfinite(value)
    return node("td", (text or number_text(value)) if known else None, data_v=repr(value) if known else "")
