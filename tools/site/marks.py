"""What a tool writes to a page, between the marks ``<!-- NAME -->`` and ``<!-- end of NAME -->``."""

from __future__ import annotations


def marked(text: str, name: str) -> str:
    """What stands between the marks of a name; a ValueError if the text lacks them, or has them twice."""
    return _parted(text, name)[1]


def replaced(text: str, name: str, lines: str) -> str:
    """A text with other lines between the marks of a name; a ValueError if it lacks them, or has them twice."""
    before, _, after = _parted(text, name)
    return f"{before}{lines.strip()}\n{after}"


def _parted(text: str, name: str) -> tuple[str, str, str]:
    """A text before, between and after marks, with the marks."""
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    if text.count(begin) != 1 or text.count(end) != 1:
        raise ValueError(f"the page lacks the marks {begin.strip()} and {end}, each on a line of its own, once")
    before, _, rest = text.partition(begin)
    shown, _, after = rest.partition(end)
    return before + begin, shown, end + after
