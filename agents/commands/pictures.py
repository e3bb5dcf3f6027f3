"""The ``--plot`` and ``--dpi`` of commands that draw."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from agents.console import note
from agents.figures.sheet import FORMATS, image_bytes, new_sheet
from agents.files import write_bytes
from envs.settings import refuse_unknown

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def check_picture(plot: Path | None, dpi: int) -> None:
    """Check that a picture can be drawn, before anything runs.

    Raises:
        ValueError: for an unknown file format or a bad resolution.
        ModuleNotFoundError: if a picture is asked for and matplotlib is missing.
    """
    if not 40 <= dpi <= 600:
        raise ValueError(f"dpi {dpi} must be from 40 to 600")
    if plot is not None:
        refuse_unknown([plot.suffix.lower()], FORMATS, f"file format of {plot}:")
        new_sheet(1.0, 1.0)


def write_picture(sheet: Figure, plot: Path, dpi: int) -> None:
    """Write a drawing to a file, and say so."""
    write_bytes(plot, image_bytes(sheet, plot.suffix, dpi, colors=256))
    note(f"wrote {plot}")
