"""The report as one HTML file: charts and tables in plain HTML, episodes and replays as compressed data."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.report.bundle import script, style
from agents.report.markup import Node, episodes_link, html, node
from agents.report.numbers import Quantity, differences, profiled, quantities
from agents.report.pictures.charts import Chart
from agents.report.pictures.looks import Look, policy_looks
from agents.report.provenance import provenance
from agents.report.results_file import Results, TaskScores
from agents.report.side_by_side import side_by_side
from agents.report.tables import costs_table, differences_table, profile_table, scores_table
from envs.rendering.document import palette_document
from planners.files import write_text

_DIGITS = 7  # of the numbers of an episode in the page


def write_report(files: Sequence[tuple[str, Results]], path: Path) -> None:
    """Write the report of one or several files of results, each given with its name."""
    write_text(path, report_page(files))


def report_page(files: Sequence[tuple[str, Results]]) -> str:
    """The report as HTML. It needs nothing beside itself, and its security policy lets it ask for nothing."""
    tasks = side_by_side(files)
    looks = policy_looks(files, tasks)
    code, styles = script(), style()
    content = [_section(number, task, looks) for number, task in enumerate(tasks)]
    page = node(
        "body",
        _header(files, tasks),
        node(
            "nav",
            *(node("a", task.task, href=f"#task-{number}") for number, task in enumerate(tasks)),
            aria_label="Tasks",
        ),
        node("noscript", node("p", "JavaScript is off: charts and tables are here, episodes and replays are not.")),
        node("main", *content),
        provenance(files),
        node("dialog", id="episodes", aria_labelledby="episodes-title"),
        node("div", id="tip", role="tooltip", hidden=True),
        node("script", packed(report_data(tasks, looks)), type="text/plain", id="data"),
    )
    policy = (
        f"default-src 'none'; script-src '{_digest(code)}'; style-src '{_digest(styles)}'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    head = node(
        "head",
        node("meta", charset="utf-8"),
        node("meta", http_equiv="Content-Security-Policy", content=policy),
        node("meta", name="viewport", content="width=device-width, initial-scale=1"),
        node("meta", name="color-scheme", content="light dark"),
        node("title", f"planarm: {', '.join(task.task for task in tasks)}"),
    )
    # The texts of script and style are planarm's own files and hold no end tag; everything else is escaped.
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n{html(head).removesuffix("</head>")}<style>{styles}</style></head>\n'
        f'{html(page).removesuffix("</body>")}\n<script type="module">{code}</script>\n</body>\n</html>\n'
    )


def report_data(tasks: Sequence[TaskScores], looks: Mapping[str, Look]) -> dict[str, Any]:
    """What the script of the page reads: every episode, and the replays."""
    return {"palette": palette_document(), "tasks": [_task_data(task, looks) for task in tasks]}


def packed(document: Mapping[str, Any]) -> str:
    """A document as JSON, compressed, in base64; the same document always gives the same text."""
    text = json.dumps(document, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(gzip.compress(text.encode(), compresslevel=9, mtime=0)).decode()


def _task_data(task: TaskScores, looks: Mapping[str, Look]) -> dict[str, Any]:
    bounds = task.bounds
    shown = [{"key": "return", "title": "return", "factor": 1.0, "lower": False, "share": False}]
    shown += [
        {
            "key": each.column,
            "title": each.title,
            "factor": each.factor,
            "lower": bool(each.lower_is_better),
            "share": each.share,
        }
        for each in quantities(task)
        if each.key not in ("return", "limit_broken", "above_bound")
    ]
    best = None
    if bounds is not None:
        values = [bounds[1].get(seed, math.nan) for seed in task.seeds]
        best = {"key": bounds[0].key, "values": [_rounded(value) for value in values]}
    return {
        "title": task.task,
        "env": task.env_name or task.env,
        "settings": task.env_config,
        "options": task.options,
        "seeds": task.seeds,
        "primary": task.primary.key if task.primary else "return",
        "quantities": shown,
        "bound": best,
        "policies": [
            {
                "name": each.policy,
                "source": each.policy if each.source is None else each.source,
                "look": looks[each.policy].classes,
                "actions": each.action_config,
                "episodes": {
                    key: [_rounded(value) for value in column]
                    for key, column in each.episodes.items()
                    if key in {"return", "length", "is_success", *(item["key"] for item in shown)}
                },
            }
            for each in task.policies
        ],
        "replays": task.replays and task.replays.model_dump(by_alias=True),
    }


def _rounded(value: float | bool | None) -> float | bool | None:
    if value is None or isinstance(value, bool):
        return value
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None


def _header(files: Sequence[tuple[str, Results]], tasks: Sequence[TaskScores]) -> Node:
    policies = list(dict.fromkeys(each.policy for task in tasks for each in task.policies))
    episodes = sum(len(task.seeds) * len(task.policies) for task in tasks)
    dates = sorted({results.started[:10] for _, results in files if results.started})
    about = f"{len(policies)} policies, {len(tasks)} tasks, {episodes} episodes. "
    what = "Every number leads to the episodes behind it, and recorded episodes to their replays."
    unfinished = not all(results.complete for _, results in files)
    return node(
        "header",
        node("h1", "planarm benchmark", node("small", " ".join(dates))),
        node("p", about, what),
        node("p", "The benchmark was interrupted: this is what was finished.", class_="warning")
        if unfinished
        else None,
    )


def _section(number: int, task: TaskScores, looks: Mapping[str, Look]) -> Node:
    """The charts and tables of a task."""
    chart, columns, pairs = Chart(number, task, looks), quantities(task), differences(task)
    key = task.primary.key if task.primary else "return"
    count = f"{len(task.seeds)} {'episode' if len(task.seeds) == 1 else 'episodes'}"
    first = 3 if task.primary else 2
    points = [_card(column.title, chart.points(column)) for column in columns[:first]]
    more = [
        _card(
            "How the episodes are distributed",
            _below(chart.profiles(), _legend(task, looks)),
            f"Share of {_profiled(task)} that are a success with the value \u03c4 or a better one; the higher, "
            "the better. Bands: 95 % intervals.",
            profile_table(number, task, looks),
            f"{task.task} profile",
        ),
        _card(
            "Differences on the same episodes",
            chart.differences(pairs),
            "Median of the first policy minus the second, with its 95 % bootstrap interval; an episode without success "
            "is infinitely bad. Right: share of episodes in which the first is better.",
            differences_table(number, task, pairs),
            f"{task.task} differences",
        ),
        _card(
            "Cost against score",
            chart.costs(),
            "Time of the policy alone, planning included, as measured on the machine named below.",
            costs_table(number, task, looks),
            f"{task.task} cost",
        ),
    ]
    return node(
        "section",
        node(
            "h2",
            task.task,
            node("small", node("a", count, href=episodes_link(number, [0], key), title="Show all episodes")),
        ),
        node("p", *_in_short(task, columns, number)),
        node("div", *points, class_="charts"),
        node(
            "div",
            node("div", scores_table(number, task, looks), class_="scroll"),
            _exports(f"{task.task} scores"),
            node("p", _caption(task), class_="caption"),
            class_="card exported",
        ),
        node("div", *more, class_="charts"),
        id=f"task-{number}",
    )


def _in_short(task: TaskScores, columns: Sequence[Quantity], number: int) -> list[Node | str]:
    """A sentence: the best policy, how far it comes, and the best known value."""
    best = task.policies[0]
    parts: list[Node | str] = ["Best by success, then by return: ", node("strong", best.policy)]
    for column in columns[: 2 if task.primary else 1]:
        estimate = column.of(best)
        if estimate is not None:
            name, unit = _split(column.title)
            link = node("a", f"{column.text(estimate.value)}{unit}", href=episodes_link(number, [0], column.column))
            parts += [f", {name} ", link]
    bound = next((column for column in columns if column.bound is not None), None)
    if bound is not None and bound.bound is not None:
        parts.append(f"; {task.bound_name} {bound.text(bound.bound)}{_split(bound.title)[1]}")
    return [*parts, "."]


def _split(title: str) -> tuple[str, str]:
    """The name in a title such as "settled (s)", and its unit with a space before it."""
    name, bracket, unit = title.rpartition(" (")
    return (name, f" {unit.removesuffix(')')}") if bracket else (title, "")


def _legend(task: TaskScores, looks: Mapping[str, Look]) -> Node:
    """Which line is which policy."""
    names = [
        node("li", node("span", class_=f"stroke {looks[each.policy].classes}"), each.policy) for each in task.policies
    ]
    bound = node("li", node("span", class_="dashes"), "best known") if task.bounds is not None else None
    return node("ul", *names, bound, class_="legend", aria_hidden="true")


def _profiled(task: TaskScores) -> str:
    """Which episodes the profiles are of, and why not all."""
    which = profiled(task)
    return which if which == "the episodes" else f"{which}, those with a best known motion,"


def _caption(task: TaskScores) -> str:
    meaning, bound = task.bound_meaning, ""
    if task.bounds is not None and meaning:
        bound = f" {task.bound_name.capitalize()}: {meaning}, from the same starts; the median."
        bound += " Over best known: the difference."
        if task.certified:
            bound += " Lower bound: proven, no motion is better; the median."
    return (
        "Shares with Wilson's 95 % interval; return: interquartile mean with its 95 % bootstrap interval; all else: "
        f"medians. A dash: not defined, or not computed.{bound}"
    )


def _below(drawing: Node | None, legend: Node) -> Node | None:
    return None if drawing is None else node("div", drawing, legend)


def _card(
    title: str, drawing: Node | None, caption: str = "", table: Node | None = None, name: str = ""
) -> Node | None:
    """A chart with its caption, and its table to unfold."""
    if drawing is None:
        return None
    unfolding = None
    if table is not None:
        content = node("div", node("div", table, class_="scroll"), _exports(name), class_="exported")
        unfolding = node("details", node("summary", "Table"), content)
    return node(
        "figure",
        node("figcaption", title),
        drawing,
        node("p", caption, class_="caption") if caption else None,
        unfolding,
        class_="card",
    )


def _exports(name: str) -> Node:
    buttons = [
        node("button", text, type="button", data_export=kind) for kind, text in (("csv", "CSV"), ("tex", "LaTeX"))
    ]
    return node("p", "Save as ", *buttons, class_="exports", data_name=name)


def _digest(text: str) -> str:
    """The source expression of a Content-Security-Policy that allows exactly this text."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
