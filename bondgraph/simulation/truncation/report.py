"""Truncation report of a phase: the truncated modes and their estimated effect, in the terms of the result.

The effect on the slow solution is an averaged forcing. Averaged over its phase, an oscillation forces the slow motion by a term of second order in
the rates (for a lossless one the gradient of its frequency times its action), and the slow motion answers by its own linearized equations. Where a
bound shows that the answer lies below the tolerance, it is not computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compiler.api import Array, ComplexArray, Program

from ...errors import RunFailed
from ...results.truncation import FastMode, TruncationReport, frequency_text
from ..monitors.step_size_diagnosis import elements_of
from ..segments.timeline import Segment
from ..segments.trajectory import Trajectory
from .modal_envelope import ALIKE, Ringing, Way, amplitudes, followed, ways_of
from .mode_truncation import Leaving, Removal
from .spectrum_split import STEADY, ScaledDynamics

SHARE = 0.01  # fraction of the largest removed amplitude above which a mode is named
IN_A_TURN, LEAST = 3, 48  # instants with forcing: per period of the slow motion, and at least in all
ROOM = 2_000_000  # most numbers in their matrices
APART = 0.01  # relative distance of eigenvalues below which modes are taken together
# Largest change of the answer matrix, in powers of e, among intervals that share one propagator.
ALIKE_ENOUGH = 0.01
UNSEEN = 0.3  # in units of the tolerance: below this bound nothing is computed
# Powers of e within an interval: below, the forcing changes linearly; above, that of the larger end is used.
EVEN, STEEP = 1e-4, 3.0
ALIVE = 4.0  # powers of e after which the forcing of a decaying oscillation is ignored
PHASES = np.exp(0.5j * np.pi * np.arange(4))
TERMS = 8  # number of terms of the series of an exponential for arguments below 1


def left_out_of(
    bandwidth: float, program: Program, leaving: Leaving | None, instants: Array, trajectory: Trajectory, stretches: Sequence[Segment]
) -> TruncationReport:  # fmt: skip
    """Return the truncation report of a phase that has been run. `stretches`: its segments, where no event cut them."""
    if leaving is None:
        events = program.hybrid is not None
        what = "events ask for its states, fast ones too" if events else "delayed signals carry on what is fast"
        return TruncationReport(bandwidth, reason=f"{what}, so all is followed")
    flow, end = leaving.flow, trajectory.kept
    removals = [r for r in leaving.removals if end is None or r.time <= end.time]
    if flow is None or not removals:
        return TruncationReport(bandwidth, leaving.faster, reason=_reason(leaving, len(program.states.names) > 0))
    found = TruncationReport(bandwidth, leaving.faster, _modes(flow, removals), tuple(float(r.time) for r in removals))
    names, reasons = program.outputs.names, _reasons(leaving)
    lacking, changed = np.full((2, len(names)), np.nan)
    try:
        lacking, changed, why = _estimated(removals, flow, instants, trajectory.states, trajectory.pieces or stretches)
        reasons.extend(why)
    except (RunFailed, np.linalg.LinAlgError) as failed:
        reasons.append(f"the ringing cannot be followed: {failed}")
    return replace(found, outputs=_finite(names, lacking), kept=_finite(names, changed), reason="; ".join(reasons))


def _estimated(
    removals: Sequence[Removal], flow: ScaledDynamics, instants: Array, states: Array, pieces: Sequence[Segment]
) -> tuple[Any, Any, list[str]]:
    """Return the largest amplitude of the oscillation per output, its largest effect on the slow solution (outputs,), and further remarks."""
    lacking = np.zeros(len(flow.program.outputs.names))
    reasons: list[str] = []
    ringings: list[tuple[Way, Ringing]] = []
    whole, ringing = float(instants[-1] - removals[0].time), None
    for removal, way in zip(removals, ways_of(removals, instants, states, pieces), strict=True):
        ringing = followed(flow, removal, way, (way.times[-1] - way.times[0]) / whole if whole > 0 else 1.0, ringing)
        lacking = np.maximum(lacking, amplitudes(flow, ringing))
        ringings.append((way, ringing))
        grows = ringing.grows()
        if grows is not None:
            since, times = grows
            reasons.append(f"what was left out grows from t = {since:.6g} s on, to {times:.3g} times as much")
        if ringing.lost is not None:
            reasons.append(f"after t = {ringing.lost:.6g} s what rings is not told from what is kept")
    return lacking, kept(flow, ringings), list(dict.fromkeys(reasons))


def _finite(names: Sequence[str], values: Array) -> dict[str, float]:
    """Return values by name, with NaN (unknown) for each value that is not finite."""
    return {n: float(v) if np.isfinite(v) else math.nan for n, v in zip(names, values, strict=True)}


def _reason(leaving: Leaving, has_states: bool) -> str:
    """Return the reason why nothing was truncated."""
    if leaving.flow is None:
        if has_states:
            return "this model is linear and solved exactly, however fast it is"
        return "nothing in this run moves by itself"
    if leaving.reasons:
        return "; ".join(_reasons(leaving))
    if leaving.faster:
        count = f"{leaving.faster} modes are" if leaving.faster > 1 else "one mode is"
        found = f"{count} faster, and none rings by more than the tolerance"
    elif leaving.decay:
        found = f"nothing that is faster rings, as what does so in {1 / leaving.decay:.3g} s decays without a turn"
    else:
        fastest, looks = frequency_text(leaving.fastest / (2 * np.pi)), leaving.looks
        where = f"at the {len(looks)} instants from t = {looks[0]:.6g} s on"
        if len(looks) == 1:
            where = f"at t = {looks[0]:.6g} s"
        found = f"nothing in it is faster, as its fastest motion is one of {fastest} {where} where it was looked at"
    return "; ".join([found, *_reasons(leaving)])


def _reasons(leaving: Leaving) -> list[str]:
    told = [f"at t = {time:.6g} s {why}" for why, time in leaving.reasons.items()]
    if leaving.above:
        told.append(
            f"what drives it changes as fast as {frequency_text(float(f'{leaving.above:.2g}'))}, and is followed"
        )
    return told


@dataclass(eq=False)
class _NamedMode:
    """A truncated mode, with its right and left vectors at its last removal."""

    told: FastMode
    right: Any
    left: Any

    def is_in(self, right: ComplexArray, left: ComplexArray) -> bool:
        return bool(abs((left @ self.right) * (self.left @ right)) > ALIKE)


def _modes(flow: ScaledDynamics, removals: Sequence[Removal]) -> tuple[FastMode, ...]:
    """Return the truncated modes, those of one removal slowest first; a mode removed several times is reported as at its first removal."""
    names, known = flow.program.states.names, list[_NamedMode]()
    for removal in removals:
        at, before = removal.found.split, list(known)  # modes of one removal are distinct
        shares = np.abs(at.dual @ removal.found.removed) * np.linalg.norm(at.right, axis=0)
        for i in np.argsort(np.abs(at.values), kind="stable"):
            right, left, rate = at.right[:, i], at.dual[i], at.values[i]
            if rate.imag < 0 or shares[i] <= SHARE * shares.max():
                continue
            damping = -rate.real / abs(rate)
            told = FastMode(
                float(f"{abs(rate) / (2 * np.pi):.6g}"),
                float(f"{damping:.3g}") if abs(damping) > STEADY else 0.0,
                elements_of(names, np.abs(right * left)),
            )
            old = next((k for k in before if k.is_in(right, left) or k.told.is_like(told)), None)
            if old is None:
                known.append(_NamedMode(told, right, left))
            else:
                before.remove(old)
                old.right, old.left = right, left
    return tuple(k.told for k in known)


@dataclass(frozen=True, eq=False)
class Fine:
    """An oscillation at a finer set of instants.

    `shapes`: as they are there; `later`: their first-order corrections because they change along the way, of the same shape; `sizes` (k, p):
    amplitudes relative to the first; `matrices` (k, n, n); `places` (k - 1,): index of the place that each interval belongs to.
    """

    way: Way
    matrices: Any
    shapes: Any
    later: Any
    sizes: Any
    places: Any


def kept(flow: ScaledDynamics, ringings: Sequence[tuple[Way, Ringing]]) -> Any:
    """Upper bound, per output (outputs,), on the shift of the slow solution by the truncated oscillations, over all ways.

    0 where it is surely below the tolerance, NaN where it is not known.
    """
    largest = np.zeros(len(flow.program.outputs.names))
    if any(ringing.lost is not None for _, ringing in ringings):
        return largest + np.nan
    ringings = [(way, ringing) for way, ringing in ringings if len(ringing.splits) > 1]
    if not _seen(flow, ringings):
        return largest
    begin, stop = ringings[0][0].times[0], ringings[-1][0].times[-1]
    held, later = np.zeros((2, flow.count))
    for way, ringing in ringings:
        fine = _fine(flow, way, ringing, float(stop - begin))
        removed = fine.later[0].real.sum(axis=1)  # has none of it
        held = held + ringing.splits[0].slow @ (later - removed)
        found, lacks = _answer(flow, fine, ringing, held)
        held, later = found, (fine.later[-1] @ ringing.phases).real
        largest = np.maximum(largest, lacks)
    return largest


def _seen(flow: ScaledDynamics, ringings: Sequence[tuple[Way, Ringing]]) -> bool:
    """Return True if the effect of all oscillations together may exceed the tolerance."""
    bound = 0.0
    for way, ringing in ringings:
        bound += _bound(flow, ringing, float(ringings[-1][0].times[-1] - way.times[0]))
        if not bound < UNSEEN:
            return True
    return False


def _answer(flow: ScaledDynamics, fine: Fine, ringing: Ringing, held: Array) -> tuple[Any, Any]:
    """Return the shift of the slow solution at the end (n,), and its largest effect on each output; `held`: the shift at the start."""
    slow, static = (np.array([getattr(at, part) for at in ringing.splits])[fine.places] for part in ("slow", "inverse"))
    each = _pushes(flow, fine.way, fine.shapes + fine.later)
    pushes = each.sum(axis=1)
    lengths = np.diff(fine.way.times)[:, None, None]
    answers = slow @ (0.5 * lengths * (fine.matrices[:-1] + fine.matrices[1:])) @ slow
    changes = np.abs(np.diff(answers, axis=0)).sum(axis=2).max(axis=1)
    groups = np.floor(np.cumsum(np.append(0.0, changes)) / ALIKE_ENOUGH).astype(int)
    _, first, groups = np.unique(groups, return_index=True, return_inverse=True)
    through, mean = _propagators(answers[first])
    forced = lengths[:, 0] * (mean[groups] @ (slow @ _means(each, fine.sizes)[:, :, None]))[:, :, 0]
    ways, found = list(through), [held]
    for group, push in zip(groups.tolist(), forced, strict=True):
        found.append(ways[group] @ found[-1] + push)
    moved = np.zeros((len(found), 2, flow.count))
    moved[1:, 0] = found[1:]
    moved[1:, 0] -= (static @ pushes[1:, :, None])[:, :, 0]
    values = fine.way.outputs(flow, moved)
    return found[-1], np.abs(values[:, 0] - values[:, 1]).max(axis=0)


def _bound(flow: ScaledDynamics, ringing: Ringing, rest: float) -> float:
    """Upper bound, in units of the tolerance, on the effect of one oscillation, computed from the places alone.

    Assumes forcing of one sign for the whole run, and shapes that change as fast as the slow motion; both are carried from state to state as far
    as that motion does within a period, or within `rest`, the remaining time of the run in s.
    """
    way, splits, shapes = ringing.way, ringing.splits, ringing.largest
    span = way.times[-1] - way.times[0]
    gap = min(at.gap for at in splits)
    others = np.concatenate([at.others for at in splits])
    if gap <= 0 or not len(others):
        return np.inf
    slow, static = np.array([at.slow for at in splits]), np.array([at.inverse for at in splits])
    pushes = _pushes(flow, way, shapes).sum(axis=1)[..., None]
    pushed = (span * np.abs(slow @ pushes) + np.abs(static @ pushes)).max(axis=0)[:, 0]
    turned = np.abs(slow[:, None] @ shapes).max(axis=(0, 1)).sum(axis=1) * np.abs(others).max() / gap
    ways = np.abs(slow @ np.array([at.matrix for at in splits]) @ slow).max(axis=0)
    with np.errstate(all="ignore"):
        reached = pushed + turned
        reached = np.maximum(reached, ways @ reached / max(np.abs(others).min(), 1 / rest))
        growth = max(0.0, others.real.max(), *(at.decays.real.max(initial=0.0) for at in splits))
        return float((reached * np.exp(growth * rest) / flow.allowed).max())


def _fine(flow: ScaledDynamics, way: Way, ringing: Ringing, run: float) -> Fine:
    """Return the oscillation at enough instants up to the last place, while it rings; `run`: length of the whole run in s."""
    last = int(np.searchsorted(way.times, ringing.way.times[-1]))
    span = float(way.times[-1] - way.times[0])
    least, turns = int(np.ceil(LEAST * span / run)), ringing.splits[0].slowest * span / (2 * np.pi)
    wanted = min(max(least, round(IN_A_TURN * turns)), max(1, ROOM // flow.count**2))
    sizes = ringing.sizes(way.times[: last + 1])
    alive = min(last, int(np.flatnonzero((sizes > np.exp(-ALIVE)).any(axis=1))[-1]) + 1)
    chosen = np.append(0, np.arange(last, 0, -max(1, -(-last // wanted)))[::-1])
    chosen = np.union1d(chosen, np.arange(0, alive, max(1, -(-alive // wanted))))
    way, sizes = way[chosen], sizes[chosen]
    matrices = flow.matrices(way.times, way.modes, way.states)
    resolvents = _resolvents(ringing)
    shapes = _between(way, matrices, ringing, resolvents)
    changes = np.gradient(shapes, way.times, axis=0)
    places = np.clip(np.searchsorted(ringing.way.times, way.times, "right") - 1, 0, len(ringing.splits) - 2)
    later = np.empty_like(changes)
    for k, resolvent in enumerate(resolvents[:-1]):
        later[places == k] = -_through(resolvent, changes[places == k])
    return Fine(way, matrices, shapes * sizes[:, None, :], later * sizes[:, None, :], sizes, places[:-1])


def _resolvents(ringing: Ringing) -> Any:
    """Resolvents of the modes at each place (k, p, n, n): they give the change of a mode's vector for a small change of the matrix."""
    matrices = np.array([at.matrix for at in ringing.splits])[:, None]
    unit, rates = np.eye(matrices.shape[-1]), ringing.values[..., None, None]
    near = [
        np.abs(at.values - own[:, None]) <= APART * np.abs(own)[:, None]
        for at, own in zip(ringing.splits, ringing.values, strict=True)
    ]
    own = np.array([(at.right * chosen[:, None, :]) @ at.dual for at, chosen in zip(ringing.splits, near, strict=True)])
    return np.linalg.solve(rates * (unit + own) - matrices, unit - own)


