"""Changes to documents, texts and bytes, drawn from a `random.Random`, which Hypothesis can shrink."""

from __future__ import annotations

import copy
import math
from random import Random
from typing import Any

import yaml

CANARY = "fuzz_canary"
"""Name of a module that nothing may import."""

HUGE, DEEP = 2**64, 40

STRANGE: tuple[Any, ...] = (
    *(None, True, -1, 0, 1, 2**31, HUGE, -HUGE, 10**30, 0.0, -0.0, 1e308, -1e308, 1e-308, math.nan, math.inf),
    *("", " ", "x" * 3000, "\x00", "\x1b[31m", "é\u202e", "[bold]", "../../etc/passwd", "1e400", ".nan"),
    *(-math.inf, f"{CANARY}:Task", {"task_type": f"{CANARY}:Task"}, {"": 0}),
    *([], {}, [[]], [None], ["x"], [1e308] * 40, list(range(2000))),
)
"""Values of wrong kinds and sizes."""

STRANGE_KEYS = ("task_type", "id", "render_mode", "num_envs", "", "__class__", "arm", "x" * 300, "entry_point")

SNIPPETS = (
    *("&a ", "*a", "!!python/object/apply:os.system ['true']", f"!!python/name:{CANARY}.x ", "!!binary x", "<<: *a"),
    *("a: &a [*a, *a]\n", "\t", "\x00", "? ", "- " * 30, "[" * 60, "{" * 60, "%YAML 9.9\n", "---\n", "...\n"),
    *("1:" * 500 + "1", "9" * 5000, "2026-01-01", "2026-99-99", "~", '"', "'", "|\n", ">\n", "# ", "\ufeff"),
    *("0x" + "f" * 900, "\u2028", "NaN", "Infinity", "1e400", "\\ud800", "/*", "é", "=cmd", "\r"),
)
"""Pieces of YAML, JSON and CSV that parsers stumble over."""


def changed(document: Any, random: Random) -> Any:
    """A copy of a document with one to four values, keys or structures changed."""
    root = {"": copy.deepcopy(document)}
    for _ in range(random.randint(1, 4)):
        places = _places(root)
        container, key = places[random.randrange(len(places))]
        value = container[key]
        kind = random.randrange(7)
        if kind == 0 and len(container) > 1:
            del container[key]
        elif kind == 1:
            for _ in range(DEEP):
                value = [value] if random.random() < 0.5 else {"a": value}
            container[key] = value
        elif kind == 2 and isinstance(value, dict):
            value[random.choice(STRANGE_KEYS)] = random.choice(STRANGE)
        elif kind == 3 and isinstance(value, list):
            container[key] = value * random.choice((2, 3, 50)) or [0]
        elif kind == 4:
            other, name = places[random.randrange(len(places))]
            container[key] = copy.deepcopy(other[name])
        elif kind == 5 and isinstance(value, (int, float)):
            container[key] = value * random.choice((-1, 1e-12, 1e6, 1e300, 0))
        else:
            container[key] = copy.deepcopy(random.choice(STRANGE))
    return root.get("")


def _places(root: Any) -> list[tuple[Any, Any]]:
    """Every container of a document with every key or index in it."""
    found, pending = [], [root]
    while pending:
        container = pending.pop()
        keys = list(container) if isinstance(container, dict) else range(len(container))
        found += [(container, key) for key in keys]
        pending += [container[key] for key in keys if isinstance(container[key], (dict, list)) and container[key]]
    return found


def changed_text(text: str, random: Random) -> str:
    """A text with up to three pieces inserted, removed or repeated."""
    for _ in range(random.randint(1, 3)):
        first = random.randint(0, len(text))
        last = random.randint(first, min(len(text), first + 40))
        piece = random.choice((random.choice(SNIPPETS), "", text[first:last] * 3))
        text = text[:first] + piece + text[random.choice((first, last)) :]
    return text


def changed_bytes(content: bytes, random: Random) -> bytes:
    """Bytes with some flipped, cut, repeated, or in another encoding."""
    for _ in range(random.randint(1, 4)):
        first = random.randint(0, len(content))
        last = random.randint(first, min(len(content), first + random.choice((1, 8, 200, len(content)))))
        inside = content[first:last]
        kind = random.randrange(5)
        if kind == 0:
            inside = bytes(random.randrange(256) for _ in range(min(len(inside), 8))) + inside[8:]
        elif kind == 1:
            inside = b""
        elif kind == 2:
            inside = inside * 2
        elif kind == 3:
            inside = random.choice((b"\x00", b"\xff")) * len(inside)
        else:
            inside = random.choice(SNIPPETS).encode(errors="replace") + inside
        content = content[:first] + inside + content[last:]
    if random.random() < 0.05:
        content = content.decode(errors="replace").encode(random.choice(("utf-16", "utf-32", "utf-8-sig")))
    return content


def yaml_bytes(document: Any, random: Random) -> bytes:
    """A document as YAML, changed as a document, as a text, or as bytes."""
    kind = random.randrange(4)
    text = yaml.safe_dump(changed(document, random) if kind < 2 else document, sort_keys=False, allow_unicode=True)
    if kind in (1, 2):
        text = changed_text(text, random)
    content = text.encode(errors="replace")
    return changed_bytes(content, random) if kind == 3 else content
