"""Compiled code passes vectors to C functions in the calling conventions of Unix and of Windows x64."""

from __future__ import annotations

import ctypes
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite.binding
import pytest
from numba import njit, types

from envs.physics.chipmunk import vector_function

POINTER, REAL, NOTHING = types.intp, types.float64, types.void
VECTOR = types.UniTuple(REAL, 2)  # type: ignore[no-untyped-call]

SOURCE = """
typedef struct { double x, y; } Vector;
typedef struct { Vector position, velocity; double angle; } Body;
#define EXPORT __attribute__((CONVENTION))
EXPORT Vector get_position(Body *body) { return body->position; }
EXPORT void set_position(Body *body, Vector p) { body->position = p; p.x = p.y = -1.0; }
EXPORT Body *init(Body *joint, Body *a, Body *b, Vector first, Vector second) {
    joint->position = first; joint->velocity = second;
    joint->angle = a->angle - b->angle;
    first.x = second.y = 1e9;
    return joint;
}
EXPORT Vector turn(Vector v, double angle, Body *body) { Vector r = {v.x + angle, v.y * body->angle}; return r; }
"""


class Body(ctypes.Structure):
    _fields_ = [(name, ctypes.c_double) for name in ("x", "y", "vx", "vy", "angle")]


CONVENTIONS = {"ms_abi": {"by_pointer": True, "convention": "win64cc"}, "sysv_abi": {"by_pointer": False}}


@pytest.fixture(scope="module", params=CONVENTIONS)
def c_function(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    """C functions compiled with a calling convention, by name, result and arguments."""
    compiler = shutil.which("gcc")
    if compiler is None or platform.machine() != "x86_64" or sys.platform != "linux":
        pytest.skip("needs gcc on Linux x86_64 to compile functions of the other calling convention")
    folder: Path = tmp_path_factory.mktemp("c")
    (folder / "vectors.c").write_text(SOURCE)
    define = f"-DCONVENTION={request.param}"
    subprocess.run(
        [compiler, "-O2", "-shared", "-fPIC", define, "vectors.c", "-o", "vectors.so"], cwd=folder, check=True
    )
    library = ctypes.CDLL(str(folder / "vectors.so"))

    def bind(name: str, result: Any, *arguments: Any) -> Any:
        symbol = f"{request.param}_{name}"
        llvmlite.binding.add_symbol(symbol, ctypes.cast(getattr(library, name), ctypes.c_void_p).value)
        return vector_function(symbol, result, *arguments, **CONVENTIONS[request.param])

    return bind


def test_a_vector_is_returned(c_function: Callable[..., Any]) -> None:
    get_position = c_function("get_position", VECTOR, POINTER)
    body = Body(1.5, -2.5)
    assert njit(lambda pointer: get_position(pointer))(ctypes.addressof(body)) == (1.5, -2.5)


def test_a_vector_is_taken(c_function: Callable[..., Any]) -> None:
    set_position = c_function("set_position", NOTHING, POINTER, VECTOR)
    body = Body(angle=0.5)

    @njit
    def run(pointer: int, x: float, y: float) -> tuple[float, float]:
        for i in range(1000):  # in a loop, and what the callee does to its copy does not come back
            set_position(pointer, x + i, y - i)
        return x, y

    assert run(ctypes.addressof(body), 1.0, 2.0) == (1.0, 2.0)
    assert (body.x, body.y, body.vx, body.angle) == (1000.0, -997.0, 0.0, 0.5)


def test_two_vectors_are_taken_behind_pointers(c_function: Callable[..., Any]) -> None:
    init = c_function("init", POINTER, POINTER, POINTER, POINTER, VECTOR, VECTOR)
    joint, a, b = Body(), Body(angle=3.0), Body(angle=1.0)
    pointers = [ctypes.addressof(one) for one in (joint, a, b)]
    assert njit(lambda j, a, b: init(j, a, b, 1.0, 2.0, 3.0, 4.0))(*pointers) == pointers[0]
    assert [joint.x, joint.y, joint.vx, joint.vy, joint.angle] == [1.0, 2.0, 3.0, 4.0, 2.0]


def test_a_vector_is_taken_and_returned_beside_numbers(c_function: Callable[..., Any]) -> None:
    turn = c_function("turn", VECTOR, VECTOR, REAL, POINTER)
    body = Body(angle=-2.0)
    assert njit(lambda pointer: turn(1.0, 2.0, 0.25, pointer))(ctypes.addressof(body)) == (1.25, -4.0)


def test_interpreted_environments_are_refused_in_one_line() -> None:
    command = [sys.executable, "-m", "planarm", "rollout", "ConveyorTrack-v0", "--policy", "random"]
    done = subprocess.run(
        command, env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == "planarm rollout: planarm's environments run compiled code only; unset NUMBA_DISABLE_JIT\n"
