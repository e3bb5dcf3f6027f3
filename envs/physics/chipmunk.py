"""The compiled bridge to Chipmunk, the C library inside Pymunk.

Pymunk's Python calls cost more than the physics itself. The functions below are the same C functions, callable from
numba-compiled code. Bodies, spaces and joints are made with Pymunk; `address` gives the number that stands for one.

Chipmunk passes its two-component vectors by value, and compiled code passes them as two numbers. On every 64-bit Linux
and macOS, and on Windows for ARM (System V and AArch64 calling conventions), such a struct goes through two
floating-point registers, exactly like two doubles. On Windows x64 it goes by pointer to a copy of the caller's, and
comes back through a hidden first pointer.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Callable
from typing import Any

import llvmlite.binding
from llvmlite import ir
from numba import types
from numba.core import cgutils, config
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

try:
    from pymunk._chipmunk_cffi import ffi, lib
except ImportError as error:  # pragma: no cover - only with an unknown Pymunk
    raise ImportError(
        "planarm calls the Chipmunk library inside Pymunk, and this Pymunk keeps it somewhere else; "
        'install a tested one: pip install "pymunk>=7.3,<8"'
    ) from error

if sys.maxsize <= 2**32:  # pragma: no cover - not reached on supported platforms
    raise ImportError("planarm's bridge to Chipmunk needs 64-bit Python")

if getattr(config, "DISABLE_JIT", False):
    raise ImportError("planarm's environments run compiled code only; unset NUMBA_DISABLE_JIT")

VECTORS_BY_POINTER = sys.platform == "win32" and platform.machine().upper() in ("AMD64", "X86_64")
"""Whether C functions take and return vectors by pointer here."""

_pointer, _real, _nothing = types.intp, types.float64, types.void
_vector = types.UniTuple(_real, 2)  # type: ignore[no-untyped-call]


def _register(name: str) -> str:
    """Register the C function `name` with the compiler and return its symbol.

    A symbol, unlike a pointer, stays valid in numba's on-disk cache.
    """
    if not hasattr(lib, name):
        raise ImportError(f'this Pymunk has no {name}; install a tested one: pip install "pymunk>=7.3,<8"')
    symbol = f"planarm_{name}"
    llvmlite.binding.add_symbol(symbol, int(ffi.cast("uintptr_t", ffi.addressof(lib, name))))
    return symbol


def _bind(name: str, result: Any, *arguments: Any) -> Callable[..., Any]:
    """The C function `name`, which takes and returns numbers, callable from compiled code."""
    return types.ExternalFunction(_register(name), result(*arguments))


def vector_function(
    symbol: str, result: Any, *arguments: Any, by_pointer: bool = VECTORS_BY_POINTER, convention: str = ""
) -> Callable[..., Any]:
    """A C function that takes or returns vectors, callable from compiled code.

    Args:
        symbol: its name to the compiler.
        result: its type; a vector is returned as a tuple.
        arguments: their types; a vector is given as two numbers.
        by_pointer: how vectors are passed, see above.
        convention: LLVM's name of the calling convention; the platform's own when left out.
    """
    real, vector = ir.DoubleType(), ir.LiteralStructType([ir.DoubleType()] * 2)
    passed = {_real: real, _pointer: ir.IntType(64), _nothing: ir.VoidType(), _vector: vector}

    def call(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        def slot() -> Any:
            place = cgutils.alloca_once(builder, ir.ArrayType(real, 2))  # type: ignore[no-untyped-call]
            place.align = 16
            return place

        hidden = [slot()] if by_pointer and result == _vector else []
        given, sent = iter(cgutils.unpack_tuple(builder, values[0])), list(hidden)  # type: ignore[no-untyped-call]
        for kind in arguments:
            if kind == _vector and by_pointer:
                sent.append(slot())
                builder.store(context.make_tuple(builder, _vector, [next(given), next(given)]), sent[-1])
            else:
                sent += [next(given) for _ in range(2 if kind == _vector else 1)]
        prototype = ir.FunctionType(ir.VoidType() if hidden else passed[result], [one.type for one in sent])
        function = cgutils.get_or_insert_function(builder.module, prototype, symbol)  # type: ignore[no-untyped-call]
        function.calling_convention = convention
        returned = builder.call(function, sent)
        if result != _vector:
            return context.get_dummy_value() if result == _nothing else returned
        if hidden:
            return builder.load(hidden[0])
        components = [builder.extract_value(returned, index) for index in range(2)]
        return context.make_tuple(builder, _vector, components)

    flat = types.Tuple([one for kind in arguments for one in (kind if kind == _vector else [kind])])  # type: ignore[no-untyped-call]

    @intrinsic
    def function(typing_context: Any, *given: Any) -> Any:
        return result(flat), call

    return function


def _bind_vectors(name: str, result: Any, *arguments: Any) -> Callable[..., Any]:
    """The C function `name`, which takes or returns vectors, callable from compiled code."""
    return vector_function(_register(name), result, *arguments)


def _reals_at(typing_context: Any, address: Any) -> Any:
    """A pointer to float64 numbers at an address, in compiled code."""

    def cast(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.int64), cast  # type: ignore[no-untyped-call]


reals_at: Any = intrinsic(_reals_at)
"""A pointer to the float64 numbers at an address, in compiled code."""


def _array_at(typing_context: Any, address: Any, shape: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        array = context.make_array(signature.return_type)(context, builder)
        sizes = cgutils.unpack_tuple(builder, values[1])  # type: ignore[no-untyped-call]
        strides = [context.get_constant(types.intp, 8)]
        for size in reversed(sizes[1:]):
            strides.insert(0, builder.mul(strides[0], size))
        data = builder.inttoptr(values[0], ir.DoubleType().as_pointer())
        populate_array(array, data, sizes, strides, 8, None)  # type: ignore[no-untyped-call]
        return array._getvalue()

    sizes = types.UniTuple(types.intp, len(shape))  # type: ignore[no-untyped-call]
    return types.Array(types.float64, len(shape), "C")(types.intp, sizes), build


array_at: Any = intrinsic(_array_at)
"""``array_at(address, shape)``: the array of float64 of a shape that lies at an address, in compiled code."""


space_step = _bind("cpSpaceStep", _nothing, _pointer, _real)
space_get_current_time_step = _bind("cpSpaceGetCurrentTimeStep", _real, _pointer)
space_set_current_time_step = _bind("cpSpaceSetCurrentTimeStep", _nothing, _pointer, _real)
space_add_constraint = _bind("cpSpaceAddConstraint", _pointer, _pointer, _pointer)
space_remove_constraint = _bind("cpSpaceRemoveConstraint", _nothing, _pointer, _pointer)
body_get_angle = _bind("cpBodyGetAngle", _real, _pointer)
body_set_angle = _bind("cpBodySetAngle", _nothing, _pointer, _real)
body_get_angular_velocity = _bind("cpBodyGetAngularVelocity", _real, _pointer)
body_set_angular_velocity = _bind("cpBodySetAngularVelocity", _nothing, _pointer, _real)
body_set_mass = _bind("cpBodySetMass", _nothing, _pointer, _real)
body_set_moment = _bind("cpBodySetMoment", _nothing, _pointer, _real)
body_set_center_of_gravity = _bind_vectors("cpBodySetCenterOfGravity", _nothing, _pointer, _vector)
body_get_moment = _bind("cpBodyGetMoment", _real, _pointer)
body_get_torque = _bind("cpBodyGetTorque", _real, _pointer)
body_set_torque = _bind("cpBodySetTorque", _nothing, _pointer, _real)
body_set_position = _bind_vectors("cpBodySetPosition", _nothing, _pointer, _vector)
body_set_velocity = _bind_vectors("cpBodySetVelocity", _nothing, _pointer, _vector)
body_get_position = _bind_vectors("cpBodyGetPosition", _vector, _pointer)
body_get_velocity = _bind_vectors("cpBodyGetVelocity", _vector, _pointer)
pivot_joint_init = _bind_vectors("cpPivotJointInit", _pointer, _pointer, _pointer, _pointer, _vector, _vector)
constraint_set_error_bias = _bind("cpConstraintSetErrorBias", _nothing, _pointer, _real)
constraint_get_user_data = _bind("cpConstraintGetUserData", _pointer, _pointer)
constraint_set_user_data = _bind("cpConstraintSetUserData", _nothing, _pointer, _pointer)


def address(cdata: Any) -> int:
    """The address of a Pymunk object's C struct (``space._space``, ``body._body``, ``joint._constraint``)."""
    return int(ffi.cast("uintptr_t", cdata))
