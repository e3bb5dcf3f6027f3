"""Matplotlib figures made without pyplot: their types, axes and image files. All figures begin with `new_sheet`."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

from envs.rendering.palette import Color

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
    from matplotlib.figure import SubFigure as SubFigure
else:  # matplotlib is optional
    Axes = Figure = SubFigure = Any

Rgb = tuple[float, ...]

FORMATS = (".png", ".svg", ".pdf")  # file formats of pictures


def new_sheet(width: float, height: float) -> Figure:
    """An empty figure, inches; a ModuleNotFoundError says how to install matplotlib if it is missing."""
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError('plots need matplotlib: pip install "planarm[viz]"') from error
    return Figure(figsize=(width, height), layout="constrained")


def name_axes(axes: Axes, title: str, x: str, y: str) -> None:
    """Give a panel a title, axis labels, a faint grid and a legend."""
    axes.set(title=title, xlabel=x, ylabel=y)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="x-small")


def image_bytes(sheet: Figure, suffix: str, dpi: int, *, colors: int | None = None) -> bytes:
    """A figure as a file of one of ``FORMATS``; ``colors`` reduces a PNG to so many, which makes the file small.

    Raises:
        ValueError: if matplotlib does not know the file format.
    """
    image = io.BytesIO()
    sheet.savefig(image, format=suffix.lower().removeprefix("."), dpi=dpi)
    if colors is None or suffix.lower() != ".png":
        return image.getvalue()
    from PIL import Image

    smaller = io.BytesIO()
    with Image.open(image) as picture:
        reduced = picture.convert("RGB").quantize(colors, kmeans=3, dither=Image.Dither.NONE)
        reduced.save(smaller, format="png", optimize=True)
    return smaller.getvalue()


def rgb(color: Color) -> Rgb:
    """A colour as matplotlib takes it."""
    return tuple(channel / 255.0 for channel in color)
