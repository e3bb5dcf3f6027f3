"""The script and the style of the report, put together from the modules and style sheets of planarm's pages."""

from __future__ import annotations

import re
from importlib.resources import files

from envs.rendering.document import palette_document

MODULES = (
    ("agents.pages", "scene.js"),
    ("agents.report", "replay.js"),
    ("agents.report", "player.js"),
    ("agents.report", "exports.js"),
    ("agents.report", "episodes.js"),
    ("agents.report", "report.js"),
)
"""Modules of the script, each after those that it imports."""
_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([\w.]+)";\n', flags=re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:class|function|const) (\w+))", flags=re.MULTILINE)


def script() -> str:
    """All modules as one, in which each has a scope of its own."""
    return bundled([(name, _text(package, name)) for package, name in MODULES])


def style() -> str:
    """The colours of the frames as variables, for light and for dark pages, and the style sheet."""
    light, dark = (
        "".join(f"--{name}:{color};" for name, color in palette_document()[ground].items())
        for ground in ("light", "dark")
    )
    colors = f":root{{{light}}}\n@media (prefers-color-scheme: dark){{:root{{{dark}}}}}\n"
    return colors + _text("agents.report", "report.css")


def bundled(modules: list[tuple[str, str]]) -> str:
    """Modules, given by name and text, as one; a ValueError for an import that is not of an earlier one."""
    parts = ["const modules = {};\n"]
    known: set[str] = set()
    for name, text in modules:
        for imported in _IMPORT.findall(text):
            if imported[1] not in known:
                raise ValueError(f"{name} imports {imported[1]}, which is not before it")
        exported = ", ".join(found[1] for found in _EXPORT.findall(text))
        body = _EXPORT.sub(r"\1", _IMPORT.sub(r'const {\1} = modules["\2"];\n', text))
        if re.search(r"^(?:import|export)\b", body, flags=re.MULTILINE):
            raise ValueError(f"{name} has an import or export of another form than import {{...}} and export class")
        parts.append(f'modules["{name}"] = (() => {{\n{body}\nreturn {{ {exported} }};\n}})();\n')
        known.add(name)
    return "".join(parts)


def _text(package: str, name: str) -> str:
    return files(package).joinpath(name).read_text(encoding="utf-8")
