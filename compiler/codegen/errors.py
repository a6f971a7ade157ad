"""Errors of models that cannot be turned into a program: BG6xx."""

from __future__ import annotations

from ..errors import Diagnostic


class NoiseOutOfStep(Diagnostic):
    code = "BG602"
    title = "The instants at which `noise` takes a new number are not equally spaced in time"
    advice = "Write `noise(time, period, seed)`, with a period that does not change; bend the result instead."


class TableTurnsBack(Diagnostic):
    code = "BG603"
    title = "Causality asks the table in the law of `{owner}` for its argument, but its values neither rise nor fall throughout"
    advice = "Give a table of the other variable, say `require = …` to see what stands against it, or put a storage beside it."
    owner: str


class EvenPower(Diagnostic):
    code = "BG604"
    title = "Causality asks the law of `{owner}` for the base of a power, but a power of {exponent} has two inverses or none"
    advice = "Write the law the other way round; of a positive base `b`, `exp(n*log(b))` is the same power and can be turned round."
    owner: str
    exponent: str


class NoSteps(Diagnostic):
    code = "BG620"
    title = "A model with events is written in C with a loop over fixed steps, which has no method for {what}"
    advice = "Compile with `--steps variable`; or for numpy, which has functions for all of them; or a controller alone, with `--part`."
    what: str


class NoPart(Diagnostic):
    code = "BG621"
    title = "The model has no instance `{name}`"
    advice = "{hint}"
    name: str
    hint: str


class PartWithElements(Diagnostic):
    code = "BG622"
    title = "`{name}` is no controller: it holds `{element}`, which bonds join to the rest"
    advice = "A part that is compiled alone consists of signals, modes and events; compile the whole model instead."
    name: str
    element: str


class PartWithoutOutputs(Diagnostic):
    code = "BG623"
    title = "`{name}` has no outputs, so that nothing of it would be computed"
    advice = "Give its model an `output`: the command of a controller."
    name: str


class NumpyAlone(Diagnostic):
    code = "BG605"
    title = "{what} cannot be written in {target} yet"
    advice = "{instead}"
    target: str
    what: str = "Events, switched junctions and delays"
    instead: str = "Compile for numpy, which has functions for all of them."


class UnitInText(Diagnostic):
    code = "BG607"
    title = "`{name}` is an imported unit ({file}), whose equations no program can hold"
    advice = "Write the rest alone: give its outputs as `input`s of the model, and join the two where they run."
    name: str
    file: str


class NotInUnit(Diagnostic):
    code = "BG606"
    title = "A functional mock-up unit, or C that chooses its steps, cannot hold {what} yet"
    advice = "{instead}"
    what: str
    instead: str
