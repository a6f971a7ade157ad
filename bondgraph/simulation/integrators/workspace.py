"""Workspace of the native integrator. All arrays belong to the caller; nothing is allocated, nothing is global.

One record with many fields, in groups that comments name: see the README for the reason.
"""

from __future__ import annotations

from collections.abc import Callable

from compiler.api import Floats, Ints, Record, sized

from ...numerics.indicators import PLACES
from .dop853 import ALL_STAGES
from .linear_algebra.exponentials import ExponentialTables
from .linear_algebra.factors import ComplexFactors, Factors
from .linear_algebra.sparse import Pattern
from .projection.projection import ProjectionWorkspace
from .radau import STUBBORN
from .selection import StateSelection

# Arguments: time, state, inputs, constants, mode, array for the values.
Function = Callable[[float, "Floats", "Floats", "Floats", "Floats", "Floats"], None]


class IntegratorWorkspace(Record):
    """Data of an integration over one smooth segment. n states and unknowns."""

    # functions of the program
    derivative: Function
    entries: Function
    signals: Function
    holds: Function
    powers: Function
    bends: Function
    peaks: Function
    stored_energy: Function
    roots: Function
    # values of the run, sizes, and the pattern of the Jacobian
    inputs: Floats
    constants: Floats
    mode: Floats
    n: int
    differential: int  # the first of the n are states
    method: int  # one of `methods.py`
    entry_count: int
    rows: Ints  # entry_count
    columns: Ints  # entry_count
    # units of states and rates
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
    # signals that a step must resolve
    signal_count: int
    allowed: Floats  # signal_count
    seen: Floats = sized("looks", "signal_count")
    signal_nodes: int  # number of places at which the signals are known
    node_time: Floats  # signal_nodes
    node_value: Floats  # signal_nodes signal_count
    node_next: int  # index of the first of them that lies ahead
    steady: int  # 1 if they are equal at all of them
    earliest: float
    latest: float
    longest: float
    # kinks of laws
    bend_count: int
    bend_seen: Floats = sized(6, "bend_count")  # values at places of a step, and work space
    bend_side: Floats = sized("bend_count")  # side of each kink at which the Jacobian was computed
    # peaks of laws: places and values, see `steps/peaks.py`
    peak_node_count: int
    peak_nodes: Floats = sized(8)  # fractions of a step at which they are evaluated
    peak_count: int
    peak_seen: Floats = sized(18, "peak_count")  # values at places of a step, and work space
    beside: Floats = sized(3, "n")  # what rates are beside the slope of the step in a peak and outside of it
    peak_ahead: float  # size of the step after one that ends before a peak; else 0
    peak_cuts: int  # tries of this step in which peaks were looked for
    # conditions that may cross zero
    root_count: int
    root_said: Ints = sized("root_count")  # 1 where the condition holds in the mode
    root_strict: Ints  # root_count: 1 where it does not hold at zero
    root_floor: Floats = sized("root_count")  # rounding level
    root_seen: Floats = sized(PLACES, "root_count")
    root_narrow: int  # 1 if an indicator may have narrow peaks, which values at places do not show
    root_form: Floats = sized(PLACES)  # the polynomial of one of them
    greatest: Floats = sized("n")  # largest values of the scaled states
    # current point
    time: float
    stop: float
    until: float  # end of the last step at an event, or the stop
    size: float
    state: Floats  # n
    rate: Floats = sized("n")
    last_size: float  # 0 before the first step
    last_error: float
    contraction: float  # contraction of the last Newton iteration
    rounded: float  # largest rounding, in tolerances, with which a step was accepted
    missed: Floats = sized("n")  # most tolerances by which rates that a step has missed would move each state
    stages: Floats = sized("stage_room", "n")  # relative to the start of the last step
    # Jacobian and the matrices that it gives
    current: int  # 1 if the Jacobian belongs to this state
    known: int  # 1 if there is a Jacobian
    factorised: int
    factorised_size: float
    negative: int  # 1 if the determinant of the real matrix is negative; 0 where it is sparse
    jacobian: Floats = sized("entry_count")
    inner_jacobian: Floats = sized("entry_count")  # at an instant within a step
    inner: Factors
    steepness: Floats = sized("n")  # step size times the sum of the absolute values in a row of the Jacobian
    # polynomials of the last step
    apart: Ints = sized("n")  # how the two polynomials of the last step agree, see `polynomials.py`
    differs: int  # the largest of them
    # factorised matrices: sparse on a pattern, or dense
    sparse: int
    pattern: Pattern
    real: Factors
    complex: ComplexFactors
    second: ComplexFactors  # of methods with more than three stages
    third: ComplexFactors
    # order of Radau's method
    stage_count: int  # of the next step
    smoothed_contraction: float
    since_order: int  # number of steps with this many stages
    # the last three ends of steps
    ends: int
    end_time: Floats = sized(3)
    end_state: Floats = sized(3, "n")
    end_slope: Floats = sized(3, "n")
    first_sloped: int  # 1 if the rates at the first of them are known
    nodes: Floats = sized(6)
    coefficients: Floats = sized(6, "n")  # coefficients of the polynomial through them
    node_count: int  # 0: not yet computed
    # matrix exponential
    exponentials: ExponentialTables
    # energy-conserving method
    energy: float  # energy to be conserved
    energies: Floats = sized("n", plus=1)  # energy of a state, and its gradient
    dropped: Floats = sized("n")  # rounding errors of the last steps
    # DOP853
    slope: Floats = sized(ALL_STAGES, "n")  # rates of the stages
    dense: Floats = sized(7, "n")  # coefficients of the dense output of the last step
    dense_known: int
    # search for the fastest mode
    automatic: int  # 1: where only stability limits the steps, another method goes on
    fastest: float  # the rate of the fastest mode, 1/s; 0: not known
    direction: Floats = sized("n")  # direction of the fastest mode
    since_looked: int  # number of steps since the last search for it
    held_by_stability: int  # number of last steps limited by stability
    free_steps: int  # number of other steps since then
    # work arrays
    si: Floats = sized("n")  # states in SI
    z: Floats = sized("stage_room", "n")
    w: Floats = sized("stage_room", "n")
    f: Floats = sized("stage_room", "n")
    change: Floats = sized("stage_room", "n")
    last_change: Floats = sized("stage_room", "n")  # that of the last iteration
    scale: Floats = sized("n")
    per_tolerance: Floats = sized("n")  # one over the tolerances of a step
    new: Floats = sized("n")
    error: Floats = sized("n")  # error of the last step, in units of its tolerance
    rest: Floats = sized("n")
    terms: Floats = sized("n")  # the sizes of the terms of each equation
    norms: Floats = sized(STUBBORN)  # of the last rejected tries
    sizes: Floats = sized(STUBBORN)
    # reported states
    instants: Floats = sized("instant_count")
    instant_count: int
    position: int
    reported: Floats = sized("instant_count", "n")
    # states at places of all steps, for the extremes of the outputs
    place_count: int  # in each step; 0: none are kept
    places: Floats = sized("place_count")  # fractions of a step
    kept: int  # number of instants that are stored
    kept_room: int
    kept_time: Floats = sized("kept_room")
    kept_state: Floats = sized("kept_room", "n")
    # limits
    limit_count: int
    left: Ints = sized("limits")  # 1 where a violation is known
    truth: Floats = sized("limits")
    always: int  # 1 if the caller checks every step
    selection: StateSelection
    # work
    power_count: int
    work: Floats = sized("power_count")
    power: Floats = sized(7, "power_count")
    partial: Floats = sized(2, "power_count")
    traffic: float
    tolerance: float  # relative, of the work
    pending: int  # 2: the last step has not been checked yet; 1: it is not yet complete
    # constraints, and singular poses ahead
    closed: ProjectionWorkspace
    usual: float  # the longest step where no pose is near
    poses: int  # number of last ones stored
    pose_time: Floats = sized(3)
    pose_least: Floats = sized(3)  # smallest singular values
    ahead: float  # extrapolated time until it vanishes
    behind: float
    tried: float  # time ahead at the last failed try to cross
    comes: int
    redundant: int  # 1 if there are inactive residuals
    # statistics
    steps: int
    derivatives: int
    jacobians: int
    factorisations: int
