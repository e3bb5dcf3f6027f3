"""Only functions with an entry become machine code of their own, which saves a seventh of the time of compilation.

Numba optimises every function and translates it into machine code, also one that only compiled code calls and that is a
part of each of its callers. Importing this module puts that off until the address of the function or of its entry for
Python is asked, which it never is for most. It holds for all compiled functions of the process.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from numba.core.compiler_lock import global_compiler_lock

_codegen: Any = import_module("numba.core.codegen")
_environments: Any = import_module("numba.core.environment")

_ENVIRONMENT = "_ZN08NumbaEnv"
"""Names of variables that hold the environment of a function begin with it."""


class LinkedLibrary(_codegen.JITCodeLibrary):  # type: ignore[misc]
    """The code of a function: linked into that of its callers, and translated when an address in it is asked."""

    _translated = False

    def get_pointer_to_function(self, name: str) -> int:
        """The address of a function of machine code, 0 if it is not defined here."""
        self._ensure_finalized()
        if not self._translated:
            if all(function.name != name for function in self.get_defined_functions()):
                return 0
            with global_compiler_lock:
                self._translate()
        return int(super().get_pointer_to_function(name))

    def serialize_using_object_code(self) -> tuple[str, str, Any]:
        """What is kept in the cache: the code for callers, and machine code where there is some."""
        self._ensure_finalized()
        serialized = super().serialize_using_object_code if self._translated else self.serialize_using_bitcode
        kept: tuple[str, str, Any] = serialized()
        return kept

    def _optimize_functions(self, ll_module: Any) -> None:
        """Optimise each function of a module, with the same list of passes."""
        ll_module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        """Nothing yet: callers optimise it as a part of themselves."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True
        if getattr(self, "_compiled_object", None) is not None:  # machine code from the cache
            self._load()

    def _translate(self) -> None:
        super()._optimize_final_module()
        self._load()
        for variable in self._final_module.global_variables:
            environment = _environments.lookup_environment(variable.name)
            if variable.name.startswith(_ENVIRONMENT) and environment is not None:
                self._codegen.set_env(variable.name, environment)

    def _load(self) -> None:
        super()._finalize_final_module()
        self._translated = True


def _set_environment(codegen: Any, name: str, environment: Any) -> None:
    """``JITCPUCodegen.set_env``, which takes only variables that are in memory."""
    if codegen._engine.is_symbol_defined(name):
        _set(codegen, name, environment)


_set = _codegen.JITCPUCodegen.set_env
_codegen.JITCPUCodegen.set_env = _set_environment
_codegen.JITCPUCodegen._library_class = LinkedLibrary
