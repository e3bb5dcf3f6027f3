"""`record_dataset`: episodes of policies, as a Minari dataset that a fresh environment repeats to the bit."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from threading import Thread
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.datasets.store import DETAILS, Draft, as_json, minari
from agents.environments import card_of, check_names, check_seed, import_env, make_one, portable, with_defaults
from agents.policies.lookup import AnyPolicy, NamedPolicy, name_policies
from agents.policies.play import play
from agents.policies.policy import Actor
from agents.provenance import machine, versions
from agents.yaml_config import refuse_twice
from envs.experts.base import Expert
from planners.checks import brief
from planners.typing import Array

Info = Mapping[str, Any]
PLAN = "planned_position"
"""Key of the infos with the joint angles that a policy has planned for the time of each observation, rad."""
_AT_ONCE = 64  # episodes that are kept in memory


@dataclass
class Recorded:
    """What was recorded of a policy.

    Attributes:
        policy: its name.
        returns: of the episodes that are in the dataset.
        successes: how many of them are successes.
        left_out: episodes that are not in the dataset, because they are no successes.
    """

    policy: str
    returns: list[float] = field(default_factory=list)
    successes: int = 0
    left_out: int = 0

    def document(self) -> dict[str, Any]:
        """As JSON holds it."""
        episodes = len(self.returns)
        mean = {} if not episodes else {"mean_return": float(np.mean(self.returns))}
        counts = {"episodes": episodes, "successes": self.successes, "left_out": self.left_out}
        return {"policy": self.policy, **counts, **mean}


@dataclass(frozen=True)
class Recording:
    """A dataset that was written.

    Attributes:
        dataset_id: by which Minari loads it.
        folder: of the dataset.
        policies: what was recorded of each.
        finished: whether all episodes were recorded; not after Ctrl-C.
    """

    dataset_id: str
    folder: Path
    policies: tuple[Recorded, ...]
    finished: bool


def record_dataset(
    dataset_id: str,
    env_id: str,
    policies: Sequence[AnyPolicy] | Mapping[str, AnyPolicy],
    episodes: int,
    *,
    seed: int = 0,
    env_config: Info | None = None,
    options: Info | None = None,
    only_successes: bool = False,
    overwrite: bool = False,
    allow_code: bool = False,
    command: str = "",
    progress: Callable[[int], object] = lambda ended: None,
) -> Recording:
    """Record episodes of policies as a Minari dataset.

    Each episode holds its observations, actions, rewards, ends and infos (with the terms of the reward, and what the
    policy has planned, NaN without a plan), its seed and options, and as metadata the policy's name, its success and
    its return. The dataset's metadata hold the settings, the task's card (all of it but its functions), versions,
    machine and command. A fresh environment of `minari.MinariDataset.recover_environment` repeats an episode from its
    seed, options and actions to the bit. Ctrl-C ends the recording: the dataset then holds the episodes so far.

    Args:
        dataset_id: ``(namespace/)name-v0``; it is written where Minari keeps its datasets.
        env_id: of the environment; ``"my_module:MyTask-v0"`` imports the module first.
        policies: policies, or policies by name, as `agents.evaluate` takes them.
        episodes: of each policy; all policies meet the same seeds.
        seed: of the first episode; each further episode has the next.
        env_config: settings of the environment.
        options: of each ``reset``.
        only_successes: leave out episodes that are no successes.
        overwrite: replace a dataset of this id.
        allow_code: whether to load models of Stable-Baselines3, which can run any code in them.
        command: by which it is made, for the metadata.
        progress: called with 1 after each episode.

    Raises:
        ValueError: for an unknown policy, setting or option, policies that act in different control modes,
            ``info_terms`` false, no episode that is a success, or an id that is malformed, taken or inside a dataset.
        gymnasium.error.DependencyNotInstalled: without Minari, the extra ``data``.
        KeyboardInterrupt: if Ctrl-C comes before the first episode has ended.
    """
    minari()
    if not isinstance(episodes, int | np.integer) or episodes < 1:
        raise ValueError(f"episodes {brief(episodes)} must be a whole number from 1")
    seed = check_seed(seed)
    env_id = import_env(env_id)
    refuse_twice([policy for policy in policies if isinstance(policy, str)], "policy")
    named = name_policies(policies, env_id, allow_code=allow_code)
    given = portable(env_config or {})
    settings = _common_settings(env_id, named, given)
    check_names(env_id, settings, options or {})
    for name, value in (options or {}).items():
        try:
            np.asarray(value)
        except ValueError:
            message = f"option {name} {brief(value)} has lists of different lengths, which HDF5 cannot hold"
            raise ValueError(message) from None
    recorded = [Recorded(each.name) for each in named]
    began = datetime.now(UTC).isoformat("T", "seconds")
    finished = False
    with closing(make_one(env_id, settings)) as env, Draft(dataset_id, env, overwrite=overwrite) as draft:
        batch: list[tuple[Any, dict[str, Any]]] = []
        try:
            for policy, record in zip(named, recorded, strict=True):
                for number in range(seed, seed + episodes):
                    episode, details = _episode(env, policy, number, dict(options or {}))
                    if only_successes and not details["is_success"]:
                        record.left_out += 1
                    else:
                        batch.append((episode, details))
                        record.returns.append(details["return"])
                        record.successes += details["is_success"]
                    if len(batch) == _AT_ONCE:
                        _write(draft, batch)
                    progress(1)
            finished = True
        except KeyboardInterrupt:
            if not any(record.returns for record in recorded):
                raise
        if not any(record.returns for record in recorded):
            raise ValueError(f"none of the {episodes} episodes of each policy is a success: nothing is written")
        _write(draft, batch)
        details = {
            "env": env_id,
            "env_config": settings,
            "options": dict(options or {}),
            "seed": seed,
            "finished": finished,
            "card": _card(env_id),
            "policies": [record.document() for record in recorded],
            "versions": versions(("minari",)),
            "machine": machine(),
            "command": command,
            "began": began,
        }
        names = ", ".join(record.policy for record in recorded)
        metadata = {
            "algorithm_name": names,
            "description": f"{env_id}, episodes of {names}, recorded by planarm",
            DETAILS: as_json(details),
        }
        return Recording(dataset_id, draft.finish(metadata), tuple(recorded), finished)


class _Recorder(gym.Wrapper[Any, Any, Any, Any]):
    """Keeps what an episode returns."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.observations: list[Any] = []
        self.infos: list[Info] = []
        self.actions: list[Any] = []
        self.ends: list[tuple[float, bool, bool]] = []

    def reset(self, **given: Any) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(**given)
        self.observations, self.infos, self.actions, self.ends = [observation], [info], [], []
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.observations.append(observation)
        self.infos.append(info)
        self.actions.append(action)
        self.ends.append((float(reward), terminated, truncated))
        return observation, reward, terminated, truncated, info


