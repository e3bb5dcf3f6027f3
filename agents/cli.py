"""The `planarm` command. The module of a subcommand is imported only when that is run, so that help is quick."""

from __future__ import annotations

import io
import os
import re
import shutil
import signal
import sys
import textwrap
from collections.abc import Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import make_dataclass
from importlib import import_module, metadata
from itertools import pairwise
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
    "dataset": Command("agents.datasets.command", "DatasetOptions", "record episodes as a Minari dataset"),
    "warmup": Command("agents.commands.warmup", "WarmupOptions", "compile ahead of the first run, on two processors"),
    "train": Command("agents.commands.train", "TrainOptions", "train an agent with PPO, SAC or TD3, or continue a run"),
    "sweep": Command("agents.sweeps.command", "SweepOptions", "train with many settings, side by side on Ray"),
    "curves": Command("agents.commands.curves", "CurvesOptions", "draw learning curves of training runs"),
    "submit": Command("agents.submissions.command", "SubmitOptions", "an agent of your own for the leaderboard"),
    "paper-dpct": Command("agents.papers.dpct.command", "ReportOptions", "the conveyor-tracking paper's results"),
    "paper-lagrange": Command("agents.papers.lagrange.command", "ReportOptions", "the minimal-torque paper's results"),
    "paper-apf": Command("agents.papers.apf.command", "ReportOptions", "the potential-field paper's results"),
    "paper-excavator": Command(
        "agents.papers.excavator.command", "PaperExcavatorOptions", "the excavator paper's results"
    ),
}

REPEATED = ("--obstacle",)
"""Options of which each is one more."""

DESCRIPTION = """\
Simulated planar robot arms, with classical planners and trained agents for the same tasks.

  planarm benchmark                                  the leaderboard
  planarm rollout ConveyorTrack-v0 --policy agent --render
                                                     watch one episode
  planarm list                                       what there is, by name
  planarm paths ObstacleDodge-v0 --plot paths.png    draw paths of three experts
  planarm benchmark --policies my_module:make_policy dpct
                                                     your own and a planner
  planarm COMMAND --help                             options of a command
  planarm --version                                  the version

Exit codes: 0 done; 1 an output could not be written or printed whole, there is nothing to show, or a submission is \
refused; 2 something given is unknown or impossible; 130 ended by Ctrl-C, 143 by SIGTERM."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; its exit code, as `DESCRIPTION` says.

    A command's ``run`` raises a ValueError for anything unknown or impossible, and a ModuleNotFoundError or
    DependencyNotInstalled that names the missing extra, before its first episode or training step.
    """
    if arguments is None and signal.getsignal(signal.SIGINT) is signal.SIG_DFL:  # while the package was imported
        signal.signal(signal.SIGINT, signal.default_int_handler)
    code = _answer(list(sys.argv[1:] if arguments is None else arguments))
    if arguments is None and code > 128:  # interrupted: without the second that torch takes to tidy up
        with suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        if (cache := sys.modules.get("planners.compile_cache")) is not None:  # unless it was just being imported
            cache.delete_temporary()
        os._exit(code)
    return code


def _answer(given: list[str]) -> int:
    """Run a command line; its exit code."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the shell
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # of a terminal that has no such character
    named = next((name for name in given[:1] if name in COMMANDS), None)
    if repeated := _repeated(given):
        return _complain(named, f"{repeated} is given twice: give it once, with all of its values behind it", 2)
    try:
        if given == ["--version"]:
            print(f"planarm {metadata.version('planarm')}")
            code = 0
        else:
            code = _run(named, _parse(given, named))  # the parser exits after help or an error
        sys.stdout.flush()
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # the reader of the output, such as head, has stopped
        _print_no_more()
        return 1
    except ImportError as error:
        return _complain(named, error, 2)
    except OSError as error:
        if error.errno is None or error.filename is not None:
            return _complain(named, f"{error.filename}: {error.strerror}" if error.strerror else error, 1)
        try:
            print(flush=True)  # fails again where it has failed
        except OSError:
            _print_no_more()
            return _complain(named, f"cannot print: {error.strerror}", 1)
        return _complain(named, error.strerror, 1)
    return code


def _run(named: str | None, options: Any) -> int:
    """Run a command; the exit code."""
    from gymnasium.error import DependencyNotInstalled

    from agents.commands.outputs import check_outputs
    from agents.console import catch_interrupt, exit_code_of, note, note_compiling

    try:
        check_outputs(options)
        with catch_interrupt(at_once=True), note_compiling():
            code: int | None = import_module(COMMANDS[str(named)].module).run(options)
    except KeyboardInterrupt as interrupt:
        note("interrupted: nothing was finished", "yellow")
        return exit_code_of(interrupt)
    except (ValueError, ImportError, DependencyNotInstalled) as error:
        return _complain(named, error, 2)
    except MemoryError as error:
        return _complain(named, f"not enough memory: {error}", 1)
    except NotImplementedError:
        if not getattr(import_module("numba").config, "DISABLE_JIT", False):
            raise
        return _complain(named, "this runs compiled code only; unset NUMBA_DISABLE_JIT", 2)
    return code or 0


def _complain(named: str | None, error: object, code: int) -> int:
    """Print an error in one line; the exit code."""
    with suppress(OSError):
        print(f"planarm{f' {named}' if named else ''}: {' '.join(str(error).split())}", file=sys.stderr)
    return code


def _print_no_more() -> None:
    """Leave out what is still to be printed, where stdout takes no more."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


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
    arguments = _changes_together(arguments) if named == "train" else arguments
    printed = io.StringIO()
    try:
        with redirect_stdout(printed):
            return tyro.cli(union, prog="planarm", description=DESCRIPTION, args=arguments, config=config)
    finally:
        sys.stdout.write(_wrapped(printed.getvalue()))


def _repeated(arguments: list[str]) -> str | None:
    """An option with values that is given twice, if there is one: the last one alone would count."""
    given = [
        word.partition("=")[0].replace("_", "-")
        for word, following in pairwise([*arguments, "--"])
        if word.startswith("--") and ("=" in word or not following.startswith("--"))
    ]
    return next((option for option in given if given.count(option) > 1 and option not in REPEATED), None)


def _changes_together(arguments: list[str]) -> list[str]:
    """Arguments with every key=value in front of the options, where alone they are understood."""
    changes = [
        word
        for before, word in pairwise(arguments)
        if re.match(r"[A-Za-z_][\w.]*=", word) and not before.startswith("--")
    ]
    place = next((place for place, word in enumerate(arguments) if word.startswith("--")), len(arguments))
    first, others = ([word for word in part if word not in changes] for part in (arguments[:place], arguments[place:]))
    return [*first, *changes, *others] if len(first) > 1 else arguments  # the configuration comes before them


def _wrapped(text: str) -> str:
    """Help with no line longer than the terminal is wide; an example goes on behind a backslash."""
    width = shutil.get_terminal_size().columns
    lines = []
    for line in re.sub(r"\n{3,}", "\n\n", text).splitlines():
        indent = line[: len(line) - len(line.lstrip())]
        example = line.startswith(f"{indent}$ ")
        wrapped = textwrap.wrap(
            line.replace(",", ", ") if line.startswith("usage: planarm [-h] {") else line,
            width - 2 * example,
            subsequent_indent=f"{indent}    " if example or line.startswith("usage") else indent,
            break_long_words=False,
            break_on_hyphens=False,
        )
        lines.append((" \\\n" if example else "\n").join(wrapped) if len(line) > width else line)
    return "".join(f"{line}\n" for line in lines)


if __name__ == "__main__":
    sys.exit(main())
