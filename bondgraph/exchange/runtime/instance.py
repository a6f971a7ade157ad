"""Data of one instance of a functional mock-up unit. All of it lies in one block of memory, so a copy of the block is its state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from compiler.api import Record

from ...simulation.integrators.workspace import Function, IntegratorWorkspace

if TYPE_CHECKING:
    from compiler.api import Floats, Ints

OK, WARNING, DISCARD, ERROR = 0, 1, 2, 3  # answers to an importer
INSTANTIATED, INITIALIZING, EVENTS, RUNNING, TERMINATED, FAILED = 0, 1, 2, 3, 4, 5  # phases of an instance
# Messages, by their numbers in `messages.py`.
SAID_NOTHING, NO_VALUE, NOT_NOW, TOO_MANY_STEPS, NO_STEP, NOT_FINITE, LIMIT_LEFT, TABLE_LEFT, WRONG_TIME, NO_SLOPE = (
    range(10)
)


class FmuInstance(Record):
    """Values of a model and the state of its integration. n states; sizes of arrays after the names.

    Value references count: time, states, their rates, inputs, parameters, outputs.
    """

    find_constants: Function
    find_start: Function
    find_instants: Function
    find_periods: Function
    find_switches: Function
    find_output: Function
    find_slopes: Function
    find_limits: Function
    solver: IntegratorWorkspace  # it also has the inputs, the constants and the mode
    parameter_count: int
    input_count: int
    output_count: int
    instant_count: int
    period_count: int
    slope_count: int
    mode_count: int
    parameters: Floats  # parameter_count
    state: Floats  # n
    is_set: Ints  # n: 1 where the importer has set the start
    starts: Floats  # n
    rates: Floats  # n
    outputs: Floats  # output_count
    instants: Floats  # instant_count
    periods: Floats  # period_count
    slope_rows: Ints  # slope_count: rates, then outputs
    slope_columns: Ints  # slope_count: states, then inputs
    slopes: Floats  # slope_count
    seed: Floats  # n + input_count
    is_table: Ints  # for each limit 1 where nothing is known beyond it
    limit_place: Ints  # for each limit the first of its values: of a table the argument and both ends
    limit_values: Floats
    time: float
    next_instant: float
    stop: float
    relative: float  # tolerance, of co-simulation
    phase: int
    message: int
    makes_steps: int  # 1 in co-simulation
    constants_known: int
    segment_known: int
    rates_known: int
    outputs_known: int
    slopes_known: int
    broken: int  # 1 if the integration cannot go on from its last step
    own_method: int  # with which an integration begins
