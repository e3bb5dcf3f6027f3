"""`planarm rollout`: show or record one episode, and print its info."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from gymnasium.error import DependencyNotInstalled

import envs
from agents.commands.reset_options import given_options
from agents.console import note
from agents.environments import check_names, check_seed, import_env, make_one
from agents.figures.film import Film, require_recordable
from agents.policies.lookup import find_policy
from agents.policies.play import play
from agents.tables import Table
from agents.yaml_config import assigned
from envs.experts import expert_names
from envs.physics.actuation import LIMIT_KINDS

Info = dict[str, Any]


@dataclass(frozen=True)
class RolloutOptions:
    """Run one episode, show or record it if asked to, and print its info.

    For example:

        $ planarm rollout ConveyorTrack-v0 --policy dpct --render
        $ planarm rollout ConveyorTrack-v0 --policy follower --seed 7 --control-mode jerk
        $ planarm rollout ConveyorTrack-v0 --policy agent --scenario paper --record paper.gif
        $ planarm rollout ConveyorTrack-v0 --policy dpct+adaptive --settings payload=0.3 --options belt_speed=0.2
        $ planarm rollout ExcavatorPayload-v0 --policy my_module:make_policy --scenario cycle
    """

    env: tyro.conf.Positional[str]
    """Id of the environment, such as ConveyorTrack-v0; module:id for your own."""
    policy: str | None = None
    """Name of an expert, by default the first on the task's card; agent for the one that comes with planarm; the path
    of a run, an agent or a .zip; or module:name for your own planner, policy, or function that makes one."""
    seed: int = 0
    """Seed of the episode's start."""
    scenario: str | None = None
    """Which start, short for --options scenario=...; paper is the paper's."""
    options: tuple[str, ...] = ()
    """key=value for each option of the reset, such as belt_speed=0.2."""
    level: str | None = None
    """Difficulty level, from the task's card (docs/benchmark/levels.md)."""
    control_mode: str | None = None
    """What an action of an expert means, such as torque; by default what it means in the environment."""
    settings: tuple[str, ...] = ()
    """key=value for each other setting of the environment to change from its default."""
    render: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Show the episode in a window."""
    record: Path | None = None
    """Write the episode to this file: .gif, .mp4, or .png for its last frame."""
    fps: int = 20
    """Frames a second in the file; at most the environment's control rate."""
    width: int = 640
    """Width of the recorded picture, pixels."""
    allow_code: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load a Stable-Baselines3 .zip, and the statistics beside it, although any code in them is run."""


def run(options: RolloutOptions) -> int:
    """Run the episode; the exit code."""
    env_id = import_env(options.env)
    card = envs.task_card(env_id)  # raises for an unknown id
    check_seed(options.seed)
    if options.render and options.record is not None:
        raise ValueError("--render shows and --record writes: give one, then the other with the same --seed")
    if options.record is not None:
        require_recordable(options.record, fps=options.fps, width=options.width)
    if options.render:
        require_display()
    policy = options.policy or expert_names(env_id)[0]
    named = find_policy(policy, env_id, allow_code=options.allow_code)
    changes = assigned({}, options.settings)
    if options.control_mode is not None:
        if changes.get("control_mode", options.control_mode) != options.control_mode:
            raise ValueError(
                f"--control-mode {options.control_mode} and --settings control_mode={changes['control_mode']}: give "
                "one of them"
            )
        changes["control_mode"] = options.control_mode
    changes, reset_options = card.at_level(options.level, changes, given_options(options.options, options.scenario))
    settings = named.own_settings(changes)
    check_names(env_id, settings, reset_options)
    if assumption := named.assumption(env_id, settings):
        note(f"{assumption}, such as --control-mode jerk", "yellow")
    render_mode = "human" if options.render else "rgb_array" if options.record is not None else None
    with closing(make_one(env_id, settings, render_mode)) as env:
        film = None if options.record is None else Film(min(options.fps, env.metadata["render_fps"]), options.width)
        rate = float(env.metadata["render_fps"])

        def take(steps: int, ended: bool) -> None:
            if film is not None:
                film.take(steps / rate, env.render, last=ended)

        info = play(env, named.policy, options.seed, reset_options, take)
    if film is not None and options.record is not None:
        film.write(options.record)
        note(f"wrote {options.record}")
    Table(f"{env_id}, {named.name}, seed {options.seed}", ("info", "value"), list(info_rows(info))).show()
    return 0


def require_display() -> None:
    """Raise a ValueError where a window cannot be shown, or a DependencyNotInstalled without pygame."""
    wanted = os.environ.get("SDL_VIDEODRIVER")
    if sys.platform == "linux" and not (wanted or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))):
        raise ValueError("--render needs a display, and neither DISPLAY nor WAYLAND_DISPLAY names one: use --record")
    try:
        import pygame
    except ModuleNotFoundError:
        raise DependencyNotInstalled('--render needs pygame; run: pip install "planarm[viz]"') from None
    try:
        pygame.display.init()
        driver = pygame.display.get_driver()
        pygame.display.quit()
    except pygame.error as error:
        raise ValueError(f"--render finds no display: {error}; use --record") from None
    if driver in ("dummy", "offscreen") and driver != wanted:  # in place of a display that does not answer
        raise ValueError("--render needs a display, and the one that DISPLAY names does not answer: use --record")


def info_rows(info: Info, indent: str = "") -> Iterator[tuple[str, str]]:
    """An episode's info, nested entries indented, as rows of a table."""
    for key, value in info.items():
        if key == "limit_ratios":
            value = dict(zip(LIMIT_KINDS, map(float, value), strict=True))
        if isinstance(value, dict):
            yield f"{indent}{key}", ""
            yield from info_rows(value, f"{indent}  ")
        else:
            yield f"{indent}{key}", f"{value:.6g}" if isinstance(value, float) else str(value)
