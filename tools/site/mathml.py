"""Formulas as MathML inside the pages: every browser draws it, and nothing is fetched."""

from __future__ import annotations

import re

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

_log = logging.getLogger(__name__)
_ACCENTED = re.compile(
    r"\\(?:tilde|hat|bar|dot|ddot|vec)\s*(?:\{(?:[^{}]|\{[^{}]*\})*\}|\\[A-Za-z]+|(?<![A-Za-z])[A-Za-z])(?=\s*_)"
)
"""An accent and what it stands on, before an index: docutils puts the index below unless there is more in the group."""


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer, ``html_math_renderer = "mathml"``."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(_mathml(node, as_block=False))
    raise nodes.SkipNode


def _block(self: HTML5Translator, node: nodes.math_block) -> None:
    self.body.append(self.starttag(node, "div", CLASS="math"))
    self.body.append(_mathml(node, as_block=True))
    self.body.append("</div>")
    raise nodes.SkipNode


def _mathml(node: nodes.Element, *, as_block: bool) -> str:
    """A formula as MathML; a warning, which ends the build, for LaTeX that cannot be turned into it."""
    latex = _ACCENTED.sub(r"{\g<0>{}}", node.astext())
    try:
        return str(tex2mathml(latex, as_block=as_block))
    except MathError as error:
        _log.warning("cannot draw the formula %s: %s", latex, error, location=node)
        return ""
