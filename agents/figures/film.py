"""Episodes as files: animated GIF, MP4, or PNG of the last frame."""

from __future__ import annotations

import importlib.util
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from envs.rendering import palette
from envs.settings import refuse_unknown
from planners.files import whole_file

Frame = NDArray[np.uint8]

_GIF_COLORS = 128
_NEEDS = {".gif": ("PIL", "viz"), ".png": ("PIL", "viz"), ".mp4": ("imageio_ffmpeg", "video")}
"""Module and extra that each file format needs."""


def require_recordable(path: Path, *, fps: int, width: int) -> None:
    """Raise, before the episode is run, if it could not be written; a missing extra is a DependencyNotInstalled."""
    refuse_unknown([path.suffix.lower()], _NEEDS, f"file format of {path}:")
    if not 1 <= fps <= 100:
        raise ValueError(f"fps {fps} must be from 1 to 100")
    if not 64 <= width <= 4096:
        raise ValueError(f"width {width} must be from 64 to 4096 pixels")
    for module, extra in (("PIL", "viz"), _NEEDS[path.suffix.lower()]):
        if importlib.util.find_spec(module) is None:
            raise DependencyNotInstalled(f'recording {path.suffix} needs {module}; run: pip install "planarm[{extra}]"')
    if path.suffix.lower() == ".mp4":
        try:
            _encode(bytes(3 * 16 * 16), (16, 16), fps, "-f", "null", "-")
        except OSError as error:
            raise ValueError(f"cannot write {path}: {error}; record a .gif, or install another ffmpeg") from None


class Film:
    """Frames of an episode, sampled at ``fps`` frames a second and scaled to ``width`` pixels."""

    def __init__(self, fps: int, width: int) -> None:
        self._fps, self._width = fps, width
        self._frames: list[Any] = []

    def take(self, time: float, render: Callable[[], Any], *, last: bool = False) -> None:
        """Take a frame if one is due at this time (s) of the episode, or if it is the last."""
        if last or time * self._fps >= len(self._frames) - 1e-9:
            self._frames.append(self._scaled(render()))

    def write(self, path: Path) -> None:
        """Write the frames atomically, in the format of the suffix."""
        writers = {".gif": self._write_gif, ".png": self._write_png, ".mp4": self._write_mp4}
        with whole_file(path) as draft:
            writers[path.suffix.lower()](draft)

    def _scaled(self, pixels: Frame) -> Any:
        from PIL import Image

        image = Image.fromarray(pixels)
        # Video needs even sides.
        size = (2 * (self._width // 2), 2 * round(0.5 * self._width * image.height / image.width))
        return image.resize(size, Image.Resampling.LANCZOS)

    def _write_gif(self, path: Path) -> None:
        from PIL import Image

        # One palette for all frames, from the first, middle and last one, keeps colours from flickering.
        shown = [self._frames[0], self._frames[len(self._frames) // 2], self._frames[-1]]
        width, height = shown[0].size
        sheet = Image.new("RGB", (width, height * len(shown)))
        for row, frame in enumerate(shown):
            sheet.paste(frame, (0, row * height))
        # The drawing's own colours come first: a small part of the picture, such as a lamp, keeps its colour.
        own = [color for color in vars(palette).values() if isinstance(color, tuple)]
        others = sheet.quantize(_GIF_COLORS - len(own)).getpalette() or []
        colors = np.array([*own, *np.reshape(others, (-1, 3))[: _GIF_COLORS - len(own)]], np.uint8)
        frames = [_quantized(frame, colors) for frame in self._frames]
        ends = np.rint(100.0 * np.arange(len(frames)) / self._fps)  # GIF counts hundredths of a second
        durations = [*(10 * np.diff(ends).astype(int)).tolist(), 2000]
        frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0, optimize=False)

    def _write_png(self, path: Path) -> None:
        self._frames[-1].save(path, optimize=True)

    def _write_mp4(self, path: Path) -> None:
        frames = b"".join(frame.tobytes() for frame in self._frames)
        _encode(frames, self._frames[0].size, self._fps, str(path))


def _quantized(frame: Any, colors: NDArray[np.uint8]) -> Any:
    """A frame in the nearest of the colours ``(n, 3)``; Pillow's own search rounds, and misses a colour by a little."""
    from PIL import Image

    pixels = np.asarray(frame, np.uint32)
    packed = (pixels[..., 0] << 16) | (pixels[..., 1] << 8) | pixels[..., 2]
    found, places = np.unique(packed, return_inverse=True)
    shades = np.stack([found >> 16, (found >> 8) & 255, found & 255], axis=1).astype(np.int32)
    nearest = ((shades[:, None] - colors.astype(np.int32)) ** 2).sum(axis=2).argmin(axis=1).astype(np.uint8)
    image = Image.fromarray(nearest[places.reshape(packed.shape)], "P")
    image.putpalette(colors.tobytes())
    return image


def _encode(frames: bytes, size: tuple[int, int], fps: int, *output: str) -> None:
    """Encode frames of ``size`` pixels as H.264; an OSError says why ffmpeg did not.

    Its own messages name what it lacks, such as a codec or room on the disk.
    """
    import imageio_ffmpeg

    try:
        ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
        given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-r", str(fps), "-i", "-"]
        wanted = ["-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "25", *output]
        result = subprocess.run([ffmpeg, "-v", "error", "-y", *given, *wanted], input=frames, capture_output=True)
    except (OSError, RuntimeError) as error:
        raise OSError(f"ffmpeg cannot be run: {error}") from None
    if result.returncode != 0:
        complaint = " ".join(result.stderr.decode(errors="replace").split())[:300]
        raise OSError(f"ffmpeg ended with {result.returncode}. {complaint}".strip())
