"""Environments by name: ``module:id`` for a task of your own, and settings and reset options checked by name."""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Mapping
from importlib import import_module
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode

from envs.card import TaskCard, env_ids, load, task_card
from envs.checks import checked_seed
from envs.settings import refuse_unknown
from planners import arm_document, arm_names, load_arm
from planners.checks import brief

VectorEnv = gym.vector.VectorEnv[Any, Any, Any]
SEED_MOST = 2**62
"""The largest seed of a first episode."""
MOST_EPISODES = 10_000_000
"""Most episodes of an evaluation."""

_OWN: dict[str, str] = {}  # modules that `import_env` has imported, by the id of the environment
_IN_MODULE = re.compile(r"[^\W\d][\w.]*:[^\W\d][\w./+-]*")


def is_in_module(text: str) -> bool:
    """Whether a name is of the form ``module:name``."""
    return _IN_MODULE.fullmatch(text) is not None


def import_before(text: str) -> str:
    """Import the module of ``module:name``, which may lie in the current folder.

    Returns:
        The name, without the module; a text without a module as it is.

    Raises:
        ValueError: if there is no such module, or its code raises an error.
    """
    if not isinstance(text, str):
        raise ValueError(f"{brief(text)} is no name: give a text, such as ConveyorTrack-v0")
    if not is_in_module(text):
        if ":" in text:
            raise ValueError(f'"{text}" is no module:name, such as my_module:MyTask-v0')
        return text
    module, _, name = text.partition(":")
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        import_module(module)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and error.name and f"{module}.".startswith(f"{error.name}."):
            raise ValueError(
                f"no module {module} for {text}: there is no {error.name}.py or folder {error.name} in {os.getcwd()}, "
                "and no such package is installed; name it as Python imports it"
            ) from None
        raise ValueError(f"{module} cannot be imported: {_where(error)}") from error
    return name


def import_env(env_id: str) -> str:
    """The id of an environment, without the module in front of it, which is imported; raises as `import_before`."""
    name = import_before(env_id)
    if name != env_id:
        _OWN[name] = env_id.partition(":")[0]
    return name


def full_name(env_id: str) -> str:
    """The id with the module in front of it that `import_env` has imported for it, if any: as commands take it."""
    return f"{_OWN[env_id]}:{env_id}" if env_id in _OWN else env_id


def own_modules() -> tuple[str, ...]:
    """The modules that `import_env` has imported in this process, which another one needs for the same tasks."""
    return tuple(dict.fromkeys(_OWN.values()))


def check_seed(seed: Any) -> int:
    """A seed of a first episode as an int; a ValueError if it is no whole number, negative or too large."""
    number = checked_seed(seed)
    if number is None or number > SEED_MOST:
        raise ValueError(f"seed {seed} must be a whole number from 0 to 2**62")
    return number


def make_batch(env_id: str, num_envs: int, settings: Mapping[str, Any], *, resets: bool = True) -> VectorEnv:
    """A vector environment that resets in the step that ends an episode, or not by itself; a ValueError for unknown
    settings.

    An environment that is no task of planarm's kind resets as it does by itself.
    """
    check_names(env_id, settings, {})
    own = AutoresetMode.SAME_STEP if resets else AutoresetMode.DISABLED
    mode: dict[str, Any] = {} if task_type(env_id) is None else {"autoreset_mode": own}
    return gym.make_vec(env_id, num_envs=num_envs, **mode, **settings)


def make_one(env_id: str, settings: Mapping[str, Any], render_mode: str | None = None) -> gym.Env[Any, Any]:
    """A single environment; a ValueError for settings that its task does not have."""
    check_names(env_id, settings, {})
    return gym.make(env_id, render_mode=render_mode, **settings)


def check_names(
    env_id: str, settings: Mapping[str, Any], options: Mapping[str, Any], *, takes_options: bool = True
) -> None:
    """Raise a ValueError for a setting or a reset option that a task does not have.

    The message says so where the name is one of the other kind, and how to give it if ``takes_options``: where reset
    options can be given too. Environments that are no tasks of planarm's kind check their own.
    """
    for given_names in (settings, options):
        _require_mapping(given_names)
    task = task_type(env_id)
    if task is None:
        return
    kinds = (("setting", task.config_type.model_fields), ("option", task.options_type.model_fields))
    for given, (what, known), (other, others) in ((settings, *kinds), (options, *reversed(kinds))):
        for name in given:
            if name not in known and name in others:
                argument = "env_config" if other == "setting" else "options"
                shown = f"--{other}s {name}={given[name]}, in Python as {argument}={{{name!r}: {given[name]!r}}}"
                advice = f": give it as {shown}" if takes_options else ""
                raise ValueError(
                    f"{name} is {'a setting' if other == 'setting' else 'a reset option'} of {env_id}, not "
                    f"{'a setting' if what == 'setting' else 'a reset option'}{advice}"
                )
        refuse_unknown(given, known, f"{env_id} {what}")


def _require_mapping(given: Any) -> None:
    if not isinstance(given, Mapping):
        raise ValueError(f"settings and options are names with values, as in {{'payload': 0.2}}, not {brief(given)}")


def card_of(env_id: str) -> TaskCard:
    """The card of a task; an empty one for an environment that is not registered with planarm."""
    return task_card(env_id) if env_id in env_ids() else TaskCard(metrics=(), experts={})


def portable(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of an environment; an arm that is an object or a file becomes a document, as JSON can hold it."""
    _require_mapping(settings)
    arm = settings.get("arm")
    if arm is None or (isinstance(arm, str) and arm in arm_names()):
        return dict(settings)
    return {**settings, "arm": arm_document(load_arm(arm))}


def task_type(env_id: str) -> Any:
    """The `envs.task.Task` class of an environment; None if it is no task of planarm's kind."""
    spec = gym.registry.get(env_id.rpartition(":")[2])
    kind = None if spec is None else spec.kwargs.get("task_type")
    return load(kind) if isinstance(kind, str) else kind


def with_defaults(env_id: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of an environment, those that are left out with their defaults if it is a task of planarm's kind."""
    task = task_type(env_id)
    fields = {} if task is None else task.config_type.model_fields
    return {**{name: spec.default for name, spec in fields.items()}, **settings}


def _where(error: BaseException) -> str:
    """An error in one line, with the last place in the code where it arose."""
    text = f"{type(error).__name__}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    if isinstance(error, SyntaxError) or not frames:
        return text
    return f"{text} ({frames[-1].filename}:{frames[-1].lineno})"
