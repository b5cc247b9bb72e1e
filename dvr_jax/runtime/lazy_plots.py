"""Importing a library that imports matplotlib without waiting for matplotlib, which takes half a second."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

NAME = "matplotlib"
"""Name of the package."""


class _LazyModule(ModuleType):
    """Stands for a module of matplotlib, and imports the real one when something of it is used."""

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the real module."""
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(importlib.import_module(self.__name__), name)


@contextmanager
def without_plots() -> Iterator[None]:
    """Let what is imported in the block have a matplotlib that is imported when it first draws something."""
    if NAME in sys.modules:
        yield
        return

    package = _LazyModule(NAME)
    pyplot = _LazyModule(f"{NAME}.pyplot")
    setattr(package, "pyplot", pyplot)  # noqa: B010
    stand_ins = {module.__name__: module for module in (package, pyplot)}
    sys.modules.update(stand_ins)
    try:
        yield
    finally:
        # Whoever imports matplotlib after this block gets the real one.
        for name, module in stand_ins.items():
            if sys.modules.get(name) is module:
                del sys.modules[name]
