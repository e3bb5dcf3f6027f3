"""Numba finds the types of operators once, and the same as before."""

from __future__ import annotations

import operator
from typing import Any

import numba
import numpy as np
import pytest
from numba import types
from numba.core.registry import cpu_target
from numba.core.types.functions import BaseFunction
from numba.extending import overload

from planners.compiled import operators


def function_type(function: Any) -> Any:
    numba.njit(lambda x: x + 1.0)(0.5)  # Numba loads its templates
    context: Any = cpu_target.typing_context
    context.refresh()
    return context.resolve_value_type(function)


def asked(function: Any, *args: Any) -> tuple[Any, int]:
    """The signature of an operator, and how often Numba's own search was asked for it."""
    searches = 0
    find = operators._find

    def counted(*given: Any) -> Any:
        nonlocal searches
        searches += 1
        return find(*given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(operators, "_find", counted)
        signature = function_type(function).get_call_type(cpu_target.typing_context, args, {})
    return signature, searches


@pytest.mark.parametrize(
    ("function", "args"),
    [
        (operator.mul, (types.float64, types.float64)),
        (operator.add, (types.int64, types.float64)),
        (operator.lt, (types.uint64, types.int64)),
        (operator.getitem, (types.float64[:, ::1], types.UniTuple(types.int64, 2))),  # type: ignore[no-untyped-call]
        (operator.setitem, (types.float64[::1], types.int64, types.int64)),
    ],
)
def test_an_operator_is_searched_once_for_each_kind_of_arguments(function: Any, args: Any) -> None:
    first, _ = asked(function, *args)
    second, searches = asked(function, *args)
    assert searches == 0
    assert second == first == operators._find(function_type(function), cpu_target.typing_context, args, {})


def test_numbers_of_other_types_are_not_taken_for_each_other() -> None:
    @numba.njit
    def product(x: Any, y: Any) -> Any:
        return x * y

    assert isinstance(product(3, 4), int)
    assert isinstance(product(3, 0.5), float)
    assert product(np.arange(3.0), 2.0).tolist() == [0.0, 2.0, 4.0]


def test_an_operator_that_was_missing_is_found_once_it_is_there() -> None:
    text = types.unicode_type
    with pytest.raises(numba.TypingError):
        asked(operator.matmul, text, text)

    @overload(operator.matmul)
    def both(a, b):  # type: ignore[no-untyped-def]  # Numba compares its signature with that of what it returns
        return (lambda a, b: 1.0) if a == b == text else None

    assert asked(operator.matmul, text, text)[0].return_type == types.float64


def test_what_an_overload_gives_is_searched_each_time() -> None:
    for _ in range(2):
        assert asked(operator.eq, types.unicode_type, types.unicode_type)[1] > 0
        assert asked(max, types.float64, types.float64)[1] > 0
    assert BaseFunction.get_call_type is operators._remember
