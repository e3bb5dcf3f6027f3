"""HTML and SVG by elements of the standard library's XML, which escapes every text and attribute."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote
from xml.etree import ElementTree  # nosec B405 - only writes

Node = ElementTree.Element


def node(tag: str, *children: Node | str | None, **attributes: Any) -> Node:
    """An element.

    Args:
        tag: its name.
        children: elements and texts in order; None is left out.
        attributes: by name; ``class_`` is class, other underscores are hyphens. A number is written in few digits, True
            is an empty attribute, and None or False is none.
    """
    made = Node(tag)
    for name, value in attributes.items():
        if value is not None and value is not False:
            made.set(name.rstrip("_").replace("_", "-"), _written(value))
    last: Node | None = None
    for child in children:
        if isinstance(child, str):
            if last is None:
                made.text = (made.text or "") + child
            else:
                last.tail = (last.tail or "") + child
        elif child is not None:
            made.append(child)
            last = child
    return made


def html(element: Node) -> str:
    """An element as HTML."""
    return ElementTree.tostring(element, encoding="unicode", method="html")


def episodes_link(task: int, policies: list[int], key: str) -> str:
    """The address, in the page, of the episodes behind a number of one policy, or of the difference of two."""
    return f"#/{task}/{'-'.join(map(str, policies))}/{quote(key, safe='')}"


def _written(value: Any) -> str:
    if value is True:
        return ""
    return f"{value:.5g}" if isinstance(value, float) else str(value)
