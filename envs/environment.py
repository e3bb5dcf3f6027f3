"""`PlanarArmEnv`: one environment of a task, a batch of one, as a Gymnasium environment."""

from __future__ import annotations

import re
import weakref
from copy import deepcopy
from inspect import cleandoc
from threading import Lock
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from gymnasium.utils import EzPickle, seeding
from numpy.typing import NDArray

from envs.batch.exclusive import exclusive, refuse_second
from envs.batch.records import reader
from envs.batch.state import Episodes, State, episodes_of, set_generator, state_of_generator
from envs.card import load
from envs.checks import checked_actions, checked_options, checked_seed, time_limits_of, untouched_when_refused
from envs.infos import Info, TaskInfos
from envs.observation import Observation
from envs.physics.actuation import LIMIT_KINDS
from envs.settings import UnknownName, refuse_unknown
from envs.task import Task
from envs.task_camera import Frame, TaskCamera
from planners import MotionProblem
from planners.typing import Array

_READ = ("limit_ratio", "step", "reward", "terminated", "truncated", "success", "reward_terms")
"""Fields of a record that a step reads."""

_SECTIONS = (
    "Description",
    "Action space",
    "Observation space",
    "Rewards",
    "Starting state",
    "Episode end",
    "Info",
    "Arguments",
    "Difficulty",
    "Version history",
)
"""Headings of an environment's docstring, in order, as in Gymnasium's own."""
_DECLARED = """
## Observation space
Each element is a physical value divided by a fixed scale, clipped at the bound.

{layout}

## Info
Every key is there at the reset and at every step; with `info_terms=False` only where an episode ends, and other infos
are empty. Until it is known, a number is NaN and a bool is False.

| Key | Known | Meaning |
|---|---|---|
| `is_success` | always | whether the task is solved |
{rewards}
{outcomes}
| `limit_ratio` | always | worst value / limit of all kinds so far |
| `limit_ratios` | always | worst value / limit so far of each kind: {kinds}; an array |

The end is also where Gymnasium's `TimeLimit` (`max_episode_steps`) cuts an episode.

## Arguments
Settings of the environment, `gym.make(id, name=value)`:

{settings}

Options of an episode, `reset(options={{"name": value}})`; what is left out is drawn:

{options}
"""


def _in_order(text: str, declared: str) -> str:
    """A docstring with the declared sections, each after what the text itself says under that heading."""
    summary, *own = re.split(r"^## ", text, flags=re.MULTILINE)
    parts: dict[str, list[str]] = {}
    for section in [*own, *declared.strip().removeprefix("## ").split("\n\n## ")]:
        heading, _, body = section.partition("\n")
        parts.setdefault(heading, []).append(body.strip())
    known = [heading for heading in _SECTIONS if heading in parts]
    headings = [*known, *(heading for heading in parts if heading not in known)]
    return "\n\n".join([summary.strip(), *(f"## {heading}\n" + "\n\n".join(parts[heading]) for heading in headings)])


