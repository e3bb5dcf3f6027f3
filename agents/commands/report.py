"""`planarm report`: one HTML file, and figures for papers, from what `planarm benchmark --json` wrote."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from agents.console import note
from agents.report.page import write_report
from agents.report.results_file import Results
from planners.files import check_output


@dataclass(frozen=True)
class ReportOptions:
    """Turn results into a page, or into figures for papers.

    The page is one HTML file that needs nothing beside itself: every number leads to the episodes behind it, worst
    first, and those that were recorded to a replay with all policies on one canvas. Results of several files stand side
    by side where their episodes are the same.

    For example:

        $ planarm benchmark --json results.json && planarm report results.json --out report.html
        $ planarm report results.json mine.json --out both.html
        $ planarm report results.json --figures figures
    """

    results: tyro.conf.Positional[tuple[Path, ...]]
    """Files that planarm benchmark --json or planarm evaluate --json wrote."""
    out: Path | None = None
    """Write the page to this file; report.html if neither this nor --figures is given."""
    figures: Path | None = None
    """Write every chart into this folder, as PDF and as SVG; needs matplotlib, the viz extra."""


def run(options: ReportOptions) -> int:
    """Write the page and the figures; the exit code."""
    if not options.results:
        raise ValueError("no results: give a file that planarm benchmark --json wrote")
    out = options.out or (Path("report.html") if options.figures is None else None)
    check_output(out)
    if options.figures is not None and options.figures.is_file():
        raise ValueError(f"cannot write figures to {options.figures}: it is a file; give the name of a folder")
    files = list(zip(_names(options.results), map(Results.read, options.results), strict=True))
    if out is not None:
        write_report(files, out)
        note(f"wrote {out}")
    if options.figures is not None:
        from agents.report.pictures.figures import write_figures

        count = write_figures(files, options.figures)
        note(f"wrote {count} files to {options.figures}")
    return 0


def _names(paths: tuple[Path, ...]) -> list[str]:
    """Names of files: without folder and suffix where that tells them apart."""
    stems = [path.stem for path in paths]
    return stems if len(set(stems)) == len(stems) else [str(path) for path in paths]
