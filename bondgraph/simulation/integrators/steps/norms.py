"""Norms of changes and the step-size factor, for methods with a Jacobian."""

from __future__ import annotations

from math import pow

from .. import radau
from ..workspace import IntegratorWorkspace

SLOWEST, CREEPING, LARGEST = radau.SLOWEST, radau.CREEPING, float(radau.LARGEST)


def most_left(s: IntegratorWorkspace, stages: int) -> float:
    """Return the largest further change of a single component by more iterations, from the last changes and those before, in units of the tolerance.

    With a Jacobian that is far too steep for it, one component changes slowly, which large changes of the others hide.
    """
    most = 0.0
    for i in range(stages):
        for k in range(s.n):
            now = abs(s.change[i * s.n + k])
            before = abs(s.last_change[i * s.n + k])
            if now > CREEPING * before and before > 0.0:
                rate = min(now / before, SLOWEST)
                most = max(most, now * s.per_tolerance[k] * rate / (1.0 - rate))
    return most


def factor(s: IntegratorWorkspace, size: float, norm: float, power: float) -> float:
    """Return the step-size factor from the last two errors (Gustafsson; Hairer and Wanner, section IV.8); `power`: exponent of the error."""
    if norm == 0.0:
        return LARGEST
    result = pow(norm, -power)
    if s.last_error > 0.0 and s.last_size > 0.0:
        result = min(result, size / s.last_size * pow(s.last_error / norm, power) * result)
    return result
