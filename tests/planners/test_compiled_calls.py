"""Compiled functions that are called by address, and copies of whole arrays in compiled code."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from numba import njit, types

from planners.compiled.calls import Kernel, call, call_real, clear_array, copy_array, new_array, private

SHORT = np.dtype([("a", "f8"), ("q", "f8", (2,)), ("n", "i8")], align=True)
LONG = np.dtype([("a", "f8"), ("q", "f8", (2,)), ("n", "i8"), ("more", "f8", (3,))], align=True)


def _ratio(record: Any, values: Any) -> float:
    record.a = values[0] / record.q[1]
    return record.a + record.n


def _refuse(record: Any) -> None:
    if record.n > 3:
        raise ValueError("too many")
    record.n += 1


RATIO, REFUSE = Kernel(_ratio), Kernel(_refuse)


@private
def _doubled(x: float) -> float:
    return 2.0 * x


@njit
def _quadrupled(x: float) -> float:
    return 2.0 * _doubled(x)


def test_python_can_call_what_is_compiled_for_compiled_callers() -> None:
    for copied in (_doubled, copy.deepcopy(_doubled), pickle.loads(pickle.dumps(_doubled))):
        assert copied(1.0) == 2.0
    assert _quadrupled(1.5) == 6.0
    assert _doubled(np.float32(1.5)) == 3.0


@njit
def _ratios(records: Any, address: int, values: Any) -> tuple[float, float]:
    record = records[0]
    return call_real(address, record, values), call_real(address, record, record.more)


@njit
def _refused(records: Any, address: int) -> None:
    call(address, records[0])


def test_a_kernel_takes_records_that_begin_like_the_one_it_knows() -> None:
    records = np.zeros(1, LONG)
    records["q"], records["n"], records["more"] = 3.0, 4, 6.0
    address = RATIO.address(SHORT, types.float64[::1])
    assert address == RATIO.address(SHORT, types.float64[::1])
    assert _ratios(records, address, np.ones(5)) == (1.0 / 3.0 + 4.0, 6.0)
    assert records["a"] == 2.0
    np.testing.assert_array_equal(records["more"], [[6.0, 6.0, 6.0]])


def test_an_error_in_a_kernel_reaches_the_caller() -> None:
    records = np.zeros(1, LONG)
    records["n"] = 3
    _refused(records, REFUSE.address(SHORT))
    with pytest.raises(ValueError, match="too many"):
        _refused(records, REFUSE.address(SHORT))
    assert records["n"] == 4


@njit
def _copy(target: Any, source: Any) -> None:
    copy_array(target, source)


@njit
def _clear(target: Any) -> None:
    clear_array(target)


def test_whole_arrays_are_copied_and_cleared() -> None:
    target, source = np.zeros((2, 3)), np.arange(6.0).reshape(2, 3)
    _copy(target, source)
    np.testing.assert_array_equal(target, np.arange(6.0).reshape(2, 3))
    _clear(target[0])
    np.testing.assert_array_equal(target, [[0.0, 0.0, 0.0], [3.0, 4.0, 5.0]])


@pytest.mark.parametrize("source", [np.arange(6.0)[::2], np.arange(3), np.ones((1, 3))])
def test_only_contiguous_arrays_of_one_kind_are_copied(source: Any) -> None:
    with pytest.raises(TypeError, match="copy_array takes contiguous arrays of one kind"):
        _copy(np.zeros(3), source)


@njit
def _filled(n: int) -> Any:
    row, block = new_array(n), new_array(2, n, 3)
    clear_array(block)
    for i in range(n):
        row[i] = block[1, i, 2] = i + 0.5
    return row, block


def test_a_new_array_has_the_shape_that_is_asked() -> None:
    row, block = _filled(4)
    expected = np.zeros((2, 4, 3))
    expected[1, :, 2] = row
    assert row.tolist() == [0.5, 1.5, 2.5, 3.5]
    assert block.flags.c_contiguous
    assert np.array_equal(block, expected)
