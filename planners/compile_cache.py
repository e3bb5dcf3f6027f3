"""Where compiled functions are kept for the next process, and when they are compiled anew.

Numba compiles a function again when its own file changes, but not when a function that it calls changes in another
file: after an update it would run a mixture of old and new code. `SourceLocator` therefore stamps a compiled function
with the contents of every file that its own file imports, directly or not. Importing this module installs it.
"""

from __future__ import annotations

import atexit
import gc
import glob
import hashlib
import os
import re
import shutil
import stat
import sys
import sysconfig
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

_caching: Any = import_module("numba.core.caching")
_event: Any = import_module("numba.core.event")

OURS = ("planners", "envs")
"""Packages with compiled functions, beside each other, that others may call."""

_ROOT = Path(__file__).parent.parent
_OWN = tuple(f"{_ROOT / name}{os.sep}" for name in OURS)
_LIBRARY = {"site-packages", "dist-packages", Path(sysconfig.get_path("stdlib")).name}
_COMMENT = re.compile(rb"#[^\n]*")
_IMPORT = re.compile(
    rb"(?:^|[;:])[ \t]*"
    rb"(?:from[ \t]+([\w.]+)[ \t]+import[ \t]*(\([^)]*\)|(?:[^\n;\\]|\\\r?\n)*)|import[ \t]+([\w., \t]+))",
    re.MULTILINE,
)


class SourceLocator(_caching._CacheLocator):  # type: ignore[misc]
    """The cache of a function of these packages, or of one whose file imports them.

    It lies where Numba keeps it: in ``NUMBA_CACHE_DIR``, in ``__pycache__`` beside the source, or in the user's cache;
    where none of them can be written, in a temporary folder, with one warning.
    """

    def __init__(self, function: FunctionType, file: str) -> None:
        self._py_file = file
        self._name = f"{Path(file).stem}.{function.__qualname__}".replace("<", "").replace(">", "")
        self._stamp = _stamp(file)
        self._folder = _cache_folder(file, _caching.config.CACHE_DIR)

    @classmethod
    def from_function(cls, function: FunctionType, file: str) -> SourceLocator | None:
        """The locator of a function; None leaves it to Numba's own."""
        _forget_if_changed(file)
        return cls(function, file) if any(_is_ours(one) for one in _reached_from(file)) else None

    def ensure_cache_path(self) -> None:
        """Make the folder, without what was compiled from other source; Numba calls it before it writes there."""
        super().ensure_cache_path()
        for path in Path(self._folder).glob(f"{glob.escape(self._name)}-*.nb[ic]"):
            if self.get_disambiguator() not in path.name:
                with suppress(OSError):  # another process may have deleted it
                    path.unlink()

    def get_cache_path(self) -> str:
        """The folder."""
        return self._folder

    def get_source_stamp(self) -> str:
        """A hash of all source that the function can reach."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """Part of the names of the files: processes that run different source never write the same ones."""
        return self._stamp[:16]


if SourceLocator not in _caching.CacheImpl._locator_classes:
    _caching.CacheImpl._locator_classes.insert(0, SourceLocator)


@contextmanager
def _compile_anyway(cache: Any) -> Iterator[None]:
    """Where a compiled function cannot be kept or read, as on a full disk, it is used all the same."""
    if not isinstance(cache._impl.locator, SourceLocator):
        with _as_numba_does(cache):
            yield
        return
    try:
        yield
    except OSError as error:
        if not _unkept:
            _unkept.append(cache.cache_path)
            warnings.warn(
                f"compiled functions are not kept for the next process: {cache.cache_path}: {error.strerror}",
                RuntimeWarning,
                stacklevel=2,
            )


_as_numba_does = _caching.Cache._guard_against_spurious_io_errors
_unkept: list[str] = []  # the first folder that could not be used
_caching.Cache._guard_against_spurious_io_errors = _compile_anyway


class _CollectLater(_event.Listener):  # type: ignore[misc]
    """No garbage collection while Numba compiles: it takes a tenth of the time. Numba's lock is held meanwhile."""

    def __init__(self) -> None:
        self._collected: list[bool] = []

    def on_start(self, event: object) -> None:
        self._collected.append(gc.isenabled())
        gc.disable()

    def on_end(self, event: object) -> None:
        if self._collected.pop():
            gc.enable()


_event.register("numba:compile", _CollectLater())


def cache_place() -> str:
    """Where this package's compiled functions are kept, in words."""
    folder = Path(_cache_folder(__file__, _caching.config.CACHE_DIR))
    beside = folder == Path(__file__).parent / "__pycache__"
    return f"kept in __pycache__ beside the source in {_ROOT}" if beside else f"kept in {folder.parent}"


_temporary: list[tuple[Path, int]] = []  # with the process that made it


def temporary_folder(warning: str) -> Path:
    """A folder that is deleted at the end of this process; the first use in it warns."""
    if not _temporary:
        _temporary.append((Path(tempfile.mkdtemp(prefix="planarm-")), os.getpid()))
        atexit.register(delete_temporary)
        warnings.warn(warning, RuntimeWarning, stacklevel=3)
    return _temporary[0][0]


def delete_temporary() -> None:
    """Delete the temporary folder, if this process made one: for an end without Python's own tidying up."""
    for folder, owner in _temporary:
        if os.getpid() == owner:  # not in a forked process
            shutil.rmtree(folder, ignore_errors=True)


