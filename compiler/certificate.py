"""Certificate: the kind of a model's equations. `reduction/certificate.py` makes it. Results contain it, so this module imports nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from .fast_dataclass import dataclass

SCHEMA = "bondgraph-certificate/1"
LISTED = 12  # names on one line of text


@dataclass(frozen=True, slots=True)
class LoopSummary:
    """An algebraic loop: the number of its unknowns, and its elements and junctions.

    `unique` is True if it surely has no second solution: its laws rise strictly, and what joins them conserves power. This holds for all values of the
    parameters with their signs in the text, at all states and instants. False: that is not known, as of laws with parameters that a run sets.
    """

    linear: bool  # solved in each evaluation; else by Newton's method with the step of the run
    size: int
    members: tuple[str, ...]
    unique: bool = False


@dataclass(frozen=True, slots=True)
class Certificate:
    """Result of a compilation: the kind of the equations.

    `form` is the form that a run solves: `explicit ODE`; `linear-implicit ODE` (linear loops, closing joints, or dependent storages that
    share the rates: solved in every evaluation); `index-1 DAE` (with unknowns of nonlinear loops); `algebraic` without any state.
    `index` is that of the equations as written: 0 explicit, 1 with loops, 2 and more with storages in derivative form.
    """

    model: str
    form: str
    index: int
    states: tuple[str, ...]
    dependent: tuple[str, ...]  # storages in derivative form: they follow from the states
    loops: tuple[LoopSummary, ...]
    linear: bool  # affine in states and unknowns, for given time and inputs
    time_varying: bool  # True if coefficients change with time or inputs
    driven: bool  # True if time or inputs occur; else the equations are autonomous
    left_out: tuple[str, ...]  # elements and junctions that give nothing
    unneeded: tuple[str, ...]  # states behind no requested output
    degrees_of_freedom: int  # states that are momenta, or speeds of a mechanism: independent flows
    notes: tuple[str, ...]  # laws that do what one may not expect, such as a resistor that creates energy
    constraints: int = 0  # of closing joints, solved in each evaluation and kept by projection
    redundant: tuple[str, ...] = ()  # those that follow from others where the mechanism was drawn
    events: tuple[str, ...] = ()  # events: `when`, `every`, switched junctions, delays, with their lines
    following: tuple[str, ...] = ()  # storages and `integral` signals that share the state of another
    unexcited: tuple[str, ...] = ()  # states that stay at zero, as nothing moves them: a run does not compute them

    @property
    def reduced(self) -> bool:
        """True if derivatives had to be formed."""
        return self.index > 1

    @property
    def line(self) -> str:
        """The certificate in one line."""
        parts = [self.form + (f", reduced from index {self.index}" if self.reduced else "")]
        parts.append(_count(len(self.states), "state"))
        if self.unexcited:
            parts.append(f"{_count(len(self.unexcited), 'state')} that nothing excites")
        if self.states or self.loops:
            parts.append(("linear" if self.linear else "nonlinear") + (", time-varying" if self.time_varying else ""))
            parts.append("driven" if self.driven else "autonomous")
        if self.dependent:
            parts.append(f"{_count(len(self.dependent), 'storage')} in derivative form")
        if self.constraints:
            redundant = f", {len(self.redundant)} of them redundant" if self.redundant else ""
            parts.append(f"{_count(self.constraints, 'constraint')} of closing joints{redundant}")
        if self.events:
            parts.append(_count(len(self.events), "event"))
        for word, linear in (("linear", True), ("nonlinear", False)):
            sizes = sorted(x.size for x in self.loops if x.linear is linear)
            if sizes:
                told = ", ".join(map(str, sizes[:LISTED])) + ", …" * (len(sizes) > LISTED)
                parts.append(f"{_count(len(sizes), f'{word} loop')} ({told} unknown{'s' * (sizes != [1])})")
        return f"{self.model}: {'; '.join(parts)}"

    def __str__(self) -> str:
        lists = (f"  {what}: {_listed(names)}" for what, names in self._lists() if names)
        return "\n".join([self.line, *lists, *(f"  note: {n}" for n in self.notes)])

    def _lists(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        yield f"states, of {_count(self.degrees_of_freedom, 'degree')} of freedom", self.states
        yield "in derivative form", self.dependent
        yield "sharing a state", self.following
        yield "constraints that follow from others where it is drawn", self.redundant
        yield "at instants", self.events
        for loop in self.loops:
            word = "linear" if loop.linear else "nonlinear"
            solution = "not known whether it has one solution only"
            if loop.unique:
                solution = "one solution at most, as its laws are monotone"
            yield (
                f"{word} loop of {_count(loop.size, 'unknown')}{f' ({solution})' if loop.unique or not loop.linear else ''} through",
                loop.members,
            )
        yield "left out, as it gives nothing", self.left_out
        yield "left out, as no output needs it", self.unneeded
        yield "left out, as nothing excites it", self.unexcited

    def to_json(self) -> dict[str, Any]:
        """Data for `json.dumps`: `bondgraph-certificate/1`, the fields under their own names; `unique` of a loop is null where it is not known."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        told = {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
        loops = [
            {"linear": x.linear, "size": x.size, "members": list(x.members), "unique": x.unique or None}
            for x in self.loops
        ]
        return {"schema": SCHEMA, **told, "loops": loops}


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'s' * (number != 1)}"


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names[:LISTED]) + (f" and {len(names) - LISTED} more" if len(names) > LISTED else "")
