"""What can be wrong with a mechanism as a whole: BG2xx."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import Diagnostic


@dataclass(frozen=True, slots=True)
class ClosedLoop(Diagnostic):
    """BG201."""

    code = "BG201"
    title = "The {kind} `{joint}` closes a loop ({loop}), which would need constraint equations; this version does not support them"
    advice = "A loop may be closed by a `free` joint, with springs on its three freedoms: then no constraint is needed."
    kind: str
    joint: str
    loop: str


@dataclass(frozen=True, slots=True)
class NothingMoves(Diagnostic):
    """BG202."""

    code = "BG202"
    title = "Nothing with {what} moves along `{coordinate}`: its acceleration is not determined"
    advice = "Give the body `{body}` a {what}, or join something with {what} to it."
    coordinate: str
    body: str
    what: str