def is_private(folder: Path) -> bool:
    """Whether nobody but the user and root can put files into a folder or replace it; also if there is none yet.

    Caches hold machine code: anyone who can write them can run code as the user.
    """
    for path, others in ((folder, False), (folder.parent, True)):
        if sys.platform != "win32" and path.exists():
            status = path.stat()
            sticky = others and status.st_mode & stat.S_ISVTX
            if status.st_uid not in (0, os.geteuid()) or (status.st_mode & stat.S_IWOTH and not sticky):
                return False
    return True


@cache
def _cache_folder(file: str, chosen: str) -> str:
    """The first of Numba's folders that can be written."""
    kinds = ["InTreeCacheLocator", "UserWideCacheLocator"]
    for kind in ["UserProvidedCacheLocator", *kinds] if chosen else kinds:
        locator = getattr(_caching, kind)(_cache_folder.__wrapped__, file)
        folder = str(locator.get_cache_path())
        with suppress(OSError):
            if kind == "UserProvidedCacheLocator" and not is_private(Path(folder)):
                warnings.warn(
                    f"NUMBA_CACHE_DIR {chosen} is not used: others can write there, and so run code as you",
                    RuntimeWarning,
                    stacklevel=2,
                )
            elif not folder.startswith("~"):  # no home
                locator.ensure_cache_path()
                return folder
    temporary = temporary_folder(
        f"compiled functions are not kept for the next process: neither {os.path.dirname(file)} nor a folder in the "
        "user's home can be written; set NUMBA_CACHE_DIR, and PLANARM_CACHE for tables, to folders that can"
    )
    return str(temporary / _caching._CacheLocator.get_suitable_cache_subpath(file))


class _Source(NamedTuple):
    """A source file as it was when it was read."""

    changed: tuple[int, int]
    digest: bytes
    imports: tuple[str, ...]


_sources: dict[str, _Source] = {}


def _forget_if_changed(file: str) -> None:
    """Forget all source if a file is not as it was read: its module is loaded again."""
    if file in _sources and _sources[file].changed != _changed(file):
        _sources.clear()
        _stamp.cache_clear()
        _reached_from.cache_clear()


def _changed(file: str) -> tuple[int, int]:
    status = os.stat(file)
    return status.st_mtime_ns, status.st_size


def _source(file: str) -> _Source:
    if file not in _sources:
        changed, content = _changed(file), Path(file).read_bytes()
        imports = tuple(dict.fromkeys(_imports(Path(file), content)))
        _sources[file] = _Source(changed, hashlib.sha256(content).digest(), imports)
    return _sources[file]


@cache
def _stamp(file: str) -> str:
    sources = sorted((os.path.basename(one), _source(one).digest) for one in _reached_from(file))
    return hashlib.sha256(repr(sources).encode()).hexdigest()


@cache
def _reached_from(file: str) -> frozenset[str]:
    """A source file and its direct and indirect imports; none if there is no such file."""
    reached: set[str] = set()
    pending = [file] if os.path.isfile(file) else []
    while pending:
        one = pending.pop()
        if one not in reached:
            reached.add(one)
            pending += _source(one).imports
    return frozenset(reached)


def _is_ours(file: str) -> bool:
    return str(Path(file)).startswith(_OWN)


def _imports(path: Path, content: bytes) -> Iterator[str]:
    """Files of the modules that a file imports, other than those of installed libraries."""
    base = path.parent
    while (base / "__init__.py").is_file():
        base = base.parent
    package = path.parent.relative_to(base).parts
    for module, names, plain in _IMPORT.findall(_COMMENT.sub(b"", content)):
        for one in plain.decode(errors="replace").split(","):
            yield from _files(one.split(" as ")[0].split(), str(base), package)
        if module:
            listed = re.sub(r"\bas\s+\w+", "", names.decode(errors="replace"))
            yield from _files([module.decode(), *re.findall(r"\w+", listed)], str(base), package)


def _files(imported: list[str], base: str, package: tuple[str, ...]) -> Iterator[str]:
    """Files of ``[module]`` imported plainly, or ``[module, *names]`` imported from it, in a file of a package."""
    if not imported:
        return
    name = imported[0].lstrip(".")
    dots = len(imported[0]) - len(name)
    parts = (*package[: len(package) + 1 - dots], *name.split(".")) if dots else tuple(name.split("."))
    for root in _roots(base, parts[0] if parts else "", package):
        place = os.path.join(root, *(part for part in parts if part))
        names = imported[1:] if os.path.isdir(place) else []
        found = [file for name in names for file in _module(os.path.join(place, name))]
        whole = [] if found and len(found) == len(imported) - 1 else _module(place)
        if found or whole:
            yield from [*found, *whole]
            return


def _roots(base: str, top: str, package: tuple[str, ...]) -> Iterator[str]:
    """Folders in which a module of the user's or of these packages may lie; libraries are not followed."""
    if top in OURS:
        yield str(_ROOT)
        return
    if top in package[:1] or not _in_library(base):
        yield base
    yield from (entry for entry in sys.path if entry and not _in_library(entry))


@cache
def _in_library(folder: str) -> bool:
    return bool(_LIBRARY & set(Path(folder).parts))


def _module(place: str) -> list[str]:
    return [one for one in (os.path.join(place, "__init__.py"), f"{place}.py") if os.path.isfile(one)][:1]
