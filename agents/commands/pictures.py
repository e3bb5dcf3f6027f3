"""The ``--plot`` and ``--dpi`` of commands that draw."""

from __future__ import annotations

from pathlib import Path

from agents.console import note
from agents.figures.sheet import FORMATS, Figure, image_bytes, new_sheet
from envs.settings import refuse_unknown
from planners.files import write_bytes


def check_picture(plot: Path | None, dpi: int) -> None:
    """Raise, before anything runs, if a picture that is asked for could not be drawn."""
    if not 40 <= dpi <= 600:
        raise ValueError(f"dpi {dpi} must be from 40 to 600")
    if plot is not None:
        refuse_unknown([plot.suffix.lower()], FORMATS, f"file format of {plot}:")
        new_sheet(1.0, 1.0)


def write_picture(sheet: Figure, plot: Path, dpi: int) -> None:
    """Write a drawing to a file, and say so."""
    write_bytes(plot, image_bytes(sheet, plot.suffix, dpi, colors=256))
    note(f"wrote {plot}")
