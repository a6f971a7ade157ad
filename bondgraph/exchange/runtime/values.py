"""Values of an instance: what importers set and read, and what follows from it. Nothing is computed before it is read."""

from __future__ import annotations

from math import isfinite

from compiler.api import Bytes, Floats, ShortInts

from ...simulation.phases.notes import MISSED
from .conditions import indicate
from .constraints import complete, connect, factorise_slopes, put_assembled, spread
from .events import start_modes
from .instance import (
    ERROR,
    EVENTS,
    INITIALIZING,
    INSTANTIATED,
    LIMITS,
    MISSED_RATES,
    NO_SLOPE,
    NO_TRUTH,
    NO_VALUE,
    NOT_FINITE,
    NOT_NOW,
    OK,
    REQUIREMENT,
    RUNNING,
    START,
    WARNING,
    FmuInstance,
    refused,
)
from .segment import INFINITE, enter_segment, forget, inside, near_ticks, place_ticks, tick


def settle(s: FmuInstance) -> None:
    """Compute what follows from the parameters, the segment of time, and before the run begins the mode."""
    w = s.solver
    connect(s)
    if s.constants_known == 0:
        s.find_constants(0.0, s.state, w.inputs, s.parameters, w.mode, w.constants)
        if s.phase <= INITIALIZING and w.n > 0:
            s.find_start(0.0, s.state, w.inputs, w.constants, w.mode, s.starts)
            for i in range(w.differential):
                if s.is_set[i] == 0:
                    s.state[i] = s.starts[i]
            put_assembled(s)
        if s.has_events != 0:
            place_ticks(s)
        s.constants_known = 1
        s.segment_known = 0
        forget(s)
    if s.segment_known == 0:
        enter_segment(s)
        s.segment_known = 1
        forget(s)
    if s.has_events != 0 and s.phase <= INITIALIZING and s.events.modes_known == 0:
        start_modes(s)
        s.events.modes_known = 1
        s.full_known = 0


def find_rates(s: FmuInstance) -> int:
    """Compute the rates of the states."""
    settle(s)
    w = s.solver
    if s.rates_known == 0 and w.n > 0:
        failed = complete(s)
        if failed != OK:
            return failed
        if w.closed.multipliers == 0:
            w.derivative(inside(s), s.full, w.inputs, w.constants, w.mode, s.rates)
        for i in range(w.differential):
            if not isfinite(s.rates[i]):
                return refused(s, NOT_FINITE)
    s.rates_known = 1
    return OK


def find_outputs(s: FmuInstance) -> int:
    """Compute the outputs."""
    settle(s)
    w = s.solver
    if s.outputs_known == 0 and s.output_count > 0:
        failed = complete(s)
        if failed != OK:
            return failed
        s.find_output(inside(s), s.full, w.inputs, w.constants, w.mode, s.outputs)
        for i in range(s.output_count):
            if not isfinite(s.outputs[i]):
                return refused(s, NOT_FINITE)
        s.outputs_known = 1
    return OK


def find_all_slopes(s: FmuInstance) -> int:
    """Compute the slopes of rates and outputs by states and inputs."""
    settle(s)
    w = s.solver
    if s.slopes_known == 0 and s.slope_count > 0:
        failed = complete(s)
        if failed != OK:
            return failed
        s.find_slopes(inside(s), s.full, w.inputs, w.constants, w.mode, s.slopes)
        if not factorise_slopes(s):
            return refused(s, NOT_FINITE)
        s.slopes_known = 1
    return OK


