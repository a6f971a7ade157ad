"""Bond graphs as pictures: from a compilation to a figure in a textbook's notation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .compose import compose
from .picture import write_figure
from .place import place
from .subject import subject_of
from .svg import svg_text

if TYPE_CHECKING:
    from ..door import Compilation
    from .figure import Figure

__all__ = ["draw", "svg_text", "write_figure"]


def draw(compilation: Compilation, closed: bool = False, numbers: bool = False) -> Figure:
    """The diagram of a scene. `closed`: instances are boxes; `numbers`: with the numbers of the bonds. Raises `CompilationFailed`."""
    subject = subject_of(compilation, closed)
    return compose(subject, place(subject), numbers)
