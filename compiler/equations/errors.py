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
class DerivativeField(Diagnostic):
    """BG402."""

    code = "BG402"
    title = "The field `{element}` would need derivative form at its port `{port}`, which this version does not support"
    advice = "Something else already decides its {what}: put a resistor or a storage of another kind between the two."
    element: str
    port: str
    what: str


@dataclass(frozen=True, slots=True)
class Undetermined(Diagnostic):
    """BG404."""

    code = "BG404"
    title = "Nothing decides `{variable}`: the bonds at `{node}` form a ring of junctions or transformers"
    advice = "Leave out one bond of the ring, or put an element into it."
    node: str
    variable: str


@dataclass(frozen=True, slots=True)
class StartOfDependent(Diagnostic):
    """BG403."""

    code = "BG403"
    title = "`{element}` is in derivative form, so its start follows from other storages and cannot be given"
    advice = "Remove its `start`, or give `prefer = integral` to it and `prefer = derivative` to the other one."
    element: str