def get_values(s: FmuInstance, references: ShortInts, count: int, values: Floats) -> int:
    """Put the values of some references into an array."""
    n = s.solver.differential
    if count < 0:
        return refused(s, NO_VALUE)
    for k in range(count):
        place = references[k]
        if place == 0:
            values[k] = s.time
        elif place < 0:
            return refused(s, NO_VALUE)
        elif place <= n:
            settle(s)
            values[k] = s.state[place - 1]
        elif place <= 2 * n:
            failed = find_rates(s)
            if failed != OK:
                return failed
            values[k] = s.rates[place - 1 - n]
        elif place <= 2 * n + s.input_count:
            values[k] = s.solver.inputs[place - 1 - 2 * n]
        elif place <= 2 * n + s.input_count + s.parameter_count:
            values[k] = s.parameters[place - 1 - 2 * n - s.input_count]
        elif place <= 2 * n + s.input_count + s.parameter_count + s.output_count:
            failed = find_outputs(s)
            if failed != OK:
                return failed
            values[k] = s.outputs[place - 1 - 2 * n - s.input_count - s.parameter_count]
        elif is_mode(s, mode_place(s, place)):
            settle(s)
            values[k] = s.solver.mode[mode_place(s, place)]
        elif s.has_events != 0 and 0 <= mode_place(s, place) - s.events.discrete_count < s.solver.root_count:
            settle(s)
            indicate(s, s.events.conditions.change)
            values[k] = s.events.conditions.change[mode_place(s, place) - s.events.discrete_count]
        else:
            return refused(s, NO_VALUE)
    return OK


def get_clocks(s: FmuInstance, references: ShortInts, count: int, values: Bytes) -> int:
    """Tell which sampled events are due, at an initialization or in event mode; where the run begins, those that have acted."""
    for k in range(count):
        place = (
            mode_place(s, references[k]) - s.events.discrete_count - s.solver.root_count if s.has_events != 0 else -1
        )
        if place < 0 or place >= s.events.sample_count:
            return refused(s, NO_VALUE)
        if s.phase != EVENTS and s.phase != INITIALIZING:
            return refused(s, NOT_NOW)
        settle(s)
        acted = s.events.begins != 0 and s.events.acted[s.events.sampled[place]] != 0
        values[k] = 1 if acted or tick(s.events, place) <= s.time + near_ticks(s, place) else 0
    return OK


def mode_place(s: FmuInstance, reference: int) -> int:
    """Return the place of a discrete variable in the mode."""
    return reference - 1 - 2 * s.solver.differential - s.input_count - s.parameter_count - s.output_count


def is_mode(s: FmuInstance, place: int) -> bool:
    """Return True if there is a discrete variable at a place of the mode."""
    return s.has_events != 0 and place >= 0 and place < s.events.discrete_count


def set_values(s: FmuInstance, references: ShortInts, count: int, values: Floats) -> int:
    """Set states, inputs, parameters, and before the run begins discrete variables."""
    n = s.solver.differential
    if count < 0:
        return refused(s, NO_VALUE)
    for k in range(count):
        if not isfinite(values[k]):
            return refused(s, NOT_FINITE)
        place = references[k] - 1
        if 0 <= place < n:
            if s.phase == RUNNING and s.makes_steps != 0:
                return refused(s, NOT_NOW)
            s.state[place] = values[k]
            s.is_set[place] = 1
            forget(s)
        elif 2 * n <= place < 2 * n + s.input_count:
            if s.solver.inputs[place - 2 * n] != values[k]:
                s.solver.inputs[place - 2 * n] = values[k]
                s.broken = 1
                forget(s)
        elif 2 * n + s.input_count <= place < 2 * n + s.input_count + s.parameter_count:
            for i in range(s.part_count):
                if s.parts[i] == place - 2 * n - s.input_count:
                    return refused(s, NO_VALUE)
            if s.phase > INITIALIZING and s.unheld == 0 and s.solver.closed.constraints > 0:
                settle(s)
                failed = complete(s)
                if failed != OK:
                    return failed
                s.unheld = 1
            s.parameters[place - 2 * n - s.input_count] = values[k]
            s.constants_known = 0
            s.broken = 1
        elif is_mode(s, mode_place(s, references[k])) and s.phase <= INITIALIZING:
            s.solver.mode[mode_place(s, references[k])] = values[k]
            s.events.is_set[mode_place(s, references[k])] = 1
            forget(s)
        else:
            return refused(s, NO_VALUE)
    return OK


