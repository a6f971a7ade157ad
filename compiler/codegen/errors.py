"""What cannot be turned into a program: BG6xx."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import Diagnostic


@dataclass(frozen=True, slots=True)
class JumpsWithoutEnd(Diagnostic):
    """BG601."""

    code = "BG601"
    title = "`{function}` of an expression of time jumps at instants that this version does not find"
    advice = "Write the signal with step, pulse, ramp or `if` on time."
    function: str
