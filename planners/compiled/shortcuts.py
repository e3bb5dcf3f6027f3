"""Work that Numba does while it compiles and that nobody needs: importing this module leaves it out.

It holds for all compiled functions of the process, whose code stays the same, except that the error of an assignment
to a slice from an array of another shape does not tell the shapes.
"""

from __future__ import annotations

from functools import wraps
from importlib import import_module
from types import SimpleNamespace
from typing import Any

from numba.extending import overload


def _raise_for_shapes(source: Any, target: Any) -> None:
    """What compiled code calls where the shapes in ``target[...] = source`` do not fit."""
    raise NotImplementedError


@overload(_raise_for_shapes)
def _raise_without_shapes(source: Any, target: Any) -> Any:
    """Numba's own writes them into its message, for which it compiles forty functions of texts."""

    def refuse(source: Any, target: Any) -> None:
        raise ValueError("cannot assign slice from input of different shape")

    return refuse


def _without_entry_for_c(build: Any) -> Any:
    """``_build_impl`` of functions that `numba.extending.overload` makes: only compiled code calls them."""

    @wraps(build)
    def build_impl(template: Any, *arguments: Any) -> Any:
        template._jit_options = {**template._jit_options, "no_cfunc_wrapper": True}
        return build(template, *arguments)

    return build_impl


def _asked_once(find: Any) -> Any:
    """``get_abi_sizeof``, which has LLVM read a module for each variable of a function."""
    sizes: dict[str, int] = {}

    @wraps(find)
    def get_abi_sizeof(context: Any, kind: Any) -> int:
        name = str(kind)
        if name not in sizes:
            sizes[name] = find(context, kind)
        return sizes[name]

    return get_abi_sizeof


def _hash_of_kind(_: Any) -> Any:
    """``TargetConfig.__hash__``, which sorts the names of all options, the same ones each time."""
    return lambda config: hash(type(config))


def _without_copies(_: Any) -> Any:
    """``InlineWorker.inline_function``, which copies twice the representation of a function that it has just made."""
    closures: Any = import_module("numba.core.inline_closurecall")
    not_copied = SimpleNamespace(deepcopy=lambda block: block)

    def inline_function(worker: Any, caller: Any, block: Any, i: int, function: Any, arg_typs: Any = None) -> Any:
        made, names, before = worker.run_untyped_passes(function), function.__code__.co_freevars, closures.copy
        closures.copy = not_copied
        try:
            return worker.inline_ir(caller, block, i, made, names, arg_typs=arg_typs)
        finally:
            closures.copy = before

    return inline_function


def _without_live_variables(run: Any) -> Any:
    """``PostProcessor.run``, which after each pass finds the live variables; wanted in generators and at the end."""
    analyses: Any = import_module("numba.core.postproc")

    @wraps(run)
    def run_processor(processor: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        code = processor.func_ir
        if emit_dels or code.is_generator:
            run(processor, emit_dels, extend_lifetimes)
            return
        code.blocks = analyses.transforms.canonicalize_cfg(code.blocks)
        code.variable_lifetime, code.generator_info = analyses.VariableLifetime(code.blocks), None

    return run_processor


_BETTER: tuple[tuple[str, str, str, Any], ...] = (
    ("numba.np.arrayobj", "", "raise_with_shape_context", lambda _: _raise_for_shapes),
    ("numba.core.typing.templates", "_OverloadFunctionTemplate", "_build_impl", _without_entry_for_c),
    ("numba.core.base", "BaseContext", "get_abi_sizeof", _asked_once),
    ("numba.core.targetconfig", "TargetConfig", "__hash__", _hash_of_kind),
    ("numba.core.inline_closurecall", "InlineWorker", "inline_function", _without_copies),
    ("numba.core.postproc", "PostProcessor", "run", _without_live_variables),
)
"""Module, class and name of what is replaced, and what makes the replacement of it."""

for _module, _class, _name, _improved in _BETTER:
    _owner: Any = import_module(_module)
    _owner = getattr(_owner, _class) if _class else _owner
    setattr(_owner, _name, _improved(getattr(_owner, _name)))

# LLVM reports each of a hundred thousand calls to Numba, which measures how long they take.
_ffi: Any = import_module("llvmlite.binding.ffi")
for _callbacks in list(_ffi.lib._lock._cblist):
    _ffi.unregister_lock_callback(*_callbacks)

# Numba imports SciPy to see whether it is there: it is, and few functions need it.
_linalg: Any = import_module("numba.np.linalg")
_ensure_blas, _linalg.ensure_blas = _linalg.ensure_blas, lambda: None
try:
    import_module("numba.np.arraymath").ensure_blas = _ensure_blas  # type: ignore[attr-defined]
finally:
    _linalg.ensure_blas = _ensure_blas
