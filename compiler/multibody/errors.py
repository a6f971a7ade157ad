"""What can be wrong with a mechanism as a whole: BG2xx."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import Diagnostic


@dataclass(frozen=True, slots=True)
class ClosedLoop(Diagnostic):
    """BG201."""

    code = "BG201"
    title = "The {kind} `{joint}` closes a loop ({loop}), which this kind of joint cannot do"
    advice = "Let another joint of the loop close it: a hinge, slide, weld, ball, cylinder or universal joint that is declared after this one."
    kind: str
    joint: str
    loop: str


@dataclass(frozen=True, slots=True)
class NothingMoves(Diagnostic):
    """BG202."""

    code = "BG202"
    title = "Nothing with {what} moves along `{coordinate}`: its acceleration is not determined"
    advice = "Give the body `{body}` {what}, or join something with {what} to it."
    coordinate: str
    body: str
    what: str


@dataclass(frozen=True, slots=True)
class RodWithoutLength(Diagnostic):
    """BG203."""

    code = "BG203"
    title = "The rod `{joint}` has no length: its two ends are drawn at one place"
    advice = "What holds two points together is a hinge, in space a ball."
    joint: str


@dataclass(frozen=True, slots=True)
class NoCoordinate(Diagnostic):
    """BG204."""

    code = "BG204"
    title = "`{coordinate}` is asked for, but the {kind} closes a loop, where only hinges, slides and cylinders have coordinates"
    advice = "The joint farthest from the ground closes a loop, in order of declaration: declare those that lead to this one first, or read bodies' poses."
    coordinate: str
    kind: str
