"""Tables of figures get the class ``figures``: their cells are short and stay on one line; numbers are on the right."""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx

LONGEST = 45
"""Characters of a cell in a table of figures."""
_NUMBER = re.compile(r"[-+<]?\.?\d|[-+]inf|never$")


def setup(app: Sphinx) -> dict[str, bool]:
    """Have the tables of every page looked at."""
    app.connect("doctree-read", _mark)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _mark(app: Sphinx, page: nodes.document) -> None:
    for table in page.findall(nodes.table):
        columns = next(iter(table.findall(nodes.tgroup))).get("cols", 0)
        if columns >= 5 and all(len(cell.astext()) <= LONGEST for cell in table.findall(nodes.entry)):
            table["classes"].append("figures")
            for cell in table.findall(nodes.entry):
                if _NUMBER.match(cell.astext()):
                    cell["classes"].append("number")
