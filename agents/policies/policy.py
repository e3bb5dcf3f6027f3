"""What a policy is: Stable-Baselines3's `predict`, how one is made for an environment, how its actions are checked."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import envs
from planners.checks import is_masked
from planners.typing import Array

VectorEnv = gym.vector.VectorEnv[Any, Any, Any]
PolicyMaker = Callable[..., "Policy"]  # makes a policy, for an environment if it takes one


@runtime_checkable
class Policy(Protocol):
    """A policy as in Stable-Baselines3: batched observations in, batched actions out.

    One that is a `CountsPlans` or an `EstimatesPayload` too has more of it recorded. A ``predict`` that does not take
    ``state``, ``episode_start`` or ``deterministic`` is called without them.
    """

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Actions ``(num_envs, n)`` for observations ``(num_envs, size)``, and the state for the next call."""


@runtime_checkable
class CountsPlans(Protocol):
    """A policy that counts its plans, so that planning is timed apart from its other work.

    Attributes:
        plans_made: so far.
        planning_seconds: time they took.
        infeasible: how many of them had no solution.
    """

    plans_made: int
    planning_seconds: float
    infeasible: int


@runtime_checkable
class EstimatesPayload(Protocol):
    """A policy that estimates the payload."""

    @property
    def mass_estimate(self) -> Array | None:
        """After the last call, ``(num_envs,)``, kg; None without an estimate."""


@runtime_checkable
class ChecksEnvironment(Protocol):
    """A policy that acts in some environments only."""

    def check_env(self, env: Any) -> None:
        """Raise a ValueError for an environment, single or vector, in which it cannot act."""


@runtime_checkable
class FitsEnvironment(Protocol):
    """A policy that acts in an environment through another one, which it makes for it."""

    def for_env(self, env: Any) -> Any:
        """The policy for an environment, single or vector."""


class NormalizedPolicy:
    """A model behind the observation statistics that it was trained with."""

    def __init__(self, model: Any, statistics: Any) -> None:
        self.observation_space, self.action_space = model.observation_space, model.action_space
        self.model, self.statistics = model, statistics

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[Any, Any]:
        """As the model's, for observations as the environment gives them."""
        seen = self.statistics.normalize_obs(observation)
        answer: tuple[Any, Any] = self.model.predict(seen, state, episode_start, deterministic)
        return answer


def normalized(policy: Any) -> Any:
    """A policy; a model whose environment has a VecNormalize, behind the statistics of that."""
    own = getattr(policy, "get_vec_normalize_env", None)
    statistics = own() if callable(own) else None
    return policy if statistics is None else NormalizedPolicy(policy, statistics)


def is_maker(policy: object) -> bool:
    """Whether this is no policy, but makes one when called: a class, or a function without ``predict``."""
    return isinstance(policy, type) or (not isinstance(policy, Policy) and callable(policy))


def as_policy(policy: Policy | PolicyMaker | str, env: VectorEnv | gym.Env[Any, Any]) -> Policy:
    """A policy for an environment: an expert by its name, what a function or a class makes, any other as it is.

    A function or a class is called with the environment, or without arguments if it takes none. A model of
    Stable-Baselines3 whose environment has a VecNormalize acts behind the statistics of that.

    Raises:
        ValueError: for an unknown expert, an object without ``predict``, or a policy that is not for this environment.
    """
    if isinstance(policy, str):
        expert: Policy = envs.make_expert(policy, env)
        return expert
    made: Any = _made(policy, env) if is_maker(policy) else policy
    if not isinstance(made, Policy):
        what = f"{_title(policy)} gave {made!r}, which" if made is not policy else f"policy {policy!r}"
        raise ValueError(
            f"{what} has no predict(observation, state, episode_start, deterministic); "
            "give the name of an expert, or an object with Stable-Baselines3's predict"
        )
    _check_spaces(made, env)
    if isinstance(made, ChecksEnvironment):
        made.check_env(env)
    fitted: Policy = made.for_env(env) if isinstance(made, FitsEnvironment) else normalized(made)
    return fitted


