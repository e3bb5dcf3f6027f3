"""The compiled bridge to Chipmunk, the C library inside Pymunk.

Pymunk's Python calls cost more than the physics itself. The functions below are the same C functions, callable from
numba-compiled code. Bodies, spaces and joints are made with Pymunk; `address` gives the number that stands for one.

Chipmunk passes its two-component vectors by value. On every 64-bit Linux and macOS (System V and AArch64 calling
conventions) such a struct is passed in two floating-point registers, exactly like two doubles, so a vector argument is
declared here as two doubles. Windows passes it differently and is refused.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import llvmlite.binding
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.numpy_support import carray

from planners.typing import Array

try:
    from pymunk._chipmunk_cffi import ffi, lib
except ImportError as error:  # pragma: no cover - only with an unknown Pymunk
    raise ImportError(
        "planarm calls the Chipmunk library inside Pymunk, and this Pymunk keeps it somewhere else; "
        'install a tested one: pip install "pymunk>=7.3,<8"'
    ) from error

if sys.platform == "win32" or sys.maxsize <= 2**32:  # pragma: no cover - not reached on supported platforms
    raise ImportError(
        "planarm's bridge to Chipmunk needs 64-bit Linux or macOS (on Windows, the Windows Subsystem for Linux)"
    )

_pointer, _real, _nothing = types.intp, types.float64, types.void
_vector = (_real, _real)


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


def _bind_vector_getter(name: str) -> Callable[..., tuple[float, float]]:
    """The C function `name`, which takes a pointer and returns a vector, callable from compiled code."""
    symbol = _register(name)

    @intrinsic
    def getter(typing_context: Any, pointer: Any) -> Any:
        def call(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            real = ir.DoubleType()
            prototype = ir.FunctionType(ir.LiteralStructType([real, real]), [ir.IntType(64)])
            function = cgutils.get_or_insert_function(  # type: ignore[no-untyped-call]
                builder.module, prototype, symbol
            )
            vector = builder.call(function, arguments)
            components = [builder.extract_value(vector, 0), builder.extract_value(vector, 1)]
            return context.make_tuple(builder, signature.return_type, components)

        return types.UniTuple(_real, 2)(_pointer), call  # type: ignore[no-untyped-call]

    return getter


def _reals_at(typing_context: Any, address: Any) -> Any:
    """A pointer to float64 numbers at an address, in compiled code."""

    def cast(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.int64), cast  # type: ignore[no-untyped-call]


_pointer_to_reals: Any = intrinsic(_reals_at)


@njit(cache=True, nogil=True)
def array_at(address: int, shape: Any) -> Array:
    """The array of float64 of a shape that lies at an address, in compiled code."""
    array: Array = carray(_pointer_to_reals(address), shape)
    return array


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
body_set_center_of_gravity = _bind("cpBodySetCenterOfGravity", _nothing, _pointer, *_vector)
body_set_torque = _bind("cpBodySetTorque", _nothing, _pointer, _real)
body_set_position = _bind("cpBodySetPosition", _nothing, _pointer, *_vector)
body_set_velocity = _bind("cpBodySetVelocity", _nothing, _pointer, *_vector)
body_get_position = _bind_vector_getter("cpBodyGetPosition")
body_get_velocity = _bind_vector_getter("cpBodyGetVelocity")
pivot_joint_init = _bind("cpPivotJointInit", _pointer, _pointer, _pointer, _pointer, *_vector, *_vector)
constraint_set_error_bias = _bind("cpConstraintSetErrorBias", _nothing, _pointer, _real)
constraint_get_user_data = _bind("cpConstraintGetUserData", _pointer, _pointer)
constraint_set_user_data = _bind("cpConstraintSetUserData", _nothing, _pointer, _pointer)


def address(cdata: Any) -> int:
    """The address of a Pymunk object's C struct (``space._space``, ``body._body``, ``joint._constraint``)."""
    return int(ffi.cast("uintptr_t", cdata))
