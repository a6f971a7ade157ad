"""Choice of the method for a segment: the author's choice, or one from an examination of the model.

An explicit method is faster where accuracy, not stability, limits its steps. The spectrum of the Jacobian at the beginning of a segment decides
clear cases; otherwise the explicit method makes some trial steps, which are not kept. Stiffness that begins later is detected on the way. Laws
with kinks are given to Radau, whose steps end there.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import AUTOMATIC, SOLVERS, Array, Program, Solver

from ...errors import UsageError
from ..integrators.compiled.fields import is_piecewise_affine, is_sparse
from ..integrators.linear_algebra.exponentials import LARGEST as FEW
from ..integrators.methods import EXPLICIT, EXPONENTIAL, METHODS, RADAU
from ..integrators.radau import StepFailed
from ..segments.timeline import Segment
from .native_integrator import explicit_trial

if TYPE_CHECKING:
    from .integration_state import IntegrationState

# Phase of the fastest mode in a segment, in radians, for which an explicit method needs no more than about fifty steps.
EASY = 300.0
STIFF = 3000.0  # the same for a mode that decays: it has done so long before the end
DAMPED = 0.3  # least ratio of decay rate to rate of a mode that decays
LARGEST = 200  # most states for which the spectrum is computed
LARGEST_INTERPRETED = 60  # most states for which the explicit steps run in Python
FEWER, FEWEST = 16, 6  # most states for which the matrix exponential is chosen; the same where its steps run in Python
TRIAL = 60  # trial steps
UNCLEAR = -1  # no method
ENOUGH = 64  # most discrete modes examined: others are assumed to be like most of them


# The method of a segment, evaluations of the trial steps that chose it, and True if it is also that of all further segments.
Chosen = tuple[int, dict[str, int], bool]


def method_of(stepper: IntegrationState, stretch: Segment, x: Array, compiled: bool) -> Chosen:
    """Return the method that goes on from state x. Raises `UsageError` where the requested one is not possible."""
    if stepper.solver != AUTOMATIC:
        solver = SOLVERS[stepper.solver]
        if obstacle := _obstacle(stepper, stretch, solver, compiled):
            sentence, advice = solver.refusal
            raise UsageError("BR712", f"{sentence}: {obstacle};", f"{advice}")
        return METHODS.index(solver), {}, False
    if stepper.result.settled is not None:
        return stepper.result.settled, {}, False
    fits = len(x) <= (FEWER if compiled else FEWEST)
    if fits and not _obstacle(stepper, stretch, METHODS[EXPONENTIAL], compiled):
        return EXPONENTIAL, {}, False
    if (
        _obstacle(stepper, stretch, METHODS[EXPLICIT], compiled)
        or stepper.program.bends is not None
        or stepper.history is not None
        or (len(x) > LARGEST_INTERPRETED and not compiled)
    ):
        return RADAU, {}, False
    if stepper.program.hybrid is None:
        return _by_spectrum(stepper, stretch, x)
    # Events return to modes that have been examined before.
    known, key = stepper.methods, np.asarray(stretch.mode).tobytes()
    if key not in known and len(known) >= ENOUGH:
        return Counter(known.values()).most_common(1)[0][0], {}, False
    if key in known:
        return known[key], {}, False
    chosen = _by_spectrum(stepper, stretch, x)
    known[key] = chosen[0]
    return chosen


def _by_spectrum(stepper: IntegrationState, stretch: Segment, x: Array) -> Chosen:
    """Return the method that fits the eigenvalues on a segment; evaluations of trial steps count, also where an earlier run has made them."""
    chosen: Chosen = stepper.constraints.recall(
        "method", stepper.key_at(stretch, x), lambda: _examined(stepper, stretch, x), lambda answer: len(x) // LARGEST
    )
    return chosen


def _examined(stepper: IntegrationState, stretch: Segment, x: Array) -> Chosen:
    """Return what the eigenvalues and trial steps choose."""
    rates = _spectrum(stepper, stretch, x)
    method = RADAU if rates is None else int(clear_method(rates, stretch.stop - stretch.start))
    return _tried(stepper, stretch, x) if method == UNCLEAR else (method, {}, False)


def clear_method(rates: Array, length: float) -> Any:
    """Return the method that fits eigenvalues, shape (…, n), on a segment of this length, shape (…,); `UNCLEAR` where trial steps decide."""
    turns = np.abs(rates) * length
    dying = np.where(-rates.real >= DAMPED * np.abs(rates), turns, 0.0).max(axis=-1, initial=0.0)
    stiff = np.where(dying > STIFF, RADAU, UNCLEAR)
    return np.where(turns.max(axis=-1, initial=0.0) <= EASY, EXPLICIT, stiff)


def after_trial(stiff: Any, finished: Any) -> tuple[Any, Any]:
    """Return the method after trial steps of the explicit one, and True if it is also that of all further segments."""
    return np.where(stiff & ~finished, RADAU, EXPLICIT), ~finished


def _obstacle(stepper: IntegrationState, stretch: Segment, solver: Solver, compiled: bool) -> str:
    """Return the reason why a method is not possible on a segment; empty if it is."""
    cache, key = stepper.program.kept, ("obstacle", solver.word, compiled)
    if key not in cache:
        cache[key] = _obstacle_in(stepper.program, solver, compiled)
    obstacle: str = cache[key]
    if solver.exact and not obstacle:
        return dict(solver.refused).get(_inexact(stepper, stretch), "")
    return obstacle


def _obstacle_in(program: Program, solver: Solver, compiled: bool) -> str:
    """Return the reason why a method is not possible for a program; empty if it is."""
    states = len(program.states.names) + len(program.unknowns.names)
    has = {
        "constraints": bool(program.multipliers),
        "unknowns": bool(program.unknowns.names),
        "events": program.hybrid is not None,
        "delays": program.delays is not None,
        "kinks": program.bends is not None,
        "size": states > LARGEST and not compiled,
        "sparse": is_sparse(program),
        "laws": not is_piecewise_affine(program),
        "many": states > FEW,
    }
    obstacle = next((reason for name, reason in solver.refused if has.get(name)), "")
    return obstacle.format(most=LARGEST, few=FEW, states=states)


def _inexact(stepper: IntegrationState, stretch: Segment) -> str:
    """Return the property because of which the matrix exponential is not possible on a segment, of those that depend on numbers; empty if there is none."""
    signals = stepper.signals(stretch)
    if len(signals.allowed) and not signals.steady:
        return "signals"
    blurred, mode = stepper.tolerances.kept, ("mode", np.asarray(stretch.mode).tobytes())
    if mode not in blurred:
        magnitude, fixed = stepper.tolerances.magnitude, (stepper.inputs, stepper.constants, stretch.mode)
        matrix = np.asarray(stepper.program.jacobian(stretch.start, np.zeros(len(magnitude)), *fixed), dtype=float)
        matrix = matrix * magnitude / magnitude[:, None]
        if (key := ("matrix", matrix.tobytes())) not in blurred:  # the mode has what samples hold, too
            from ..integrators.exponential import is_blurred

            blurred[key] = not np.isfinite(matrix).all() or is_blurred(matrix, stepper.whole)
        blurred[mode] = blurred[key]
    return "rounding" if blurred[mode] else ""


def _spectrum(stepper: IntegrationState, stretch: Segment, x: Array) -> Any:
    """Return the eigenvalues at a state; for a large model a bound of the fastest one; None if there are none."""
    program, magnitude = stepper.program, stepper.tolerances.magnitude
    fixed = (stepper.inputs, stepper.constants, stretch.mode)
    entries = scaled_entries(program, program.jacobian_entries(stretch.start, x, *fixed), magnitude)
    if not np.isfinite(entries).all():
        return None
    if len(x) > LARGEST:
        sums = np.zeros(len(x))
        np.add.at(sums, program.pattern[0], np.abs(entries))
        return 1j * sums.max(initial=0.0, keepdims=True)
    try:
        return spectrum(program, entries)
    except np.linalg.LinAlgError:
        return None


def scaled_entries(program: Program, entries: Array, magnitude: Array) -> Any:
    """Return the entries of Jacobians, shape (…, entries), in units of the magnitudes, shape (…, n)."""
    rows, columns = program.pattern
    return entries * magnitude[..., columns] / magnitude[..., rows]


def spectrum(program: Program, entries: Array) -> Any:
    """Return the eigenvalues of matrices with these entries, shape (…, n). Raises `LinAlgError`."""
    count = len(program.states.names)
    matrices = np.zeros((*entries.shape[:-1], count, count))
    matrices[(..., *program.pattern)] = entries
    return np.linalg.eigvals(matrices)


def _tried(stepper: IntegrationState, stretch: Segment, x: Array) -> Chosen:
    """Return the same from some trial steps of the explicit method, which are not kept."""
    try:
        evaluations, stiff, finished = explicit_trial(stepper, stretch, x, TRIAL)
    except StepFailed:
        return RADAU, {}, False
    method, settled = after_trial(np.bool_(stiff), np.bool_(finished))
    return int(method), evaluations, bool(settled)
