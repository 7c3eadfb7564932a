"""Formulas as MathML, which browsers show by themselves: no script, and no network."""

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator


def show_inline(page: HTML5Translator, node: nodes.math) -> None:
    """Put a formula into a line."""
    page.body.append(convert(node.astext()))
    raise nodes.SkipNode


def show_displayed(page: HTML5Translator, node: nodes.math_block) -> None:
    """Put a formula on a line of its own."""
    page.body.append(convert(node.astext(), display="block"))
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_html_math_renderer("mathml", (show_inline, None), (show_displayed, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True}
