"""The sealed list: seeds that nobody knows before a release, and a hash published beforehand that commits to them.

A secret of 32 random bytes makes the seeds of every task; the repository holds its SHA-256 (`PUBLISHED`). With the next
release the secret is published too, so that everybody can verify it and score the same episodes again.
"""

from __future__ import annotations

import hashlib
import hmac
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from agents.submissions.card import Digest, Word
from envs.settings import Settings
from planners.documents import read_document

PUBLISHED = Path(__file__).with_name("sealed.json")
"""The hash of the secret of the sealed list, and the secrets of those that are open."""
VARIABLE = "PLANARM_SEALED"
"""Environment variable that may hold the secret."""


class Opened(Settings):
    """A list that is open.

    Attributes:
        release: the version of planarm for which it was sealed.
        sha256: the hash that was published then.
        secret: what it is the hash of, 64 hexadecimal digits.
    """

    release: Word
    sha256: Digest
    secret: Digest


class Published(Settings):
    """What is published of the lists.

    Attributes:
        release: the version of planarm for which the list is sealed.
        sha256: the hash of its secret.
        opened: earlier lists, the last first.
    """

    release: Word
    sha256: Digest
    opened: tuple[Opened, ...] = Field((), max_length=1000)


@dataclass(frozen=True)
class SealedList:
    """A list whose secret is known here.

    Attributes:
        release: the version of planarm for which it was sealed.
        secret: 32 bytes.
        open: whether everybody knows it.
    """

    release: str
    secret: bytes
    open: bool = False

    def seeds(self, task: str, episodes: int) -> NDArray[np.int64]:
        """The seeds of a task by its title, ``(episodes,)``, below 2**61; more episodes only append to them."""
        texts = (f"planarm sealed list\n{task}\n{number}" for number in range(episodes))
        codes = (hmac.digest(self.secret, text.encode(), "sha256") for text in texts)
        return np.array([int.from_bytes(code[:8], "big") >> 3 for code in codes], dtype=np.int64)


def published() -> Published:
    """What is published of the lists."""
    return Published.parse(read_document(PUBLISHED), f"{PUBLISHED} entry")


def commitment(secret: bytes) -> str:
    """The hash that is published of a secret."""
    return hashlib.sha256(secret).hexdigest()


def broken(lists: Published) -> list[str]:
    """Releases whose published secret is not what was hashed."""
    return [each.release for each in lists.opened if commitment(bytes.fromhex(each.secret)) != each.sha256]


def find_list(source: str | None) -> SealedList | None:
    """A list by the file of its secret, or the release of one that is open; by default that of `VARIABLE`, or None.

    Raises:
        ValueError: if there is no such list, or a secret is not the one whose hash is published.
    """
    lists = published()
    for each in lists.opened:
        if each.release == source:
            if each.release in broken(lists):
                raise ValueError(f"the secret of the list of {source} is not what was hashed: do not rely on it")
            return SealedList(each.release, bytes.fromhex(each.secret), open=True)
    where, text = (VARIABLE, os.environ.get(VARIABLE, "")) if source is None else (source, _read(Path(source)))
    if not text and source is None:
        return None
    try:
        secret = bytes.fromhex(text.strip())
    except ValueError:
        secret = b""
    if len(secret) != 32:
        raise ValueError(f"{where} holds no secret of a sealed list: 64 hexadecimal digits")
    if commitment(secret) != lists.sha256:
        raise ValueError(f"the secret in {where} is not that of the list sealed for {lists.release}: its hash differs")
    return SealedList(lists.release, secret)


def _read(path: Path) -> str:
    """The text of a file; a ValueError if it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(200).decode("ascii", errors="replace")
    except OSError as error:
        names = ", ".join(each.release for each in published().opened) or "none"
        raise ValueError(
            f"cannot read {path}: {error.strerror}; give the file of the secret, or the release of an open list "
            f"({names})"
        ) from None
