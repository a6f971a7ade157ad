"""Data of one instance of a functional mock-up unit. All of it lies in one block of memory, so a copy of the block is its state."""

from __future__ import annotations

from compiler.api import Floats, Ints, Record, sized

from ...simulation.integrators.acceptance.event_indicators import IndicatorWorkspace
from ...simulation.integrators.acceptance.event_passing import OFTEN
from ...simulation.integrators.linear_algebra.factors import Factors
from ...simulation.integrators.loop_newton import LoopSystem
from ...simulation.integrators.workspace import Function, IntegratorWorkspace

OK, WARNING, DISCARD, ERROR = 0, 1, 2, 3  # answers to an importer
INSTANTIATED, INITIALIZING, EVENTS, RUNNING, TERMINATED, FAILED = 0, 1, 2, 3, 4, 5  # phases of an instance
KEPT = OFTEN + 1  # intervals kept for each event: the last ones, and the longest
# Bits of `makes_steps`: the importer lets events act; a step may end before its communication point.
EVENT_MODE, EARLY_RETURN = 2, 4
REQUIREMENT, TABLE, START = 0, 1, 2  # kinds of limits
# Messages, by their numbers in `messages.py`.
(
    SAID_NOTHING, NO_VALUE, NOT_NOW, TOO_MANY_STEPS, NO_STEP, NOT_FINITE, WRONG_TIME, NO_SLOPE,
    SLIDES, WITHOUT_END, PILED_UP, SET_TWICE, WRONG_SAMPLING, ENDED, CROWDED, SINGULAR, OPEN, NO_SOLUTION,
    NO_TRUTH, MISSED_RATES,
    LIMITS,  # and on: each limit of the model
) = range(21)  # fmt: skip


class EventData(Record):
    """Events of a model, and what their search has seen so far.

    The conditions, their roots and what counts as zero are those of the integration (`root_…` of the workspace).
    """

    find_modes: Function
    find_counts: Function
    find_triggers: Function
    find_values: Function
    find_sampling: Function
    discrete_count: int  # the first items of the mode
    counted_count: int
    event_count: int
    setting_count: int
    sample_count: int
    conditions: IndicatorWorkspace
    counted: Ints  # counted_count: places of whole numbers of states
    counts: Floats = sized("counted_count")
    is_set: Ints = sized("discrete_count")  # 1 where the importer has set the start
    starts: Floats = sized("discrete_count")
    stops: Ints  # event_count: 1 where the event ends the run
    late: Ints  # event_count: 1 where it sets what the event before it has computed
    at_once: Ints = sized("event_count")  # 1 where it does so at the same instant
    owner: Ints  # setting_count: the event
    position: Ints  # setting_count: place in the mode or among the states
    is_mode: Ints  # setting_count
    values: Floats = sized("setting_count")
    sampled: Ints  # sample_count: the event
    sampling: Floats = sized(5, "sample_count")  # period, offset, delay, jitter, seed
    number: Floats = sized("sample_count")  # of the next tick
    triggers: Floats = sized("event_count")
    other_triggers: Floats = sized("event_count")  # with another truth of a condition
    other_roots: Floats = sized("root_count")
    was_true: Ints = sized("event_count")
    due: Ints = sized("event_count")
    acts: Ints = sized("event_count")
    acted: Ints = sized("event_count")  # 1 for those that acted at this instant
    left: Ints = sized("event_count")  # how often in a row an event made its condition false
    when: Floats = sized("event_count")  # instant at which it acted last
    intervals: Floats = sized(KEPT, "event_count")  # between its last instants, the latest first; then the longest one
    floor: Floats = sized("root_count")  # before this instant
    flips: Ints = sized("root_count")  # conditions that change again and again
    rest: Ints = sized("root_count")  # their truth where both sides are equal
    crossed: Ints = sized("root_count")  # those that have crossed zero
    alike: int  # 1 if the rates are equal in the modes of a cycle
    modes_known: int
    resets: int  # 1 if a state was set at this instant
    ended: int
    located: int  # 1 if the last step was cut at an event
    crowded: int  # times in a row that a crossing was found where its step begins
    done: float  # up to here all that is due has acted
    recent: float  # instant from which on events count as simultaneous
    simultaneous: int
    wrong: int  # 1 if the sampling is out of its range
    begins: int  # 1 from the end of the initialization to the first update


class FmuInstance(Record):
    """Values of a model and the state of its integration. n states and unknowns, of which an importer sees the `differential` first, the states.

    Value references count: time, states, their rates, inputs, parameters, outputs, discrete variables.
    """

    find_constants: Function
    find_start: Function
    find_instants: Function
    find_recurring: Function
    find_periods: Function
    find_switches: Function
    find_output: Function
    find_slopes: Function
    find_limits: Function
    find_claims: Function
    solver: IntegratorWorkspace  # it also has the inputs, the constants and the mode
    events: EventData  # nothing where the model has none
    loops: LoopSystem  # nothing where multipliers are the only unknowns
    behind: Factors  # slopes of residuals by unknowns
    has_events: int
    parameter_count: int
    part_count: int
    parts: Ints  # part_count: parameters that say which constraints take part
    input_count: int
    output_count: int
    instant_count: int
    period_count: int
    slope_count: int
    mode_count: int  # of conditions on time
    timed: Ints  # mode_count: their places in the mode
    switches: Floats = sized("mode_count")
    parameters: Floats  # parameter_count
    state: Floats = sized("n")
    is_set: Ints = sized("n")  # 1 where the importer has set the start
    starts: Floats = sized("n")
    written: Floats  # n: start of the model with its own parameters, as its text gives it, and as the run assembles it
    assembled: Floats  # n
    claim_count: int
    claims: Floats = sized("claim_count")
    claimed: Floats  # claim_count: claims on the assembled start
    full: Floats = sized("n")  # states on their constraints, and the unknowns that belong to them
    right: Floats = sized("n")
    rates: Floats = sized("n")
    outputs: Floats = sized("output_count")
    other_rates: Floats = sized("n")  # with another truth of a condition
    other_outputs: Floats = sized("output_count")
    instants: Floats = sized("instant_count")
    recurring_count: int
    recurring: Floats = sized("recurring_count")  # value at time 0 and slope of functions that jump at integers
    periods: Floats = sized("period_count")
    slope_rows: Ints  # slope_count: rates, residuals of unknowns, outputs, invariants
    slope_columns: Ints  # slope_count: states, unknowns, inputs
    slopes: Floats = sized("slope_count")
    seed: Floats = sized("seeds")
    limit_kind: Ints  # for each limit: a requirement, a range of a table, values with which the model has no meaning
    limit_place: Ints  # for each limit the first of its values: of a table the argument and both ends
    limit_values: Floats = sized("limit_numbers")
    time: float
    next_instant: float
    stop: float
    relative: float  # tolerance, of co-simulation
    phase: int
    message: int
    makes_steps: int  # 0 in model exchange; in co-simulation 1, with these bits where the importer allows it
    waiting: int  # 1 if the importer is to let an event act
    constants_known: int
    segment_known: int
    full_known: int
    unheld: int  # 1 if a parameter has changed that may open a loop
    rates_known: int
    outputs_known: int
    slopes_known: int
    broken: int  # 1 if the integration cannot go on from its last step
    goes_on: int  # 1 where steps may go beyond the communication point, as nothing has changed at the last one
    ahead: float  # up to here the last step holds
    cut: int  # 1 where an event ends it there
    own_method: int  # with which an integration begins


def refused(s: FmuInstance, message: int) -> int:
    """Refuse a call of the importer, with a message that says why."""
    s.message = message
    return ERROR
