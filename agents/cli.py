"""The `planarm` command. A subcommand's module is imported only when it is called for, so that help is quick."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, make_dataclass
from importlib import import_module, metadata
from typing import Annotated, Any, Union

import tyro


@dataclass(frozen=True)
class Command:
    """A subcommand: the module that runs it, the class of its options there, and a line of help."""

    module: str
    options: str
    summary: str

    def options_type(self) -> type[Any]:
        """The class of its options."""
        kind: type[Any] = getattr(import_module(self.module), self.options)
        return kind


COMMANDS = {
    "benchmark": Command(
        "agents.commands.benchmark", "BenchmarkOptions", "score policies on tasks, beside the known optimum"
    ),
    "evaluate": Command(
        "agents.commands.evaluate", "EvaluateOptions", "score one policy on one task, others beside it"
    ),
    "rollout": Command("agents.commands.rollout", "RolloutOptions", "show or record one episode"),
    "paths": Command("agents.commands.paths", "PathsOptions", "the ways of several policies from one start, drawn"),
    "train": Command("agents.commands.train", "TrainOptions", "train an agent with PPO, or go on with a run"),
    "curves": Command("agents.commands.curves", "CurvesOptions", "how training runs came along, a table and a picture"),
    "paper-dpct": Command("agents.papers.dpct", "ReportOptions", "the conveyor-tracking paper's results"),
    "paper-lagrange": Command("agents.papers.lagrange", "ReportOptions", "the minimal-torque paper's results"),
    "paper-apf": Command("agents.papers.apf.command", "ReportOptions", "the potential-field paper's results"),
    "paper-excavator": Command(
        "agents.papers.excavator.command", "PaperExcavatorOptions", "the excavator paper's results"
    ),
}

DESCRIPTION = """\
Planar robot arms with real physics, beside the planners that solve them.

  planarm benchmark                                         the leaderboard, in two minutes
  planarm rollout ConveyorTrack-v0 --policy agent --render  watch one episode
  planarm paths ObstacleDodge-v0 --plot paths.png           draw the ways three experts take
  planarm COMMAND --help                                    what a command can do
  planarm --version                                         the version"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code: 0, 2 for what the user must put right, 130 after Ctrl-C."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given == ["--version"]:
        print(f"planarm {metadata.version('planarm')}")
        return 0
    named = next((name for name in given[:1] if name in COMMANDS), None)
    options = _parse(given, named)  # ends the program, after help or a complaint, unless a command was named
    from gymnasium.error import DependencyNotInstalled

    try:
        code: int | None = import_module(COMMANDS[str(named)].module).run(options)
    except KeyboardInterrupt:
        return 130
    except (ValueError, OSError, ModuleNotFoundError, DependencyNotInstalled) as error:
        print(f"planarm {named}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    return code or 0


def _parse(arguments: list[str], named: str | None) -> Any:
    """The options of the named command. The other commands are there for the help only, and import nothing."""
    kinds: list[Any] = []
    for name, command in COMMANDS.items():
        if name == named:
            kinds.append(Annotated[command.options_type(), tyro.conf.subcommand(name)])
        else:
            empty = make_dataclass(name.title(), [])
            kinds.append(Annotated[empty, tyro.conf.subcommand(name, description=command.summary)])
    union: Any = Union[tuple(kinds)]  # noqa: UP007
    config = (tyro.conf.OmitSubcommandPrefixes,)
    return tyro.cli(union, prog="planarm", description=DESCRIPTION, args=arguments, config=config)


if __name__ == "__main__":
    sys.exit(main())
