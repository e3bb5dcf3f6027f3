"""`planarm list`: everything that has a name: environments, experts, planners, recipes, agents, arms."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Any

import gymnasium as gym
import tyro
from pydantic.fields import FieldInfo

import envs
from agents.console import say
from agents.environments import import_env, task_type
from agents.policies.lookup import find_policy, shipped_policies
from agents.tables import Table
from agents.yaml_config import shipped_configs
from envs.experts import expert_names
from envs.settings import Settings
from planners import arm_names, load_arm
from planners.capabilities import capability_rows
from planners.files import write_json

Document = dict[str, Any]


@dataclass(frozen=True)
class ListOptions:
    """Print the names that commands and Python take, or all about some environments.

    For example:

        $ planarm list
        $ planarm list ConveyorTrack-v0
        $ planarm list my_module:MyTask-v0
        $ planarm list --json names.json
    """

    env: tyro.conf.Positional[tuple[str, ...]] = ()
    """Ids of environments, module:id for your own, to print their settings, reset options and metrics."""
    json: Path | None = None
    """Write the names to this file."""


def run(options: ListOptions) -> int:
    """Print the names; the exit code."""
    chosen = [import_env(env_id) for env_id in options.env]
    for env_id in chosen:
        envs.task_card(env_id)  # raises for an unknown id
    document = names(chosen)
    if options.json is not None:
        write_json(options.json, document)
    if chosen:
        for env_id in chosen:
            _show_environment(env_id, document["environments"][env_id])
        return 0
    _show_names(document)
    return 0


def names(env_ids: list[str] | None = None) -> Document:
    """All names, with what is known of each; of some environments only, if any are given."""
    return {
        "environments": {env_id: _environment(env_id) for env_id in env_ids or envs.env_ids()},
        "planners": _planners(),
        "recipes": [name for name in shipped_configs() if "/" in name and not name.startswith("arms/")],
        "agents": [env_id for env_id in envs.env_ids() if shipped_policies(env_id)],
        "arms": {name: _arm(name) for name in arm_names()},
    }


def _environment(env_id: str) -> Document:
    card, task = envs.task_card(env_id), task_type(env_id)
    return {
        "summary": _summary(env_id, task),
        "experts": expert_names(env_id),
        "agents": {name: find_policy(name, env_id).summary for name in shipped_policies(env_id)},
        "control_modes": list(card.control_modes),
        "links": list(card.links),
        "recipe": card.recipe,
        "settings": _fields(task.config_type),
        "options": _fields(task.options_type),
        "metrics": {metric.key: metric.title for metric in card.metrics},
    }


def _summary(env_id: str, task: Any) -> str:
    """The first sentence about an environment."""
    entry: Any = gym.registry[env_id].entry_point
    documented = envs.card.load(entry) if isinstance(entry, str) else entry
    if "task_type" not in vars(documented):
        documented = task  # a task without an environment class of its own
    text = inspect.cleandoc(documented.__doc__ or "").partition("\n\n")[0]
    return " ".join(text.split())


def _fields(settings: type[Settings]) -> Document:
    """Default and meaning of each field."""
    meanings = settings.descriptions()
    return {
        name: {"default": _default(field), "meaning": meanings.get(name, "").removesuffix(".").replace("``", "")}
        for name, field in settings.model_fields.items()
    }


def _default(field: FieldInfo) -> Any:
    value = None if field.is_required() else field.get_default(call_default_factory=True)
    return value.model_dump(mode="json") if isinstance(value, Settings) else value


def _planners() -> dict[str, list[str]]:
    """Variants of each planner, the default first."""
    variants: dict[str, list[str]] = {}
    for planner, variant, *_ in capability_rows():
        own = variants.setdefault(planner, [])
        if variant not in own:
            own.append(variant)
    return variants


def _arm(name: str) -> Document:
    arm = load_arm(name)
    return {"links": arm.n_joints, "lengths_m": list(arm.lengths), "reach_m": arm.reach}


def _show_names(document: Document) -> None:
    rows = [
        (
            env_id,
            ", ".join(entry["experts"]),
            ", ".join(entry["control_modes"]),
            ", ".join(map(str, entry["links"])) or "its own",
            entry["recipe"] or "",
        )
        for env_id, entry in document["environments"].items()
    ]
    Table(
        "Environments", ("id", "experts", "their control modes", "links of an arm", "recipe"), rows, text_columns=5
    ).show()
    variants = [(name, ", ".join(names)) for name, names in document["planners"].items()]
    title = "Planners (planarm plan; --list says what each takes)"
    Table(title, ("name", "variants"), variants, text_columns=2).show()
    say(f"{_wrapped('Recipes (planarm train)', document['recipes'])}\n")
    agents = [f"{env_id} ({', '.join(document['environments'][env_id]['agents'])})" for env_id in document["agents"]]
    say(f"{_wrapped('Agents that come with planarm', agents)}\n")
    arms = [(name, str(arm["links"]), f"{arm['reach_m']:.3f}") for name, arm in document["arms"].items()]
    Table("Arms (--settings arm=NAME)", ("name", "links", "reach (m)"), arms).show()
    say("planarm list ID: settings, reset options and metrics of an environment.")


def _wrapped(what: str, names: list[str]) -> str:
    """Names after what they are of, in lines of at most 120 characters."""
    return fill(f"{what}: {', '.join(names)}", 120, break_long_words=False, break_on_hyphens=False)


def _show_environment(env_id: str, entry: Document) -> None:
    say(f"{env_id}: {entry['summary']}\n")
    say(f"Experts: {', '.join(entry['experts'])}. Their control modes: {', '.join(entry['control_modes'])}.\n")
    for name, summary in entry["agents"].items():
        say(f"Policy {name}. {summary}\n")
    for title, key in (
        ("Settings (--settings key=value)", "settings"),
        ("Reset options (--options key=value)", "options"),
    ):
        rows = [(name, str(field["default"]), field["meaning"]) for name, field in entry[key].items()]
        Table(title, ("key", "default", "meaning"), rows, text_columns=3).show()
    Table("Metrics", ("key", "title"), list(entry["metrics"].items()), text_columns=2).show()
