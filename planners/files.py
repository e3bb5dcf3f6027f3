"""Atomic writes of files, and strict JSON."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np

_DRAFTS = count()
_STANDARD = ("/dev/stdin", "/dev/stdout", "/dev/stderr")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Write a file atomically: a draft beside ``path``, with its suffix, replaces it if the block raises no error.

    Makes the folder if it is missing. Readers see the old file or the new one. Behind a symbolic link the file that it
    leads to is replaced; a pipe or a device gets the content when the block has ended.

    Raises:
        OSError: naming the file, if it cannot be written.
    """
    try:
        with _replaced(path) as draft:
            yield draft
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OSError(f"cannot write {path}: {error.strerror or error}") from error


@contextmanager
def _replaced(path: Path) -> Iterator[Path]:
    """A draft that goes where ``path`` leads."""
    if is_stream(path):
        with TemporaryDirectory() as folder:
            draft = Path(folder) / f"draft{path.suffix}"
            yield draft
            with draft.open("rb") as content, _open_stream(path) as stream:
                shutil.copyfileobj(content, stream)
        return
    target = Path(os.path.realpath(path))
    target.parent.mkdir(parents=True, exist_ok=True)
    draft = _draft(target, path.suffix)
    try:
        yield draft
        if target.exists():
            shutil.copymode(target, draft)
        with draft.open("r+b") as content:
            os.fsync(content.fileno())
        os.replace(draft, target)
        _sync_folder(target.parent)
    finally:
        draft.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    """Keep a renaming through a power failure, where folders can be synchronised."""
    if os.name == "posix":
        with suppress(OSError):
            number = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(number)
            finally:
                os.close(number)


def check_output(path: Path | None) -> None:
    """Raise a ValueError, before any work is done for it, if a file could not be written.

    None is no file, and always right.
    """
    if path is None:
        return
    try:
        if path.is_dir():
            raise ValueError("it is a folder; give the name of a file")
        if is_stream(path):
            if _descriptor(path) is None and not os.access(path, os.W_OK):
                raise PermissionError("it may not be written to")
            return
        target = Path(os.path.realpath(path))
        if target.is_symlink():
            raise ValueError("its symbolic links lead round in a circle")
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError("it may not be written to")
        existing = next(parent for parent in target.parents if parent.exists())
        draft = _draft(existing / target.name, path.suffix)
        draft.touch()
        draft.unlink()
    except (OSError, ValueError) as error:
        raise ValueError(f"cannot write {path}: {getattr(error, 'strerror', None) or error}") from None


def _draft(target: Path, suffix: str) -> Path:
    """The name of a draft; of a long name, whose letters may take several bytes, only the beginning."""
    return target.with_name(f".{target.stem[:20]}.{os.getpid()}-{next(_DRAFTS)}{suffix[:20]}")


def is_draft(path: Path) -> bool:
    """Whether a file has the name of a draft of `whole_file`, which a killed process may have left."""
    return re.fullmatch(r"\..{0,20}\.\d+-\d+(\..{0,19})?", path.name) is not None


def is_stream(path: Path) -> bool:
    """Whether a path is a pipe, a device, or one of the open files, which are not to be replaced."""
    return _descriptor(path) is not None or (path.exists() and not path.is_file() and not path.is_dir())


def _descriptor(path: Path) -> int | None:
    """The number of an open file that a path such as ``/dev/stdout`` or ``/dev/fd/3`` means; None for others."""
    name = os.path.abspath(path)
    if name in _STANDARD:
        return _STANDARD.index(name)
    found = re.fullmatch(r"/(?:dev|proc/self)/fd/(\d{1,9})", name)
    return None if found is None else int(found[1])


def _open_stream(path: Path) -> BinaryIO:
    """A pipe or a device to write to; of an open file a second handle, which goes on where that one is."""
    descriptor = _descriptor(path)
    if descriptor is None:
        return path.open("wb")
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    return os.fdopen(os.dup(descriptor), "wb")


def write_bytes(path: Path, content: bytes | memoryview) -> None:
    """Write a file atomically."""
    with whole_file(path) as draft:
        draft.write_bytes(content)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""
    write_bytes(path, text.encode())


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write strict JSON atomically; NumPy arrays become lists, inf and NaN null."""
    write_text(path, json_text(document))


def json_text(document: Mapping[str, Any]) -> str:
    """Strict JSON as `write_json` writes it."""
    return json.dumps(_plain(document), indent=1, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """The value in types of strict JSON."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
