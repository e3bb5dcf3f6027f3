"""The `planarm` command. The module of a subcommand is imported only when that is run, so that help is quick."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import make_dataclass
from importlib import import_module, metadata
from typing import Annotated, Any, NamedTuple, Union

import tyro


class Command(NamedTuple):
    """A subcommand: the module that runs it, the class of its options there, and a line of help."""

    module: str
    options: str
    summary: str


COMMANDS = {
    "benchmark": Command("agents.commands.benchmark", "BenchmarkOptions", "score policies on tasks, beside the bound"),
    "report": Command("agents.commands.report", "ReportOptions", "a page or figures from benchmark results"),
    "evaluate": Command("agents.commands.evaluate", "EvaluateOptions", "score a policy on a task, beside others"),
    "play": Command("agents.commands.play", "PlayOptions", "watch policies in the browser, and interfere"),
    "rollout": Command("agents.commands.rollout", "RolloutOptions", "show or record one episode"),
    "paths": Command("agents.commands.paths", "PathsOptions", "draw the paths of several policies from one start"),
    "plan": Command("agents.commands.plan", "PlanOptions", "plan one motion of an arm, without any environment"),
    "list": Command("agents.commands.listing", "ListOptions", "environments, experts, planners, recipes, agents, arms"),
    "train": Command("agents.commands.train", "TrainOptions", "train an agent with PPO, SAC or TD3, or continue a run"),
    "curves": Command("agents.commands.curves", "CurvesOptions", "draw learning curves of training runs"),
    "paper-dpct": Command("agents.papers.dpct", "ReportOptions", "the conveyor-tracking paper's results"),
    "paper-lagrange": Command("agents.papers.lagrange", "ReportOptions", "the minimal-torque paper's results"),
    "paper-apf": Command("agents.papers.apf.command", "ReportOptions", "the potential-field paper's results"),
    "paper-excavator": Command(
        "agents.papers.excavator.command", "PaperExcavatorOptions", "the excavator paper's results"
    ),
}

OUTPUTS = ("json", "plot", "record", "csv", "report")  # options that name a file to write

DESCRIPTION = """\
Simulated planar robot arms, with classical planners and trained agents for the same tasks.

  planarm benchmark                                         the leaderboard
  planarm rollout ConveyorTrack-v0 --policy agent --render  watch one episode
  planarm list                                              what there is, by name
  planarm paths ObstacleDodge-v0 --plot paths.png           draw the paths of three experts
  planarm benchmark --policies my_module:make_policy dpct   your own policy beside a planner
  planarm COMMAND --help                                    the options of a command
  planarm --version                                         the version"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    The exit code is 0, 2 for an error of the user, 130 after Ctrl-C, and 1 where the output is not read to its end. A
    command's ``run`` raises a ValueError for anything unknown or impossible, and a ModuleNotFoundError or
    DependencyNotInstalled that names the missing extra, before its first episode or training step.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # of a terminal that has no such character
    if given == ["--version"]:
        print(f"planarm {metadata.version('planarm')}")
        return 0
    named = next((name for name in given[:1] if name in COMMANDS), None)
    try:
        return _run(named, _parse(given, named))  # the parser exits after help or an error
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # the reader of the output, such as head, has stopped
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _complain(named, error)


def _run(named: str | None, options: Any) -> int:
    """Run a command; the exit code."""
    from gymnasium.error import DependencyNotInstalled

    from agents.console import catch_interrupt, note_compiling
    from planners.files import check_output

    try:
        for name in OUTPUTS:
            check_output(getattr(options, name, None))
        with catch_interrupt(at_once=True), note_compiling():
            code: int | None = import_module(COMMANDS[str(named)].module).run(options)
        sys.stdout.flush()
    except (ValueError, ModuleNotFoundError, DependencyNotInstalled) as error:
        return _complain(named, error)
    return code or 0


def _complain(named: str | None, error: Exception) -> int:
    """Print an error of the user in one line; the exit code."""
    print(f"planarm {named}: {' '.join(str(error).split())}", file=sys.stderr)
    return 2


def _parse(arguments: list[str], named: str | None) -> Any:
    """The options of the named command; the other commands appear in the help, without being imported."""
    kinds: list[Any] = []
    for name, command in COMMANDS.items():
        if name == named:
            options = getattr(import_module(command.module), command.options)
            kinds.append(Annotated[options, tyro.conf.subcommand(name)])
        else:
            empty = make_dataclass(name.title(), [])
            kinds.append(Annotated[empty, tyro.conf.subcommand(name, description=command.summary)])
    union: Any = Union[tuple(kinds)]  # noqa: UP007
    config = (tyro.conf.OmitSubcommandPrefixes,)
    return tyro.cli(union, prog="planarm", description=DESCRIPTION, args=arguments, config=config)


if __name__ == "__main__":
    sys.exit(main())