def get_slopes(s: FmuInstance, unknowns: ShortInts, unknown_count: int, knowns: ShortInts, known_count: int, seed: Floats, result: Floats) -> int:  # fmt: skip
    """Compute the derivatives of rates and outputs along a direction of states and inputs."""
    if begin_slopes(s, min(unknown_count, known_count)) != OK:
        return ERROR
    for k in range(known_count):
        column = column_of(s, knowns[k] - 1)
        if column < 0:
            return refused(s, NO_SLOPE)
        s.seed[column] += seed[k]
    spread(s)
    for k in range(unknown_count):
        row = row_of(s, unknowns[k] - 1)
        if row < 0:
            return refused(s, NO_SLOPE)
        result[k] = slope_along(s, row)
    return OK


def slope_along(s: FmuInstance, row: int) -> float:
    """Return the derivative of a rate or an output along the direction in `seed`."""
    total = 0.0
    for i in range(s.slope_count):
        if s.slope_rows[i] == row:
            total += s.slopes[i] * s.seed[s.slope_columns[i]]
    return total


def get_adjoint_slopes(
    s: FmuInstance, unknowns: ShortInts, unknown_count: int, knowns: ShortInts, known_count: int, seed: Floats, result: Floats
) -> int:  # fmt: skip
    """Compute the derivatives of a sum of rates and outputs, each with a factor."""
    if begin_slopes(s, min(unknown_count, known_count)) != OK:
        return ERROR
    if s.solver.closed.constraints > 0 or s.behind.n > 0:
        return get_adjoints_one_by_one(s, unknowns, unknown_count, knowns, known_count, seed, result)
    for k in range(unknown_count):
        row = row_of(s, unknowns[k] - 1)
        if row < 0:
            return refused(s, NO_SLOPE)
        for i in range(s.slope_count):
            if s.slope_rows[i] == row:
                s.seed[s.slope_columns[i]] += seed[k] * s.slopes[i]
    for k in range(known_count):
        column = column_of(s, knowns[k] - 1)
        if column < 0:
            return refused(s, NO_SLOPE)
        result[k] = s.seed[column]
    return OK


def get_adjoints_one_by_one(
    s: FmuInstance, unknowns: ShortInts, unknown_count: int, knowns: ShortInts, known_count: int, seed: Floats, result: Floats
) -> int:  # fmt: skip
    """Compute the same, along each known: what leads through constraints and unknowns has no slopes of its own."""
    for k in range(known_count):
        column = column_of(s, knowns[k] - 1)
        if column < 0:
            return refused(s, NO_SLOPE)
        clear_seed(s)
        s.seed[column] = 1.0
        spread(s)
        result[k] = 0.0
        for i in range(unknown_count):
            row = row_of(s, unknowns[i] - 1)
            if row < 0:
                return refused(s, NO_SLOPE)
            result[k] += seed[i] * slope_along(s, row)
    return OK


def begin_slopes(s: FmuInstance, count: int) -> int:
    """Compute the slopes, and begin with a direction of zeros."""
    if count < 0:
        return refused(s, NO_VALUE)
    clear_seed(s)
    return find_all_slopes(s)


def clear_seed(s: FmuInstance) -> None:
    """Begin with a direction of zeros."""
    for i in range(s.solver.n + s.input_count):
        s.seed[i] = 0.0


def column_of(s: FmuInstance, place: int) -> int:
    """Return the column of the slopes of a state or an input; -1 for what has none."""
    n = s.solver.differential
    if 0 <= place < n:
        return place
    return place - 2 * n + s.solver.n if 2 * n <= place < 2 * n + s.input_count else -1


def row_of(s: FmuInstance, place: int) -> int:
    """Return the row of the slopes of a rate or an output; -1 for what has none."""
    n = s.solver.differential
    before = 2 * n + s.input_count + s.parameter_count
    if n <= place < 2 * n:
        return place - n
    if before <= place < before + s.output_count:
        return place - before + s.solver.n
    return -1


