"""Calls of compiled functions by their address.

Numba copies a function into every compiled function that calls it, and LLVM optimises and translates each copy. A
`Kernel` is compiled once for each kind of arguments. Its callers get its address as a number, which costs one indirect
call, and do not depend on its code.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numba import config, from_dtype, njit, typeof, types
from numba.core import cgutils
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering
from numba.extending import intrinsic
from numba.np.arrayobj import _empty_nd_impl

Function = TypeVar("Function", bound=Callable[..., Any])

_njit: Any = njit  # whose types do not know every option


def inlined(function: Function) -> Function:
    """Compile a function as a part of each caller, not on its own: for what is called in one or two places."""
    compiled: Function = _njit(cache=True, nogil=True, inline="always")(function)
    return compiled


class _Private(CPUDispatcher):
    def __call__(self, *arguments: Any) -> Any:
        return _entrance(self)(*arguments)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """What a compiled caller calls: one function for every number, also for constants in the caller's code."""
        unliteral: Any = types.unliteral
        return super().get_call_template([unliteral(each) for each in args], kws)


@cache
def _entrance(function: _Private) -> Any:
    """A compiled caller of a function, which Python can call."""
    return _njit(lambda *arguments: function(*arguments))


def private(function: Function, **options: Any) -> Function:
    """Compile a function for compiled callers, in half the time; the first call from Python compiles one for it."""
    compiled: Any = _njit(cache=True, nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)(function)
    if isinstance(compiled, CPUDispatcher):  # not with NUMBA_DISABLE_JIT
        compiled.__class__ = _Private  # for want of an entry point for Python
    private_one: Function = compiled
    return private_one


def dividing(function: Function) -> Function:
    """A `private` function whose divisions by 0 give inf or NaN, as NumPy's do, instead of an exception."""
    return private(function, error_model="numpy")


_register_pass: Any = register_pass


@_register_pass(mutates_CFG=False, analysis_only=True)
class _Translate(AnalysisPass):
    """Translate a function into machine code, although it has no entry for Python."""

    _name = "planarm_translate"

    def __init__(self) -> None:
        """Nothing to keep."""

    def run_pass(self, state: Any) -> bool:
        state.library.get_pointer_to_function(state.cr.fndesc.llvm_func_name)
        return False


class _KernelCompiler(CompilerBase):
    def define_pipelines(self) -> list[Any]:
        builder: Any = DefaultPassBuilder
        passes = builder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_Translate, NativeLowering)
        passes.finalize()
        return [passes]


class Kernel:
    """A function that is compiled on its own, and called by compiled code through its address.

    It cannot be called from Python.

    Args:
        function: what is compiled, for every combination of types of which an address is asked.
        options: of `numba.njit`.
    """

    def __init__(self, function: Callable[..., Any], **options: Any) -> None:
        self._compiled: Any = private(function, pipeline_class=_KernelCompiler, **options)

    def address(self, *arguments: Any) -> int:
        """The address, to call with such arguments: Numba types, the dtype of a record, or an array like the one given.

        The function is compiled, or loaded from the cache, when its address is first asked.
        """
        return address_of(self._compiled, *(_kind_of(one) for one in arguments))


def require_compiled(what: str) -> None:
    """Raise ImportError where Numba compiles nothing: Python cannot run code that reads records or calls addresses."""
    if getattr(config, "DISABLE_JIT", False):
        raise ImportError(f"{what} runs compiled code only; unset NUMBA_DISABLE_JIT")


def address_of(compiled: Any, *kinds: Any) -> int:
    """The address of what ``numba.njit`` has made of a function, to call with arguments of these Numba types."""
    require_compiled("this part of planarm")
    compiled.compile(kinds)
    overload = compiled.overloads[kinds]
    return int(overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name))


def _kind_of(argument: Any) -> Any:
    if isinstance(argument, np.ndarray):
        return typeof(argument)  # type: ignore[no-untyped-call]
    return from_dtype(argument) if isinstance(argument, np.dtype) else argument


def caller(result: Any) -> Any:
    """A function of compiled code, ``call(address, *arguments)``, that calls a `Kernel` which returns that Numba type.

    The arguments must have the types of which the address was asked. Instead of a record it may be one that begins with
    the same fields; an array that is a field of a record is like any other that is contiguous.
    """

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        given = signature.args[1].types
        pointer = context.call_conv.get_function_type(result, given).as_pointer()
        status, returned = context.call_conv.call_function(
            builder,
            builder.inttoptr(values[0], pointer),
            result,
            given,
            cgutils.unpack_tuple(builder, values[1]),  # type: ignore[no-untyped-call]
        )
        with cgutils.if_unlikely(builder, status.is_error):  # type: ignore[no-untyped-call]
            context.call_conv.return_status_propagate(builder, status)
        return returned

    @intrinsic
    def call(typing_context: Any, address: Any, *arguments: Any) -> Any:
        plain = [types.unliteral(one) for one in arguments]  # type: ignore[no-untyped-call]
        return result(types.intp, types.StarArgTuple.from_types(plain)), build  # type: ignore[no-untyped-call]

    return call


def _copy_array(typing_context: Any, target: Any, source: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, values: Any) -> None:
        to, of = (
            context.make_array(kind)(context, builder, one) for kind, one in zip(signature.args, values, strict=True)
        )
        cgutils.raw_memcpy(builder, to.data, of.data, of.nitems, of.itemsize)  # type: ignore[no-untyped-call]

    if (target.dtype, target.ndim, target.layout, source.layout) != (source.dtype, source.ndim, "C", "C"):
        raise TypeError(f"copy_array takes contiguous arrays of one kind, not {target} and {source}")
    return types.void(target, source), build


def _clear_array(typing_context: Any, target: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, values: Any) -> None:
        array = context.make_array(signature.args[0])(context, builder, values[0])
        size = builder.mul(array.nitems, array.itemsize)
        cgutils.memset(builder, array.data, size, 0)  # type: ignore[no-untyped-call]

    if target.layout != "C":
        raise TypeError(f"clear_array takes a contiguous array, not {target}")
    return types.void(target), build


def _new_array(typing_context: Any, *shape: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        sizes = cgutils.unpack_tuple(builder, values[0])  # type: ignore[no-untyped-call]
        array = _empty_nd_impl(context, builder, signature.return_type, sizes)  # type: ignore[no-untyped-call]
        return array._getvalue()

    sizes = types.UniTuple(types.intp, len(shape))  # type: ignore[no-untyped-call]
    return types.Array(types.float64, len(shape), "C")(sizes), build


new_array: Any = intrinsic(_new_array)
"""``np.empty(shape)`` in compiled code, ``new_array(*shape)``: Numba compiles that one anew for each kind of shape."""

copy_array: Any = intrinsic(_copy_array)
"""``target[:len(source)] = source`` in compiled code, for contiguous arrays; it compiles faster than a loop."""

clear_array: Any = intrinsic(_clear_array)
"""``target[:] = 0`` in compiled code, for a contiguous array of numbers."""

call: Any = caller(types.void)
"""Calls a kernel that returns nothing."""

call_real: Any = caller(types.float64)
"""Calls a kernel that returns a float."""
