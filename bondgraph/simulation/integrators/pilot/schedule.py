"""Pilot run: limits and data that its steps, their loop and its caller share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from compiler.api import Program

from ....numerics.scales import group_numbers

MOST_STEPS = 600  # most steps, where its Newton iteration needs shorter ones
GROWN, SAME = 1.5, 1.2  # growth factor in a step, and the one that counts as no growth
CAREFUL = 300  # number of steps up to which a step must not overshoot growing states
AGAIN = 1.25  # ratio of the times at which magnitudes are recorded
NOTES = 128  # most records; enough from the shortest step on
SETTLED = 0.1  # largest relative correction of an unknown that counts for its magnitude
SLIGHT = 1e-4  # relative to the largest state of one unit: growth of smaller states does not matter for the magnitudes


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions of a program: `holds` in the mode, `strict` ones do not hold at zero; shape (conditions,)."""

    holds: Any
    strict: Any


@dataclass(slots=True)
class StepSchedule:
    """Step schedule of a pilot run on a segment: current time and step sizes."""

    time: float
    size: float  # size of the next step
    taken: int  # steps tried, on all segments
    usual: float
    smallest: float
    stop: float


class Progress(Protocol):
    """State of a pilot run (n,), its largest magnitudes so far (n,), and records of times (NOTES,) and of magnitudes up to them (NOTES, n)."""

    state: Any
    largest: Any
    far: Any
    until: Any
    noted: int  # number of records


def unit_numbers(program: Program) -> Any:
    """Return the index of the unit of each state and unknown, in the order of first use; shape (n,)."""
    kept = program.kept
    if "units" not in kept:
        kept["units"] = group_numbers(program.variables.units)
    return kept["units"]
