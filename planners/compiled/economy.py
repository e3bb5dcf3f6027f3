"""What Numba does for nothing while it compiles, left out: about a tenth of its time.

Importing this module replaces some of Numba's methods by ones that give the same result with less work. A Numba without
such a method compiles as it does.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from importlib import import_module
from types import SimpleNamespace
from typing import Any
from weakref import WeakKeyDictionary


def _replace(module: str, name: str, substitute: Callable[[Any], Any]) -> None:
    """Put what a function makes of ``module.name`` in its place, if there is such a one."""
    with suppress(ImportError, AttributeError):
        *owners, last = name.split(".")
        owner: Any = import_module(module)
        for one in owners:
            owner = getattr(owner, one)
        setattr(owner, last, substitute(getattr(owner, last)))


def _without_unused_lifetimes(run: Any) -> Any:
    """Which variables live at the entry of a block is only asked by generators and what is written to end lifetimes."""
    processing: Any = import_module("numba.core.postproc")

    def process(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        function = self.func_ir
        if emit_dels or function.is_generator:
            run(self, emit_dels, extend_lifetimes)
        else:
            function.blocks = processing.transforms.canonicalize_cfg(function.blocks)
            function.variable_lifetime = processing.VariableLifetime(function.blocks)
            function.generator_info = None

    return process


def _without_copies_of_variables(module: Any) -> Any:
    """Inlining copies each block of a function, and with each block all variables, which nobody changes."""

    def copy_block(block: Any) -> Any:
        return deepcopy(block, {id(variable): variable for variable in block.scope.localvars._con.values()})

    return SimpleNamespace(**{**vars(module), "deepcopy": copy_block})


def _without_copies_of_places(place: Any) -> Any:
    """A place in the source never changes."""
    place.__deepcopy__ = lambda self, memory: self
    return place


def _without_declarations(_: Any) -> Any:
    """A function that is only declared has nothing to optimise."""

    def optimise(self: Any, module: Any) -> None:
        module.data_layout = self._codegen._data_layout
        for function in module.functions:
            if not function.is_declaration:
                manager, builder = self._codegen._function_pass_manager()
                with self._recorded_timings.record(f"Function passes on {function.name!r}", builder):
                    manager.run(function, builder)

    return optimise


def _without_parsing(get_abi_size: Any) -> Any:
    """LLVM parses a module to say how large a type is: ask once for a type that does not depend on a name."""
    known: dict[Any, int] = {}

    def size(self: Any, target_data: Any, context: Any = None) -> int:
        text = str(self)
        if "%" in text:
            return int(get_abi_size(self, target_data, context))
        if (asked := (text, target_data)) not in known:
            known[asked] = get_abi_size(self, target_data, context)
        return known[asked]

    return size


def _without_news(refresh: Any) -> Any:
    """Nothing is looked up again in registries to which nothing has been added."""
    seen: Any = WeakKeyDictionary()

    def entries(context: Any) -> list[int]:
        loaders = [*context._registries.items(), *context.typing_context._registries.items()]
        return [len(getattr(registry, name)) for registry, loader in loaders for name in loader.registry_items]

    def renew(self: Any) -> None:
        if seen.get(self) != entries(self):
            refresh(self)
            seen[self] = entries(self)

    return renew


def _without_unused_options(module: Any) -> Any:
    """What an overload compiles to depends on the options that it inherits from its caller, on no others."""

    def inherited() -> Any:
        flags = module.ConfigStack.top_or_none()
        return flags and (flags.nrt, flags.error_model, flags.forceinline, str(flags.fastmath))

    return SimpleNamespace(ConfigStack=SimpleNamespace(top_or_none=inherited))


def _without_events(lock: Any) -> Any:
    """No event for each of ten thousand calls of LLVM."""
    for acquired, released in list(lock._cblist):
        if acquired.__module__ == "numba.core.base":
            lock.unregister(acquired, released)
    return lock


def _without_scipy(ensure_blas: Any) -> Any:
    """Numba imports SciPy's linear algebra, a tenth of a second, to know whether it is there; then only for its use."""
    algebra: Any = import_module("numba.np.linalg")
    algebra.ensure_blas = lambda: None
    import_module("numba.np.arraymath")
    return ensure_blas


_replace("numba.core.postproc", "PostProcessor.run", _without_unused_lifetimes)
_replace("numba.core.inline_closurecall", "copy", _without_copies_of_variables)
_replace("numba.core.ir", "Loc", _without_copies_of_places)
_replace("numba.core.codegen", "CPUCodeLibrary._optimize_functions", _without_declarations)
_replace("llvmlite.ir.types", "Type.get_abi_size", _without_parsing)
_replace("numba.core.base", "BaseContext.refresh", _without_news)
_replace("numba.core.typing.templates", "targetconfig", _without_unused_options)
_replace("llvmlite.binding.ffi", "lib._lock", _without_events)
_replace("numba.np.linalg", "ensure_blas", _without_scipy)
