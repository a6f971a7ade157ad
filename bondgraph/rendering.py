"""Renderers of results: the link from methods such as `summary` and `plot` to the functions of the presentation layer.

A result knows numbers and names only. `bondgraph/__init__.py` installs the table of `presentation/renderers.py`, once; a renderer is imported at its
first use.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

_RENDERERS: dict[tuple[str, str], str] = {}  # (name of a class, kind of picture or text) -> "module:function"


def install(renderers: Mapping[tuple[str, str], str]) -> None:
    """Install the table of renderers. Raises RuntimeError if there is one already."""
    if _RENDERERS:
        raise RuntimeError("the renderers are installed already")
    _RENDERERS.update(renderers)


def renderer(subject: object, kind: str) -> Callable[..., Any]:
    """Return the function that makes pictures or texts of this kind for the class of `subject`."""
    module, _, function = _RENDERERS[type(subject).__name__, kind].partition(":")
    found: Callable[..., Any] = getattr(import_module(module), function)
    return found


def text_of(subject: object, kind: str = "summary", *options: object) -> str:
    """Return the text (plain, HTML, SVG or LaTeX) of a result; `options` are further arguments of its renderer."""
    text: str = renderer(subject, kind)(subject, *options)
    return text


def draw(subject: object, path: str | os.PathLike[str], kind: str = "plot", *options: object) -> None:
    """Draw a result into a file. Raises `UsageError` for an unknown ending, `MissingPackage` without matplotlib, OSError."""
    renderer(subject, kind)(subject, path, *options)


class Summarised:
    """Result with a renderer for terminals."""

    __slots__ = ()

    def summary(self) -> str:
        """Return the result as tables for terminals."""
        return text_of(self)


class Plotted:
    """Result with a renderer for files of pictures."""

    __slots__ = ()

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Plot the result into a .png, .svg or .pdf file. Raises `UsageError` for another ending, `MissingPackage` without matplotlib, OSError."""
        draw(self, path)