def check_limits(s: FmuInstance) -> int:
    """Look at the limits of the model at the current values, and at what a run tells of conditions and rates."""
    settle(s)
    w = s.solver
    answer = OK
    for i in range(w.differential):
        if w.missed[i] > MISSED:
            w.missed[i] = 0.0
            s.message = MISSED_RATES
            answer = WARNING
    if w.limit_count + w.root_count == 0:
        return answer
    failed = complete(s)
    if failed == OK and w.root_count > 0:
        failed = check_conditions(s)
    if failed != OK or w.limit_count == 0:
        return max(failed, answer)
    w.holds(inside(s), s.full, w.inputs, w.constants, w.mode, w.truth)
    return max(judge_limits(s, inside(s), s.full), answer)


def check_conditions(s: FmuInstance) -> int:
    """Refuse a condition without a value where something reads it: what a root of -1 is compared with would count as false."""
    w = s.solver
    roots = s.events.conditions.root
    w.roots(inside(s), s.full, w.inputs, w.constants, w.mode, roots)
    for j in range(w.root_count):
        if not roots[j] <= INFINITE and decides(s, j):
            return refused(s, NO_TRUTH)
    return OK


def decides(s: FmuInstance, j: int) -> bool:
    """Return True if anything reads a condition: one beside it may leave it without effect."""
    e = s.events
    w = s.solver
    differing = 0
    for compares in range(2):
        place = e.conditions.places[j]
        w.mode[place] = 1.0 - w.mode[place]
        forget(s)
        find_rates(s)
        find_outputs(s)
        w.roots(inside(s), s.full, w.inputs, w.constants, w.mode, e.conditions.root)
        if e.event_count > 0:
            e.find_triggers(s.time, s.full, w.inputs, w.constants, w.mode, e.triggers)
        differing += set_aside(s.rates, w.n, s.other_rates, compares)
        differing += set_aside(s.outputs, s.output_count, s.other_outputs, compares)
        differing += set_aside(e.triggers, e.event_count, e.other_triggers, compares)
        differing += set_aside(e.conditions.root, w.root_count, e.other_roots, compares)
    return differing > 0


def set_aside(values: Floats, count: int, aside: Floats, compares: int) -> int:
    """Copy values, or return how many differ from those that were copied."""
    differing = 0
    for i in range(count):
        if compares == 0:
            aside[i] = values[i]
        elif aside[i] != values[i] and (aside[i] <= INFINITE or values[i] <= INFINITE):
            differing += 1
    return differing


def judge_limits(s: FmuInstance, time: float, state: Floats) -> int:
    """Judge the truth of the limits at a state: a table that is left by more than the tolerance is an error, a requirement a warning, once."""
    w = s.solver
    answer = OK
    for k in range(w.limit_count):
        if w.truth[k] == 1.0 or w.left[k] != 0:
            continue
        if s.limit_kind[k] == REQUIREMENT:
            w.left[k] = 1
            s.message = LIMITS + k
            answer = WARNING
            continue
        if s.limit_kind[k] == START:
            return refused(s, LIMITS + k)
        s.find_limits(time, state, w.inputs, w.constants, w.mode, s.limit_values)
        at = s.limit_place[k]
        x = s.limit_values[at]
        low = s.limit_values[at + 1]
        high = s.limit_values[at + 2]
        if not max(low - x, x - high) <= s.relative * (high - low):
            return refused(s, LIMITS + k)
    return answer


def check_start(s: FmuInstance) -> int:
    """Refuse parameters with which the model has no meaning, and starts that are not finite."""
    w = s.solver
    for i in range(w.n):
        if not isfinite(s.state[i]):
            return refused(s, NOT_FINITE)
    if w.limit_count > 0:
        w.holds(inside(s), s.state, w.inputs, w.constants, w.mode, w.truth)
    for k in range(w.limit_count):
        if s.limit_kind[k] == START and w.truth[k] != 1.0:
            return refused(s, LIMITS + k)
    return OK


def may_start(s: FmuInstance) -> int:
    """Begin the initialization."""
    if s.phase != INSTANTIATED:
        return refused(s, NOT_NOW)
    s.phase = INITIALIZING
    return OK


def have_none(s: FmuInstance, count: int) -> int:
    """Answer to a request of values of a type that no quantity has."""
    return OK if count == 0 else refused(s, NO_VALUE)


def refuse(s: FmuInstance) -> int:
    """Refuse what no unit of ours does."""
    return refused(s, NOT_NOW)
