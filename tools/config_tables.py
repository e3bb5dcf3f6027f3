"""The tables of docs/agents/configs.md, from the settings' own types, defaults, bounds and docstrings.

``python -m tools.config_tables`` writes them between the page's marks, ``<!-- settings of NAME -->`` and
``<!-- end of NAME -->``. What is written there is what validates the files, so the page cannot say otherwise.
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import gymnasium as gym

import envs
from agents.evaluation.benchmark_config import BenchmarkConfig, BenchmarkTask, Published, Quick
from agents.training.recipe import (
    Amortisation,
    Demonstrations,
    Forecasts,
    OffPolicyConfig,
    PPOConfig,
    SACConfig,
    TD3Config,
    TrainingConfig,
    WarmStart,
)
from envs.settings import Settings
from planners.files import write_text

PAGE = Path(__file__).parent.parent / "docs" / "agents" / "configs.md"
_MARKED = re.compile(r"^(<!-- settings of (\S+) -->)$.*?^(<!-- end of \2 -->)$", flags=re.MULTILINE | re.DOTALL)


def documented() -> dict[str, type[Settings]]:
    """What has a table, by its name: benchmarks, training, and of every environment its settings and its options."""
    training = (
        TrainingConfig,
        PPOConfig,
        WarmStart,
        Amortisation,
        Forecasts,
        OffPolicyConfig,
        Demonstrations,
        SACConfig,
        TD3Config,
    )
    kinds = (BenchmarkConfig, Quick, BenchmarkTask, Published, *training)
    found: dict[str, type[Settings]] = {kind.__name__: kind for kind in kinds}
    for env_id in envs.env_ids():
        module, _, name = str(gym.spec(env_id).entry_point).removesuffix("Env").partition(":")
        task = getattr(import_module(module), name)
        found[env_id], found[f"{env_id}/options"] = task.config_type, task.options_type
    return found


def own_fields(kind: type[Settings]) -> list[str]:
    """Names of the settings in a table: of a recipe those that differ from its base's or are new."""
    base = kind.__mro__[1]
    if not issubclass(base, TrainingConfig):
        return list(kind.model_fields)
    known = base.model_fields
    return [
        name
        for name, field in kind.model_fields.items()
        if name != "algorithm"
        and (name not in known or (field.default, field.metadata) != (known[name].default, known[name].metadata))
    ]


def _table(kind: type[Settings]) -> str:
    head, rule, *rows = kind.table().splitlines()
    own = {f"| `{name}` |" for name in own_fields(kind)}
    return "\n".join([head, rule, *(row for row in rows if row.startswith(tuple(own)))])


def updated(page: str) -> str:
    """A page with every table written anew.

    Raises:
        ValueError: if it lacks the marks of some settings, or has marks of others.
    """
    kinds, found = documented(), [match[2] for match in _MARKED.finditer(page)]
    if sorted(found) != sorted(kinds):
        raise ValueError(f"the page has marks for {sorted(found)}; it needs a pair each for {sorted(kinds)}")
    return _MARKED.sub(lambda match: f"{match[1]}\n{_table(kinds[match[2]])}\n{match[3]}", page)


def main() -> None:
    """Write the page anew."""
    write_text(PAGE, updated(PAGE.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main()