class Actor:
    """A policy in one environment: calls `predict` and checks what it gives.

    Args:
        policy: a policy, or a name or function as `as_policy` takes them; raises as that.
        env: the environment, single or vector.
        name: of the policy, for messages.
    """

    def __init__(self, policy: Policy | PolicyMaker | str, env: VectorEnv | gym.Env[Any, Any], name: str) -> None:
        self.policy = as_policy(policy, env)
        self._name = name
        batch = env.num_envs if isinstance(env, gym.vector.VectorEnv) else 1
        self._shape = (batch, *(_spaces(env)["action_space"].shape or ()))
        self._takes = _keywords(self.policy.predict)

    def act(self, observations: Any, state: Any, begins: NDArray[np.bool_]) -> tuple[NDArray[Any], Any]:
        """Deterministic actions ``(num_envs, n)`` for observations ``(num_envs, size)``, and the next state.

        Raises:
            ValueError: if `predict` gives no pair, or actions of another shape or kind, or NaN or inf.
        """
        given = {"state": state, "episode_start": begins, "deterministic": True}
        answer: Any = self.policy.predict(observations, **{name: given[name] for name in self._takes})
        if not isinstance(answer, tuple) or len(answer) != 2:
            shown = f"a tuple of {len(answer)}" if isinstance(answer, tuple) else type(answer).__name__
            raise ValueError(
                f"predict of {self._name} gave {shown}; expected a pair: actions of shape {self._shape}, and the state "
                "for the next call or None"
            )
        actions, state = np.asarray(answer[0]), answer[1]
        if actions.shape != self._shape:
            raise ValueError(
                f"{self._name} gave actions of shape {actions.shape}; expected {self._shape}: a row for each of "
                f"{self._shape[0]} environments"
            )
        if actions.dtype.kind not in "fiub":
            raise ValueError(f"{self._name} gave actions of type {actions.dtype}; expected numbers in [-1, 1]")
        if is_masked(answer[0]):
            raise ValueError(f"{self._name} gave masked actions: what is hidden is no number")
        if not np.isfinite(actions).all():
            row = int(np.flatnonzero(~np.isfinite(actions).reshape(self._shape[0], -1).all(axis=1))[0])
            raise ValueError(
                f"{self._name} gave the action {actions[row].tolist()} in environment {row}; actions are finite"
            )
        return actions, state


def _made(maker: Any, env: Any) -> Any:
    """What a function or a class makes, called with the environment if it takes an argument."""
    try:
        signature = inspect.signature(maker)
    except (TypeError, ValueError):
        return maker(env)
    for arguments in ((env,), ()):
        try:
            signature.bind(*arguments)
        except TypeError:
            continue
        if arguments and not _takes_one(signature):
            continue
        return maker(*arguments)
    raise ValueError(
        f"{_title(maker)}{signature} is called with the environment or without arguments to make a policy; "
        "give its other arguments defaults"
    )


def _takes_one(signature: inspect.Signature) -> bool:
    """Whether the first argument is meant for the environment: it has no default, or is called env."""
    first = next(iter(signature.parameters.values()), None)
    return first is not None and (first.default is first.empty or first.name.startswith("env"))


def _keywords(predict: Callable[..., Any]) -> tuple[str, ...]:
    """Which of the keywords of Stable-Baselines3's `predict` this one takes."""
    names = ("state", "episode_start", "deterministic")
    try:
        parameters = inspect.signature(predict).parameters.values()
    except (TypeError, ValueError):
        return names
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return names
    taken = {parameter.name for parameter in parameters if parameter.kind is not parameter.POSITIONAL_ONLY}
    return tuple(name for name in names if name in taken)


def _check_spaces(policy: Policy, env: VectorEnv | gym.Env[Any, Any]) -> None:
    """Raise a ValueError if a policy has spaces of its own, as a model of Stable-Baselines3 has, and others."""
    for name, space in _spaces(env).items():
        own = getattr(policy, name, None)
        if isinstance(own, gym.Space) and own != space:
            kind = name.replace("_", " ")
            differing = f"of shape {own.shape}" if own.shape != space.shape else "with other bounds"
            raise ValueError(
                f"{type(policy).__name__} was trained with an {kind} {differing}, and that of {_id(env)} is of shape "
                f"{space.shape}: it was another environment, one with other settings (give them), behind a wrapper, or "
                "of another version of planarm"
            )


def _spaces(env: VectorEnv | gym.Env[Any, Any]) -> dict[str, gym.Space[Any]]:
    """The spaces of one environment."""
    prefix = "single_" if isinstance(env, gym.vector.VectorEnv) else ""
    return {name: getattr(env, prefix + name) for name in ("observation_space", "action_space")}


def _id(env: VectorEnv | gym.Env[Any, Any]) -> str:
    return "the environment" if env.spec is None else env.spec.id


def _title(maker: object) -> str:
    return str(getattr(maker, "__name__", repr(maker)))
