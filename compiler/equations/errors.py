"""What can be wrong with laws in the direction that causality asks for: BG4xx."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import Diagnostic


@dataclass(frozen=True, slots=True)
class NotInvertible(Diagnostic):
    """BG401."""

    code = "BG401"
    title = "Causality asks `{element}` for its {wanted}, but its law cannot be solved for it"
    advice = "{hint}"
    element: str
    wanted: str
    hint: str


@dataclass(frozen=True, slots=True)
class Undetermined(Diagnostic):
    """BG404."""

    code = "BG404"
    title = "Nothing decides `{variable}`: the bonds at `{node}` form a ring of junctions or transformers"
    advice = "Leave out one bond of the ring, or put an element into it."
    node: str
    variable: str
