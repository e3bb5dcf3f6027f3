"""The card of a submission: who made the agent, how, for which tasks, and the scores that are claimed."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import Field, StringConstraints

from envs.settings import Settings
from planners.documents import parse_yaml, read_document
from planners.files import write_json, write_text

FORMAT = 1
"""Version of the card."""
CARDS = ("card.yaml", "card.json")
"""Names that the file of a card may have."""

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9]([A-Za-z0-9 ._-]*[A-Za-z0-9])?$", max_length=40)]
Author = Annotated[str, StringConstraints(pattern=r"^\w[\w .,'-]*$", max_length=80)]
Licence = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9 .+()-]*$", max_length=80)]
Link = Annotated[str, StringConstraints(pattern=r"^https://[^\s<>\"'`|\[\](){}\\]+$", max_length=300)]
Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Word = Annotated[str, StringConstraints(max_length=80)]


class Claim(Settings):
    """The scores that are claimed on one task.

    Attributes:
        episodes: number of them, those of the leaderboard.
        success: number of successful ones.
        steps: control steps of all episodes.
        returns: interquartile mean of the returns.
        metric: key of the task's primary metric.
        median: its median, in SI units; null for never.
        digest: SHA-256 of every episode's seed, length, return, primary metric and success.
    """

    episodes: int = Field(ge=1)
    success: int = Field(ge=0)
    steps: int = Field(ge=1)
    returns: float
    metric: Word
    median: float | None
    digest: Digest


class Claims(Settings):
    """The claimed scores, and where they were computed.

    Attributes:
        platform: operating system, processor and versions of the libraries that round.
        tasks: the scores by the title of the task.
    """

    platform: dict[Word, Word] = Field(max_length=20)
    tasks: dict[Word, Claim] = Field(max_length=20)


class Card(Settings):
    """A card.

    Attributes:
        format: version of the card.
        name: of the agent in the tables, none of a policy or another row of the leaderboard.
        authors: who made it.
        tasks: titles of tasks of the leaderboard, all of the agent's environment.
        settings: those in which the agent acts, as in agent.json; the control mode.
        training: how it was trained, in some sentences.
        steps: control steps of training.
        seconds: time of training, s.
        licence: of the weights, as an SPDX expression.
        link: to code or paper.
        claims: the claimed scores; the action ``claim`` writes them.
    """

    format: Literal[1]
    name: Name
    authors: tuple[Author, ...] = Field(min_length=1, max_length=20)
    tasks: tuple[Word, ...] = Field(min_length=1, max_length=20)
    settings: dict[Word, Any]
    training: str = Field(min_length=1, max_length=2000)
    steps: int = Field(ge=0)
    seconds: float = Field(ge=0.0)
    licence: Licence
    link: Link | None = None
    claims: Claims | None = None


def read_card(path: Path) -> Card:
    """The card in a file.

    Raises:
        ValueError: as `planners.documents.read_document`, and for unknown, missing or impossible entries.
    """
    content = read_document(path)
    if not isinstance(content, dict):
        raise ValueError(f"{path} must hold names and values: a card")
    found = content.get("format")
    if type(found) is not int or found != FORMAT:
        raise ValueError(f"{path} has format {found!r:.40}; this version of planarm reads cards of format {FORMAT}")
    return Card.parse(content, f"{path} entry")


def write_claims(path: Path, claims: Claims) -> None:
    """Put claims into the card in a file, in place of those that it has; all else stays as it is written."""
    content, block = read_document(path), {"claims": claims.model_dump(mode="json")}
    content = {**content, **block}
    if path.suffix == ".json":
        write_json(path, content)
        return
    text = path.read_text(encoding="utf-8-sig")
    kept = re.sub(r"^claims:.*\n?(?:[ \t#].*\n?|\n)*", "", text, flags=re.MULTILINE).rstrip("\n")
    text = f"{kept}\n{yaml.safe_dump(block, sort_keys=False)}"
    try:
        fits = parse_yaml(text, str(path)) == content
    except ValueError:
        fits = False
    write_text(path, text if fits else yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