class PlanarArmEnv(gym.Env[Observation, NDArray[np.float32]], EzPickle):
    """One environment of a task as a Gymnasium environment.

    Copying and pickling keep the running episode. One thread at a time may use it: another one gets a RuntimeError. The
    docstring of a subclass with a `task_type` gets tables of the observation, the info and the settings that the task
    declares.

    Args:
        render_mode: ``"human"``, ``"rgb_array"`` or None.
        task_type: the `Task` class, or ``"module:Name"`` of it; by default the class attribute of this name.
        config: fields of the task's configuration.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}  # type: ignore[misc]
    task_type: ClassVar[type[Any]]

    def __init_subclass__(cls) -> None:
        task: Any = cls.task_type
        rewards = [f"| `reward_{name}` | after a step | this term of its reward |" for name in task.reward_terms]
        outcomes = [f"| `{key}` | at the end | {meaning} |" for key, meaning in task.outcomes.items()]
        declared = _DECLARED.format(
            layout=task.layout.table(),
            rewards="\n".join(rewards),
            outcomes="\n".join(outcomes),
            kinds=", ".join(LIMIT_KINDS),
            settings=task.config_type.table(),
            options=task.options_type.table(),
        )
        cls.__doc__ = _in_order(cleandoc(cls.__doc__ or ""), declared)

    def __init__(
        self, render_mode: str | None = None, *, task_type: type[Any] | str | None = None, **config: Any
    ) -> None:
        EzPickle.__init__(self, render_mode, task_type=task_type, **config)
        self.task: Task = make_task(task_type or self.task_type, config, 1, render_mode, self.metadata)
        self.metadata = {**self.metadata, "render_fps": self.task.frame_rate}  # type: ignore[misc]
        self.render_mode = render_mode
        self.observation_space = self.task.layout.space()
        self.action_space = self.task.action_space()
        self._action_shape = (self.task.batch["action"].shape[1],)
        self._needs_reset, self._begun, self._cut_after = True, False, 0
        self._infos = TaskInfos(self.task)
        self._camera = TaskCamera(self.task, 0, window=render_mode == "human")
        # Views of the one record, made once to keep a step fast.
        self._env = self.task.batch[0]
        self._read = reader(self.task.batch, 0, _READ)
        self._observation = self._env["observation"]
        self._time_limits: list[weakref.ref[gym.wrappers.TimeLimit[Any, Any]]] = []
        self._in_use, self._closed = Lock(), False

    @exclusive
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Info]:
        """Begin an episode; the environment's docstring lists the options.

        Raises:
            ValueError: for options that are refused; the episode and the random numbers go on as if not called.
        """
        self._require_open()
        seed = checked_seed(seed)
        generator, used_seed = (self.np_random, self.np_random_seed) if seed is None else seeding.np_random(seed)
        with untouched_when_refused([generator]):
            self.task.reset_envs([0], [generator], checked_options(options))
        self._np_random, self._np_random_seed = generator, used_seed
        self._needs_reset, self._begun = False, True
        time_limits = time_limits_of(self)
        self._time_limits = [weakref.ref(time_limit) for time_limit in time_limits]
        self._cut_after = min((int(time_limit._max_episode_steps) for time_limit in time_limits), default=0)
        self._camera.begin()
        if self.render_mode is not None:
            self._follow()
        return self._observation.copy(), self._infos.at_reset()

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, Info]:
        """Hold an action for one control period."""
        if self._in_use.locked():
            refuse_second("step", self)
        with self._in_use:
            if self._needs_reset:
                self._require_open()
                raise gym.error.ResetNeeded("the episode is over or has not begun: call reset() first")
            self.task.advance(checked_actions(action, self._action_shape))
            worst, step, reward, terminated, truncated, *known = self._read()
            self._needs_reset = over = terminated or truncated
            info = self._infos.at_step(worst, known, ended=over or step == self._cut_after)
            if self.render_mode is not None:
                self._follow()
            return self._observation.copy(), reward, terminated, truncated, info

    def _follow(self) -> None:
        """Add to the trail of the hand, and draw in a window."""
        self._camera.follow()
        if self.render_mode == "human":
            self._camera.frame()

    @exclusive
    def render(self) -> Frame | None:
        """The current frame, ``(height, width, 3)``, or None in ``"human"`` mode, where it goes to a window."""
        if not self._begun:
            self._require_open()
            raise gym.error.ResetNeeded("no episode has begun: call reset() before render()")
        if self.render_mode is None:
            gym.logger.warn('render() needs a render mode: gym.make(..., render_mode="rgb_array")')
            return None
        frame = self._camera.frame()
        return None if self.render_mode == "human" else frame

    @exclusive
    def get_state(self) -> State:
        """The running episode, with its random numbers, as a value to keep, compare, pickle and continue from.

        What follows from it is the same to the bit, in any environment with the same settings
        (docs/extend/state.md).
        """
        random, trail = state_of_generator(self.np_random), self._camera.trail
        over = (self._needs_reset,)
        return self.task.get_state(Episodes(self._begun, over, (random,), self._np_random_seed, (trail,)))

    @exclusive
    def set_state(self, state: State) -> None:
        """Continue from what `get_state` returned, here or in another environment with the same settings.

        An episode that has lasted for the ``max_episode_steps`` of this environment, or longer, is over here.

        Raises:
            ValueError: for anything else, with what differs; nothing has changed then.
        """
        self._require_open()
        episodes = episodes_of(state, 1)
        self.task.set_state(state)
        self._np_random = set_generator(self.np_random, episodes.randoms[0])
        self._np_random_seed = episodes.seed
        self._begun, (self._needs_reset,) = episodes.begun, episodes.over
        self._needs_reset |= 0 < self._cut_after <= int(self._env["step"])
        (self._camera.trail,) = episodes.trails
        self._set_elapsed()

    def _set_elapsed(self) -> None:
        """Let the time limits around this environment know its step."""
        for time_limit in self._living_limits():
            time_limit._elapsed_steps = int(self._env["step"])  # type: ignore[assignment]

    def _living_limits(self) -> list[gym.wrappers.TimeLimit[Any, Any]]:
        """The time limits around this environment that there still are."""
        return [time_limit for each in self._time_limits if (time_limit := each()) is not None]

    def __getstate__(self) -> Info:
        kept = {name: getattr(self, name) for name in ("spec", "_cut_after", "_closed")}
        return {
            **EzPickle.__getstate__(self),
            **kept,
            "episode": self.get_state(),
            "time_limits": self._living_limits(),
        }

    def __setstate__(self, kept: Info) -> None:
        EzPickle.__setstate__(self, kept)
        self.set_state(kept["episode"])
        self.spec, self._cut_after = kept["spec"], kept["_cut_after"]
        self._time_limits = [weakref.ref(time_limit) for time_limit in kept["time_limits"]]
        if kept["_closed"]:
            self.close()

    def __copy__(self) -> Self:
        return deepcopy(self)

    @exclusive
    def close(self) -> None:
        """Close the window, if any; may be called twice. Nothing but copying goes on afterwards."""
        self._camera.close()
        self.task.close()
        self._closed = self._needs_reset = True
        self._begun = False

    def resume(self) -> Observation:
        """The observation after a control of the task's card was used; an episode that was over goes on."""
        self._needs_reset = False
        self._set_elapsed()
        observation: Observation = self._observation.copy()
        return observation

    def joint_state(self) -> tuple[Array, Array]:
        """Joint angles (rad) and velocities (rad/s), each ``(n,)``."""
        return self.task.batch["q"][0].copy(), self.task.batch["qd"][0].copy()

    def motion_problem(self) -> MotionProblem:
        """The planning problem that the current observation states."""
        return self.task.motion_problem(self._observation)

    def _require_open(self) -> None:
        if self._closed:
            raise gym.error.ClosedEnvironmentError("the environment is closed: make another one")


def make_task(task_type: type[Any] | str, config: Info, num_envs: int, render_mode: str | None, metadata: Info) -> Task:
    """The task of an environment, whose render mode has to be one of those in its metadata.

    The message about an unknown setting has Python's own words for it too: clients that probe what an environment takes
    look for them.
    """
    refuse_unknown([] if render_mode is None else [render_mode], metadata["render_modes"], "render mode")
    kind: Any = load(task_type) if isinstance(task_type, str) else task_type
    for name in config:
        try:
            refuse_unknown([name], kind.config_type.model_fields, f"{kind.env_id} setting")
        except UnknownName as error:
            raise UnknownName(f"{error}: unexpected keyword argument '{name}'") from None
    task: Task = kind.make(config, num_envs)
    return task
