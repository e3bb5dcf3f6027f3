"""`planarm fidelity`: the table of how true the physics is."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from agents.files import write_text
from envs.fidelity import table


@dataclass(frozen=True)
class FidelityOptions:
    """Print how far the simulated arms are from independent references (a few seconds)."""

    json: Path | None = None
    """Also write the table to this file."""


def run(options: FidelityOptions) -> None:
    """Print the table, and write it if asked for."""
    rows = table()
    printed = Table(title="Pymunk arms against independent references")
    for heading in ("physics step", "joints and reading", "two-link arm, 3 s: angle", "triple pendulum, 10 s: energy"):
        printed.add_column(heading, justify="right")
    for row in rows:
        printed.add_row(
            f"{1e3 * row.physics_step:g} ms",
            "Pymunk's defaults" if row.pymunk_defaults else "planarm",
            f"{row.two_link_error:.1e} rad",
            f"{100.0 * row.energy_error:.2g} %",
        )
    Console().print(printed)
    if options.json is not None:
        write_text(options.json, json.dumps([asdict(row) for row in rows], indent=2) + "\n")
