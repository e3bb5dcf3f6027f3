"""What Numba leaves out while it compiles changes nothing that it makes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba.extending import overload

import planners

COMPILE = """
import re, sys
{first}
import numba, numpy as np

@numba.njit(inline="always")
def share(x, low, high):
    while x > 1.0:
        x *= 0.5
    return min(1.0, max(0.0, (x - low) / (high - low)))

@numba.njit(inline="always")
def twice(x, high):
    return share(x, -high, high) + share(0.5 * x, 0.0, high)

@numba.njit(error_model="numpy")
def scale(xs, high):
    scaled = np.empty((xs.shape[0], 2))
    for i in range(xs.shape[0]):
        record = xs[i]
        scaled[i, 0], scaled[i, 1] = twice(record.x, high), record.pair[1] / high
    return scaled

@numba.njit
def total(xs, high):
    kept = [one for one in scale(xs, high).sum(axis=1) if one > 0.1]
    return max(kept) + len(kept)

xs = np.ones(5, [("x", "f8"), ("pair", "f4", (2,))])
total(xs, 4.0)
for function in scale, total:
    (code,) = function.inspect_asm().values()
    print(re.sub(r"_?_ZN\\S*|\\.const\\.\\S*|# .*|.*missing Environment.*\\n.*", "", code))
"""


def machine_code(first: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", COMPILE.format(first=first)],
        cwd=Path(planners.__file__).parent.parent,
        env={**os.environ, "PYTHONHASHSEED": "0"},
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout


def test_the_machine_code_is_the_same() -> None:
    code = machine_code("")
    assert code.count("\n") > 200
    assert machine_code("import planners.compiled.economy") == code


def ratio(a: float, b: float) -> float:
    raise NotImplementedError


@overload(ratio)
def _ratio(a, b):  # type: ignore[no-untyped-def]  # Numba compares its signature with that of what it returns
    return lambda a, b: a / b


def test_an_overload_divides_as_its_caller() -> None:
    def divide(x: float) -> float:
        return ratio(1.0, x)

    compiled: Any = numba.njit
    python, also = compiled(divide), compiled(nogil=True)(divide)
    like_numpy = compiled(error_model="numpy")(divide)
    for one in python, also:
        with pytest.raises(ZeroDivisionError):
            one(0.0)
    assert like_numpy(0.0) == np.inf
    assert python(4.0) == like_numpy(4.0) == 0.25


def test_what_is_registered_later_is_found() -> None:
    def later(x: float) -> float:
        raise NotImplementedError

    use = numba.njit(lambda x: later(x))
    with pytest.raises(numba.TypingError):
        use(1.0)

    @overload(later)
    def _later(x):  # type: ignore[no-untyped-def]
        return lambda x: x + 1.0

    assert numba.njit(lambda x: later(x))(1.0) == 2.0


@pytest.mark.filterwarnings("ignore::numba.NumbaWarning")
def test_generators_and_objects_compile() -> None:
    @numba.njit
    def squares(count: int) -> Any:
        for i in range(count):
            yield i * i

    @numba.jit(forceobj=True)
    def texts(count: int) -> list[str]:
        found = []
        for i in range(count):
            found.append(str(i))
        return found

    assert list(squares(4)) == [0, 1, 4, 9]
    assert texts(3) == ["0", "1", "2"]


def test_linear_algebra_is_loaded_for_its_use_only(tmp_path: Path) -> None:
    code = """
import sys, planners, numba, numpy as np
numba.njit(lambda x: x + 1.0)(1.0)
print("scipy.linalg" in sys.modules)
print(numba.njit(lambda a: np.dot(a, a))(np.arange(3.0)))
"""
    folder = Path(planners.__file__).parent.parent
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["False", "5.0"]
