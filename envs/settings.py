"""Validated settings: frozen, typed, documented once, with the nearest known name in the message for an unknown one."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from inspect import cleandoc
from types import UnionType
from typing import Annotated, Any, Literal, Self, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic.fields import FieldInfo

from planners.checks import UnknownName as UnknownName
from planners.checks import brief
from planners.checks import refuse_unknown as refuse_unknown

_UNIT = re.compile(r"(?:^|, )((?:k?g|m|s|rad|N)(?: m)?(?:/s(?:\^[23])?)?)$")
"""A unit at the end of the first clause of a description, as in "time of one step, s; ..."."""
_BOUNDS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
_WORDS = {int: "integer", float: "number", str: "text", bool: "true or false", type(None): "null", Any: "value"}


class Settings(BaseModel):
    """Base of every set of settings: the configuration of an environment, its reset options, an experiment's YAML.

    The ``Attributes`` section of a class's docstring describes its fields; `table` and `descriptions` read it.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown(cls, given: Any) -> Any:
        """Unknown names with the nearest known one, in nested settings too."""
        if isinstance(given, Mapping):
            refuse_unknown(given, cls.model_fields, "setting")
            for name, value in given.items():
                kinds = {*_kinds(cls.model_fields[name].annotation)}
                for one in _leaves(value):
                    if isinstance(one, bool | str) and {int, float} & kinds and not {type(one), Literal, Any} & kinds:
                        raise ValueError(f"{name} = {brief(value)}: {brief(one)} must be a number")
        return given

    @classmethod
    def parse(cls, given: Mapping[str, Any], what: str) -> Self:
        """Settings from a mapping.

        Args:
            given: names and values.
            what: what they are, for messages ("ConveyorTrack-v0 option").

        Raises:
            UnknownName: for an unknown name (a ValueError and a TypeError), with the nearest known one.
            ValueError: naming each bad value with what is allowed.
        """
        refuse_unknown(given, cls.model_fields, what)
        try:
            return cls.model_validate(dict(given))
        except ValidationError as error:
            raise ValueError(f"{what}: {_complaints(list(_causes(error.errors())))}") from None

    def numbers(self) -> dict[str, Any]:
        """The fields that are numbers or bools, by name: what compiled code can read."""
        kinds = {name: field.annotation for name, field in type(self).model_fields.items()}
        return {name: getattr(self, name) for name, kind in kinds.items() if kind in (float, int, bool)}

    @classmethod
    def descriptions(cls) -> dict[str, str]:
        """Description of each field, from the docstrings of this class and of its bases."""
        found: dict[str, str] = {}
        for base in reversed(cls.__mro__):
            if issubclass(base, Settings):
                _, _, attributes = cleandoc(base.__doc__ or "").partition("Attributes:\n")
                for names, text in re.findall(r"^    (\w[\w, ]*): (.*(?:\n     +.*)*)", attributes, flags=re.MULTILINE):
                    found |= {name: " ".join(text.split()) for name in names.split(", ")}
        return found

    @classmethod
    def table(cls) -> str:
        """The fields as a Markdown table.

        Raises:
            ValueError: for a field that no docstring describes.
        """
        meanings = cls.descriptions()
        missing = sorted(set(cls.model_fields) - set(meanings))
        if missing:
            raise ValueError(f"the docstring of {cls.__name__} does not describe {', '.join(missing)}")
        rows = [(f"`{name}`", *_cells(name, field, meanings[name])) for name, field in cls.model_fields.items()]
        lines = [("key", "values", "default", "unit", "meaning"), ("---",) * 5, *rows]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _kinds(annotation: Any) -> Iterator[Any]:
    """The types that an annotation is made of; `Literal` stands for each of its kind."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        yield Literal
    elif origin is Annotated:
        yield from _kinds(parts[0])
    elif parts:
        for part in parts:
            yield from _kinds(part)
    else:
        yield annotation


def _leaves(value: Any) -> Iterator[Any]:
    """A value, or those in a list or tuple of them."""
    for one in value if isinstance(value, list | tuple) else [value]:
        yield from _leaves(one) if isinstance(one, list | tuple) else [one]


def _causes(errors: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Errors without those that only follow from others: a tuple whose items are refused counts as too short."""
    places = [tuple(error["loc"]) for error in errors]
    for error, place in zip(errors, places, strict=True):
        inside = any(other[: len(place)] == place and other != place for other in places)
        if not (inside and error["type"] == "too_short"):
            yield error


def _complaints(errors: Sequence[Mapping[str, Any]], most: int = 5) -> str:
    """Errors of pydantic in words, the first of many."""
    more = f"; and {len(errors) - most} more" if len(errors) > most else ""
    return "; ".join(map(_complaint, errors[:most])) + more


def _complaint(error: Mapping[str, Any]) -> str:
    """An error of pydantic in words; a nested unknown name needs no value."""
    place = ".".join(map(str, error["loc"]))
    if error["type"] == "value_error" and isinstance(error["input"], Mapping):
        return f"{place:.120}: {error['ctx']['error']}" if place else str(error["ctx"]["error"])
    message = str(error["ctx"]["error"]) if error["type"] == "value_error" else error["msg"]
    if error["type"] == "tuple_type":
        message = f"give a list, such as [{brief(error['input'])}]"
    return f"{place:.120} = {brief(error['input'])}: {message:.300}"


def _cells(name: str, field: FieldInfo, meaning: str) -> tuple[str, str, str, str]:
    """Values, default, unit and meaning of a field."""
    first, *rest = meaning.removesuffix(".").replace("``", "`").split("; ")
    unit = _UNIT.search(first)
    if unit is not None:
        first = first[: unit.start()]
    explained = "; ".join((first or name.replace("_", " "), *rest))
    return _values(field), _default(field), unit[1] if unit else "", explained


def _values(field: FieldInfo) -> str:
    """The type in words, and its bounds if there are any."""
    bounds = [
        f"{sign} {getattr(item, bound):g}"
        for item in field.metadata
        for bound, sign in _BOUNDS.items()
        if hasattr(item, bound)
    ]
    return ", ".join([_words(field.annotation), *bounds])


def _words(kind: Any) -> str:
    """A type in the words of YAML."""
    inner = get_args(kind)
    if get_origin(kind) is Annotated:  # also InstanceOf
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
    return _WORDS.get(kind) or str(kind.__name__).lower()


def _default(field: FieldInfo) -> str:
    """The default as YAML, but with text unquoted."""
    if field.is_required():
        return "required"
    value: Any = field.get_default(call_default_factory=True)
    return f"`{value}`" if value and isinstance(value, str) else f"`{json.dumps(value)}`"
