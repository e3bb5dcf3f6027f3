"""Policies by name, path or ``module:name``: experts, trained agents, models of Stable-Baselines3, and your own."""

from __future__ import annotations

import operator
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from agents.environments import import_before, is_in_module, task_type, with_defaults
from agents.policies.agent import ACTION_SETTINGS, Agent
from agents.policies.files import load_agent, shipped_agents, shipped_variants
from agents.policies.policy import Policy, PolicyMaker
from agents.policies.sb3 import load_model
from envs.experts import ADAPTIVE, Expert, expert_names, is_expert
from envs.settings import refuse_unknown
from planners import load_arm
from planners.checks import brief

SHIPPED = "agent"  # name of the agent shipped with planarm for the environment
AnyPolicy = Policy | PolicyMaker | str
"""A policy, a function or class that makes one for an environment, or a name or path as `find_policy` takes it."""


@dataclass(frozen=True)
class NamedPolicy:
    """A policy with its name and the settings that it carries.

    Attributes:
        name: in tables.
        policy: a policy, what makes one, or the name of an expert.
        action_config: settings that define what its actions mean, and all that a policy of your own declares; it acts
            with no others.
        env_config: settings of the environment that it was trained in or made for.
        own: whether it is the user's own and not one that comes with planarm.
        unknown_actions: whether what its actions mean is not known, so that the settings have to say it.
        source: the name or path by which `find_policy` finds it; empty for a policy in memory.
    """

    name: str
    policy: Policy | PolicyMaker | str
    action_config: Mapping[str, Any] = field(default_factory=dict)
    env_config: Mapping[str, Any] = field(default_factory=dict)
    own: bool = False
    unknown_actions: bool = False
    source: str = ""

    @property
    def summary(self) -> str:
        """The first line of the card of an agent; empty for a policy without one."""
        return str(self.policy.document.get("summary", "")) if isinstance(self.policy, Agent) else ""

    @property
    def is_expert(self) -> bool:
        """Whether it is a scripted expert."""
        return isinstance(self.policy, str)

    def settings(self, env_config: Mapping[str, Any]) -> dict[str, Any]:
        """The settings of an environment, with those of the policy's actions; a ValueError if they contradict."""
        for name, value in {**self._left_out(), **self.action_config}.items():
            if env_config.get(name, value) != value:
                raise ValueError(
                    f"{self.name} was made for {name} {value!r} and cannot act with {env_config[name]!r}; "
                    f"leave {name} out, so that each policy has its own"
                )
        arm = load_arm(env_config["arm"]) if env_config.get("arm") is not None else None
        if isinstance(self.policy, Agent) and arm is not None:
            self.policy.check_arm(arm)
        if isinstance(self.policy, Expert):
            task = self.policy.task
            default = getattr(task, "default_arm", task.arm)  # the excavator's task has its own machine alone
            if (arm or default) != (own := getattr(task.config, "arm", None) or default):
                raise ValueError(f"{self.name} was made for the arm {own.name}: make it for this one")
        return {**env_config, **self.action_config}

    def _left_out(self) -> dict[str, Any]:
        """The settings of an agent's actions and observations that its file leaves out, as their defaults."""
        task = task_type(self.policy.env_id) if isinstance(self.policy, Agent) else None
        fields = {} if task is None else task.config_type.model_fields
        return {name: fields[name].default for name in ACTION_SETTINGS if name in fields}

    def require_same_episodes(self, env_id: str, settings: Mapping[str, Any]) -> None:
        """Raise ValueError if it declares what an environment with these settings does not have.

        It would act in other episodes than other policies; the meaning of its actions is its own.
        """
        has = with_defaults(env_id, settings)
        others = {name: value for name, value in self.action_config.items() if name not in ACTION_SETTINGS}
        given = [f"{name} {brief(value)}" for name, value in others.items() if name not in has or has[name] != value]
        if given:
            raise ValueError(
                f"{self.name} was made for {', '.join(given)} and would have other episodes than the rest: give "
                f"{'this' if len(given) == 1 else 'these'} to every policy, as a setting of {env_id}"
            )

    def assumption(self, env_id: str, settings: Mapping[str, Any]) -> str | None:
        """A sentence about what its actions are taken to mean, if neither it nor the settings say so."""
        task = task_type(env_id)
        if not self.unknown_actions or task is None or "control_mode" in settings:
            return None
        mode = task.config_type.model_fields["control_mode"].default
        return (
            f"{self.name} does not say in which control mode it was trained; its actions are taken for control_mode "
            f"{mode}, the default of {env_id}: give another one as a setting"
        )

    @property
    def carried(self) -> dict[str, Any]:
        """Settings of its environment in which a policy is scored alone; an agent of planarm brings none."""
        return {} if isinstance(self.policy, Agent) and not self.own else dict(self.env_config)

    def own_settings(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """All settings that the policy carries, with changes to those that are not about its actions."""
        return self.settings({**self.carried, **changes})


def name_policy(policy: AnyPolicy, env_id: str, *, name: str | None = None, allow_code: bool = False) -> NamedPolicy:
    """Any policy with its name and the settings that it carries; raises as `find_policy`.

    A policy of your own carries settings in an attribute ``env_config``.
    """
    if isinstance(policy, str):
        found = replace(find_policy(policy, env_id, allow_code=allow_code), source=policy)
    elif isinstance(policy, Agent):
        found = _of_agent(type(policy).__name__, policy, env_id)
    elif isinstance(policy, Expert):
        config = policy.task.config
        made_for = {**config.model_dump(include=config.model_fields_set), "control_mode": config.control_mode}
        found = NamedPolicy(type(policy).__name__, policy, _of_actions(made_for), made_for)
    else:
        title = policy.__name__ if hasattr(policy, "__name__") else type(policy).__name__
        found = _of_own(title, policy, env_id)
    return replace(found, name=name or found.name)


def name_policies(
    policies: Sequence[AnyPolicy] | Mapping[str, AnyPolicy], env_id: str, *, allow_code: bool = False
) -> list[NamedPolicy]:
    """Several policies, each with a name of its own; raises as `find_policy`, and if there is none.

    Args:
        policies: policies, or policies by name.
        env_id: of the environment that they act in.
        allow_code: whether to load models of Stable-Baselines3.
    """
    given: list[tuple[str | None, AnyPolicy]] = []
    if isinstance(policies, Mapping):
        given = list(policies.items())
    elif isinstance(policies, Iterable) and not isinstance(policies, str):
        given = [(None, policy) for policy in policies]
    if not given:
        raise ValueError(f"policies {policies!r:.80}: give a list with at least one")
    named: dict[str, NamedPolicy] = {}
    for name, policy in given:
        found = name_policy(policy, env_id, name=name, allow_code=allow_code)
        own = found.name
        if own in named and isinstance(policy, str):
            own = policy
        number = 2
        while own in named:
            own, number = f"{found.name} {number}", number + 1
        named[own] = replace(found, name=own)
    return list(named.values())


def shipped_policies(env_id: str) -> list[str]:
    """Names of the agents that planarm ships for an environment."""
    variants = [f"{SHIPPED}:{variant}" for variant in shipped_variants(env_id)]
    return [SHIPPED, *variants] if env_id in shipped_agents() else []


def is_shipped(name: str) -> bool:
    """Whether a name is of an agent that planarm ships, ``agent`` or ``agent:NAME``."""
    return name.partition(":")[0] == SHIPPED


def find_policy(source: str, env_id: str, *, allow_code: bool = False) -> NamedPolicy:
    """A policy by name or by path.

    Args:
        source: the name of an expert, with ``+adaptive`` behind it for online payload estimation; ``agent`` for the
            agent shipped for the environment, and ``agent:NAME`` for one shipped for harder episodes
            (`shipped_policies`); the path of a training run's folder, of an agent (.safetensors), or of a
            model of Stable-Baselines3 (.zip); or ``module:name``, which imports the module and finds an expert or a
            planner that it registers under this name, or else what it calls so: a policy, or a function or a class
            that makes one, with the environment or without arguments.
        env_id: of the environment that it acts in.
        allow_code: whether to load a model of Stable-Baselines3, which can run any code in its file.

    Raises:
        ValueError: if there is none, it was trained on another environment, or it may not be loaded.
        ModuleNotFoundError: for a model of Stable-Baselines3 without the `rl` extra.
    """
    if is_expert(source):
        return NamedPolicy(source, source)
    if not source:
        raise ValueError("no policy: its name is empty")
    path = Path(source)
    if source.endswith(".zip"):
        model = load_model(path, env_id, allow_code=allow_code)
        return NamedPolicy(path.stem, model, own=True, unknown_actions=True)
    if is_shipped(source):
        refuse_unknown([env_id], shipped_agents(), "environment with an agent of its own")
        return _of_agent(source, load_agent(env_id, source.partition(":")[2] or None), env_id)
    if is_in_module(source) and not path.exists():
        return _of_module(source, env_id)
    if not (source.endswith(".safetensors") or path.is_dir() or os.sep in source or "/" in source):
        others = "policy (or module:name, or the path of a run, a .safetensors or a .zip)"
        refuse_unknown([source], [*expert_names(env_id), *shipped_policies(env_id)], others)
    place = path.resolve()
    return _of_agent(place.name if path.is_dir() else place.stem, load_agent(path), env_id)


def _of_agent(name: str, agent: Agent, env_id: str) -> NamedPolicy:
    if agent.env_id != env_id:
        raise ValueError(f"{name} was trained on {agent.env_id}, not on {env_id}")
    return NamedPolicy(name, agent, agent.action_config, agent.env_config, own=not agent.shipped)


def _of_module(source: str, env_id: str) -> NamedPolicy:
    """A policy of the user's own module, after its import: a registered expert, or an attribute."""
    name = import_before(source)
    if is_expert(name):
        return NamedPolicy(name, name, own=True)
    module = sys.modules[source.partition(":")[0]]
    try:
        value = operator.attrgetter(name)(module)
    except AttributeError:
        known = [each for each in vars(module) if not each.startswith("_")]
        refuse_unknown([name.removesuffix(ADAPTIVE)], known, f"name in {module.__name__}")
        raise
    if not callable(value) and not isinstance(value, Policy):
        raise ValueError(
            f"{source} is {value!r}: give an object with predict, or a function or class that makes one for the "
            "environment"
        )
    return _of_own(name, value, env_id)


def _of_own(name: str, policy: Any, env_id: str) -> NamedPolicy:
    carried = getattr(policy, "env_config", None)
    model = callable(getattr(policy, "get_env", None))
    if isinstance(carried, Mapping):
        return NamedPolicy(name, policy, dict(carried), dict(carried), own=True)
    settings = _training_settings(policy, env_id) if model else {}
    return NamedPolicy(name, policy, _of_actions(settings), settings, own=True)


def _training_settings(model: Any, env_id: str) -> dict[str, Any]:
    """Settings of the environment of a model of Stable-Baselines3 in memory; none if it has no environment."""
    env, task = model.get_env(), task_type(env_id)
    spec = None if env is None else getattr(env, "get_attr", lambda name: [None])("spec")[0]
    if spec is None or spec.id != env_id or task is None:
        return {}
    return {name: value for name, value in spec.kwargs.items() if name in task.config_type.model_fields}


def _of_actions(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that define what actions mean."""
    return {name: value for name, value in settings.items() if name in ACTION_SETTINGS}
