"""States at reported instants within the last step, and the limits of the model; see `validity.py`."""

from __future__ import annotations

from compiler.api import Floats

from .. import dop853, radau
from ..methods import CONSERVING, THROUGH_ENDS
from ..projection.projection import project
from ..steps.energy_step import sample_step
from ..workspace import IntegratorWorkspace
from .polynomials import interpolated
from .stiff_interpolation import bring_back, is_off, misses_stiff_states

INNER, C = dop853.INNER, tuple(radau.C.tolist())


def sample(s: IntegratorWorkspace) -> bool:
    """Store states at the reported instants within the last step; return True if the caller should check the limits of the model."""
    first = s.position
    looked = False
    missing = False
    while s.position < s.instant_count:
        at = s.instants[s.position]
        if at > s.time or at >= s.until:
            break
        state_at(s, at, s.reported[s.position * s.n :])
        if not looked and at < s.time:
            missing = misses_stiff_states(s)
            looked = True
        missing = corrected(s, at, s.reported[s.position * s.n :], missing)
        s.position += 1
    if s.place_count > 0 and keep_places(s):
        return True
    if s.always != 0:
        return True
    if s.limit_count == 0:
        return False
    start = s.end_time[s.ends - 2]
    size = min(s.time, s.until) - start
    if leaves(s, start) or leaves(s, min(s.time, s.until)):
        return True
    if THROUGH_ENDS[s.method] == 0:
        for k in range(4):
            if leaves(s, start + INNER[k] * size):
                return True
    elif leaves(s, start + C[0] * size) or leaves(s, start + C[1] * size):
        return True
    for k in range(first, s.position):
        if leaves(s, s.instants[k]):
            return True
    return False


def corrected(s: IntegratorWorkspace, time: float, out: Floats, missing: bool) -> bool:
    """Correct the stiff states within the last step where its polynomials miss them (`missing`); return True if the next ones need it too."""
    if missing and time < s.time and (THROUGH_ENDS[s.method] != 0 or is_off(s, time)):
        return bring_back(s, time, out)
    return missing


def keep_places(s: IntegratorWorkspace) -> bool:
    """Store the states at the places of the last step; return True if there is no room for those of another step."""
    start = s.end_time[s.ends - 2]
    stop = min(s.time, s.until)
    missing = misses_stiff_states(s)
    for k in range(s.place_count):
        at = stop if k == s.place_count - 1 else start + s.places[k] * (stop - start)
        out = s.kept_state[s.kept * s.n :]
        state_at(s, at, out)
        if start < at:
            missing = corrected(s, at, out, missing)
        s.kept_time[s.kept] = at
        s.kept += 1
    return s.kept + s.place_count > s.kept_room


def leaves(s: IntegratorWorkspace, time: float) -> bool:
    """Return True if a limit without known violation does not hold at an instant of the last step."""
    state_at(s, time, s.si)
    s.holds(time, s.si, s.inputs, s.constants, s.mode, s.truth)
    for k in range(s.limit_count):
        if s.left[k] == 0 and s.truth[k] != 1.0:
            return True
    return False


def scaled_at(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Compute the scaled state within the last step."""
    if CONSERVING[s.method] != 0:
        sample_step(s, time, out)
    else:
        interpolated(s, time, out)


def state_at(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Compute the state in SI there, projected on the constraints."""
    scaled_at(s, time, out)
    for i in range(s.n):
        out[i] *= s.magnitude[i]
    if s.closed.constraints > 0:
        project(s.closed, time, out)


def scaled_along(s: IntegratorWorkspace, count: int, times: Floats, out: Floats) -> None:
    """Compute the scaled states at several instants."""
    for k in range(count):
        scaled_at(s, times[k], out[k * s.n :])
