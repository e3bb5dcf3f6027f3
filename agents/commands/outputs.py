"""The files that commands write: what is asked for is checked before any work is done for it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from agents.console import note
from agents.figures.sheet import FORMATS, Figure, image_bytes, new_sheet
from agents.policies.sb3 import statistics_names
from agents.yaml_config import SHIPPED
from envs.settings import refuse_unknown
from planners.files import check_output, is_stream, write_bytes

OUTPUTS = ("json", "report", "csv", "save", "plot", "record", "animate")
"""Options that name a file to write."""

FILES_OF_FOLDERS = ("best", "last", "checkpoint", "previous", "config", "run", "metrics", "warm_start", "agent", "card")
"""Names, without suffixes, of the files of runs and of submissions."""

BELONGS = {"dpi": "plot", "fps": "record", "width": "record"}
"""Options that say how the file of another one is written."""


def check_outputs(options: Any) -> None:
    """Raise, before a command runs, if a file that its options ask for could not be written.

    Raises:
        ValueError: for a file that cannot be written, that two options name or that the command reads, or an option
            that says how a file is written without one that names it.
        ModuleNotFoundError: for a picture without matplotlib.
    """
    given: dict[str, Path] = {}
    read = {os.path.realpath(path) for path in _read_by(options)}
    for name in (*OUTPUTS, "out"):
        path = getattr(options, name, None)
        if isinstance(path, Path) and os.path.realpath(path) in read and not is_stream(path):
            raise ValueError(f"--{name} would replace {path}, which the command reads: give it a name of its own")
    for name in OUTPUTS:
        path = getattr(options, name, None)
        if path is None:
            continue
        check_output(path)
        for other, known in given.items():
            if os.path.realpath(known) == os.path.realpath(path) and not is_stream(path):
                raise ValueError(f"--{other} and --{name} both write to {path}: give each a file of its own")
        given[name] = path
    for field in fields(options):
        owner = BELONGS.get(field.name)
        if owner is not None and owner not in given and getattr(options, field.name) != field.default:
            raise ValueError(f"--{field.name} is about the file of --{owner}: give --{owner} too, or leave it out")
    if "plot" in given:
        _check_picture(given["plot"], options.dpi)
    if (folder := getattr(options, "figures", None)) is not None:
        if folder.is_file():
            raise ValueError(f"cannot write figures to {folder}: it is a file; give the name of a folder")
        new_sheet(1.0, 1.0)


def _read_by(options: Any) -> Iterator[Path]:
    """The files that options name, but for those to write: paths, and what stands behind key=."""
    for field in fields(options):
        value = getattr(options, field.name)
        for each in value if isinstance(value, tuple) else (value,):
            if field.name in (*OUTPUTS, "out", "figures") or not isinstance(each, str | Path):
                continue
            text = str(each).rpartition("=")[2]
            yield from _beside(Path(text))
            yield Path(f"{text.partition(':')[0].replace('.', '/')}.py")  # of module:name
            if field.name == "config":
                yield SHIPPED / f"{text}.yaml"


def _beside(path: Path) -> Iterator[Path]:
    """A file that a command reads with those that belong to it; of a folder those of a run or of a submission."""
    yield path
    if path.suffix == ".safetensors":
        yield path.with_suffix(".json")
    elif path.suffix == ".zip":
        yield from (path.parent / name for name in statistics_names(path.stem))
    elif path.is_dir():
        yield from (each for each in path.iterdir() if each.stem in FILES_OF_FOLDERS)


def _check_picture(plot: Path, dpi: int) -> None:
    if not 40 <= dpi <= 600:
        raise ValueError(f"dpi {dpi} must be from 40 to 600")
    refuse_unknown([plot.suffix.lower()], FORMATS, f"file format of {plot}:")
    new_sheet(1.0, 1.0)


def write_picture(sheet: Figure, plot: Path, dpi: int, *, colors: int | None = 256) -> None:
    """Write a drawing to a file, a PNG with so many colours, and say so."""
    write_bytes(plot, image_bytes(sheet, plot.suffix, dpi, colors=colors))
    note(f"wrote {plot}")
