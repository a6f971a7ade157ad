"""What can be wrong with the equations as a whole: BG5xx."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import Diagnostic


@dataclass(frozen=True, slots=True)
class NonlinearLoop(Diagnostic):
    """BG501."""

    code = "BG501"
    title = "A nonlinear algebraic loop goes through {members}; this version solves linear loops only"
    advice = "Put a storage into the loop (a small C on a 0-junction, a small I on a 1-junction), or make the law of `{culprit}` linear."
    members: str
    culprit: str


@dataclass(frozen=True, slots=True)
class SingularLoop(Diagnostic):
    """BG502."""

    code = "BG502"
    title = "The algebraic loop through {members} has no unique solution"
    advice = "Nothing in it decides its flow: it has no loss and no storage, or they add up to nothing. Put a resistor or a storage into it."
    members: str


@dataclass(frozen=True, slots=True)
class ForcedStorage(Diagnostic):
    """BG503."""

    code = "BG503"
    title = "`{element}` is forced by `{source}`, which changes with time: `{what}` would be a derivative that this version does not form"
    advice = "Put a resistor or a storage of the other kind between the two, as every real source has one."
    element: str
    source: str
    what: str


@dataclass(frozen=True, slots=True)
class DerivativeThroughLoop(Diagnostic):
    """BG504."""

    code = "BG504"
    title = (
        "`{element}` is in derivative form behind an algebraic loop ({members}), which this version does not support"
    )
    advice = "Put a storage into the loop, or a resistor before `{element}`; if it has `prefer = derivative`, leave that out."
    element: str
    members: str


@dataclass(frozen=True, slots=True)
class NothingToCompute(Diagnostic):
    """BG505."""

    code = "BG505"
    title = "The model has no output and no state"
    advice = "Name what you want to see: `output x = spring.x`."
