"""The types of operators, found once: a tenth of the time that Numba takes to compile.

For each use of an operator, ``a * b`` or ``array[i]``, Numba asks one template after the other whether it takes such
arguments, those for lists, strings and dates before those for numbers and arrays, and has forgotten the answer when it
comes to the next use. Importing this module lets it remember: what an operator of Python's gives for arguments of known
types depends on nothing else. What `numba.extending.overload` has made depends on the options of the caller, and is
asked for each time.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_functions: Any = import_module("numba.core.types.functions")
_find: Any = getattr(getattr(_functions, "BaseFunction", None), "get_call_type", None)
_found: dict[Any, Any] = {}


def _is_operator(function: Any) -> bool:
    """Whether a function type stands for one of the module `operator`."""
    return getattr(function.typing_key, "__module__", None) == "_operator"


def _remember(function: Any, context: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
    """``BaseFunction.get_call_type``: the signature of a function for arguments of these types."""
    if kws or not _is_operator(function):
        return _find(function, context, args, kws)
    asked = function, context, args
    if (signature := _found.get(asked)) is None:
        signature = _find(function, context, args, kws)
        known = signature is not None and all(one.is_precise() for one in args)
        if known and function.get_impl_key(signature) is function.typing_key:  # not an overload
            _found[asked] = signature
    return signature


if _find is not None:
    _functions.BaseFunction.get_call_type = _remember
