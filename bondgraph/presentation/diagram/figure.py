"""Figure: lines, shapes and texts in groups, each with its meaning, independent of the file format.

Looks are named, not given: `svg.py` and `picture.py` convert the names into colours and widths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ...rendering import text_of

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Polyline:
    """An open line through some points, or a filled shape if it is closed."""

    points: tuple[Point, ...]
    look: str
    closed: bool = False


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle."""

    middle: Point
    radius: float
    look: str


@dataclass(frozen=True, slots=True)
class RoundedBox:
    """A rectangle with round corners."""

    left: float
    top: float
    width: float
    height: float
    look: str
    round: float = 0.0


@dataclass(frozen=True, slots=True)
class Lettering:
    """A line of text; `anchor`: start, middle or end."""

    text: str
    x: float
    y: float
    look: str
    anchor: str = "start"


Shape = Polyline | Circle | RoundedBox | Lettering


@dataclass(frozen=True, slots=True)
class Group:
    """Shapes of one object: its kind, its facts, and the text that a pointer shows."""

    kind: str
    shapes: tuple[Shape, ...]
    facts: Mapping[str, str] = field(default_factory=dict)
    words: str = ""
    mark: str = ""  # derivative or loop


@dataclass(frozen=True, slots=True)
class Figure:
    """Picture of some width and height; `title` names it for readers who cannot see it."""

    width: float
    height: float
    title: str
    groups: tuple[Group, ...]

    def _repr_svg_(self) -> str:
        """Return the picture as SVG, for notebooks."""
        return text_of(self, "svg")
