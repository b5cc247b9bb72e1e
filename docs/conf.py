"""Sphinx configuration: `make docs` builds the site with every warning counted as an error."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from docutils.nodes import Element, TextElement, reference
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer
from sphinx.util import logging

import dvr_jax

sys.path.insert(0, str(Path(__file__).parent))

LOGGER = logging.getLogger(__name__)

project = "dvr_jax"
author = "the dvr_jax authors"
release = version = dvr_jax.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "public_names",
]
exclude_patterns = ["README.md"]

# Every reference must resolve; what other packages document cannot be looked up without a network.
nitpicky = True
nitpick_ignore_regex = [(r"py:.*", r"(?!dvr_jax\b).*")]

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist", "attrs_block"]
myst_heading_anchors = 3

autosummary_generate = False
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
# Docstrings write code between single backticks.
default_role = "code"

html_theme = "furo"
html_title = f"dvr_jax {release}"
html_static_path = []
copybutton_prompt_text = "$ "


def resolve_by_public_name(
    app: Sphinx, environment: BuildEnvironment, node: pending_xref, content: TextElement
) -> Element | None:
    """Lead a type annotation to the page of its public name.

    A signature says `dvr_jax.scene.types.Scene` where the reference documents `dvr_jax.Scene`. Types that are not
    public are shown without a link. References that a page makes to `dvr_jax.NAME` itself are left to fail.
    """
    target = str(node.get("reftarget", ""))
    package, _, name = target.rpartition(".")

    if not package.startswith("dvr_jax."):
        return None
    if name not in dvr_jax.__all__:
        return content

    link = reference(
        "",
        "",
        internal=True,
        refuri=f"{app.builder.get_relative_uri(node['refdoc'], 'api')}#dvr_jax.{name}",
    )
    link.append(content)
    return link


def unlink_builtin_object(app: Sphinx, document: Element) -> None:
    """Show Python's type `object` without a link.

    Sphinx looks for the end of a name and would find the attributes `object` of several classes.
    """
    for node in list(document.findall(pending_xref)):
        if node.get("reftarget") == "object":
            node.replace_self(node.children)


def document_value(
    app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]
) -> None:
    """Give a public value the docstring below its assignment, in place of the docstring of its type."""
    if what != "data":
        return
    short_name = name.rpartition(".")[2]
    lines.clear()

    for module in sorted(sys.modules):
        if (
            module.startswith("dvr_jax.")
            and getattr(sys.modules[module], short_name, None) is value
        ):
            analyzer = ModuleAnalyzer.for_module(module)
            analyzer.analyze()
            lines += analyzer.attr_docs.get(("", short_name), [])
        if lines:
            return
    LOGGER.warning("the public value %s has no docstring below its assignment", name)


def require_hanging_indents(
    app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]
) -> None:
    """Warn of an argument's description whose continuation lines are not indented.

    In a docstring of Google style they must be, or each of them is shown as an argument of its own.
    """
    indent = None

    for line in lines:
        text = line.lstrip()
        if text in ("Args:", "Raises:"):
            indent = ""
        elif indent is not None and text:
            depth = line[: len(line) - len(text)]
            indent = indent or depth
            if not depth:
                indent = None
            elif depth == indent and not re.match(r"[*\w.]+( \(.*?\))?: ", text):
                LOGGER.warning(
                    "the docstring of %s has a line of Args that is not indented: %r", name, text
                )


def setup(app: Sphinx) -> None:
    """Register the handlers."""
    app.connect("missing-reference", resolve_by_public_name)
    app.connect("doctree-read", unlink_builtin_object)
    app.connect("autodoc-process-docstring", document_value, priority=300)
    # Before napoleon, which rewrites the sections at priority 500.
    app.connect("autodoc-process-docstring", require_hanging_indents, priority=400)
