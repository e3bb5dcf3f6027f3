"""Configurations in YAML: shipped ones by name or files by path, validated; ``key=value`` changes to them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from envs.settings import Settings, UnknownName, refuse_unknown
from planners.checks import brief
from planners.documents import parse_yaml, read_document

SettingsType = TypeVar("SettingsType", bound=Settings)
SHIPPED = Path(__file__).parent.parent / "configs"  # folder of the configurations that come with planarm
_SUFFIX = ".yaml"


def load_config(source: str, settings: type[SettingsType]) -> SettingsType:
    """Settings from YAML.

    Args:
        source: a path that ends in .yaml or .yml, or the name of a shipped configuration.
        settings: what the file must hold.

    Raises:
        ValueError: if there is no such file, it is no YAML, or a name or value in it is not known.
    """
    content = read_document(_find(source))
    if not isinstance(content, dict):
        raise ValueError(f"{source} must hold names and values, not {brief(content)}")
    try:
        return settings.parse(content, f"{source} setting")
    except UnknownName as error:
        raise type(error)(str(error) if source in str(error) else f"{source}: {error}") from None


def shipped_configs() -> list[str]:
    """Names of the configurations that come with planarm, those in folders as ``ppo/ConveyorTrack-v0``; no arms."""
    files = (file for file in SHIPPED.rglob(f"*{_SUFFIX}") if file.parent.name != "arms")
    return sorted(file.relative_to(SHIPPED).as_posix().removesuffix(_SUFFIX) for file in files)


def assigned(settings: Mapping[str, Any], changes: Iterable[str]) -> dict[str, Any]:
    """Settings with some changed.

    Args:
        settings: by name.
        changes: ``key=value``; dots lead into nested settings, values are YAML.

    Raises:
        ValueError: for a change that is not of this form, or a key that is given twice.
    """
    answer, changes = dict(settings), list(changes)
    refuse_twice((change.partition("=")[0] for change in changes if "=" in change), "the name")
    for change in changes:
        key, equals, text = change.partition("=")
        if not equals or not key:
            raise ValueError(f'"{change:.80}" is no key=value, such as gamma=0.99 or warm_start.episodes=512')
        try:
            value = text if text in ("+", "-") else parse_yaml(text, change)  # of an elbow; no empty list
        except ValueError:
            raise ValueError(f'"{key:.80}={text:.80}": {brief(text)} is no YAML value') from None
        _assign(answer, key.split("."), value)
    return answer


def refuse_twice(names: Iterable[str], what: str) -> None:
    """Raise a ValueError for a name that is given twice; ``what`` it is a name of, for the message."""
    for name, count in Counter(names).items():
        if count > 1:
            raise ValueError(f'{what} "{name}" is given {count} times: give it once')


def _assign(settings: dict[str, Any], path: list[str], value: Any) -> None:
    """Set a nested value; missing levels are made, and refused later if they are not known."""
    for name in path[:-1]:
        inner = settings.get(name)
        settings[name] = dict(inner) if isinstance(inner, Mapping) else {}
        settings = settings[name]
    settings[path[-1]] = value


def _find(source: str) -> Path:
    if source.endswith((_SUFFIX, ".yml")):
        return Path(source)
    refuse_unknown([source], shipped_configs(), "configuration (a file's name ends in .yaml)")
    return SHIPPED / f"{source}{_SUFFIX}"
