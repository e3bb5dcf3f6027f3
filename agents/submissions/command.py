"""`planarm submit`: an agent of one's own for the leaderboard, as a folder of data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from agents.commands.outputs import check_outputs
from agents.console import note, say
from agents.environments import import_env
from agents.evaluation.benchmark import Benchmark
from agents.evaluation.scoreboard import Scoreboard
from agents.report.outputs import run_with_bar
from agents.submissions.card import CARDS, write_claims
from agents.submissions.check import Verdict, benchmark_of, check, require_comparable
from agents.submissions.claims import claims_of
from agents.submissions.folder import read_submission
from agents.submissions.sealed import SealedList, broken, commitment, find_list, published
from agents.submissions.writing import agent_from, write_submission
from agents.tables import Table
from agents.yaml_config import assigned
from planners.files import write_json


class Interrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM while episodes were run."""


@dataclass(frozen=True)
class ExportOptions:
    """Write an agent and a card into a folder: of a run, or of a model of Stable-Baselines3 (PPO, A2C, SAC, TD3 or
    DDPG with an "MlpPolicy") with the statistics of the VecNormalize beside it."""

    source: tyro.conf.Positional[str]
    """Path of a run, an agent or a .zip; agent for the one that comes with planarm."""
    folder: tyro.conf.Positional[Path]
    """Where the submission goes; an agent there is replaced, a card is kept."""
    env: str
    """Id of the environment that it was trained on."""
    settings: tuple[str, ...] = ()
    """key=value for each setting of the environment in which a .zip was trained."""
    allow_code: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load a .zip, and the statistics beside it, although any code in them is run."""
    name: str | None = None
    """Of the agent in the tables; that of the folder if left out."""
    authors: tuple[str, ...] = ()
    """Who made it, for the card."""
    licence: str = ""
    """Of the weights, for the card, such as CC-BY-4.0."""
    training: str = ""
    """How it was trained, for the card."""


@dataclass(frozen=True)
class ClaimOptions:
    """Score a submission on the public episodes of the leaderboard, and write the scores into its card."""

    folder: tyro.conf.Positional[Path]
    """Folder of the submission."""
    episodes: int | None = None
    """Most episodes of each task, for a trial; all of the leaderboard if left out, as submissions need it."""


@dataclass(frozen=True)
class CheckOptions:
    """Score submissions on the leaderboard's episodes, beside its policies, and refuse claims that do not come out."""

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of submissions."""
    sealed: str | None = None
    """File with the secret of the sealed list, or the release of one that is open; if left out, the environment
    variable PLANARM_SEALED holds the secret, or only the public list is scored."""
    episodes: int | None = None
    """Most episodes of each task, for a trial; all of the leaderboard if left out."""
    against: tuple[str, ...] | None = None
    """Policies to compare with; all of the leaderboard if left out."""
    json: Path | None = None
    """Write verdicts, scores and comparisons to this file."""
    format: Literal["markdown"] | None = None
    """Print Markdown on a terminal too, as for a comment on a pull request."""


@dataclass(frozen=True)
class SealedOptions:
    """Show the published hash of the sealed list, and verify the secrets of the lists that are open."""


@dataclass(frozen=True)
class SubmitOptions:
    """Submit an agent to the leaderboard: a folder with its weights, their JSON and a card, without code.

    Exit codes of check: 0 accepted, 1 refused, with the reason, 2 something that is asked for is unknown; of sealed: 1
    if a secret is not what was hashed.

    For example:

        $ planarm submit export runs/mine submissions/mine --env ConveyorTrack-v0
        $ planarm submit export model.zip submissions/mine --env ObstacleDodge-v0 \
