"""Which mode holds the steps of a run that takes very many: its frequency, and where its energy is.

A mode's share in a state is the product of its right and left eigenvectors there (Pérez-Arriaga, Verghese and Schweppe, IEEE Trans. PAS 101, 1982):
a number without unit, which for a lossless model is the share of the mode's energy that the storage holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ..stretch.stepper import Solver, Stepper

LARGEST = 200  # states up to which modes are computed
MANY = 20_000  # steps of a stretch, from which on a run says what holds them
LEAST_TURNS = 0.003  # of the mode that holds the steps, in radians: what the tightest tolerance asks for
MOST_TURNS = 30.0  # more than that, and the steps do not follow it
NAMED = 3  # elements
APART = 30.0  # of two modes: the slower one could be followed by much longer steps
SHARE = 0.05  # of the largest


@dataclass(frozen=True, slots=True)
class Mode:
    """One mode of a model where a run stands: its rate in 1/s, and the elements with the largest shares in it."""

    rate: complex
    elements: tuple[str, ...]
    alone: bool  # whether no other mode is much slower

    def __str__(self) -> str:
        where = ", ".join(f"`{name}`" for name in self.elements)
        if abs(self.rate.imag) > abs(self.rate.real):
            return f"an oscillation at {abs(self.rate.imag) / (2 * np.pi):.4g} Hz, whose energy is mostly in {where}"
        return f"a motion that dies out or grows within {1 / abs(self.rate):.4g} s, mostly in {where}"


def limiting_mode(stepper: Stepper, time: float, x: Any, mode: Any, step: float, driven: Any = None) -> Mode | None:
    """The mode that holds steps of this length; None if none is told from the others. `driven`: the error of the last step, in units
    of its tolerance, which is largest where that mode moves."""
    program = stepper.program
    count = len(program.states.names)
    if program.unknowns.names or not 0 < count <= LARGEST:
        return None
    magnitude = stepper.tolerances.magnitude
    jacobian = program.jacobian(time, x, stepper.inputs, stepper.constants, mode) * magnitude / magnitude[:, None]
    if not np.isfinite(jacobian).all():
        return None
    try:
        rates, right = np.linalg.eig(jacobian)
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return None
    turns = np.abs(rates) * step
    held = (turns >= LEAST_TURNS) & (turns <= MOST_TURNS)
    if not held.any():
        return None
    moved = np.ones(count) if driven is None or not np.isfinite(driven).all() else np.abs(left @ driven)
    chosen = int(np.argmax(np.where(held, moved * turns, -1.0)))
    slower = (np.abs(rates) > 0) & (np.abs(rates) * APART < np.abs(rates[chosen]))
    elements = elements_of(program.states.names, np.abs(right[:, chosen] * left[chosen]))
    return Mode(complex(rates[chosen]), elements, not slower.any())


def notes_of(stepper: Stepper, solver: Solver, steps: int, mode: Any) -> list[str]:
    """What a run should tell that took so many steps over a stretch; nothing if they were few, or nothing slower goes on in the model."""
    if steps < MANY:
        return []
    start, stop = solver.last_step
    x = solver.state * stepper.tolerances.magnitude
    found = limiting_mode(stepper, float(stop), x, mode, float(stop - start), np.array(solver.error))
    if found is None or found.alone:
        return []
    return [f"most of the {steps} steps follow {found}; {advice(found, stepper.solver == 'explicit')}"]


def elements_of(names: Sequence[str], shares: Any) -> tuple[str, ...]:
    """The elements with the largest shares, largest first."""
    by_element: dict[str, float] = {}
    for name, share in zip(names, shares, strict=True):
        element = name.removesuffix(".v").removesuffix(".omega").rpartition(".")[0] or name
        by_element[element] = by_element.get(element, 0.0) + float(share)
    order = sorted(by_element, key=lambda name: -by_element[name])
    return tuple(name for name in order[:NAMED] if by_element[name] >= SHARE * by_element[order[0]])


def advice(mode: Mode, explicit: bool) -> str:
    """What can be done about a mode that holds the steps."""
    if explicit:
        return "it holds an explicit method by stability alone: name `radau`, or leave the solver to choose"
    if abs(mode.rate.imag) > abs(mode.rate.real):
        return (
            "if it does not matter, do not excite it: start it at rest (`equilibrium`), let what is pushed be pushed within a few of its periods, "
            "damp it, make the stiff part rigid, or leave it out by a `bandwidth`; else it has to be followed, turn by turn"
        )
    return "make what is so fast rigid or instantaneous, if it does not matter"
