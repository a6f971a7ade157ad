"""Errors of laws in the direction that causality needs: BG4xx."""

from __future__ import annotations

from ..errors import Diagnostic


class NotInvertible(Diagnostic):
    code = "BG401"
    title = "Causality asks `{element}` for its {wanted}, but its law cannot be solved for it"
    advice = "{hint}"
    element: str
    wanted: str
    hint: str


class Undetermined(Diagnostic):
    code = "BG404"
    title = "Nothing decides `{variable}`: the bonds at `{node}` form a ring of junctions or transformers"
    advice = "Leave out one bond of the ring, or put an element into it."
    node: str
    variable: str


class SignalOfItself(Diagnostic):
    code = "BG407"
    title = "Nothing decides the signal `{name}`: its definition leads back to it unchanged"
    advice = "Say what one of the signals of this circle depends on, or let it be an `input`."
    name: str


class NotConservative(Diagnostic):
    code = "BG405"
    title = (
        "The law of `{element}` creates energy: the slope of `{first}` over `{over_first}` is {value}, "
        "but that of `{second}` over `{over_second}` is {opposite}{where}"
    )
    advice = "A storage gives back what it took only if these are equal: write its law as `energy = …`, and all its efforts follow."
    element: str
    first: str
    over_first: str
    value: str
    second: str
    over_second: str
    opposite: str
    where: str


class EnergyJumps(Diagnostic):
    code = "BG420"
    title = (
        "The energy of `{element}` jumps by {height} J at {place}, and no effort gives back what it takes to pass there"
    )
    advice = "Write an energy that is continuous, or the law itself as an equation, `F = …`, which may jump."
    element: str
    place: str
    height: str


class StoredJumps(Diagnostic):
    code = "BG421"
    title = "Causality asks for the rate of `{variable}`, but by its law it jumps by {height} (SI) at {place}: the rate would be an impulse"
    advice = "Write a law without the jump, or put a resistor between the storage and what decides over it."
    variable: str
    place: str
    height: str


class NothingLeft(Diagnostic):
    code = "BG406"
    title = "Nothing is left at the junction `{node}`: all that hangs on it is zero, so its {variable} has no value"
    advice = "Give one of them a value that is not zero, or leave out what reads `{node}`."
    node: str
    variable: str
