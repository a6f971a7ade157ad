"""Solvers of an experiment, one row each: the words of an author, and the facts by which a run chooses, refuses, names and repeats.

The steps of a method are the module and function `<word>_step` in `bondgraph/simulation/integrators/steps/`, of `steps` where its row has that.
"""

from __future__ import annotations

from .fast_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Solver:
    """A solver of an experiment. Without `parts` it makes no steps.

    `steps`: word of the solver that makes them, if it is another. `parts` of a step are searched for events separately. `estimate`: order of the error
    estimate plus one. `through_ends`: within a step, a polynomial through the last step ends holds. `others`: solvers of another family that repeat a run,
    the first that can. `refused`: properties of a model that it cannot take, each with the reason, put into `refusal`.
    """

    word: str
    name: str = ""  # in a result; also the beginning of it
    purpose: str = ""
    steps: str = ""
    parts: int = 0
    estimate: int = 4
    stages: int = 3  # most stages that are solved for together
    stiff: bool = False
    through_ends: bool = False
    conserving: bool = False  # equal steps that keep the stored energy
    exact: bool = False  # states within a step satisfy the equations
    others: tuple[str, ...] = ("automatic",)
    refused: tuple[tuple[str, str], ...] = ()
    refusal: tuple[str, str] = ("", "")  # sentence and advice


AUTOMATIC = "automatic"
_CANNOT, _OTHERS = "cannot step through this model", "leave the solver to choose, or name `radau`"
_CONSTRAINTS = "constraints", "closed loops hold its states on constraints"
_UNKNOWNS = "unknowns", "the unknowns of its algebraic loops are found with each step"
_ROWS = (
    Solver(AUTOMATIC),
    Solver(
        "explicit", "Dormand-Prince 8", parts=4, estimate=8, others=("radau",),
        refused=(_CONSTRAINTS, _UNKNOWNS), refusal=(f"an explicit method {_CANNOT}", _OTHERS),
    ),
    Solver(
        "exponential", "matrix exponential", "linear models", parts=1, exact=True, others=("explicit", "radau"),
        refused=(
            ("laws", "its rates are not affine in its states from event to event"),
            _CONSTRAINTS, _UNKNOWNS, ("delays", "it has delayed signals"), ("many", "it is for up to {few} states between events"),
            ("signals", "with events on states, it takes no signals that vary but straight lines in time"),
            ("rounding", "rounding of its stiff matrix would change slow motions"),
        ),
        refusal=(f"the matrix exponential {_CANNOT}", _OTHERS),
    ),
    Solver("radau", "Radau IIA 5", parts=1, stiff=True, through_ends=True, others=("rodas", "radau")),
    Solver(
        "radau13", "Radau IIA 5 to 13", "stiff models, tight tolerances", "radau", parts=4, stages=7, stiff=True, others=("rodas", "radau"),
        refused=(("sparse", "it is for up to about 100 states and unknowns"),), refusal=(f"Radau of variable order {_CANNOT}", _OTHERS),
    ),
    Solver(
        "rodas", "Rodas5P", "stiff models", parts=4, stiff=True, others=("radau",),
        refused=(
            _CONSTRAINTS, ("delays", "delayed signals have no exact slope in time"),
            ("size", "without machine code it is for up to {most} states and unknowns, these are {states}"),
        ),
        refusal=(f"Rodas5P {_CANNOT}", _OTHERS),
    ),
    Solver(
        "energy", "Gauss 6 with constant energy", "keeps that of lossless models", parts=4, conserving=True, others=("explicit", "radau"),
        refused=(
            ("events", "events change what it stores"), ("delays", "delayed signals are no storage"),
            ("kinks", "its laws bend, which equal steps do not see"), _CONSTRAINTS, _UNKNOWNS,
        ),
        refusal=("no method keeps the energy of this model", "leave the solver to choose"),
    ),
)  # fmt: skip
SOLVERS = {row.word: row for row in _ROWS}