def _between(way: Way, matrices: Array, ringing: Ringing, resolvents: ComplexArray) -> Any:
    """Return shapes at all instants, interpolated from the places on both sides, and their first-order correction for the matrix there."""
    found = np.zeros((len(way), *ringing.shapes.shape[1:]), dtype=complex)
    for at, shapes, resolvent, own in zip(
        ringing.splits, ringing.shapes, resolvents, np.eye(len(resolvents)), strict=True
    ):
        shares = np.interp(way.times, ringing.way.times, own)
        here = np.flatnonzero(shares)
        turned = _through(resolvent, (matrices[here] - at.matrix) @ shapes)
        found[here] += shares[here, None, None] * (shapes + turned)
    return found


def _through(resolvents: ComplexArray, changes: ComplexArray) -> Any:
    """Apply the matrix (p, n, n) of each mode to its changes (c, n, p), for all modes."""
    return (resolvents @ changes.transpose(2, 1, 0)).transpose(2, 1, 0)


def _pushes(flow: ScaledDynamics, way: Way, shapes: ComplexArray) -> Any:
    """Return the mean of the rates over the phases of each mode, minus the rates without it (k, p, n)."""
    count, n, modes = shapes.shape
    ways = (shapes.transpose(0, 2, 1)[:, :, None, :] * PHASES[:, None]).real.reshape(count, 4 * modes, n)
    moved = np.concatenate([np.zeros((count, 1, n)), ways], axis=1)
    rates = flow.rates(*way.moved(flow, moved)).reshape(count, -1, n)
    return (rates[:, 1:] - rates[:, :1]).reshape(count, modes, 4, n).mean(axis=2)


