"""The record that stepping in machine code works on. All arrays belong to the caller; nothing is allocated, nothing is global."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from ....door import Record
from .factors import ComplexFactors, Factors
from .holding import Held
from .sparse import Pattern

if TYPE_CHECKING:
    from ....door import Floats, Ints

# time, state, inputs, constants, mode, where the values go
Function = Callable[[float, "Floats", "Floats", "Floats", "Floats", "Floats"], None]


class Stepper(Record):
    """Everything that a run over one smooth stretch knows. n states and unknowns; sizes of arrays behind the names."""

    derivative: Function
    entries: Function
    signals: Function
    holds: Function
    dependent: Function
    sensitivities: Function
    powers: Function
    bends: Function
    stored_energy: Function
    roots: Function
    inputs: Floats
    constants: Floats
    mode: Floats
    n: int
    differential: int  # the first of the n are states
    method: int  # one of `methods.py`
    entry_count: int
    rows: Ints  # entry_count
    columns: Ints  # entry_count
    magnitude: Floats  # n
    per_unit: Floats  # n: one over the units of the rates
    ratio: Floats  # entry_count
    # tolerances
    relative: float
    absolute: Floats  # n
    resting: Floats  # n: absolute tolerances before they grow
    held: Ints  # n: 1 where they do not grow
    peak: Floats  # n
    newton_tolerance: float
    first_newton_tolerance: float
    creeping_tolerance: float
    stagnation_tolerance: float
    allowed_estimate: float  # of Radau, in units of the tolerance
    # what a step must see
    signal_count: int
    allowed: Floats  # signal_count
    seen: Floats  # (SEEN + UNSEEN) signal_count
    signal_nodes: int  # places at which the signals are known
    node_time: Floats  # signal_nodes
    node_value: Floats  # signal_nodes signal_count
    node_next: int  # the first of them that lies ahead
    steady: int  # whether they are the same at all of them
    earliest: float
    latest: float
    longest: float
    # bends of laws
    bend_count: int
    bend_seen: Floats  # 6 bend_count: at places of a step, and room
    bend_side: Floats  # bend_count: on which side of all bends the Jacobian was taken
    # conditions that may flip
    root_count: int
    root_said: Ints  # root_count: 1 where the mode says that one holds
    root_strict: Ints  # root_count: 1 where it does not hold at zero
    root_floor: Floats  # root_count: below it lies what rounding leaves
    root_seen: Floats  # interpolants.PLACES root_count
    root_form: Floats  # interpolants.PLACES: the polynomial of one of them
    greatest: Floats  # n: the largest that scaled states have been
    # where it stands
    time: float
    stop: float
    until: float  # where an event ends the last step, or the stop
    size: float
    state: Floats  # n
    rate: Floats  # n
    last_size: float  # 0 before the first step
    last_error: float
    contraction: float  # of the last Newton iteration
    stages: Floats  # 3 n, relative to the start of the last step
    current: int  # whether the Jacobian is that of this state
    known: int  # whether there is a Jacobian
    factorised: int
    factorised_size: float
    negative: int  # whether the determinant of the real matrix is; 0 where it is sparse
    jacobian: Floats  # entry_count
    inner_jacobian: Floats  # entry_count: at an instant within a step
    inner: Factors
    steepness: Floats  # n: what a step is times the sum of a row of it
    # factorised matrices: sparse on a pattern, or dense
    sparse: int
    pattern: Pattern
    real: Factors
    complex: ComplexFactors
    # the last three ends of steps
    ends: int
    end_time: Floats  # 3
    end_state: Floats  # 3 n
    end_slope: Floats  # 3 n
    first_sloped: int  # whether the slope of the first of them is known
    nodes: Floats  # 6
    coefficients: Floats  # 6 n: of the polynomial through them
    node_count: int  # 0: not yet computed
    # of the method that keeps the energy
    energy: float  # to be kept
    energies: Floats  # 1 + n: of a state, and its slopes
    dropped: Floats  # n: by rounding of the last steps
    # of the explicit pair
    slope: Floats  # 16 n: of the stages
    dense: Floats  # 7 n: of the polynomial within the last step
    dense_known: int
    automatic: int  # 1: a step that is held by stability alone is left to another method
    fastest: float  # the rate of the fastest mode, 1/s; 0: not known
    direction: Floats  # n: in which it moves
    since_looked: int  # how many steps ago it was looked for
    held_by_stability: int  # how many of the last steps were
    free_steps: int  # since then
    # room
    si: Floats  # n: states in SI
    z: Floats  # 3 n
    w: Floats  # 3 n
    f: Floats  # 3 n
    change: Floats  # 3 n
    last_change: Floats  # 3 n: that of the last iteration
    scale: Floats  # n
    per_tolerance: Floats  # n: one over the tolerances of a step
    new: Floats  # n
    error: Floats  # n: of the last step, in units of its tolerance
    rest: Floats  # n
    terms: Floats  # n: the sizes of the terms of each equation
    norms: Floats  # STUBBORN: of the last rejected tries
    sizes: Floats  # STUBBORN
    # what is reported
    instants: Floats
    instant_count: int
    position: int
    reported: Floats  # instant_count n
    # limits
    limit_count: int
    left: Ints  # limit_count: 1 where it is known that it does not hold
    truth: Floats  # limit_count
    always: int  # whether every step is looked at by the caller
    # choice of states
    slope_count: int
    slope_rows: Ints
    slope_columns: Ints
    slope_chosen: Ints  # 1: these can change places
    slopes: Floats  # slope_count
    stored: Floats  # differential + dependents
    dependent_count: int
    stored_peak: Floats
    worst: float
    # work
    power_count: int
    work: Floats  # power_count
    power: Floats  # 7 power_count
    partial: Floats  # 2 power_count
    traffic: float
    tolerance: float  # relative, of the work
    pending: int  # 2: nothing has looked at the last step yet; 1: it is not yet closed
    # constraints, and singular poses ahead
    closed: Held
    usual: float  # the longest step where no pose is near
    poses: int  # how many of the last are kept
    pose_time: Floats  # 3
    pose_least: Floats  # 3: smallest singular values
    ahead: float  # time to where it vanishes
    behind: float
    tried: float  # time ahead at the last try to cross that failed
    comes: int
    redundant: int  # whether there are gaps that take no part
    # what it took
    steps: int
    rejected: int
    derivatives: int
    jacobians: int
    factorisations: int
