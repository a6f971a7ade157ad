"""Step-size diagnosis: the mode that limits the steps of a very long run, with its frequency and the elements that hold its energy; and growth.

The share of a mode in a state is the product of its right and left eigenvectors there (participation factor: Pérez-Arriaga, Verghese and
Schweppe, IEEE Trans. PAS 101, 1982), a number without unit. For a lossless model it is the share of the mode's energy in the storage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from compiler.api import Array

from ...numerics.scales import largest_of_group
from ..integrators.pilot.schedule import unit_numbers
from ..segments.timeline import Segment
from ..segments.trajectory import LastStep, SegmentContext

LARGEST = 200  # most states for which modes are computed
MANY = 20_000  # steps of a segment from which on a run reports their cause
LEAST_TURNS = 0.003  # least phase of the limiting mode per step, in radians: that of the tightest tolerance
MOST_TURNS = 30.0  # largest phase per step, in radians, of a mode that the steps follow
NAMED = 3  # most elements named
APART = 30.0  # ratio of two rates: the slower mode could be followed with much longer steps
# Factor on the largest value in the pilot run; no other check sees a motion made unstable by loose tolerances.
BEYOND = 1e4
LENT = 1e-3  # relative to the largest magnitude of the unit: little more than what that lends to what rests
SHARE = 0.05  # least share of an element, relative to the largest


@dataclass(frozen=True, slots=True)
class LimitingMode:
    """One eigenmode of a model at the current state: its rate in 1/s, and the elements with the largest shares in it."""

    rate: complex
    elements: tuple[str, ...]
    alone: bool  # True if no other mode is much slower

    def __str__(self) -> str:
        where = ", ".join(f"`{name}`" for name in self.elements)
        if abs(self.rate.imag) > abs(self.rate.real):
            return f"an oscillation at {abs(self.rate.imag) / (2 * np.pi):.4g} Hz, whose energy is mostly in {where}"
        return f"a motion that dies out or grows within {1 / abs(self.rate):.4g} s, mostly in {where}"


def limiting_mode(
    context: SegmentContext, time: float, x: Array, mode: Array, step: float, driven: Array | None = None
) -> LimitingMode | None:
    """Return the mode that limits steps of this length; None if no mode is distinct from the others.

    `driven`: the error of the last step, in units of its tolerance, which is largest where that mode moves.
    """
    program = context.program
    count = len(program.states.names)
    if program.unknowns.names or not 0 < count <= LARGEST:
        return None
    magnitude = context.tolerances.magnitude
    jacobian = program.jacobian(time, x, context.inputs, context.constants, mode) * magnitude / magnitude[:, None]
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
    return LimitingMode(complex(rates[chosen]), elements, not slower.any())


def notes_of(context: SegmentContext, solver: LastStep, steps: int, segment: Segment, explicit: bool) -> list[str]:
    """Return a note on the mode that limits the steps of a segment; none if the steps were few, or if the model has no slower mode.

    The steps have their mean length there: the last one was cut where the segment ends.
    """
    if steps < MANY:
        return []
    time = float(solver.last_step[1])
    x = solver.state * context.tolerances.magnitude
    found = limiting_mode(context, time, x, segment.mode, (time - segment.start) / steps, np.array(solver.error))
    if found is None or found.alone:
        return []
    return [f"most of the {steps} steps follow {found}; {advice(found, explicit)}"]


def is_usual(state: Array, steps: int) -> bool:
    """Return True if a segment took few steps, and no state is far beyond its magnitude at its end, by which it is divided."""
    return steps < MANY and (state.dot(state) < BEYOND**2 or not np.count_nonzero(np.abs(state) > BEYOND))


def growth_notes(context: SegmentContext, time: float, state: Array, notes: Sequence[str]) -> list[str]:
    """Return a note on the state farthest beyond its magnitude at the end of a segment; none if that was given or guessed, or after a first note in `notes`.
    `state`: divided by the magnitudes.

    One that nothing moved in the pilot run (behind a dead time, before an event) has the magnitude that others of its unit lend it, and is measured
    by theirs.
    """
    names, units = context.program.states.names, context.program.states.units
    tolerances = context.tolerances
    count = len(names)
    far = np.abs(np.asarray(state)[:count])
    if not (far > BEYOND).any():
        return []
    sizes = tolerances.magnitude[:count]
    lending = largest_of_group(sizes, unit_numbers(context.program)[:count])
    vague = (tolerances.held | tolerances.guessed)[:count]
    far = np.where(vague, 0.0, np.where(sizes > LENT * lending, far, far * sizes / lending))
    if not (far > BEYOND).any():
        return []
    worst = int(np.argmax(far))
    begin = f"`{names[worst]}` has got "
    if any(note.startswith(begin) for note in notes):
        return []
    value = state[worst] * tolerances.magnitude[worst]
    return [
        f"{begin}to {value:.4g} {units[worst]} at t = {time:.6g} s, {far[worst]:.2g} times what a look ahead saw: it grows without bound, "
        "or the tolerance let it beyond a value from which there is no way back, as zero is for a concentration; compare with a tolerance that is ten "
        "times tighter, or give its own (`tolerance`)"
    ]


def elements_of(names: Sequence[str], shares: Array) -> tuple[str, ...]:
    """Return the elements with the largest shares, largest first."""
    by_element: dict[str, float] = {}
    for name, share in zip(names, shares, strict=True):
        element = name.removesuffix(".v").removesuffix(".omega").rpartition(".")[0] or name
        by_element[element] = by_element.get(element, 0.0) + float(share)
    order = sorted(by_element, key=lambda name: -by_element[name])
    return tuple(name for name in order[:NAMED] if by_element[name] >= SHARE * by_element[order[0]])


def advice(mode: LimitingMode, explicit: bool) -> str:
    """Return advice on a mode that limits the steps."""
    if explicit:
        return "it holds an explicit method by stability alone: name `radau`, or leave the solver to choose"
    if abs(mode.rate.imag) > abs(mode.rate.real):
        return (
            "if it does not matter, do not excite it: start it at rest (`equilibrium`), let what is pushed be pushed within a few of its periods, "
            "damp it, make the stiff part rigid, or leave it out by a `bandwidth`; else it has to be followed, turn by turn"
        )
    return "make what is so fast rigid or instantaneous, if it does not matter"
