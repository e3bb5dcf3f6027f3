"""Validated settings: frozen, typed, and quick to say which name was mistyped."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError


class Settings(BaseModel):
    """Base of every set of settings: the configuration of an environment, its reset options, an experiment's YAML."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def parse(cls, given: Mapping[str, Any], what: str) -> Self:
        """Settings from a mapping.

        Args:
            given: names and values.
            what: what they are, for messages ("ConveyorTrack-v0 option").

        Raises:
            ValueError: naming each unknown name with the nearest known one, or each bad value with what is allowed.
        """
        refuse_unknown(given, cls.model_fields, what)
        try:
            return cls.model_validate(dict(given))
        except ValidationError as error:
            complaints = (
                f"{'.'.join(map(str, item['loc']))} = {item['input']!r}: {item['msg']}" for item in error.errors()
            )
            raise ValueError(f"{what}: " + "; ".join(complaints)) from None


def refuse_unknown(given: Iterable[str], known: Iterable[str], what: str) -> None:
    """Raise a ValueError if a given name is not known, with the nearest known name."""
    names = sorted(known)
    for name in given:
        if name not in names:
            near = difflib.get_close_matches(str(name), names, n=1, cutoff=0.5)
            hint = f'; did you mean "{near[0]}"?' if near else ""
            raise ValueError(f'unknown {what} "{name}"{hint} (known: {", ".join(names) or "none"})')
