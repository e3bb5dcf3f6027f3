"""Ctrl-C while compiled code runs is a KeyboardInterrupt, not a crash."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from types import ModuleType
from typing import Any

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
        if any("njit" in one for one in decorators):
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
