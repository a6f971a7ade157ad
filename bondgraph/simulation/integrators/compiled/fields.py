"""Initial fields of an `IntegratorWorkspace` at the start of a segment."""

from __future__ import annotations

from typing import Any

import numpy as np

from compiler.api import Array, Program, zeros_of

from ...segments.timeline import LOOKS, Segment, Signals, inside
from ...segments.trajectory import SegmentContext
from .. import dop853
from ..linear_algebra.exponentials import LARGEST, ExponentialTables
from ..linear_algebra.factorise import is_large
from ..linear_algebra.factors import ComplexFactors, Factors
from ..methods import METHODS
from ..tolerances import FIRST, allowed_estimate, creeping_tolerance, newton_tolerance, stagnation_tolerance
from ..workspace import IntegratorWorkspace

# Fields of the search for the fastest mode, as they begin.
UNMEASURED = {"fastest": 0.0, "since_looked": dop853.LOOK_AGAIN, "held_by_stability": 0, "free_steps": 0}
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


def room_of(program: Program, method: int, signals: int, bends: int, peaks: int, dense: bool = False) -> dict[str, Any]:  # fmt: skip
    """Return the other fields, which depend on the program and the method alone. `dense`: whatever its size is."""
    n = len(program.states.names) + len(program.unknowns.names)
    differential, entries = len(program.states.names), len(program.pattern[0])
    large = is_sparse(program) and not dense
    row = METHODS[method]
    order = 3 * n if row.conserving else 0 if large else n  # size of the linear systems
    pairs = [0 if row.conserving else order, *2 * [order if row.stages > 3 else 0]]
    limits = len(program.limits)
    conditions = () if program.hybrid is None else program.hybrid.conditions
    narrow = program.time_functions is not None and bool(program.time_functions.conditions)
    exact = is_piecewise_affine(program) and n <= LARGEST
    return zeros_of(
        IntegratorWorkspace, n=n, differential=differential, method=method, entry_count=entries, sparse=int(large), root_count=len(conditions),
        root_narrow=int(narrow), bend_count=bends, peak_count=peaks // 2, signal_count=signals, looks=max(len(LOOKS), len(dop853.LOOKS)),
        stage_room=7 if row.stages > 3 else 3, limits=limits, limit_count=limits if program.watched else 0, always=int(program.watched and n > differential),
        since_looked=dop853.LOOK_AGAIN,
    ) | {
        "root_strict": np.array([c.strict for c in conditions], dtype=np.int64), "selection": {"slope_count": 0},
        "inner": zeros_of(Factors, n=0 if row.conserving or large else n), "real": zeros_of(Factors, n=order),
        **{name: zeros_of(ComplexFactors, n=size) for name, size in zip(("complex", "second", "third"), pairs, strict=True)},
        "exponentials": zeros_of(ExponentialTables, n=n * exact, entry_count=entries * exact),
    }  # fmt: skip


def fields_at(stretch: Segment, signals: Signals, method: int, automatic: int) -> dict[str, Any]:
    """Return the numbers with which an `IntegratorWorkspace` goes on at the start of another segment."""
    earliest, latest = inside(stretch)
    return (signal_fields(signals, stretch.start) if len(signals.allowed) else {}) | {
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
