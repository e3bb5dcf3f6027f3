"""Trained agents: a small network with Stable-Baselines3's `predict`."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from envs.card import task_card
from envs.checks import checked_observations
from envs.experts import refuse_transformed
from envs.observation import Observation
from envs.settings import refuse_unknown
from envs.task import Task
from envs.uncertainty.draw import DRAWN
from planners import Arm
from planners.control.network import ACTIVATIONS, Network, Tensors, tanh

Actions = NDArray[np.float32]

ACTION_SETTINGS = ("control_mode", "relative_motion")
"""Settings of an environment that define what an action means, or what else is observed, and do not change the task."""
FORMAT, SQUASHED_FORMAT, NORMALIZED = 1, 2, 2
"""Versions of the files: of networks whose output is clipped to [-1, 1] (PPO), and squashed by tanh (SAC, TD3); and
what is added to them if the observations are normalised first, as by VecNormalize."""
FORMATS = (FORMAT, SQUASHED_FORMAT, FORMAT + NORMALIZED, SQUASHED_FORMAT + NORMALIZED)
"""All versions that can be read."""
_MOST_LAYERS = 64
_NORMAL = ("normal.mean", "normal.std", "normal.clip")
_LOG_STD_RANGE = np.float32(-20.0), np.float32(2.0)  # of SAC's noise, as Stable-Baselines3 limits it


@dataclass(frozen=True, eq=False)
class Agent:
    """A trained policy: the mean and the standard deviation of a Gaussian over actions.

    The inputs of the network are an observation x and, for the elements ``fine.index``, tanh(gain * x). Its tensors are
    ``fine.index``, ``fine.gain``, and ``weight`` (outputs, inputs) and ``bias`` of each layer, as in ``layer0.weight``.
    Actions of `FORMAT` are clipped to [-1, 1], and ``log_std`` is the logarithm of their standard deviation. Those of
    `SQUASHED_FORMAT` are the tanh of what is drawn; ``log_std.weight`` and ``log_std.bias`` give the logarithm of the
    standard deviation before it from the last hidden layer, and without them nothing is drawn. With `NORMALIZED` added
    to the format, x is the observation minus ``normal.mean``, over ``normal.std``, clipped to ``normal.clip``.

    Attributes:
        document: its JSON: environment, layout, architecture, training, scores.
        tensors: weights, float32; copies that cannot be written.
        generator: draws the actions that are not deterministic.
        shipped: whether it comes with planarm: then it is scored in any settings, and not in those of its training.
    """

    document: Mapping[str, Any]
    tensors: Tensors
    generator: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    shipped: bool = False
    _network: Network = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        refuse_unknown([str(self.document["activation"])], ACTIVATIONS, "activation of an agent")
        hidden = self.document["hidden"]
        if not isinstance(hidden, (list, tuple)) or len(hidden) > _MOST_LAYERS:
            raise ValueError(f"hidden {hidden!r:.80} of an agent must list the widths of at most {_MOST_LAYERS} layers")
        _check_tensors(self.tensors, len(hidden) + 1, squashed=self.squashed, normalized=self.normalized)
        widths = [self.tensors[f"layer{layer}.bias"].size for layer in range(len(hidden))]
        if list(hidden) != widths:
            raise ValueError(f"hidden {hidden!r:.80} of an agent are not the widths of its layers, {widths}")
        tensors = {name: np.array(tensor) for name, tensor in self.tensors.items()}
        for tensor in tensors.values():
            tensor.flags.writeable = False
        object.__setattr__(self, "tensors", tensors)
        object.__setattr__(self, "_network", self._packed())  # of what was checked

    @property
    def env_id(self) -> str:
        """The environment it was trained on."""
        return str(self.document["env"])

    @property
    def env_config(self) -> dict[str, Any]:
        """The settings of that environment, including those of its reward."""
        return dict(self.document["env_config"])

    @property
    def action_config(self) -> dict[str, Any]:
        """The settings that define what its actions mean and what else it observes; it acts with no others."""
        return {name: value for name, value in self.env_config.items() if name in ACTION_SETTINGS}

    @property
    def levels(self) -> tuple[str, ...]:
        """The difficulty levels at which it was trained; none if that was on the plain task."""
        levels = self._recipe.get("levels")
        return tuple(map(str, levels)) if isinstance(levels, list | tuple) else ()

    @property
    def _recipe(self) -> Mapping[str, Any]:
        """The settings of its training, as far as its file tells them."""
        training = self.document.get("training")
        config = training.get("config") if isinstance(training, Mapping) else None
        return config if isinstance(config, Mapping) else {}

    @property
    def squashed(self) -> bool:
        """Whether its actions are the tanh of the network's output, instead of clipped."""
        return self.document.get("format") in (SQUASHED_FORMAT, SQUASHED_FORMAT + NORMALIZED)

    @property
    def normalized(self) -> bool:
        """Whether its observations are normalised before the network."""
        return self.document.get("format") in (FORMAT + NORMALIZED, SQUASHED_FORMAT + NORMALIZED)

    @property
    def forecasts(self) -> bool:
        """Whether its outputs are forecasts of discs, on which an expert acts; see `for_env`."""
        return bool(self.document.get("forecasts"))

    @property
    def observation_size(self) -> int:
        """Number of inputs of its network: elements of an observation, unless it forecasts."""
        return int(self._network.sizes[0] - self._network.index.size)

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Actions, None]:
        """Actions for observations.

        Args:
            observation: ``(size,)`` or ``(num_envs, size)``.
            state: ignored; an agent has no memory.
            episode_start: ignored likewise.
            deterministic: whether to return the mean action instead of a random one.

        Returns:
            Actions in [-1, 1], ``(n,)`` or ``(num_envs, n)``, and None.

        Raises:
            ValueError: if the observation has the wrong size, or this agent forecasts.
        """
        if self.forecasts:
            raise ValueError(
                "this agent forecasts where discs will be, for the expert apf of an environment: agent.for_env(env) "
                "gives the policy there"
            )
        batch = checked_observations(observation, self.observation_size).astype(np.float32, copy=False)
        bounded = self.network_actions(batch, deterministic=deterministic)
        return (bounded[0] if np.ndim(observation) == 1 else bounded), None

    def for_env(self, env: Any) -> Any:
        """The policy in an environment, single or vector: this agent, or one that acts through it.

        That is the expert that acts on its forecasts; or, on the belt with declared uncertainty, `FilteredPolicy`, if
        its network was trained without.

        Raises:
            ValueError: if the environment is none that it was trained for.
        """
        self.check_env(env)
        if not self.forecasts:
            from envs.conveyor_track.filtered import FilteredPolicy

            task = getattr(env.unwrapped, "task", None)
            if FilteredPolicy.wanted(task) and not self._knows_uncertainty:
                return FilteredPolicy(task, self.network_actions)
            return self
        from envs.obstacle_dodge.forecasts import ForecastingExpert

        return ForecastingExpert(env.unwrapped.task, self.network_actions)

    @property
    def _knows_uncertainty(self) -> bool:
        """Whether its network may have observed uncertainty: by its settings, or at difficulty levels."""
        from envs.conveyor_track.filtered import FilteredPolicy

        if self._recipe.get("estimates") is True:
            return False
        known = task_card(self.env_id).levels
        uncertain = any({*DRAWN, "mass_error"} & {*known[name].settings} for name in self.levels if name in known)
        return FilteredPolicy.wanted(self._task) or uncertain

    def network_actions(self, inputs: NDArray[np.float32], *, deterministic: bool = True) -> Actions:
        """What the network gives for its inputs, ``(num_envs, size)``: actions or forecasts in [-1, 1].

        Raises:
            ValueError: for inputs of another shape.
        """
        batch, size = inputs, self.observation_size
        if np.ndim(inputs) != 2 or inputs.shape[1] != size:
            raise ValueError(f"inputs of shape {np.shape(inputs)} for a network that takes (num_envs, {size})")
        if self._normal:
            mean, std, clip = self._normal
            batch = np.clip((batch - mean) / std, -clip, clip).astype(np.float32)
        n = self.tensors[f"layer{len(self.document['hidden'])}.bias"].size
        outputs = self._network.run(np.array(batch, np.float32, order="C"))
        actions: Actions = outputs[:, :n]
        log_std = None if deterministic else self._log_std(outputs[:, n:])
        if log_std is not None:
            actions += np.exp(log_std) * self.generator.standard_normal(actions.shape, dtype=np.float32)
        bounded: Actions = np.clip(tanh(actions) if self.squashed else actions, np.float32(-1.0), np.float32(1.0))
        return bounded

    def _log_std(self, own: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """Logarithm of the standard deviation of the actions; None for no noise.

        ``own`` are the outputs of the network behind the mean, of agents that have them.
        """
        if not self.squashed:
            log_std: NDArray[np.float32] = self.tensors["log_std"]
            return log_std
        return np.clip(own, *_LOG_STD_RANGE) if own.size else None

    def check_env(self, env: Any) -> None:
        """Raise a ValueError for an environment, single or vector, other than those that it was trained for.

        That is one of another task, or with another arm or other actions.
        """
        task = getattr(env.unwrapped, "task", None)
        if not isinstance(task, Task):
            return  # one that only looks like the task's; the size of its observations is checked in use
        refuse_transformed(env, "an agent")
        if task.env_id != self.env_id:
            raise ValueError(f"this agent was trained on {self.env_id}, not on {task.env_id}")
        for name in ACTION_SETTINGS:
            given, own = (getattr(config, name, None) for config in (task.config, self._task.config))
            if given != own:
                raise ValueError(f"this agent was trained with {name} {own!r}; the environment has {given!r}")
        self.check_arm(task.arm)
        if not self.forecasts and task.layout.size != self.observation_size:
            others = (
                f"{name} {own!r} (here {given!r})"
                for (name, given), (_, own) in zip(task.config, self._task.config, strict=True)
                if given != own
            )
            raise ValueError(
                f"this agent observes {self.observation_size} numbers, and this environment gives {task.layout.size}: "
                f"it was trained with {', '.join(others)}"
            )

    def check_arm(self, arm: Arm) -> None:
        """Raise a ValueError for another arm than the one that it was trained for; gravity may differ."""
        if replace(arm, gravity=0.0) != replace(self._task.arm, gravity=0.0):
            raise ValueError(
                f"this agent was trained for another arm: {_in_words(self._task.arm)}; the environment has "
                f"{_in_words(arm)}. Train one for this arm (planarm train {task_card(self.env_id).recipe or 'my.yaml'} "
                "arm=...), or give the environment the agent's arm"
            )

    @cached_property
    def _task(self) -> Task:
        """The task that it was trained on."""
        with closing(gym.make(self.env_id, **self.env_config)) as env:
            task: Task = env.unwrapped.task  # type: ignore[attr-defined]
            return task

    @cached_property
    def _normal(self) -> tuple[NDArray[np.float64], ...]:
        """Mean, standard deviation and clip of the observations, in float64 as VecNormalize has them; or nothing."""
        return tuple(self.tensors[name].astype(np.float64) for name in _NORMAL) if self.normalized else ()

    def _packed(self) -> Network:
        """The mean actions before they are bounded; behind them, where there are any, the network's own log_std."""
        layers = [
            (self.tensors[f"layer{layer}.weight"], self.tensors[f"layer{layer}.bias"])
            for layer in range(len(self.document["hidden"]) + 1)
        ]
        if "log_std.weight" in self.tensors:
            weight, bias = layers[-1]
            own = self.tensors["log_std.weight"], self.tensors["log_std.bias"]
            layers[-1] = np.concatenate([weight, own[0]]), np.concatenate([bias, own[1]])
        # Compiled code would be another for arrays that cannot be written.
        fine = {name: np.array(self.tensors[name]) for name in ("fine.index", "fine.gain")}
        return Network.pack(fine, layers, self.document["activation"])


def _in_words(arm: Arm) -> str:
    """An arm in few words."""
    lengths, masses = (", ".join(f"{value:g}" for value in values) for values in (arm.lengths, arm.masses))
    return f"{arm.name} (links of {lengths} m and {masses} kg)"


def _check_tensors(tensors: Tensors, layers: int, *, squashed: bool, normalized: bool) -> None:
    """Raise a ValueError unless the layers fit together, so that compiled code reads nothing beside them."""
    names = [f"layer{layer}.{part}" for layer in range(layers) for part in ("weight", "bias")]
    noise: tuple[str, ...] = ("log_std.weight", "log_std.bias") if squashed else ("log_std",)
    if squashed and not any(name in tensors for name in noise):
        noise = ()  # of TD3
    normal = _NORMAL if normalized else ()
    listed = ("fine.index", "fine.gain", *normal, *noise, *names)
    dimensions = {name: 2 if name.endswith("weight") else 1 for name in listed}
    missing = [name for name in dimensions if name not in tensors]
    if missing:
        raise ValueError(f"an agent lacks the tensors {', '.join(missing)}")
    for name, expected in dimensions.items():
        tensor, kinds = tensors[name], "iu" if name == "fine.index" else "f"
        if tensor.ndim != expected or tensor.dtype.kind not in kinds:
            wanted = f"{expected} dimensions of {'integers' if kinds == 'iu' else 'floats'}"
            raise ValueError(f"{name} of an agent has shape {tensor.shape} of {tensor.dtype}; expected {wanted}")
    index, last = tensors["fine.index"], tensors[f"layer{layers - 1}.bias"].size
    observed = tensors["layer0.weight"].shape[1] - index.size
    if tensors["fine.gain"].size != index.size or not ((index >= 0) & (index < observed)).all():
        raise ValueError(
            f"fine.index of an agent must name elements of observations of {max(observed, 0)}, each with its fine.gain"
        )
    for name in normal:
        size = 1 if name == "normal.clip" else observed
        if tensors[name].size != size:
            raise ValueError(f"{name} of an agent has {tensors[name].size} elements; expected {size}")
    for layer in range(layers):
        weight, bias = tensors[f"layer{layer}.weight"], tensors[f"layer{layer}.bias"]
        following = tensors[f"layer{layer + 1}.weight"].shape[1] if layer + 1 < layers else last
        if weight.shape[0] != bias.size or weight.shape[0] != following:
            raise ValueError(f"layer {layer} of an agent has {weight.shape[0]} outputs; the next takes {following}")
    for name in noise:
        expected_shape = (last, tensors[f"layer{layers - 1}.weight"].shape[1])[: dimensions[name]]
        if tensors[name].shape != expected_shape:
            raise ValueError(f"{name} of an agent has shape {tensors[name].shape}; expected {expected_shape}")
