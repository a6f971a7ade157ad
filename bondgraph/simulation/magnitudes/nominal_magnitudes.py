"""Magnitude of each state in a run, so that an absolute tolerance means the same for nanometres and megapascals.

Values of the author have priority. Otherwise the start and a pilot run of implicit Euler over the whole time (L-stable, so fast modes only
follow) give the magnitude, together with the reach of a free motion from there: the speed of a part that is pushed slowly is measured by
the speed at which it would swing back. States of one unit raise each other a little: a coordinate that happens to stay at zero must not be
integrated to round-off.

States on which a pilot run gives no information have upper bounds from the rates at the start alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ...errors import RunFailed
from ...numerics.scales import equilibrated, group_numbers, largest_of_group
from ...quantities import listed
from ...results.records import ToleranceDoubt
from ..constraints.constraints import Constraints
from ..integrators.pilot.schedule import unit_numbers
from ..segments.timeline import Segment
from .pilot_run import (
    LEFT,
    SMALLEST_ANGLE,
    STEPS,
    PilotObservation,
    PilotObserver,
    PilotRun,
    smallest_angles,
    smallest_speeds,
    trusted,
)

ROUNDED = 1e-3  # relative to the smallest angle: remainder of a projection on loop joints
DIGITS = 8  # places that differ by rounding, at which rates are compared
CAUTIOUS = 1e-6  # fraction of the charge that sources could bring in a run: magnitude of an unknown state
RESTING = 2.0  # levels of rounding: what has a smaller magnitude has not moved
SHARE = 1e-2  # least magnitude relative to the largest state of the same unit in the same mechanism
PLACES = (np.arange(8) + 0.381966) / 8  # shares of a segment, at no simple fraction of a period
SLIGHT = 1e-4  # the same relative to the whole model: charge of a junction beside that of a buffer capacitor
BOUND_PLACES = 9  # places of a segment at which the rates are evaluated
MOST_STRETCHES = 64


@dataclass(frozen=True, slots=True)
class Magnitudes:
    """Magnitudes of a run.

    `values`, shape (n,), in SI; `moved`: the same, 0 for what nothing moves, whose value is the largest of all, or 1; `stopped`: the time at which the
    pilot run gave up, if it did; `unknown`: the states without information, whose magnitude is what sources could bring, and a small fraction of it then;
    `resting`: those that only rounding moves, whose tolerance is a part of their rounding level.
    """

    values: Any
    moved: Any
    stopped: float | None
    unknown: tuple[str, ...]
    resting: tuple[str, ...]
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
        coarse: PilotRun | None = None
        smallest = smallest_levels(mechanisms, constraints, state, stretches[0])

        def look_along(way: Sequence[Segment]) -> PilotObserver:
            nonlocal coarse
            coarse = PilotRun(constraints, state, smallest, coarse)  # all begin at one state
            return PilotObserver(coarse.peak(way, choice), coarse.beginning, coarse.stopped, coarse.sure)

        first = stretches[0]
        look = trusted(
            look_along, program, stretches, len(program.signals(first.start, inputs, constants, first.mode)) > 0
        )
    if look is not None:
        peak, stopped = np.maximum(peak, look.largest), look.stopped
    elif len(peak):
        peak = np.maximum(peak, _without_states(constraints, state, stretches))
    sizes = np.where(given > 0, given, peak)
    levels = rounding_levels(mechanisms, constraints, state, stretches[0])
    levels = np.maximum(levels, _cancelled(constraints, mechanisms, state, sizes, stretches))
    result = raised(program, mechanisms, sizes, levels)
    resting = (levels > 0) & (result <= RESTING * np.maximum(levels, _levels_at_rest(program, result, levels)))
    if resting.any() and not constraints:  # beside closed loops tolerances have a lower bound of their own
        rtol = LEFT if choice is None else choice.rtol
        noise = _noise(constraints, state, sizes, resting, stretches) / rtol
        result = np.where(resting, np.maximum(above_rounding(rtol) * result, noise), result)
    unknown = (result == 0) | ~np.isfinite(result)
    values = result
    if unknown.any():
        charged = CAUTIOUS * chargeable(constraints, state, stretches, np.where(unknown, 0.0, result))
        result[unknown] = charged[unknown]
        values = np.where(result > 0, result, charged.max() or CAUTIOUS)
    names, still = (tuple(program.variables.names[i] for i in np.flatnonzero(some)) for some in (unknown, resting))
    return Magnitudes(values, result, stopped, names, still, look)


def above_rounding(rtol: float) -> float:
    """Return the factor on rounding levels with which relative tolerances of what rests are a part `LEFT` of these, at least."""
    return max(1.0, LEFT / rtol)


def _noise(constraints: Constraints, state: Array, sizes: Array, resting: Array, stretches: Sequence[Segment]) -> Any:
    """Return what rounding moves in the whole run of states that rest in an open mechanism: rates change so much with the last digits of the others."""
    program, first = constraints.program, stretches[0]
    if program.unknowns.names:
        return np.zeros(len(sizes))
    whole, place = stretches[-1].stop - first.start, np.where(resting, state, np.maximum(sizes, np.abs(state)))
    fixed = constraints.inputs, constraints.constants, first.mode
    places = [place * (1 + k * np.finfo(float).eps * (1 + np.arange(len(place)) % 3)) for k in range(DIGITS)]
    rates = np.array([program.derivative(first.start, p, *fixed) for p in places])
    slopes = np.where(resting, np.abs(program.jacobian(first.start, place, *fixed)), 0.0)
    moved = np.where(resting, whole * np.ptp(rates, axis=0), 0.0)
    return np.nan_to_num(np.maximum(moved, whole * (slopes @ moved)), nan=0.0, posinf=0.0)


def _cancelled(
    constraints: Constraints, mechanisms: Sequence[str], state: Array, sizes: Array, stretches: Sequence[Segment]
) -> Any:
    """Return the rounding level of lengths and speeds of open mechanisms whose terms cancel, as of a cart that carries mirrored pendulums; 0 for others.

    A step of a pilot run adds the terms of a rate over its length, or over the time in which the state itself decays.
    """
    program, first = constraints.program, stretches[0]
    owned = smallest_angles(program, mechanisms, ("m", "m/s")) > 0
    small = owned & (sizes < SMALLEST_ANGLE * sizes.max(initial=0.0))
    if constraints or program.unknowns.names or not small.any():
        return np.zeros(len(sizes))
    places = np.array([state, sizes])
    slopes = np.abs(program.jacobian(first.start, places, constraints.inputs, constraints.constants, first.mode)).max(0)
    step = (stretches[-1].stop - first.start) / STEPS
    terms = step * slopes / (1 + step * np.diag(slopes))[:, None]
    levels = np.where(small, SMALLEST_ANGLE * (terms @ sizes), 0.0)
    return np.maximum(levels, np.where(small, terms @ levels, 0.0))


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


def chargeable(constraints: Constraints, state: Array, stretches: Sequence[Segment], known: Array) -> Any:
    """Return magnitudes of all states and unknowns, shape (n,).

    First the change at the largest rates over the whole run, or over the time in which a state itself brings its rate to zero: a diode at its full
    voltage would else bring 1e80 C. Then the effect of other states, link by link of the Jacobian. `known`: the known magnitudes, 0 elsewhere. A state
    that nothing moves and nothing couples stays 0.
    """
    program, inputs, constants = constraints.program, constraints.inputs, constraints.constants
    whole = stretches[-1].stop - stretches[0].start
    result = np.array(known, dtype=float)
    count = len(program.states.names)
    differential = np.arange(len(result)) < count
    changes, (rows, columns) = np.zeros(len(result)), program.pattern
    own = rows == columns
    with np.errstate(all="ignore"):
        for stretch in stretches[:: max(1, len(stretches) // MOST_STRETCHES)]:
            for time in np.linspace(stretch.start, stretch.stop, BOUND_PLACES):
                place = time, state, inputs, constants, stretch.mode
                rates, returns = np.abs(program.derivative(*place)), np.zeros(len(result))
                returns[rows[own]] = -np.asarray(program.jacobian_entries(*place))[own]
                change = rates / np.maximum(returns, 1.0 / whole)
                changes = np.maximum(changes, np.where(np.isfinite(change), change, 0.0))
        first = stretches[0]
        entries = program.jacobian_entries(first.start, state, inputs, constants, first.mode)
    entries = np.where(np.isfinite(entries), entries, 0.0)
    follow = _followed(program, entries)
    gain = np.where(differential[rows], whole * np.abs(entries), 0.0)
    missing = result == 0
    result[missing & differential] = changes[missing & differential]
    for _ in range(len(result)):
        missing = (result == 0) | ~np.isfinite(result)
        if not missing.any():
            break
        brought, here = np.zeros(len(result)), np.where(missing, 0.0, result)
        np.maximum.at(brought, rows, gain * here[columns])
        brought[count:] = (follow * here[:count]).max(axis=1, initial=0.0)
        new = missing & (brought > 0) & np.isfinite(brought)
        if not new.any():
            break
        result[new] = brought[new]
    return np.where(np.isfinite(result), result, 0.0)


def _followed(program: Program, entries: Array) -> Any:
    """Return how far the unknowns of loops follow each state, shape (unknowns, states), from the derivatives of their residuals, whose units are others."""
    count, unknowns = len(program.states.names), len(program.unknowns.names)
    (rows, columns), whole = program.pattern, np.zeros((unknowns, count + unknowns))
    of_loops = rows >= count
    whole[rows[of_loops] - count, columns[of_loops]] = entries[of_loops]
    scaled, row_sizes, column_sizes = equilibrated(whole[:, count:])
    inverse = np.abs(np.linalg.pinv(scaled)) / column_sizes[:, None] / row_sizes
    return inverse @ np.abs(whole[:, :count])
