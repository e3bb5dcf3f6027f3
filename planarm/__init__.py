"""``import planarm`` registers the environments; ``planarm.envs``, ``planarm.planners`` and ``planarm.agents`` follow.

Those packages have common names: importing this one raises an ImportError where Python finds others than planarm's.
"""

import signal
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if sys.argv[0] == "-m":  # python -m planarm, while this package is imported
    IS_COMMAND = "planarm" in sys.orig_argv or "-mplanarm" in sys.orig_argv
else:
    IS_COMMAND = Path(sys.argv[0]).stem == "planarm" and sys.argv[0] in sys.orig_argv
"""Whether this process is the `planarm` command; not one that a command has started, which has its `sys.argv` only."""

if IS_COMMAND and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # Until the command runs, Ctrl-C ends it without the traceback of an import.
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from planarm.names import check_names  # noqa: E402

if TYPE_CHECKING:
    import agents as agents
    import envs as envs
    import planners as planners

__all__ = ["agents", "envs", "planners"]

try:
    check_names()
except ImportError as error:
    if not IS_COMMAND:
        raise
    print(f"planarm: {error}", file=sys.stderr)  # the command: a sentence, no traceback
    sys.exit(2)

import_module("envs")  # registers the ids


def __dir__() -> list[str]:
    return [*globals(), *__all__]


def __getattr__(name: str) -> Any:
    # Loaded when asked for: registering ids must not cost the import of every planner.
    if name in __all__:
        return import_module(name)
    if name == "__version__":
        from importlib import metadata

        return metadata.version("planarm")
    raise AttributeError(f"module 'planarm' has no attribute {name!r}")
