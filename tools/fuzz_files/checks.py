"""What must hold when a damaged file is read."""

from __future__ import annotations

import sys
import time
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

from tools.fuzz_files.mutations import CANARY
from tools.fuzz_files.readers import READERS

MOST_SECONDS = 1.0
"""Time of the processor in which a file is read or refused."""

LONGEST = 2000
"""Characters of a message."""

_CODE = ("os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "pickle.find_class", "socket.connect")
_seen: list[str] | None = None


@dataclass(frozen=True)
class Outcome:
    """What became of a file.

    Attributes:
        refused: whether it was refused, instead of read.
        seconds: time of the processor.
        fault: what was wrong with that, if anything.
        error: the exception, if there was one.
    """

    refused: bool
    seconds: float
    fault: str | None
    error: BaseException | None


def watch() -> None:
    """From now on note while a file is read which code runs that should not; once for each process."""

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if _seen is None or (event not in _CODE and event != "import"):
            return
        canary = str(arguments[0]).startswith(CANARY)
        if canary if event == "import" else not (event == "pickle.find_class" and _by_numba()):
            _seen.append(f"{event} {arguments[0]}")

    sys.addaudithook(hook)


def _by_numba() -> bool:
    """Whether Numba is reading its cache of compiled functions."""
    frame = sys._getframe(2)
    while frame is not None and "numba" not in Path(frame.f_code.co_filename).parts:
        frame = frame.f_back  # type: ignore[assignment]
    return frame is not None


def check(kind: str, seed: int, number: int) -> Outcome:
    """Write and read the file of a number."""
    return check_drawn(kind, Random(f"{kind} {seed} {number}"))


def check_drawn(kind: str, random: Random) -> Outcome:
    """Write and read a file drawn from ``random``."""
    global _seen
    reader = READERS[kind]
    with TemporaryDirectory() as name:
        folder = Path(name)
        reader.write(folder, random)
        error: BaseException | None = None
        _seen, began = [], time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                reader.read(folder)
        except Exception as raised:
            error = raised
        seconds, ran, _seen = time.process_time() - began, _seen, None
        if seconds > MOST_SECONDS:  # the first time, functions may be compiled and modules imported
            began = time.process_time()
            with suppress(Exception):
                reader.read(folder)
            seconds = time.process_time() - began
        fault = _fault(error, name if reader.names_file else "")
        if seconds > MOST_SECONDS:
            fault = f"took {seconds:.1f} s"
        if ran and not reader.imports:
            fault = f"ran code: {', '.join(ran)}"
    return Outcome(error is not None, seconds, fault, error)


def _fault(error: BaseException | None, name: str) -> str | None:
    """What is wrong with a refusal."""
    if error is None:
        return None
    text = str(error)
    if not isinstance(error, ValueError) or type(error) is UnicodeDecodeError:
        return f"{type(error).__name__}: {text[:300]}"
    if "\n" in text.strip() or len(text) > LONGEST or not text.strip():
        return f"a message of {len(text)} characters in {len(text.splitlines())} lines: {text[:200]!r}"
    if name not in text:
        return f"a message without the name of the file: {text[:300]}"
    return None
