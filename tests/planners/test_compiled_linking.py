"""What becomes machine code of its own, and what is only a part of its callers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numba import jit, njit, types
from numba.core.registry import cpu_target

import envs  # noqa: F401  (registers the environments)
from planners.compiled.calls import Kernel, address_of, call_real, private
from planners.compiled.linking import LinkedLibrary


@private
def _half(x: float) -> float:
    if x < 0.0:
        raise ValueError("negative")
    return 0.5 * x


@njit
def _quarter(x: float) -> float:
    return _half(_half(x))


@njit
def _called(address: int, x: float) -> float:
    return call_real(address, x)


def library(compiled: Any) -> Any:
    return compiled.overloads[(types.float64,)].library


def translated(compiled: Any) -> bool:
    """Whether the engine that runs machine code knows a function."""
    overload = compiled.overloads[(types.float64,)]
    context: Any = cpu_target.target_context
    return bool(context.codegen()._engine.is_symbol_defined(overload.fndesc.llvm_func_name))


def test_a_function_without_an_entry_is_translated_as_a_part_of_its_callers() -> None:
    assert _quarter(3.0) == 0.75
    with pytest.raises(ValueError, match="negative"):
        _quarter(-1.0)
    assert isinstance(library(_half), LinkedLibrary)
    assert library(_quarter)._translated
    assert not library(_half)._translated
    assert library(_half).serialize_using_object_code()[1] == "bitcode"
    assert library(_quarter).serialize_using_object_code()[1] == "object"


def test_an_address_is_one_of_machine_code() -> None:
    @private
    def third(x: float) -> float:
        return x / 3.0

    assert _called(address_of(third, types.float64), 1.5) == 0.5
    assert translated(third)


def test_a_kernel_is_translated_when_it_is_compiled() -> None:
    """So that the cache keeps its machine code, and the second process does not translate it."""
    kernel = Kernel(lambda x: 2.0 * x)
    kernel._compiled.compile((types.float64,))
    assert library(kernel._compiled)._translated


def test_an_array_of_another_shape_is_refused() -> None:
    @njit
    def assign(target: Any, source: Any) -> None:
        target[:] = source

    target = np.zeros((2, 3))
    assign(target, np.ones(3))
    assert target.sum() == 6.0
    with pytest.raises(ValueError, match="cannot assign slice from input of different shape"):
        assign(target, np.ones(2))


@njit(inline="always")
def _sum_to(n: int) -> int:
    total = 0
    for i in range(n):
        if i == 7:
            break
        total += i
    return total


def test_functions_are_inlined_in_several_places_and_depths() -> None:
    @njit(inline="always")
    def twice(n: int) -> int:
        return _sum_to(n) + _sum_to(n + 1)

    @njit
    def both(n: int) -> int:
        return twice(n) * twice(2) + _sum_to(3)

    plain = [sum(range(min(n, 7))) for n in range(11)]
    assert [both(n) for n in range(10)] == [(plain[n] + plain[n + 1]) * (plain[2] + plain[3]) + 3 for n in range(10)]


def test_generators_keep_what_they_need_between_two_values() -> None:
    @njit
    def running(values: Any) -> Any:
        total, factor = 0.0, 2.0
        for value in values:
            total += factor * value
            yield total

    @njit
    def last(values: Any) -> float:
        found = -1.0
        for value in running(values):
            found = value
        return found

    assert last(np.arange(4.0)) == 12.0
    assert list(running(np.arange(4.0))) == [0.0, 2.0, 6.0, 12.0]


def test_object_mode_knows_the_variables_of_a_block() -> None:
    @jit(forceobj=True, looplift=False)
    def words(count: int) -> list[str]:
        found, text = [], "a"
        for i in range(count):
            found.append(text * i if i != 1 else "one")
        return found

    assert words(3) == ["", "one", "aa"]


def test_linear_algebra_imports_scipy_when_it_is_wanted() -> None:
    code = """
import sys, numpy as np, gymnasium as gym, envs
from numba import njit
env = gym.make("MinTorqueMove-v0")
env.reset(seed=0)
print("scipy.linalg" in sys.modules)
print(njit(lambda a, b: np.linalg.solve(a, a @ b))(np.array([[2.0, 1.0], [0.0, 4.0]]), np.array([3.0, 5.0])))
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300)
    assert run.stdout == "False\n[3. 5.]\n"


def test_a_version_of_numba_whose_internals_are_not_known_compiles_as_it_does(tmp_path: Path) -> None:
    code = """
import numba
numba.version_info = numba.version_info._replace(short=(9, 9))
import sys, numpy as np, gymnasium as gym, envs
from numba.core.codegen import JITCPUCodegen
env = gym.make("MinTorqueMove-v0")
env.reset(seed=0)
print(float(env.step(np.full(3, 0.1, np.float32))[0].sum()), JITCPUCodegen._library_class.__name__)
print("planners.compiled.shortcuts" in sys.modules)
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    run = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True, timeout=300
    )
    number, library_class, shortened = run.stdout.split()
    env: Any = gym.make("MinTorqueMove-v0")
    env.reset(seed=0)
    assert float(number) == float(env.step(np.full(3, 0.1, np.float32))[0].sum())
    assert (library_class, shortened) == ("JITCodeLibrary", "False")
