"""Ray: a connection to a cluster, or to a Ray of one's own on this machine. Imported only by what runs there."""

from __future__ import annotations

import logging
import os
import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

LOCAL, AUTO = "local", "auto"
"""The address that starts a Ray on this machine, which ends with the command, and that of the machine's cluster."""
_ANSWER = 20.0  # s that the head of a cluster has to accept a connection; Ray itself tries for minutes

_SETTINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    "RAY_AIR_NEW_OUTPUT": "0",
    "RAY_CHDIR_TO_TRIAL_DIR": "0",
    "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",
    "TUNE_DISABLE_SIGINT_HANDLER": "1",  # Ctrl-C is caught as in every other command
    "TUNE_WARN_EXCESSIVE_EXPERIMENT_CHECKPOINT_SYNC_THRESHOLD_S": "0",
}


@dataclass(frozen=True)
class Place:
    """Where a process was started: workers take it over, so that relative paths and own modules mean the same there."""

    folder: str
    modules: tuple[str, ...]  # sys.path

    @classmethod
    def here(cls) -> Place:
        """Of this process."""
        return cls(os.getcwd(), tuple(os.path.abspath(path) for path in sys.path))

    def enter(self) -> None:
        """In a worker: go there, as far as its machine has it."""
        if os.path.isdir(self.folder):
            os.chdir(self.folder)
        sys.path += [path for path in self.modules if path not in sys.path and os.path.exists(path)]


def load_ray() -> Any:
    """The module ``ray``.

    Raises:
        ModuleNotFoundError: that names the extra, if it is not installed.
    """
    for name, value in _SETTINGS.items():
        os.environ.setdefault(name, value)
    try:
        import ray
        import ray.tune
    except ImportError as error:
        raise ModuleNotFoundError(f'Ray is missing: pip install "planarm[cluster]" ({error})') from None
    return ray


@contextmanager
def connected(address: str, processors: int | None = None) -> Iterator[Any]:
    """Connect to Ray, and disconnect at the end, which ends everything that was begun there; yields ``ray``.

    Args:
        address: `LOCAL`, ``auto`` for the cluster that this machine belongs to, or ``host:port`` of its head.
        processors: how many a local Ray uses; all of them if None.

    Raises:
        ModuleNotFoundError: if Ray is not installed.
        ValueError: if there is no cluster, or ``processors`` does not fit.
    """
    if processors is not None and (address != LOCAL or processors < 1):
        raise ValueError(
            f"processors {processors} with address {address}: give at least 1, and only with {LOCAL}; a cluster's are "
            "set by ray start --num-cpus"
        )
    ray = load_ray()
    logging.getLogger("ray").setLevel(logging.CRITICAL)  # errors are reported by what is run
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.CRITICAL}
    if address == LOCAL:
        options |= {"include_dashboard": False, "num_cpus": processors}
    try:
        _check_answer(address)
        with _own_signals():
            ray.init(address=address, **options)
    except Exception as error:  # a node that does not start in time is a plain Exception of Ray
        reason = " ".join(str(error).split())[:200]
        if address == LOCAL:
            raise ValueError(f"Ray did not start here ({reason}): try again when the machine is less busy") from None
        raise ValueError(
            f"no Ray cluster at address {address} ({reason}): start one with ray start --head, set "
            f"RAY_AUTH_MODE=token if it has a token (~/.ray/auth_token), or take {LOCAL}"
        ) from None
    try:
        yield ray
    finally:
        with suppress(Exception):  # of a cluster that is lost
            ray.shutdown()


def processors_of_nodes(ray: Any) -> list[int]:
    """Processors of each node of a cluster."""
    return [int(node["Resources"].get("CPU", 0)) for node in ray.nodes() if node["Alive"]]


def _check_answer(address: str) -> None:
    """Raise an OSError or a ValueError if nothing accepts connections at an address of the form ``host:port``."""
    address = os.environ.get("RAY_ADDRESS", AUTO) if address == AUTO else address
    if address in (LOCAL, AUTO):
        return
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal():
        raise ValueError(f"an address is {LOCAL}, {AUTO} or host:port")
    with socket.create_connection((host.strip("[]"), int(port)), timeout=_ANSWER):
        pass


@contextmanager
def _own_signals() -> Iterator[None]:
    """Keep the handling of SIGTERM, which `ray.init` replaces by one that exits with the number of the signal."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    except SystemExit as end:
        if end.code != signal.SIGTERM:
            raise
        raise KeyboardInterrupt(128 + signal.SIGTERM) from None
    finally:
        with suppress(ValueError):  # in another thread than the main one, where Ray does not replace it either
            signal.signal(signal.SIGTERM, before)
