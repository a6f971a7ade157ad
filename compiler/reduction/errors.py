"""Errors of the equations as a whole: BG5xx."""

from __future__ import annotations

from ..errors import Diagnostic
from ..fast_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class SingularLoop(Diagnostic):
    """BG502."""

    code = "BG502"
    title = "The algebraic loop through {members} has no unique solution"
    advice = (
        "Nothing in it decides its flow or its effort: no loss, no storage, or they add up to nothing, or no node has a potential. "
        "Put a resistor or a storage into it; a circuit that floats needs an earth, `Se earth : u = 0 V`."
    )
    members: str


@dataclass(frozen=True, slots=True)
class ForcedByInput(Diagnostic):
    """BG503."""

    code = "BG503"
    title = "`{element}` is forced by the input `{source}`, so its flow needs the derivative of what comes from outside"
    advice = "Give `{source}` as an expression of time (`set` in an experiment), or put a resistor between the two."
    element: str
    source: str


@dataclass(frozen=True, slots=True)
class DerivativeWithoutEnd(Diagnostic):
    """BG504."""

    code = "BG504"
    title = "`{element}` is in derivative form, but nothing decides `{variable}`: it would depend on its own derivatives without end"
    advice = (
        "Let one of the storages that hang together be in integral form: remove its `require`. If none has one, a law reads an effort "
        "or a flow that hangs on this derivative: let it read what a storage holds instead, or put a small resistor between them."
    )
    element: str
    variable: str


@dataclass(frozen=True, slots=True)
class NothingToCompute(Diagnostic):
    """BG505."""

    code = "BG505"
    title = "The model has no output and no state"
    advice = "Name what you want to see: `output x = spring.x`."
