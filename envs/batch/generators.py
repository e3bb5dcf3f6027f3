"""NumPy's random number generators in compiled code, known by addresses.

Numba takes a generator from Python in 8 us, on one thread at a time; its addresses take a tenth of that, and lie in the
records that threads work on. The generator must live as long as they are used.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

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


def _generator_at(typing_context: Any, words: Any) -> Any:
    kind = types.NumPyRandomGeneratorType("generator")
    bits = types.NumPyRandomBitGeneratorType("bit_generator")

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, values[0])
        source = cgutils.create_struct_proxy(bits)(context, builder)  # type: ignore[no-untyped-call]
        names = "state", "fnptr_next_uint64", "fnptr_next_uint32", "fnptr_next_double"
        for index, name in enumerate(names):
            word = builder.load(cgutils.gep_inbounds(builder, array.data, index))  # type: ignore[no-untyped-call]
            setattr(source, name, word)
        source.state_address = source.state
        made = cgutils.create_struct_proxy(kind)(context, builder)  # type: ignore[no-untyped-call]
        made.bit_generator = source._getvalue()
        return made._getvalue()

    return kind(words), build


generator_at: Any = intrinsic(_generator_at)
"""The generator of the addresses in an array of int64, in compiled code."""
