"""Sphinx directive `public-names`: the API reference of everything in `dvr_jax.__all__`.

The page names nothing by hand. The directive reads `dvr_jax.__all__`, sorts the names by kind, and hands each one to
autodoc, so that a name without a docstring, or a reference that leads nowhere, fails the strict build.
"""

from __future__ import annotations

import inspect

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.application import Sphinx

import dvr_jax

KINDS = (
    ("Functions", "autofunction"),
    ("Classes", "autoclass"),
    ("Exceptions", "autoexception"),
    ("Values", "autodata"),
)
"""Heading and autodoc directive of each kind of public name, in the page's order."""


def directive_of(value: object) -> str:
    """Name of the autodoc directive that documents a value."""
    if inspect.isclass(value):
        return "autoexception" if issubclass(value, BaseException) else "autoclass"
    return "autofunction" if callable(value) and hasattr(value, "__name__") else "autodata"


class PublicNames(Directive):
    """Document all public names of the package, those of one kind under one heading."""

    def run(self) -> list[nodes.Node]:
        """Return one section for each kind that has names."""
        directives = {name: directive_of(getattr(dvr_jax, name)) for name in dvr_jax.__all__ if name[0] != "_"}
        sections: list[nodes.Node] = []

        for heading, directive in KINDS:
            names = [name for name, wanted in directives.items() if wanted == directive]
            if names:
                sections.append(self._section(heading, directive, names))
        return sections

    def _section(self, heading: str, directive: str, names: list[str]) -> nodes.section:
        """Return a section with the documentation of these names."""
        section = nodes.section(ids=[nodes.make_id(heading)], names=[heading.lower()])
        section += nodes.title(heading, heading)

        lines: list[str] = []
        for name in names:
            # The text of a value can fill a page; its docstring says what it is.
            options = ["   :no-value:"] if directive == "autodata" else []
            lines += [f".. {directive}:: dvr_jax.{name}", *options, ""]
        self.state.nested_parse(StringList(lines, "dvr_jax.__all__"), self.content_offset, section)
        return section


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("public-names", PublicNames)
    return {"parallel_read_safe": True}
