"""Initial fields of an `IntegratorWorkspace` at the start of a segment."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ....numerics.indicators import PLACES
from ...segments.context import SegmentContext
from ...segments.timeline import LOOKS, Segment, Signals, inside
from .. import dop853
from ..linear_algebra.exponentials import LARGEST, room_for_tables
from ..linear_algebra.factorise import is_large
from ..linear_algebra.factors import ComplexFactors, Factors, room_for
from ..methods import METHODS
from ..radau import STUBBORN
from ..tolerances import FIRST, allowed_estimate, creeping_tolerance, newton_tolerance, stagnation_tolerance

COUNTS = "steps", "rejected", "derivatives", "jacobians", "factorisations", "negative"
# Fields of a new solver: of the search for the fastest mode, and of what steps share with each other.
UNMEASURED = {"fastest": 0.0, "since_looked": dop853.LOOK_AGAIN, "held_by_stability": 0, "free_steps": 0}
FORGOTTEN = dict.fromkeys(
    ("ends", "known", "current", "factorised", "first_sloped", "node_count", "pending", "last_size", "last_error", "contraction"), 0
)  # fmt: skip
BEGUN = UNMEASURED | dict.fromkeys(COUNTS, 0)  # of a new segment
LARGEST_DENSE = 1000  # states; beyond, even a full matrix is factorised with a sparse ordering


def is_sparse(program: Program) -> bool:
    """Return True if the linear algebra is sparse."""
    count = len(program.states.names) + len(program.unknowns.names)
    return is_large(count, len(program.pattern[0])) or count > LARGEST_DENSE


def is_piecewise_affine(program: Program) -> bool:
    """Return True if in each mode the rates are affine in the states."""
    hybrid = program.hybrid
    return hybrid is not None and hybrid.affine and program.bends is None and not program.unknowns.names


def given_at(
    context: SegmentContext, stretch: Segment, state: Array, longest: float, signals: Signals
) -> dict[str, Any]:
    """Return the fields that depend on the run and on its current state."""
    program, tolerances = context.program, context.tolerances
    rows, columns = program.pattern
    differential = len(program.states.names)
    magnitude = np.asarray(tolerances.magnitude, dtype=float)
    unit = np.array(magnitude)
    unit[..., differential:] = 1.0  # the factorisation scales residuals
    scaled, resting = state / magnitude, tolerances.scaled
    relative = tolerances.relative
    earliest, latest = inside(stretch)
    return {
        "inputs": context.inputs, "constants": context.constants, "mode": np.array(stretch.mode, dtype=float),
        "rows": rows, "columns": columns, "magnitude": magnitude, "per_unit": 1.0 / unit,
        "ratio": magnitude[..., columns] / unit[..., rows], "relative": relative, "absolute": np.array(resting, dtype=float), "resting": resting,
        "held": tolerances.held, "peak": np.maximum(np.abs(scaled), 1.0),
        "allowed_estimate": allowed_estimate(relative), "newton_tolerance": newton_tolerance(relative, 1.0),
        "first_newton_tolerance": newton_tolerance(relative, FIRST), "creeping_tolerance": creeping_tolerance(relative),
        "stagnation_tolerance": stagnation_tolerance(relative),
        **signal_fields(signals, stretch.start),
        "earliest": earliest, "latest": latest, "longest": longest, "usual": longest,
        "time": stretch.start, "stop": float(stretch.stop), "until": float(stretch.stop),
        "state": np.array(scaled, dtype=float), "tolerance": relative,
    }  # fmt: skip


def room_of(program: Program, method: int, signals: int, bends: int, peaks: int) -> dict[str, Any]:
    """Return the other fields, which depend on the program and the method alone."""
    n = len(program.states.names) + len(program.unknowns.names)
    differential, entries = len(program.states.names), len(program.pattern[0])
    large = is_sparse(program)
    row = METHODS[method]
    stages = row.stages * n
    pair = partial(room_for, ComplexFactors)
    order = 3 * n if row.conserving else 0 if large else n  # size of the linear systems
    limits = len(program.limits)
    conditions = () if program.hybrid is None else program.hybrid.conditions
    narrow = program.time_functions is not None and bool(program.time_functions.conditions)
    room: Callable[[int], Any] = partial(np.zeros, dtype=float)
    whole: Callable[[int], Any] = partial(np.zeros, dtype=np.int64)
    return {
        "root_count": len(conditions), "root_said": whole(len(conditions)),
        "root_strict": np.array([c.strict for c in conditions], dtype=np.int64), "root_floor": room(len(conditions)),
        "root_seen": room(PLACES * len(conditions)), "root_narrow": int(narrow), "root_form": room(PLACES), "greatest": room(n),
        "bend_count": bends, "bend_seen": room(6 * bends), "bend_side": room(bends), "beside": room(3 * n if peaks else 0),
        "peak_count": peaks // 2, "peak_seen": room(9 * peaks), "peak_ahead": 0.0, "peak_node_count": 0, "peak_nodes": room(8), "peak_cuts": 0,
        "n": n, "differential": differential, "method": method, "entry_count": entries,
        "seen": room(max(len(LOOKS), len(dop853.LOOKS)) * signals), "poses": 0, "pose_time": room(3), "pose_least": room(3),
        "ahead": 0.0, "behind": 0.0, "tried": 0.0, "comes": 0, "size": 0.0, "rate": room(n),
        "rounded": 0.0,
        "last_size": 0.0, "last_error": 0.0, "contraction": 0.0, "stages": room(stages), "current": 0, "known": 0, "factorised": 0, "negative": 0,
        "factorised_size": 0.0, "jacobian": room(entries), "steepness": room(n), "inner_jacobian": room(entries),
        "inner": room_for(Factors, 0 if row.conserving or large else n), "sparse": int(large),
        "real": room_for(Factors, order), "complex": pair(0 if row.conserving else order), "ends": 0,
        "second": pair(order if row.stages > 3 else 0), "third": pair(order if row.stages > 3 else 0),
        "stage_count": 0, "smoothed_contraction": 0.0, "since_order": 0,
        "end_time": room(3), "end_state": room(3 * n), "end_slope": room(3 * n), "first_sloped": 0, "nodes": room(6),
        "coefficients": room(6 * n), "node_count": 0, "apart": whole(n), "differs": 0, "si": room(n), "z": room(stages), "w": room(stages), "f": room(stages),
        "change": room(stages), "last_change": room(stages), "scale": room(n), "per_tolerance": room(n), "new": room(n), "error": room(n),
        "rest": room(n), "terms": room(n), "norms": room(STUBBORN), "sizes": room(STUBBORN),
        "instants": room(0), "instant_count": 0, "position": 0, "reported": room(0),
        "place_count": 0, "places": room(0), "kept": 0, "kept_room": 0, "kept_time": room(0), "kept_state": room(0),
        "limit_count": limits if program.watched else 0, "left": whole(limits),
        "truth": room(limits), "always": int(program.watched and n > differential), "selection": {"slope_count": 0}, "power_count": 0, "work": room(0),
        "power": room(0), "partial": room(0), "traffic": 0.0, "pending": 0, "steps": 0, "rejected": 0,
        "derivatives": 0, "jacobians": 0, "factorisations": 0,
        "exponentials": room_for_tables(*((n, entries) if is_piecewise_affine(program) and n <= LARGEST else (0, 0))),
        "energy": 0.0, "energies": room(1 + n), "dropped": room(n),
        "slope": room(dop853.ALL_STAGES * n), "dense": room(7 * n), "dense_known": 0,
        "automatic": 0, "fastest": 0.0, "direction": room(n), "since_looked": dop853.LOOK_AGAIN, "held_by_stability": 0, "free_steps": 0,
    }  # fmt: skip


def fields_at(stretch: Segment, signals: Signals, method: int, automatic: int) -> dict[str, Any]:
    """Return the numbers with which a `IntegratorWorkspace` goes on at the start of another segment; `FORGOTTEN` are the others."""
    earliest, latest = inside(stretch)
    return signal_fields(signals, stretch.start) | BEGUN | {
        "time": stretch.start, "stop": float(stretch.stop), "until": float(stretch.stop), "earliest": earliest, "latest": latest,
        "method": method, "automatic": automatic,
    }  # fmt: skip


def signal_fields(signals: Signals, start: float) -> dict[str, Any]:
    """Return the fields of a `IntegratorWorkspace` for the signals of time, from a start on."""
    return {
        "node_time": signals.times, "node_value": signals.values.ravel(), "signal_nodes": len(signals.times),
        "node_next": int(signals.times.searchsorted(start)), "steady": int(signals.steady), "signal_count": len(signals.allowed),
        "allowed": signals.allowed,
    }  # fmt: skip
