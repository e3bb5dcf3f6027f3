"""Numbers of eight environments at once in compiled code: vectors of the processor (SIMD).

A `PACK` is a number for each of `WIDTH` environments. Its arithmetic is that of eight separate numbers, to the bit,
with the same instructions in the same order, so a result does not depend on who else is in the pack. Where a processor
multiplies and adds in one instruction (FMA), it does, so last digits depend on the processor.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, register_model

from planners.compiled.calls import inlined

WIDTH = 8
"""Environments in a pack: what the widest vectors of today's processors hold. On others LLVM takes several."""

_REAL, _VECTOR = ir.DoubleType(), ir.VectorType(ir.DoubleType(), WIDTH)


class _Pack(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Pack{WIDTH}")


PACK = _Pack()
"""Numba's type of a pack."""

_POINTER, _REALS = types.CPointer(PACK), types.CPointer(types.float64)  # type: ignore[no-untyped-call]


@register_model(_Pack)
class _PackModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)  # type: ignore[no-untyped-call]


def _in_all(builder: Any, kind: Any, value: Any) -> Any:
    """A pack, or a number in every place of one."""
    if kind == PACK:
        return value
    first = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    places = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, ir.Constant(_VECTOR, ir.Undefined), places)


def _define(operation: Any, instruction: str) -> None:
    """An operator of packs, and of a pack with a number."""
    kinds = [(PACK, PACK), (PACK, types.float64), (types.float64, PACK)]

    class Operator(ConcreteTemplate):
        cases = [signature(PACK, *pair) for pair in kinds]  # type: ignore[no-untyped-call]  # noqa: RUF012

    infer_global(operation)(Operator)  # type: ignore[no-untyped-call]

    def lower(context: Any, builder: Any, of: Any, values: Any) -> Any:
        both = [_in_all(builder, kind, value) for kind, value in zip(of.args, values, strict=True)]
        return getattr(builder, instruction)(*both, flags=("contract",))

    for pair in kinds:
        lower_builtin(operation, *pair)(lower)  # type: ignore[no-untyped-call]


for _operation, _instruction in (("add", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv")):
    _define(getattr(operator, _operation), _instruction)


def _function(name: str, count: int = 1) -> Any:
    """LLVM's function of a number, or of two, for each of a pack."""

    def build(context: Any, builder: Any, of: Any, values: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * count)
        one = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")  # type: ignore[no-untyped-call]
        return builder.call(one, values)

    @intrinsic
    def function(typing_context: Any, pack: Any) -> Any:
        return PACK(PACK), build

    @intrinsic
    def function_of_two(typing_context: Any, pack: Any, other: Any) -> Any:
        return PACK(PACK, PACK), build

    return function if count == 1 else function_of_two


def memory(count: int) -> Callable[[], Any]:
    """A function of compiled code that gives a place for so many packs, which its caller has until it returns."""

    def build(context: Any, builder: Any, of: Any, values: Any) -> Any:
        place = cgutils.alloca_once(builder, ir.ArrayType(_VECTOR, count))  # type: ignore[no-untyped-call]
        return builder.bitcast(place, _VECTOR.as_pointer())

    @intrinsic
    def place(typing_context: Any) -> Any:
        return _POINTER(), build

    made: Any = place
    return made  # type: ignore[no-any-return]


def _as_reals(typing_context: Any, packs: Any) -> Any:
    def build(context: Any, builder: Any, of: Any, values: Any) -> Any:
        return builder.bitcast(values[0], _REAL.as_pointer())

    return _REALS(_POINTER), build


def _spread(typing_context: Any, number: Any) -> Any:
    def build(context: Any, builder: Any, of: Any, values: Any) -> Any:
        return _in_all(builder, types.float64, values[0])

    return PACK(types.float64), build


_floor, _abs = _function("floor"), _function("fabs")
square_root = _function("sqrt")
"""The square root of each number of a pack."""

least, most = _function("minnum", 2), _function("maxnum", 2)
"""The smaller and the larger of the numbers of two packs."""

spread: Any = intrinsic(_spread)
"""The pack with a number in every place."""

reals: Any = intrinsic(_as_reals)
"""The numbers of packs one by one: number ``k`` of pack ``i`` is ``reals(packs)[i * WIDTH + k]``."""

_PER_QUARTER = 0.6366197723675814  # 2 / pi
_QUARTER = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21  # pi / 2 in parts of 33 bits


@inlined
def sine_and_cosine(x: Any) -> Any:
    """Sine and cosine of a pack of angles, rad, to an error of 2e-16; of up to about 1e6 rad.

    After fdlibm: the nearest multiple of a quarter turn is taken off, and two polynomials are turned back by it.
    """
    quarters = _floor(x * _PER_QUARTER + 0.5)
    r = ((x - quarters * _QUARTER[0]) - quarters * _QUARTER[1]) - quarters * _QUARTER[2]
    z = r * r
    s = 1.58969099521155010221e-10 * z - 2.50507602534068634195e-08
    s = (s * z + 2.75573137070700676789e-06) * z - 1.98412698298579493134e-04
    s = (s * z + 8.33333333332248946124e-03) * z - 1.66666666666666324348e-01
    s = s * z * r + r
    c = 2.08757232129817482790e-09 - 1.13596475577881948265e-11 * z
    c = (c * z - 2.75573143513906633035e-07) * z + 2.48015872894767294178e-05
    c = (c * z - 1.38888888888741095749e-03) * z + 4.16666666666666019037e-02
    c = c * z * z - 0.5 * z + 1.0
    turned = quarters - 4.0 * _floor(quarters * 0.25)
    cos_turned, sin_turned = _abs(turned - 2.0) - 1.0, 1.0 - _abs(turned - 1.0)
    return sin_turned * c + cos_turned * s, cos_turned * c - sin_turned * s
