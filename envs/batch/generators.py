"""NumPy's random number generators in compiled code, known by addresses.

Numba takes a generator from Python in 8 us, on one thread at a time; its addresses take a tenth of that, and lie in the
records that threads work on. The generator must live as long as they are used.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.random.distributions import random_standard_normal

from planners.compiled.calls import inlined

WORDS = 4
"""Number of addresses of a generator."""


def addresses_of(generator: np.random.Generator) -> tuple[int, ...]:
    """The addresses of a generator: its state, and the functions that give its next numbers."""
    bits: Any = generator.bit_generator
    return (bits.ctypes.state_address, *_functions(type(bits).__name__))


@cache
def _functions(kind: str) -> tuple[int, ...]:
    """The addresses of the functions that all bit generators of a kind, ``"PCG64"``, share."""
    made = getattr(np.random, kind)(0).ctypes
    every = made.next_uint64, made.next_uint32, made.next_double
    return tuple(int(ctypes.cast(one, ctypes.c_void_p).value or 0) for one in every)


def _next(place: int, bits: Any, result: Any) -> Any:
    """A function of compiled code that calls one of the functions with the state, which returns so many ``bits``."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        array, word = context.make_array(signature.args[0])(context, builder, values[0]), ir.IntType(64)
        state, function = (
            builder.load(cgutils.gep_inbounds(builder, array.data, index))  # type: ignore[no-untyped-call]
            for index in (0, place)
        )
        number = builder.call(builder.inttoptr(function, ir.FunctionType(bits, [word]).as_pointer()), [state])
        return builder.zext(number, word) if bits == ir.IntType(32) else number

    @intrinsic
    def following(typing_context: Any, words: Any) -> Any:
        return result(words), build

    return following


_next_uint32: Any = _next(2, ir.IntType(32), types.int64)

uniform: Any = _next(3, ir.DoubleType(), types.float64)
"""``generator.random()`` in compiled code, of the generator of the addresses in an array of int64."""


@inlined
def below(words: Any, count: int) -> int:
    """``generator.integers(count)`` in compiled code, for a small count, by Lemire's method."""
    least = (2**32 - count) % count
    while True:
        product = _next_uint32(words) * count
        if product & 0xFFFFFFFF >= least:
            return int(product >> 32)


def _bits_at(typing_context: Any, words: Any) -> Any:
    bits = types.NumPyRandomBitGeneratorType("bit_generator")

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, values[0])
        source = cgutils.create_struct_proxy(bits)(context, builder)  # type: ignore[no-untyped-call]
        names = "state", "fnptr_next_uint64", "fnptr_next_uint32", "fnptr_next_double"
        for index, name in enumerate(names):
            word = builder.load(cgutils.gep_inbounds(builder, array.data, index))  # type: ignore[no-untyped-call]
            setattr(source, name, word)
        source.state_address = source.state
        return source._getvalue()

    return bits(words), build


_bits: Any = intrinsic(_bits_at)


@inlined
def normal(words: Any) -> float:
    """``generator.standard_normal()`` in compiled code."""
    return float(random_standard_normal(_bits(words)))  # type: ignore[no-untyped-call]
