"""Sphinx configuration: `make docs` builds the site with every warning counted as an error."""

from __future__ import annotations

import sys
from pathlib import Path

import dvr_jax
from docutils.nodes import Element, TextElement, reference
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

sys.path.insert(0, str(Path(__file__).parent))

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

    link = reference("", "", internal=True, refuri=f"{app.builder.get_relative_uri(node['refdoc'], 'api')}#dvr_jax.{name}")
    link.append(content)
    return link


def setup(app: Sphinx) -> None:
    """Register the handler."""
    app.connect("missing-reference", resolve_by_public_name)
