"""A new sealed list for the next release, and the secret of the last one published.

``python -m tools.seal --release 0.2.0 --last last.secret --new next.secret`` draws a secret and writes it to a new file
that its owner alone can read. Its SHA-256 goes to ``agents/submissions/sealed.json`` with the secret of the last list.
The file goes into the repository's secret ``PLANARM_SEALED`` and a safe place, never into the repository. Where the
last secret is lost, leave ``--last`` out: the list that it sealed is replaced, and never opened.
"""

from __future__ import annotations

import os
import secrets
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from agents.console import note
from agents.submissions import sealed
from agents.submissions.sealed import Opened, Published, commitment, find_list, published
from planners.files import write_json


@dataclass(frozen=True)
class SealOptions:
    """Seal a list for a release, and open the last one."""

    release: str
    """The version of planarm for which it is sealed."""
    new: Path
    """File for the new secret, which must not exist yet."""
    last: Path | None = None
    """File with the secret of the last list, which is published. Left out if it is lost: nothing is opened."""


def main(options: SealOptions) -> int:
    """Write the new secret and what is published; a ValueError if the last secret is not the one that was hashed."""
    lists, opened = published(), published().opened
    if options.last is not None:
        last = find_list(str(options.last))
        if last is None or last.open:
            raise ValueError(f"{options.last} is not the secret of the last list")
        opened = (Opened(release=lists.release, sha256=lists.sha256, secret=last.secret.hex()), *opened)
    if options.release in (each.release for each in opened):
        raise ValueError(f"the list of {options.release} is open: seal one for the next release")
    secret = secrets.token_bytes(32)
    with os.fdopen(os.open(options.new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(f"{secret.hex()}\n")
    now = Published(release=options.release, sha256=commitment(secret), opened=opened)
    write_json(sealed.PUBLISHED, now.model_dump(mode="json"))
    opening = "" if options.last is None else f" with the secret of {lists.release}"
    note(f"wrote {options.new}, and its hash{opening} to {sealed.PUBLISHED}")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(SealOptions)))
    except (ValueError, OSError) as error:
        sys.exit(f"seal: {error}")
