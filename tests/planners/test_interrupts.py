"""Ctrl-C while compiled code runs is a KeyboardInterrupt, not a crash."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import pytest
from numba.core.dispatcher import Dispatcher

import envs
import planners


def modules() -> Iterator[ModuleType]:
    for package in (planners, envs):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            yield importlib.import_module(found.name)


def gives_named_tuple(function: Any) -> bool:
    """Whether a compiled function's declared result is a named tuple, or has one in it."""
    declared = str(function.py_func.__annotations__.get("return", ""))
    named = (function.py_func.__globals__.get(name) for name in re.findall(r"\w+", declared))
    return any(isinstance(one, type) and issubclass(one, tuple) and hasattr(one, "_fields") for one in named)


def calls_from_python(module: ModuleType) -> Iterator[tuple[str, Any]]:
    """What the interpreted functions of a module call, where that is a global name."""
    for node in ast.parse(inspect.getsource(module)).body:
        decorators = [ast.unparse(one) for one in getattr(node, "decorator_list", [])]
        if any("njit" in one or one in ("private", "inlined") for one in decorators):
            continue
        for call in (one for one in ast.walk(node) if isinstance(one, ast.Call)):
            first, *rest = ast.unparse(call.func).split(".")
            value = vars(module).get(first)
            for name in rest:
                value = getattr(value, name, None)
            yield f"{module.__name__}:{call.lineno}", value


def test_no_compiled_function_gives_python_a_named_tuple() -> None:
    """Numba's conversion of a named tuple runs Python code, and a crash follows where a signal interrupts that."""
    found = [
        (place, called.py_func.__qualname__)
        for module in modules()
        for place, called in calls_from_python(module)
        if isinstance(called, Dispatcher) and gives_named_tuple(called)
    ]
    assert found == []


# Plans of every kind, interrupted at random instants; a crash ends the process with a signal.
INTERRUPTED = """
import faulthandler, random, signal, sys, time
import planners
from planners import SCARA_1M, FixedJoints, JointLimits, MotionProblem, MovingHand

faulthandler.enable()
signal.signal(signal.SIGALRM, signal.default_int_handler)
limits = JointLimits(angle=(3.0, 2.9), velocity=(3.0, 3.0), acceleration=(20.0, 20.0), torque=(900.0, 400.0))
part = MovingHand([-0.9, 1.732], [0.2, 0.0])
belt = MotionProblem(arm=SCARA_1M, q=SCARA_1M.inverse_kinematics([-0.8, 1.732])[0], target=part, horizon=3.0)
rest = MotionProblem(arm=SCARA_1M, q=[0.1, 1.0], target=FixedJoints([0.6, 1.5]), horizon=2.0, limits=limits)
draw = random.Random(1).uniform
for planner, variant, problem in (
    (planners.dpct, "optimal", belt),
    (planners.dpct, "timing", rest),
    (planners.dpct, "torque", rest),
    (planners.lagrange, "via", rest),
    (planners.apf, "field", belt),
):
    def plan():
        try:
            planner.plan(problem, variant=variant)
        except planners.Infeasible:
            pass
    plan()
    start = time.perf_counter()
    plan()
    taken, met = time.perf_counter() - start, 0
    end = time.perf_counter() + 20.0
    while met < 30 and time.perf_counter() < end:
        try:
            signal.setitimer(signal.ITIMER_REAL, draw(1e-4, 1.5 * taken))
            plan()
            plan()
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        except KeyboardInterrupt:
            met += 1
    print(variant, met)
"""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs signal.setitimer")
def test_an_interrupt_anywhere_in_a_plan_is_a_keyboard_interrupt() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    met = dict(line.split() for line in done.stdout.splitlines())
    assert list(met) == ["optimal", "timing", "torque", "via", "field"]
    assert all(int(count) >= 5 for count in met.values()), met


def test_an_interrupt_while_scipy_is_imported_is_a_keyboard_interrupt() -> None:
    """Compiled products of matrices need it: imported in the middle of them, it would end the process."""
    code = """
import signal, sys
from planners import SCARA_50CM, FixedHand, MotionProblem, plan

class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == "scipy.linalg":
            signal.raise_signal(signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)  # a parent in the background ignores it
sys.meta_path.insert(0, Interrupts())
problem = MotionProblem(SCARA_50CM, [0.0, 1.0], FixedHand([0.4, 0.4]), 3.0)
try:
    plan(problem)
except KeyboardInterrupt:
    print("interrupted")
del sys.meta_path[0]
print(plan(problem).planner)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert (run.returncode, run.stdout) == (0, "interrupted\ndpct (optimal)\n"), run.stderr
