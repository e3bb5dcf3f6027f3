"""Docstrings on the pages of the API reference.

Names: one that has a place on the site becomes a link, another is shown as code.

A dotted name of planarm's own packages that cannot be imported, and a function, method or module that a role names and
that has no place on the site, stay what they are for Sphinx: a warning, which ends the build.
"""

from __future__ import annotations

import re
from importlib import import_module
from typing import Any

from docutils import nodes
from pydantic import BaseModel
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

_OWN = ("agents", "envs", "planarm", "planners", "tools")
_PLAIN = ("class", "data", "exc", "obj")
"""Roles of types in signatures, and of what stands in single backticks: names of other packages are among them."""


def setup(app: Sphinx) -> dict[str, bool]:
    """Have docstrings, and names without a place on the site, looked at."""
    app.connect("autodoc-process-docstring", _one_by_one, priority=400)  # before napoleon
    app.connect("autodoc-process-signature", _without_fields)
    app.connect("missing-reference", _as_code)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _without_fields(app: Sphinx, what: str, name: str, thing: object, *rest: object) -> tuple[str, None] | None:
    """No signature for settings: it would repeat their fields with all bounds."""
    return ("", None) if isinstance(thing, type) and issubclass(thing, BaseModel) else None


def _one_by_one(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Names that share a description, ``lengths, masses: of the links``, each get it."""
    text = re.sub(
        r"^(    )((?:\w+, )+\w+)(: .*(?:\n {5,}\S.*)*)",
        lambda match: "\n".join(f"{match[1]}{own}{match[3]}" for own in match[2].split(", ")),
        "\n".join(lines),
        flags=re.MULTILINE,
    )
    described = what in ("attribute", "data", "property")  # napoleon takes words before a colon there for a type
    lines[:] = [""] * described + text.split("\n")


def _as_code(app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: nodes.TextElement) -> nodes.Element | None:
    """The name as it stands, if it need not lead anywhere; None for Sphinx's warning."""
    if node.get("refdomain") != "py":
        return None
    name = str(node["reftarget"])
    around = [str(node[key]) for key in ("py:module", "py:class") if node.get(key)]
    places = [name, *(".".join([*around[:count], name]) for count in range(1, len(around) + 1))]
    if any(place.partition(".")[0] in _OWN and _exists(place) for place in places):
        return shown
    foreign = "." not in name or name.partition(".")[0] not in _OWN
    return shown if foreign and node["reftype"] in _PLAIN else None


def _exists(place: str) -> bool:
    """Whether a dotted name can be imported."""
    parts = place.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found: Any = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            if part in getattr(found, "__annotations__", {}) or part in getattr(found, "__dataclass_fields__", {}):
                return True
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False
