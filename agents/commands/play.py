"""`planarm play`: watch policies act in real time in the browser, and interfere."""

from __future__ import annotations

import webbrowser
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any

import tyro
import uvicorn

import envs
from agents.console import INTERRUPTED, catch_interrupt, say
from agents.environments import check_seed, import_env
from agents.play.server import HOST, application, open_socket
from agents.play.session import Choice, Message, Session, first_policy
from agents.yaml_config import assigned, refuse_twice


@dataclass(frozen=True)
class PlayOptions:
    """Watch policies in the browser, in real time: drag the part, the goal or a disc, and see them answer.

    The page is served to this machine only and needs no internet. Ctrl-C ends it. Several pages are independent.

    For example:

        $ planarm play
        $ planarm play ObstacleDodge-v0 --policies apf agent
        $ planarm play MinTorqueMove-v0 --policies lagrange --settings gravity=9.81 --seed 3
        $ planarm play ConveyorTrack-v0 --policies runs/mine dpct --port 8000 --no-browser
    """

    env: tyro.conf.Positional[str] = "ConveyorTrack-v0"
    """Id of the environment to begin with; module:id for your own."""
    policies: tuple[str, ...] = ()
    """Up to three to begin with, as planarm evaluate takes them, or you, whose hand follows the mouse; by default the
    expert that suits the task."""
    seed: int = 0
    """Seed of the first episode."""
    level: str | None = None
    """Difficulty level, from the task's card (docs/benchmark/levels.md)."""
    settings: tuple[str, ...] = ()
    """key=value for each setting of the environment to change from its default."""
    port: int = 0
    """Port of the page; 0 for a free one."""
    browser: bool = True
    """Open the page in the browser."""
    allow_code: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load a Stable-Baselines3 .zip, although any code in it is run."""


def run(options: PlayOptions) -> int:
    """Serve the page until Ctrl-C; the exit code."""
    env_id = import_env(options.env)
    card = envs.task_card(env_id)  # raises for an unknown id
    check_seed(options.seed)
    policies = options.policies or (first_policy(env_id),)
    refuse_twice(policies, "policy")
    settings = assigned({}, options.settings)
    card.at_level(options.level, settings, {})  # raises for an unknown level
    first: dict[str, Any] = {"env": env_id, "policies": policies, "seed": options.seed}
    levels = {} if options.level is None else {env_id: options.level}
    trial = Session(allow_code=options.allow_code, settings=settings, levels=levels)
    try:  # what the page would only show later
        trial.take(Message(do="choose", choice=Choice.parse(first, "play option")))
    finally:
        trial.close()
    listening = open_socket(options.port)
    address = f"http://{HOST}:{listening.getsockname()[1]}/"
    served = application(first, settings=settings, level=options.level, allow_code=options.allow_code)
    config = uvicorn.Config(served, log_level="error", ws="websockets-sansio", timeout_graceful_shutdown=1)
    with listening, suppress(KeyboardInterrupt), catch_interrupt(at_once=True) as interrupts:
        say(f"playing at {address} (Ctrl-C ends it)")
        if options.browser:
            webbrowser.open(address)
        uvicorn.Server(config).run(sockets=[listening])
    return (interrupts or [INTERRUPTED])[0]
