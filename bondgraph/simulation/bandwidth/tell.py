"""What a leg left out, in the words of its result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RunFailed
from ...left_out import FastMode, LeftOut, told_hertz
from ..watch.crawling import elements_of
from .along import amplitudes, followed, way_of
from .leave import Leaving, Removal
from .push import kept
from .split import Flow

if TYPE_CHECKING:
    from ..leg import Leg

SHARE = 0.01  # of the largest: modes of which more was removed are named
MOST = 20  # removals whose later ringing is estimated, the largest ones


def left_out_of(leg: Leg, bandwidth: float) -> LeftOut:
    """What a leg that has been run left out."""
    leaving, program = leg.leaving, leg.program
    if leaving is None:
        events = program.hybrid is not None
        what = "events ask for its states, fast ones too" if events else "delayed signals carry on what is fast"
        return LeftOut(bandwidth, reason=f"{what}, so all is followed")
    flow, end = leaving.flow, leg.trajectory.kept
    removals = [r for r in leaving.removals if end is None or r.time <= end.time]
    if flow is None or not removals:
        return LeftOut(bandwidth, leaving.faster, reason=_reason(leaving, leg))
    modes = {m: None for removal in removals[:MOST] for m in _modes(flow, removal)}
    found = LeftOut(bandwidth, leaving.faster, tuple(modes), tuple(float(r.time) for r in removals))
    names, reasons = program.outputs.names, _reasons(leaving)
    lacking, changed = np.full((2, len(names)), np.nan)
    try:
        lacking, changed, why = _estimated(removals, flow, leg)
        reasons.extend(why)
    except (RunFailed, np.linalg.LinAlgError) as failed:
        reasons.append(f"the ringing cannot be followed: {failed}")
    return replace(found, outputs=_finite(names, lacking), kept=_finite(names, changed), reason="; ".join(reasons))


def _estimated(removals: Sequence[Removal], flow: Flow, leg: Leg) -> tuple[Any, Any, list[str]]:
    """The amplitude of the ringing in the outputs, and what it does to what is kept, of each the largest (outputs,); what else there is to say."""
    lacking, changed = np.zeros((2, len(flow.program.outputs.names)))
    reasons: list[str] = []
    pieces = leg.trajectory.pieces or leg.stretches
    for removal in sorted(removals, key=_extent)[-MOST:]:
        way = way_of(removal, leg.instants, leg.trajectory.states, pieces)
        ringing = followed(flow, removal, way)
        lacking = np.hypot(lacking, amplitudes(flow, ringing))  # their phases know nothing of each other
        changed = changed + kept(flow, way, ringing)
        grows = ringing.grows()
        if grows is not None:
            since, times = grows
            reasons.append(f"what was left out grows from t = {since:.6g} s on, to {times:.3g} times as much")
        if ringing.lost is not None:
            reasons.append(f"after t = {ringing.lost:.6g} s what rings is not told from what is kept")
    return lacking, changed, reasons


def _extent(removal: Removal) -> float:
    return float(np.linalg.norm(removal.found.removed))


def _finite(names: Sequence[str], values: Any) -> dict[str, float]:
    """What is not finite is not known."""
    return {n: float(v) if np.isfinite(v) else math.nan for n, v in zip(names, values, strict=True)}


def _reason(leaving: Leaving, leg: Leg) -> str:
    """Why nothing was left out."""
    if leaving.flow is None:
        if leg.program.states.names:
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
        fastest = told_hertz(leaving.fastest / (2 * np.pi))
        found = f"nothing in it is faster, as its fastest motion is one of {fastest}"
    return "; ".join([found, *_reasons(leaving)])


def _reasons(leaving: Leaving) -> list[str]:
    told = [f"at t = {time:.6g} s {why}" for why, time in leaving.reasons.items()]
    if leaving.above:
        told.append(f"what drives it changes as fast as {told_hertz(float(f'{leaving.above:.2g}'))}, and is followed")
    return told


def _modes(flow: Flow, removal: Removal) -> list[FastMode]:
    """The modes that rang, slowest first."""
    at = removal.found.split
    shares = np.abs(at.dual @ removal.found.removed) * np.linalg.norm(at.right, axis=0)
    chosen = [
        i
        for i in np.argsort(np.abs(at.values), kind="stable")
        if at.values[i].imag >= 0 and shares[i] > SHARE * shares.max()
    ]
    names = flow.program.states.names
    made = []
    for i in chosen:
        rate = at.values[i]
        frequency = float(f"{abs(rate) / (2 * np.pi):.6g}")
        made.append(
            FastMode(
                frequency,
                float(f"{-rate.real / abs(rate):.3g}"),
                elements_of(names, np.abs(at.right[:, i] * at.dual[i])),
            )
        )
    return made
