"""Detection of singular poses in machine code: see `singular.SingularPoseMonitor`, whose `look` and `crossing` decide when Python is called."""

from __future__ import annotations

from math import pow

from ..outcomes import CROSS, REDUNDANT
from ..projection.limits import APART, FINE, LOOK, MISSES, NEAR, NEVER
from ..projection.projection import least_singular_value
from ..workspace import IntegratorWorkspace

GOES_ON = 0


def begin_watch(s: IntegratorWorkspace) -> None:
    """Reset the detection at the start of a segment, or after a crossing."""
    s.ahead = NEVER
    s.behind = NEVER
    s.tried = NEVER
    s.comes = 0
    s.longest = s.usual
    if s.closed.positions.rows > 0:
        in_units(s)
        s.pose_time[0] = s.time
        s.pose_least[0] = least_singular_value(s.closed, s.closed.positions, s.time, s.si)
        s.poses = 1


def in_units(s: IntegratorWorkspace) -> None:
    """Put the state in SI into `si`."""
    for i in range(s.n):
        s.si[i] = s.state[i] * s.magnitude[i]


def watch(s: IntegratorWorkspace) -> int:
    """Update the detection after a step: set the longest next step, and return if the caller should try to cross a pose."""
    in_units(s)
    if s.poses == 3:
        for k in range(2):
            s.pose_time[k] = s.pose_time[k + 1]
            s.pose_least[k] = s.pose_least[k + 1]
    else:
        s.poses += 1
    last = s.poses - 1
    now = least_singular_value(s.closed, s.closed.positions, s.time, s.si)
    s.pose_time[last] = s.time
    s.pose_least[last] = now
    slope = (now - s.pose_least[last - 1]) / (s.time - s.pose_time[last - 1])
    bend = 0.0
    if last == 2:
        before = (s.pose_least[1] - s.pose_least[0]) / (s.pose_time[1] - s.pose_time[0])
        bend = 2.0 * (slope - before) / (s.time - s.pose_time[0])
        slope += 0.5 * bend * (s.time - s.pose_time[1])
    s.ahead = now / -slope if slope < 0.0 else NEVER
    s.behind = now / slope if slope > 0.0 else NEVER
    s.comes = 0
    if s.ahead < NEVER and 0.5 * bend * s.ahead * s.ahead < MISSES * now:
        s.comes = 1
    else:
        s.tried = NEVER
    s.longest = min(s.usual, NEAR * min(s.ahead, s.behind))
    if s.redundant != 0 and opened(s):
        return REDUNDANT
    if s.comes != 0 and s.time + 2.0 * s.ahead <= s.stop and s.ahead <= 0.5 * s.tried:
        if s.ahead < LOOK * max(1.0, pow(FINE / s.relative, 0.25)) * s.size:
            return CROSS
    return GOES_ON


def opened(s: IntegratorWorkspace) -> bool:
    """Return True if an inactive residual may be open; the caller examines it."""
    smallest = NEVER
    for i in range(s.closed.positions.rows):
        smallest = min(smallest, s.closed.positions.size[i])
    s.closed.invariant(s.time, s.si, s.inputs, s.constants, s.mode, s.closed.values)
    for i in range(s.closed.gaps):
        if abs(s.closed.values[i]) > APART * smallest:
            return True
    return False
