"""Errors of a mechanism as a whole: BG2xx."""

from __future__ import annotations

from ..errors import Diagnostic


class ClosedLoop(Diagnostic):
    code = "BG201"
    title = (
        "`{joint}` is locked where it starts, not where it was drawn, and so is all of the loop that it closes ({loop})"
    )
    advice = "Draw one joint of the loop where it is locked, leave out its `start`, or unlock it."
    joint: str
    loop: str


class NothingMoves(Diagnostic):
    code = "BG202"
    title = "Nothing with {what} moves along `{coordinate}`: its acceleration is not determined"
    advice = "Give the body `{body}` {what}, or join something with {what} to it."
    coordinate: str
    body: str
    what: str


class RodWithoutLength(Diagnostic):
    code = "BG203"
    title = "The rod `{joint}` has no length: its two ends are drawn at one place"
    advice = "What holds two points together is a hinge, in space a ball."
    joint: str
