"""The ``--options`` and ``--scenario`` of commands: options of an environment's reset."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from agents.yaml_config import assigned


def given_options(changes: Iterable[str], scenario: str | None) -> dict[str, Any]:
    """Options of the reset from ``key=value`` and from ``--scenario``; a ValueError if they contradict."""
    options = assigned({}, changes)
    if scenario is None:
        return options
    if options.get("scenario", scenario) != scenario:
        raise ValueError(f"--scenario {scenario} and --options scenario={options['scenario']}: give one of them")
    return {**options, "scenario": scenario}
