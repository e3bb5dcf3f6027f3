"""The table of docs/planners.md: what every variant of every planner takes and keeps, from its own declaration.

``python -m tools.capability_table`` writes it between the page's marks.
"""

from __future__ import annotations

import re
from pathlib import Path

from agents.commands.plan import HEADERS
from planners.capabilities import capability_rows
from planners.files import write_text

PAGE = Path(__file__).parent.parent / "docs" / "planners.md"
_MARKED = re.compile(r"(<!-- planarm plan --list -->\n).*(\n<!-- end -->)", flags=re.DOTALL)


def updated(page: str) -> str:
    """A page with the table written anew."""
    rows = [HEADERS, ("---",) * len(HEADERS), *capability_rows()]
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    return _MARKED.sub(lambda match: f"{match[1]}{table}{match[2]}", page)


def main() -> None:
    """Write the page anew."""
    write_text(PAGE, updated(PAGE.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main()
