"""`planarm paper-apf`: the potential-field paper's simulation and figures, with numbers.

"Collision-Free Trajectory Planning for SCARA robot" (T. H. Kim, M. S. Park, S. Y. Song, S. K. Hong) prints one number,
its sampling period of 0.1 ms. Arm and obstacles are stated in :mod:`agents.papers.apf.runs`; the planner is
:mod:`planners.apf.paper`, with the plain distance (eq 10) or the paper's table (eq 20), and with Khatib's wall or the
one that eq 8 prints.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from agents.papers.apf.facts import facts
from agents.papers.apf.figures import figures
from agents.papers.apf.runs import (
    GOAL,
    RANDOM_PROBLEMS,
    RANDOM_SEED,
    START,
    clearances,
    norm_records,
    paper_problem,
    random_problems,
    random_records,
    scene_records,
)
from agents.papers.report import Columns, Record, Report, ReportOptions, publish, tabulate

SCENE_CAPTION = "Time (s) of the end, distance from the goal then, least clearances of hand and arm (mm)"
SCENE_COLUMNS: Columns = {
    "scene": "{scene}",
    "distance": "{distance}",
    "wall": "{wall}",
    "outcome": lambda row: row["outcome"].replace("_", " "),
    "time": "{time:.2f}",
    "from goal": lambda row: format(1e3 * row["goal_distance"], ".0f"),
    "hand": lambda row: format(1e3 * row["hand_clearance"], "z.0f"),
    "arm": lambda row: format(1e3 * row["arm_clearance"], "z.0f"),
}
RANDOM_CAPTION = (
    "In range: joint angles within their limits all the way. Gained: reached here but not with the static distance and "
    "the same wall; lost: not reached here, but with the static distance and the same wall"
)
RANDOM_SHARES = ("reached", "in_range", "gained", "lost", "hand_hit", "link_hit", "local_minimum", "late")


def percent(name: str, row: Record) -> str:
    """A share in percent."""
    return format(100.0 * row[name], ".1f")


RANDOM_COLUMNS: Columns = {
    "distance": "{distance}",
    "wall": "{wall}",
    **{name.replace("_", " "): partial(percent, name) for name in RANDOM_SHARES},
}


NORM_CAPTION = (
    "Static distance, Khatib's wall. Diagonal: how far from its centre, in radii, the field sees a disc end on the "
    "diagonal; time (s), least clearances of hand and arm (mm) in the crossing; then shares of the random moves, %"
)
NORM_COLUMNS: Columns = {
    "p": "{norm:g}",
    "diagonal": "{diagonal:.2f}",
    "crossing": lambda row: row["outcome"].replace("_", " "),
    "time": "{time:.2f}",
    "hand": lambda row: format(1e3 * row["hand_clearance"], "z.0f"),
    "arm": lambda row: format(1e3 * row["arm_clearance"], "z.0f"),
    **{name.replace("_", " "): partial(percent, name) for name in ("reached", "hand_hit", "link_hit")},
}


def run(options: ReportOptions) -> None:
    """Regenerate the paper's results: the entry point of the command."""
    scenes = list(scene_records())
    problems = list(random_problems(RANDOM_PROBLEMS, RANDOM_SEED))
    randoms, norms = list(random_records(problems)), list(norm_records(problems))
    moves = f"{RANDOM_PROBLEMS} moves past a disc from a random direction (seed {RANDOM_SEED}), % of them"
    tables = [
        tabulate(f"From {START} to {GOAL} m past moving discs", scenes, SCENE_COLUMNS, SCENE_CAPTION, 4),
        tabulate(moves, randoms, RANDOM_COLUMNS, RANDOM_CAPTION, 2),
        tabulate("The p-norm (eq 19)", norms, NORM_COLUMNS, NORM_CAPTION),
    ]
    records: dict[str, Sequence[Record]] = {
        "scenes": scenes,
        "clearances": list(clearances()),
        "random": randoms,
        "norms": norms,
    }
    publish(Report("apf", tables, list(facts(paper_problem())), records, figures), options)
