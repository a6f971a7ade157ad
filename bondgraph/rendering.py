"""Renderers of results: the link from methods such as `summary` and `plot` to the functions of the presentation layer.

A result knows numbers and names only. `bondgraph/__init__.py` installs the table of `presentation/renderers.py`, once; a renderer is imported at its
first use.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_RENDERERS: dict[tuple[str, str], str] = {}  # (name of a class, kind of picture or text) -> "module:function"


def install(renderers: Mapping[tuple[str, str], str]) -> None:
    """Install the table of renderers. Raises RuntimeError if there is one already."""
    if _RENDERERS:
        raise RuntimeError("the renderers are installed already")
    _RENDERERS.update(renderers)


def renderer(subject: object, kind: str) -> Callable[..., Any]:
    """Return the function that makes pictures or texts of this kind for the class of `subject`, or for one of its bases."""
    key = next(key for c in type(subject).__mro__ if (key := (c.__name__, kind)) in _RENDERERS)
    module, _, function = _RENDERERS[key].partition(":")
    found: Callable[..., Any] = getattr(import_module(module), function)
    return found


def text_of(subject: object, kind: str = "summary", *options: object) -> str:
    """Return the text (plain, HTML, SVG or LaTeX) of a result; `options` are further arguments of its renderer."""
    text: str = renderer(subject, kind)(subject, *options)
    return text


def draw(subject: object, path: str | os.PathLike[str] | None = None, kind: str = "plot", *options: object) -> Figure:
    """Draw a result, into a file if there is a path. Raises `UsageError` for an unknown ending, `MissingPackage` without matplotlib, OSError."""
    figure: Figure = renderer(subject, kind)(subject, path, *options)
    return figure


@dataclass(frozen=True, eq=False, repr=False)
class OfModel:
    """Result of a model, in an experiment of it or without one."""

    model: str
    experiment: str | None

    @property
    def title(self) -> str:
        """Model and experiment, as in headings."""
        return self.model if self.experiment is None else f"{self.model}: {self.experiment}"


class Summarised:
    """Result with a renderer for terminals, which is also what an interpreter and a notebook show of it."""

    __slots__ = ()

    def __repr__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        """Return the tables, and the picture where there is one and matplotlib can draw it."""
        return text_of(self, "html")

    def summary(self) -> str:
        """Return the result as tables for terminals."""
        return text_of(self)


class Plotted:
    """Result with a renderer for files of pictures."""

    __slots__ = ()

    def plot(self, path: str | os.PathLike[str] | None = None, **options: Axes | Sequence[Axes]) -> Figure:
        """Plot the result; also into a .png, .svg or .pdf file; modes and paths with `ax`, one for each panel, into the caller's figure.

        Raises `UsageError` for another ending, `MissingPackage` without matplotlib, OSError.
        """
        figure: Figure = renderer(self, "plot")(self, path, **options)
        return figure