def _episode(env: Any, named: NamedPolicy, seed: int, options: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """An episode as Minari stores it, and its metadata."""
    from minari.data_collector import EpisodeBuffer

    recorder = _Recorder(env)
    policy = Actor(named.policy, recorder, named.name).policy
    planned: list[Array | None] = []

    def observe(steps: int, ended: bool) -> None:
        if steps and isinstance(policy, Expert):
            ahead = policy.planned()
            planned.append(None if ahead is None else ahead[0])

    info = play(recorder, policy, seed, options, observe)
    infos = {key: np.array([each[key] for each in recorder.infos]) for key in _stored(recorder.infos)}
    if hasattr(env.unwrapped, "task"):
        infos[PLAN] = _plans(planned, len(recorder.observations), env.unwrapped.task.arm.n_joints)
    rewards, terminations, truncations = (list(column) for column in zip(*recorder.ends, strict=True))
    episode = EpisodeBuffer(
        seed=seed,
        options=options,
        observations=np.array(recorder.observations, env.observation_space.dtype),
        actions=np.array(recorder.actions, env.action_space.dtype),
        rewards=rewards,
        terminations=terminations,
        truncations=truncations,
        infos=infos,
    )
    succeeded = bool(info.get("is_success", False))
    return episode, {"policy": named.name, "return": float(info["return"]), "is_success": succeeded}


def _stored(infos: Sequence[Info]) -> list[str]:
    """Keys of the infos that hold a number, or numbers, at every step."""
    common = set(infos[0]).intersection(*infos)
    numeric = [key for key in infos[0] if key in common and np.asarray(infos[0][key]).dtype.kind in "biuf"]
    return [key for key in numeric if len({np.shape(info[key]) for info in infos}) == 1]


def _plans(planned: Sequence[Array | None], steps: int, joints: int) -> NDArray[np.float64]:
    """The angles planned for the time of each observation, ``(steps, joints)``; NaN without a plan."""
    rows = np.full((steps, joints), np.nan)
    for row, angles in zip(rows, planned, strict=False):
        if angles is not None:
            row[:] = angles
    return rows


def _write(draft: Draft, batch: list[tuple[Any, dict[str, Any]]]) -> None:
    """Write a batch of episodes and empty it; Ctrl-C is heard when they are written."""
    if not batch:
        return
    episodes, details = zip(*batch, strict=True)
    batch.clear()
    errors: list[Exception] = []

    def write() -> None:
        try:
            draft.add(episodes, details)
        except Exception as error:
            errors.append(error)

    thread = Thread(target=write)  # an interrupt reaches the main thread only
    thread.start()
    try:
        thread.join()
    except KeyboardInterrupt:
        thread.join()
        raise
    finally:
        if errors:
            raise errors[0]


def _common_settings(env_id: str, named: Sequence[NamedPolicy], given: Info) -> dict[str, Any]:
    """The settings of one environment for all policies; a ValueError if they need different ones, or hide infos."""
    if not given.get("info_terms", True):
        raise ValueError("info_terms false leaves out the terms of the reward, which a dataset holds: leave it out")
    settings = [
        {name: value for name, value in each.own_settings(given).items() if name != "info_terms"} for each in named
    ]
    for each, wanted in zip(named[1:], settings[1:], strict=True):
        if with_defaults(env_id, wanted) != with_defaults(env_id, settings[0]):
            raise ValueError(
                f"{named[0].name} acts with {json.dumps(as_json(settings[0]))} and {each.name} with "
                f"{json.dumps(as_json(wanted))}: a dataset has one environment, so give the same settings, such as "
                "control_mode, or record a dataset for each"
            )
    return settings[0]


def _card(env_id: str) -> dict[str, Any]:
    """The part of the task's card that is data: all but the functions."""
    card = card_of(env_id)
    return {
        "metrics": [vars(metric) for metric in card.metrics],
        "experts": list(card.experts),
        "control_modes": list(card.control_modes),
        "bound": card.bound and {"metric": card.bound.metric, "meaning": card.bound.meaning},
        "links": list(card.links),
        "levels": {
            name: {"meaning": level.meaning, "settings": dict(level.settings), "options": dict(level.options)}
            for name, level in card.levels.items()
        },
    }