def _means(pushes: Array, sizes: Array) -> Any:
    """Return the mean forcing by all modes within the intervals between instants (k - 1, n).

    It is proportional to the square of the amplitudes, which grow or decay exponentially within an interval; everything else changes linearly.
    """
    decays = 2 * (np.log(sizes[:-1]) - np.log(sizes[1:]))[:, :, None]
    first, last = pushes[:-1], pushes[1:]
    x = np.where(np.abs(decays) > EVEN, np.clip(decays, -STEEP, STEEP), 1.0)
    both = (x + np.expm1(-x)) / x**2 * first + (np.expm1(x) - x) / x**2 * last
    both = np.where(np.abs(decays) > EVEN, both, 0.5 * (first + last))
    y = np.where(np.abs(decays) > STEEP, np.abs(decays), 1.0)  # the value at the smaller end is below rounding
    one = -np.expm1(-y) / y * np.where(decays > 0, first, last)
    return np.where(np.abs(decays) > STEEP, one, both).sum(axis=1)


def _propagators(matrices: Array) -> tuple[Any, Any]:
    """Return exp(A) and the mean of exp(A s) over s from 0 to 1, for matrices A (k, n, n); Taylor series and doubling, to about four digits."""
    norm = float(np.abs(matrices).sum(axis=1).max(initial=0.0))
    halvings = max(0, int(np.ceil(np.log2(norm)))) if 0 < norm < np.inf else 0
    part, unit = matrices / 2.0**halvings, np.eye(matrices.shape[-1])
    mean = term = unit
    for order in range(2, TERMS):
        term = term @ part / order
        mean = mean + term
    through = unit + part @ mean
    for _ in range(halvings):
        mean = 0.5 * (mean + mean @ through)
        through = through @ through
    return through, mean
