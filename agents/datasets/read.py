"""Demonstrations read back from Minari datasets, for training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.datasets.store import DETAILS, as_json, fingerprint, open_dataset
from agents.environments import make_batch, portable, task_type
from planners.checks import brief
from planners.typing import Array


@dataclass(frozen=True)
class Demonstration:
    """An episode of a dataset.

    Attributes:
        observations: ``(steps + 1, size)``, the last one after the last action.
        actions: ``(steps, size)``.
        rewards: ``(steps,)``.
        terminated: whether it ended by itself, and not by the time limit.
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: Array
    terminated: bool


def check_dataset(
    dataset: str,
    env_id: str,
    settings: Mapping[str, Any],
    options: Mapping[str, Any] = MappingProxyType({}),
    sha256: str | None = None,
) -> str:
    """The fingerprint of a dataset whose episodes are of an environment with these settings and reset options.

    Raises:
        ValueError: if there is no such dataset, it cannot be read, it is of another environment, other settings or
            options, its fingerprint is not ``sha256``, or a number in it is not finite or out of range.
        gymnasium.error.DependencyNotInstalled: without Minari, the extra ``data``.
    """
    opened = open_dataset(dataset)
    found = fingerprint(opened)
    if sha256 is not None and sha256 != found:
        raise ValueError(f"dataset {dataset} is not the one this run began with: its episodes have changed")
    spec = opened.env_spec
    if spec is None or spec.id != env_id:
        raise ValueError(f"dataset {dataset} is of {'no environment' if spec is None else spec.id}, not of {env_id}")
    if differences := _differences(env_id, spec.kwargs, settings):
        raise ValueError(f"dataset {dataset} was recorded with other settings of {env_id}: {'; '.join(differences)}")
    details = opened.storage.metadata.get(DETAILS)  # other tools' datasets have none
    recorded_options = details.get("options", {}) if isinstance(details, dict) else {}
    if recorded_options != as_json(dict(options)):
        raise ValueError(
            f"dataset {dataset} was recorded with reset options {brief(recorded_options)}, and the run has "
            f"{brief(dict(options))}"
        )
    env = make_batch(env_id, 1, settings)
    spaces = {"observations": env.single_observation_space, "actions": env.single_action_space}
    env.close()
    for what, recorded in (("observations", opened.observation_space), ("actions", opened.action_space)):
        if recorded.shape != spaces[what].shape:
            raise ValueError(
                f"dataset {dataset} has {what} of shape {recorded.shape}; {env_id} has {spaces[what].shape}"
            )
    bounds = env.single_action_space
    for number, episode in enumerate(read_dataset(dataset)):
        if not len(episode.observations) - 1 == len(episode.actions) == len(episode.rewards) > 0:
            raise ValueError(f"episode {number} of dataset {dataset} has not as many actions, rewards and observations")
        for what in ("observations", "actions", "rewards"):
            numbers = getattr(episode, what)
            if not np.isfinite(numbers).all():
                raise ValueError(f"episode {number} of dataset {dataset} has {what} that are not finite")
        if not all(bounds.contains(action) for action in episode.actions.astype(bounds.dtype)):
            raise ValueError(f"episode {number} of dataset {dataset} has actions outside of {bounds}")
    return found


def read_dataset(dataset: str, *, most: int | None = None) -> list[Demonstration]:
    """The first episodes of a dataset, ``most`` at most; a ValueError if they cannot be read."""
    opened = open_dataset(dataset)
    numbers = opened.episode_indices[:most]
    try:
        return [
            Demonstration(
                np.asarray(episode["observations"], np.float32),
                np.asarray(episode["actions"], np.float32),
                np.asarray(episode["rewards"], np.float64),
                bool(episode["terminations"][-1]),
            )
            for episode in opened.storage.get_episodes(numbers)
        ]
    except Exception as error:  # a damaged file can fail in any way
        raise ValueError(f"cannot read dataset {dataset}: {type(error).__name__}: {brief(error)}") from None


def _differences(env_id: str, recorded: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
    """Settings that are not the same, in words; but for the infos, which training does not read."""
    task = task_type(env_id)
    if task is None:
        return []
    known = task.config_type.model_fields
    given = {name: value for name, value in recorded.items() if name in known}
    ours, theirs = (task.config_type.parse(portable(each), "setting").model_dump() for each in (wanted, given))
    return [
        f"{name} {brief(theirs[name])}, and the run has {brief(ours[name])}"
        for name in ours
        if ours[name] != theirs[name] and name != "info_terms"
    ]