--settings control_mode=velocity --allow-code
        $ planarm submit claim submissions/mine
        $ planarm submit check submissions/mine --json checked.json --format markdown
        $ planarm submit sealed
    """

    action: (
        Annotated[ExportOptions, tyro.conf.subcommand("export")]
        | Annotated[ClaimOptions, tyro.conf.subcommand("claim")]
        | Annotated[CheckOptions, tyro.conf.subcommand("check")]
        | Annotated[SealedOptions, tyro.conf.subcommand("sealed")]
    )


def run(options: SubmitOptions) -> int:
    """Run one of the actions; the exit code."""
    action = options.action
    check_outputs(action)
    try:
        match action:
            case ExportOptions():
                return _export(action)
            case ClaimOptions():
                return _claim(action)
            case CheckOptions():
                return _check(action)
            case SealedOptions():
                return _show_lists()
    except Interrupted as stopped:
        note("interrupted: nothing was decided", "yellow")
        return int(stopped.args[0])


def _export(options: ExportOptions) -> int:
    env_id = import_env(options.env)
    agent = agent_from(options.source, env_id, assigned({}, options.settings), allow_code=options.allow_code)
    name = options.name or options.folder.resolve().name
    write_submission(agent, options.folder, name, options.authors, options.licence, options.training)
    say(f"wrote {options.folder}: fill in its card, then run planarm submit claim {options.folder}")
    return 0


def _claim(options: ClaimOptions) -> int:
    _check_episodes(options.episodes)
    submission = read_submission(options.folder)
    claims = claims_of(_scored(benchmark_of(submission, (), options.episodes)))
    card = next(options.folder / name for name in CARDS if (options.folder / name).exists())
    write_claims(card, claims)
    for task, claim in claims.tasks.items():
        median = "never" if claim.median is None else f"{claim.median:g}"
        say(
            f"{task}: {claim.success} of {claim.episodes} successful, {claim.metric} {median}, return {claim.returns:g}"
        )
    say(f"wrote the claims into {card}")
    return 0


def _check(options: CheckOptions) -> int:
    _check_episodes(options.episodes)
    if not options.folders:
        raise ValueError("no submission: give the folder of one")
    if missing := [str(folder) for folder in options.folders if not folder.is_dir()]:
        raise ValueError(f"no folder {', '.join(missing)}")
    sealed = find_list(options.sealed)
    require_comparable(options.folders, options.against or ())
    verdicts = []
    for folder in options.folders:
        verdict = check(folder, _scored, episodes=options.episodes, against=options.against, sealed=sealed)
        verdicts.append(verdict)
        _show(verdict, sealed, options)
    if options.json is not None:
        document = {"format": 1, "submissions": [verdict.document(sealed) for verdict in verdicts]}
        write_json(options.json, document)
        note(f"wrote {options.json}")
    return 0 if all(verdict.accepted for verdict in verdicts) else 1


def _show(verdict: Verdict, sealed: SealedList | None, options: CheckOptions) -> None:
    """Print a verdict, and its tables if there are any."""
    markdown = options.format == "markdown"
    say(f"{'## ' if markdown else ''}{verdict.folder}: {'accepted' if verdict.accepted else 'refused'}")
    say(f"\n{verdict.reason}.\n")
    if options.episodes is not None:
        say(f"This is a trial: at most {options.episodes} episodes of each task.\n")
    if verdict.public is not None:
        verdict.public.show(markdown=markdown)
    if not verdict.accepted:
        return
    if verdict.sealed is None:
        say("Scored on the public list only: the secret of the sealed list is not known here.")
    elif sealed is not None:
        hashed = commitment(sealed.secret)
        say(f"{'### ' if markdown else ''}On the {'open' if sealed.open else 'sealed'} list of {sealed.release}\n")
        say(f"SHA-256 of its secret: {hashed}\n")
        verdict.sealed.show(markdown=markdown)


def _show_lists() -> int:
    lists = published()
    wrong = broken(lists)
    rows = [(lists.release, lists.sha256, "sealed")]
    rows += [(each.release, each.sha256, "broken" if each.release in wrong else "open") for each in lists.opened]
    caption = "SHA-256 of the secret of each list; open: the secret is published and has this hash."
    Table("", ("release", "SHA-256", "state"), rows, caption, text_columns=3).show()
    return 1 if wrong else 0


def _check_episodes(episodes: int | None) -> None:
    if episodes is not None and episodes < 1:
        raise ValueError(f"episodes {episodes} must be at least 1")


def _scored(benchmark: Benchmark) -> Scoreboard:
    """The results of a benchmark that is run with a progress bar."""
    if code := run_with_bar(benchmark, lambda result: None, record=False):
        raise Interrupted(code)
    return benchmark.board
