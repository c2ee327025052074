"""Convert the formulas of the pages to MathML, which browsers display without loading any script."""

import re

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging

logger = logging.getLogger(__name__)
PLAIN = 'stretchy="false" lspace="0" rspace="0"'


def mathml(node, as_block=False):
    """Convert a formula to MathML; if this fails, log a warning, which stops a build with `-W`."""
    tex = re.sub(
        r"(frac)(\d)(\d)", r"\1{\2}{\3}", node.astext()
    )  # docutils takes two digits for one number
    try:
        written = tex2mathml(tex, as_block).replace("<mo>'</mo>", "<mo>′</mo>")
        # Chromium draws what is marked as an accent through letters such as p, and a plain overscript above them.
        written = written.replace('<mover accent="true">', "<mover>")
        # as TeX has them: as high as letters, and without space around
        return re.sub(r'<mo(?: stretchy="false")?>([⟨⟩|‖/])</mo>', rf"<mo {PLAIN}>\1</mo>", written)
    except MathError as error:
        logger.warning("formula %s: %s", tex, error, location=node)
        return node.astext()


def visit_inline(translator, node):
    translator.body.append(mathml(node))
    raise nodes.SkipNode


def visit_block(translator, node):
    translator.body.append(
        translator.starttag(node, "div", CLASS="math-block") + mathml(node, True) + "</div>\n"
    )
    raise nodes.SkipNode


def setup(app):
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True}
