"""Truncation report of a phase: the truncated modes and their estimated effect, in the terms of the result."""

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
from .averaged_forcing import kept
from .modal_envelope import ALIKE, Ringing, Way, amplitudes, followed, ways_of
from .mode_truncation import Leaving, Removal
from .spectrum_split import STEADY, ScaledDynamics

SHARE = 0.01  # fraction of the largest removed amplitude above which a mode is named


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
