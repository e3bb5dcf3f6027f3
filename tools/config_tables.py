"""The tables of docs/configs.md, from the settings' own types, defaults, bounds and docstrings.

``python -m tools.config_tables`` writes them between the page's marks, ``<!-- settings of NAME -->`` and
``<!-- end of NAME -->``. What is written there is what validates the files, so the page cannot say otherwise.
"""

from __future__ import annotations

import json
import re
from importlib import import_module
from inspect import cleandoc
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import gymnasium as gym
from pydantic.fields import FieldInfo

from agents.evaluation.evaluate import known_env_ids
from agents.files import write_text
from agents.training.recipe import Amortisation, TrainingConfig, WarmStart
from agents.yaml_config import BenchmarkConfig, BenchmarkTask, Published
from envs.settings import Settings

PAGE = Path(__file__).parent.parent / "docs" / "configs.md"
_MARKED = re.compile(r"^(<!-- settings of (\S+) -->)$.*?^(<!-- end of \2 -->)$", flags=re.MULTILINE | re.DOTALL)
_UNIT = re.compile(r"(?:^|, )((?:k?g|m|s|rad|N)(?: m)?(?:/s(?:\^[23])?)?)$")
"""A unit at the end of what an attribute's description says first, as in "time of one step, s; ..."."""
_BOUNDS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
_WORDS = {int: "integer", float: "number", str: "text", bool: "true or false", type(None): "null", Any: "value"}


def documented() -> dict[str, type[Settings]]:
    """What has a table, by its name: benchmarks, training, and of every environment its settings and its options."""
    kinds = (BenchmarkConfig, BenchmarkTask, Published, TrainingConfig, WarmStart, Amortisation)
    found: dict[str, type[Settings]] = {kind.__name__: kind for kind in kinds}
    for env_id in known_env_ids():
        module, _, name = str(gym.spec(env_id).entry_point).removesuffix("Env").partition(":")
        found[env_id] = getattr(import_module(module), f"{name}Config")
        found[f"{env_id}/options"] = getattr(import_module(module), f"{name}Options")
    return found


def updated(page: str) -> str:
    """A page with every table written anew.

    Raises:
        ValueError: if it lacks the marks of some settings, or has marks of others.
    """
    kinds, found = documented(), [match[2] for match in _MARKED.finditer(page)]
    if sorted(found) != sorted(kinds):
        raise ValueError(f"the page has marks for {sorted(found)}; it needs a pair each for {sorted(kinds)}")
    return _MARKED.sub(lambda match: f"{match[1]}\n{table(kinds[match[2]])}\n{match[3]}", page)


def table(kind: type[Settings]) -> str:
    """The settings as a table of Markdown.

    Raises:
        ValueError: for a setting that no docstring describes.
    """
    meanings = descriptions(kind)
    missing = sorted(set(kind.model_fields) - set(meanings))
    if missing:
        raise ValueError(f"the docstring of {kind.__name__} does not describe {', '.join(missing)}")
    rows = [(f"`{name}`", *_cells(name, field, meanings[name])) for name, field in kind.model_fields.items()]
    lines = [("key", "values", "default", "unit", "meaning"), ("---",) * 5, *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def descriptions(kind: type[Settings]) -> dict[str, str]:
    """What the docstrings of a class and of those it builds on say of each attribute."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if issubclass(base, Settings):
            _, _, attributes = cleandoc(base.__doc__ or "").partition("Attributes:\n")
            for names, meaning in re.findall(r"^    (\w[\w, ]*): (.*(?:\n     +.*)*)", attributes, flags=re.MULTILINE):
                found |= {name: " ".join(meaning.split()) for name in names.split(", ")}
    return found


def _cells(name: str, field: FieldInfo, meaning: str) -> tuple[str, str, str, str]:
    """Values, default, unit and meaning of a setting."""
    first, *rest = meaning.removesuffix(".").replace("``", "`").split("; ")
    unit = _UNIT.search(first)
    if unit is not None:
        first = first[: unit.start()]
    explained = "; ".join((first or name.replace("_", " "), *rest))
    return _values(field), _default(field), unit[1] if unit else "", explained


def _values(field: FieldInfo) -> str:
    """The type in words, and the bounds there are."""
    bounds = [
        f"{sign} {getattr(item, bound):g}"
        for item in field.metadata
        for bound, sign in _BOUNDS.items()
        if hasattr(item, bound)
    ]
    return ", ".join([_words(field.annotation), *bounds])


def _words(kind: Any) -> str:
    """A type as who writes YAML calls it."""
    inner = get_args(kind)
    if get_origin(kind) is Annotated:
        return _words(inner[0])
    if get_origin(kind) is Literal:
        return ", ".join(f"`{value}`" for value in inner)
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(_words(item) for item in inner)
    if get_origin(kind) is tuple:
        return f"[{_words(inner[0])}, ...]" if Ellipsis in inner else f"[{', '.join(map(_words, inner))}]"
    if get_origin(kind) is dict:
        return f"{{name: {_words(inner[1])}}}"
    if isinstance(kind, type) and issubclass(kind, Settings):
        return kind.__name__
    return _WORDS[kind]


def _default(field: FieldInfo) -> str:
    """As YAML, but that no text is quoted."""
    if field.is_required():
        return "required"
    value: Any = field.get_default(call_default_factory=True)
    return f"`{value}`" if value and isinstance(value, str) else f"`{json.dumps(value)}`"


def main() -> None:
    """Write the page anew."""
    write_text(PAGE, updated(PAGE.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main()
