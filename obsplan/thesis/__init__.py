"""Figures, tables and claims of the thesis, and answers to its open questions; loaded on use."""

from importlib import import_module
from typing import Any

_HOME = {
    "ITEMS": "items",
    "Finding": "item",
    "Item": "item",
    "free_or_begun": "page",
    "write_thesis": "page",
}

__all__ = [*_HOME]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Load a public name from the module that defines it."""
    if name not in _HOME:
        raise AttributeError(f"module 'obsplan.thesis' has no public name {name!r}")
    return getattr(import_module(f"obsplan.thesis.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__]
