"""Magnitude of each state in a run, so that an absolute tolerance means the same for nanometres and megapascals.

Values of the author have priority. Otherwise the start and a pilot run of implicit Euler over the whole time (L-stable, so fast modes only
follow) give the magnitude, together with the reach of a free motion from there: the speed of a part that is pushed slowly is measured by
the speed at which it would swing back. States of one unit raise each other a little: a coordinate that happens to stay at zero must not be
integrated to round-off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ...errors import RunFailed
from ...numerics.scales import group_numbers, largest_of_group
from ...quantities import listed
from ...results.records import ToleranceDoubt
from ..constraints.constraints import Constraints
from ..integrators.pilot.schedule import unit_numbers
from ..segments.timeline import Segment
from .pilot_horizon import trusted
from .pilot_run import SMALLEST_ANGLE, PilotObservation, PilotObserver, PilotRun, smallest_angles, smallest_speeds
from .rate_bounds import MOST_STRETCHES, chargeable

ROUNDED = 1e-3  # relative to the smallest angle: remainder of a projection on loop joints
CAUTIOUS = 1e-6  # fraction of the charge that sources could bring in a run: magnitude of an unknown state
RESTING = 2.0  # levels of rounding: what has a smaller magnitude has not moved
SHARE = 1e-2  # least magnitude relative to the largest state of the same unit in the same mechanism
PLACES = (np.arange(8) + 0.381966) / 8  # shares of a segment, at no simple fraction of a period
SLIGHT = 1e-4  # the same relative to the whole model: charge of a junction beside that of a buffer capacitor


@dataclass(frozen=True, slots=True)
class Magnitudes:
    """Magnitudes of a run.

    `values`, shape (n,), in SI; `moved`: the same, 0 for what nothing moves, whose value is the largest of all, or 1; `stopped`: the time at which the
    pilot run gave up, if it did; `unknown`: the states without information, whose magnitude is what sources could bring, and a small fraction of it then.
    """

    values: Any
    moved: Any
    stopped: float | None
    unknown: tuple[str, ...]
    look: PilotObserver | None  # the pilot run; None without states

    def by_name(self, names: Sequence[str]) -> dict[str, float]:
        """Return the magnitudes of what moves."""
        return {n: m for n, m in zip(names, self.moved.tolist(), strict=True) if m > 0}

    @property
    def doubts(self) -> tuple[ToleranceDoubt, ...]:
        """Warning for the user, or none."""
        if self.stopped is None or not self.unknown:
            return ()
        text = (
            f"the magnitude of {listed(self.unknown)} is not known: the pilot run ended at t = {self.stopped:.6g} s; the absolute tolerance there begins at "
            f"rtol times {CAUTIOUS:g} of what the sources could charge in the whole run, and grows with what is reached; give `nominal`, or compare with "
            "a tolerance that is ten times tighter"
        )
        return (ToleranceDoubt(float(self.stopped), "", "tolerance", text, (), ""),)


def nominal_magnitudes(
    constraints: Constraints, mechanisms: Sequence[str], state: Array, stretches: Sequence[Segment], choice: PilotObservation | None = None,
    largest: Array | float = 0.0, look: PilotObserver | None = None,
) -> Magnitudes:  # fmt: skip
    """Return a positive magnitude for every state and unknown.

    `mechanisms`: their names; `choice`: monitor of the state selection; `largest`: magnitudes known from elsewhere; `look`: the pilot run, if it was made.
    """
    program, constants, inputs = constraints.program, constraints.constants, constraints.inputs
    given = np.asarray(program.nominal(constants), dtype=float)
    peak = np.maximum(np.abs(state), largest)
    stopped = None
    if look is None and len(program.states.names):
        free: list[Any] = []
        smallest = smallest_levels(mechanisms, constraints, state, stretches[0])

        def look_along(way: Sequence[Segment]) -> PilotObserver:
            coarse = PilotRun(constraints, state, smallest)
            coarse.free = free  # all begin at one state
            return PilotObserver(coarse.peak(way, choice), coarse.beginning, coarse.stopped, coarse.sure)

        first = stretches[0]
        look = trusted(
            look_along, program, stretches, len(program.signals(first.start, inputs, constants, first.mode)) > 0
        )
    if look is not None:
        peak, stopped = np.maximum(peak, look.largest), look.stopped
    elif len(peak):
        peak = np.maximum(peak, _without_states(constraints, state, stretches))
    levels = rounding_levels(mechanisms, constraints, state, stretches[0])
    result = raised(program, mechanisms, np.where(given > 0, given, peak), levels)
    unknown = (result == 0) | ~np.isfinite(result)
    values = result
    if unknown.any():
        share = 1.0 if stopped is None else CAUTIOUS
        charged = chargeable(constraints, state, stretches, np.where(unknown, 0.0, result))
        result[unknown] = share * charged[unknown]
        values = np.where(result > 0, result, share * (charged.max() or 1.0))
    names = tuple(program.variables.names[i] for i in np.flatnonzero(unknown))
    return Magnitudes(values, result, stopped, names, look)


def _without_states(constraints: Constraints, state: Array, stretches: Sequence[Segment]) -> Any:
    """Return the largest unknowns of a program without states at some instants: one alone may be where all is zero but for rounding."""
    loops, largest = constraints.loops(), np.abs(state)
    for stretch in stretches[:: max(1, len(stretches) // MOST_STRETCHES)]:
        times = stretch.start + (stretch.stop - stretch.start) * PLACES
        with suppress(RunFailed):  # the run itself will raise the error
            states = loops.solve_all(times, np.tile(state, (len(times), 1)), stretch.mode)
            largest = np.maximum(largest, np.abs(states).max(axis=0))
    return largest


def raised(program: Program, mechanisms: Sequence[str], sizes: Array, levels: Array) -> Any:
    """Return sizes, shape (…, n), raised by those of the same unit, and to their rounding levels."""
    for members, share in ((_owned_units(program, tuple(mechanisms)), SHARE), (unit_numbers(program), SLIGHT)):
        sizes = np.maximum(sizes, share * largest_of_group(sizes, members))
    sizes = np.maximum(sizes, levels)
    return np.maximum(sizes, _levels_at_rest(program, sizes, levels))


def _owned_units(program: Program, mechanisms: tuple[str, ...]) -> Any:
    """Return the number of the group of each state and unknown, by mechanism (or name) and unit."""
    key = "owned units", mechanisms
    if key not in program.kept:
        owners = [next((m for m in mechanisms if n.startswith(f"{m}.")), n) for n in program.variables.names]
        program.kept[key] = group_numbers(list(zip(program.variables.units, owners, strict=True)))
    return program.kept[key]


def rounding_levels(mechanisms: Sequence[str], constraints: Constraints, state: Array, first: Segment) -> Any:
    """Return the rounding level of angles, and of lengths of mechanisms with closed loops, that symmetry leaves."""
    result = smallest_levels(mechanisms, constraints, state, first)
    if constraints:
        units = np.array(constraints.program.variables.units)
        result = result.copy()
        places = np.concatenate([constraints.positions, constraints.speeds])
        length = constraints.length(first.start, state, first.mode)
        result[places] = np.where(
            np.isin(units[places], ["m", "m/s"]), np.maximum(SMALLEST_ANGLE * length, result[places]), result[places]
        )
    return result


def smallest_levels(mechanisms: Sequence[str], constraints: Constraints, state: Array, first: Segment) -> Any:
    """Return the rounding level of angles of mechanisms and their rates, and of speeds of what rolls."""
    angles = smallest_angles(constraints.program, mechanisms)
    return np.maximum(angles, smallest_speeds(constraints, state, first)) if constraints else angles


def _levels_at_rest(program: Program, sizes: Array, levels: Array) -> Any:
    """Return the largest rounding level of each unit, where nothing with this unit is larger; else 0."""
    units = unit_numbers(program)
    level = largest_of_group(levels, units)
    return np.where(largest_of_group(sizes, units) <= RESTING * level, level, 0.0)


def of_what_moved(known: Mapping[str, float], program: Program, levels: Array) -> dict[str, float]:
    """Return known magnitudes without those at the level of rounding: of mechanisms that have rested so far, and of all that has their unit."""
    names = program.variables.names
    sizes = np.array([known.get(n, 0.0) for n in names])
    resting = sizes <= RESTING * np.maximum(levels, _levels_at_rest(program, sizes, levels))
    left_out = {n for n, rests in zip(names, resting.tolist(), strict=True) if rests}
    return {n: magnitude for n, magnitude in known.items() if n not in left_out}


def least_tolerances(
    mechanisms: Sequence[str], constraints: Constraints, state: Array, first: Segment, magnitude: Array
) -> Any:
    """Return lower bounds of absolute tolerances, because projection on loop joints is accurate to rounding only; 0 for other states.

    Coordinates that such joints lock altogether, and storages on them, stay constant to that accuracy, whatever fraction of their magnitude a
    tolerance is.
    """
    levels = rounding_levels(mechanisms, constraints, state, first)
    result, places = np.zeros(len(state)), np.concatenate([constraints.positions, constraints.speeds])
    result[places] = levels[places]
    return ROUNDED * np.maximum(result, _levels_at_rest(constraints.program, magnitude, levels))
