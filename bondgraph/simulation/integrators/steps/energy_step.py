"""One step of the energy-conserving method of `gauss.py`; one source, as machine code and as Python."""

from __future__ import annotations

from math import isfinite, sqrt

from compiler.api import Floats

from ..gauss import CLOSE, ITERATIONS, PROJECTIONS, SLOW, WITHIN, A, B, C
from ..linear_algebra.factors import back, eliminate
from ..outcomes import NEWTON
from ..workspace import IntegratorWorkspace
from .evaluation import put_end, rates, renew


def energy_step(s: IntegratorWorkspace) -> int:
    """Make one step of the common size; return 0, or the reason why there is none."""
    n = s.n
    end = s.stop if s.time + 1.5 * s.size >= s.stop else s.time + s.size
    size = end - s.time
    for i in range(n):
        s.slope[i] = s.rate[i]
    iterations = find_stages(s, size)
    if iterations == 0:
        s.since_looked = SLOW
        iterations = find_stages(s, size)
        if iterations == 0:
            return NEWTON
    s.since_looked = iterations
    for i in range(n):
        change = size * (B[0] * s.slope[n + i] + B[1] * s.slope[2 * n + i] + B[2] * s.slope[3 * n + i])
        s.new[i] = move_by(s, i, s.state[i], change)
        s.peak[i] = max(s.peak[i], abs(s.new[i]))
    for _ in range(PROJECTIONS):
        onto_energy(s, end, s.new, 1)
    rates(s, end, s.new, s.slope[4 * n :])
    put_end(s, end, s.slope[4 * n :])
    for i in range(n):
        s.rate[i] = s.slope[4 * n + i]
    s.last_size = size
    s.dense_known = 0
    return 0


def move_by(s: IntegratorWorkspace, i: int, start: float, change: float) -> float:
    """Return a state after a change, with compensated summation (Kahan): the rounding error is stored for the next step."""
    whole = change + s.dropped[i]
    result = start + whole
    s.dropped[i] = whole - (result - start)
    return result


def find_stages(s: IntegratorWorkspace, size: float) -> int:
    """Compute stages and their rates to rounding, by simplified Newton iteration; return the number of iterations, 0 if it fails."""
    n = s.n
    if s.since_looked >= SLOW or s.factorised_size != size:
        renew(s)
        if not factorise_stages(s, size):
            return 0
    for i in range(3):
        for k in range(n):
            s.z[i * n + k] = size * C[i] * s.rate[k]
    last = 1e300
    for iteration in range(ITERATIONS):
        for i in range(3):
            for k in range(n):
                s.rest[k] = s.state[k] + s.z[i * n + k]
            rates(s, s.time + size * C[i], s.rest, s.slope[(i + 1) * n :])
        norm = 0.0
        for i in range(3):
            for k in range(n):
                total = (
                    A[3 * i] * s.slope[n + k] + A[3 * i + 1] * s.slope[2 * n + k] + A[3 * i + 2] * s.slope[3 * n + k]
                )
                s.change[i * n + k] = size * total - s.z[i * n + k]
        back(s.real, s.change)
        for i in range(3):
            for k in range(n):
                s.z[i * n + k] += s.change[i * n + k]
                part = s.change[i * n + k] / s.peak[k]
                norm += part * part
        norm = sqrt(norm)
        if not isfinite(norm):
            return 0
        if norm == 0.0 or (norm < CLOSE and norm >= last):
            return iteration + 1
        last = norm
    return 0


def factorise_stages(s: IntegratorWorkspace, size: float) -> bool:
    """Factorise I - h A x J for all stages together."""
    n = s.n
    m = 3 * n
    matrix = s.real.matrix
    for i in range(m * m):
        matrix[i] = 0.0
    for i in range(m):
        matrix[i * m + i] = 1.0
    for k in range(s.entry_count):
        for i in range(3):
            for j in range(3):
                matrix[(i * n + s.rows[k]) * m + j * n + s.columns[k]] -= size * A[3 * i + j] * s.jacobian[k]
    s.factorisations += 1
    s.factorised_size = size
    return eliminate(s.real)


def onto_energy(s: IntegratorWorkspace, time: float, y: Floats, keep: int) -> None:
    """Move scaled states to the energy of the start, by the least change relative to their peaks; `keep`: store the rounding error."""
    n = s.n
    for i in range(n):
        s.si[i] = y[i] * s.magnitude[i]
    s.stored_energy(time, s.si, s.inputs, s.constants, s.mode, s.energies)
    total = 0.0
    for i in range(n):
        slope = s.energies[1 + i] * s.magnitude[i] * s.peak[i]
        total += slope * slope
    if not total > 0.0:
        return
    share = (s.energies[0] - s.energy) / total
    for i in range(n):
        change = -share * s.energies[1 + i] * s.magnitude[i] * s.peak[i] * s.peak[i]
        y[i] = move_by(s, i, y[i], change) if keep != 0 else y[i] + change


def take_energy(s: IntegratorWorkspace) -> None:
    """Store the energy at the start of a segment as the one to conserve."""
    for i in range(s.n):
        s.si[i] = s.state[i] * s.magnitude[i]
    s.stored_energy(s.time, s.si, s.inputs, s.constants, s.mode, s.energies)
    s.energy = s.energies[0]


def within_step(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Put the scaled states within the last step into `out`."""
    n = s.n
    before = s.ends - 2
    size = s.end_time[before + 1] - s.end_time[before]
    at = (time - s.end_time[before]) / size
    if s.dense_known == 0:
        for i in range(n):
            left = s.end_state[(before + 1) * n + i] - s.end_state[before * n + i]
            for row in range(5):
                total = 0.0
                for stage in range(5):
                    total += WITHIN[5 * row + stage] * s.slope[stage * n + i]
                s.dense[row * n + i] = size * total
                left -= size * total
            s.dense[5 * n + i] = left  # the remaining difference at the end of the step
        s.dense_known = 1
    smooth = at * at * (3.0 - 2.0 * at)
    for i in range(n):
        value = s.dense[4 * n + i]
        for row in range(3, -1, -1):
            value = value * at + s.dense[row * n + i]
        out[i] = s.end_state[before * n + i] + (value * at + smooth * s.dense[5 * n + i])


def sample_step(s: IntegratorWorkspace, time: float, out: Floats) -> None:
    """Put the scaled states within the last step, moved to the energy of the start, into `out`."""
    within_step(s, time, out)
    for _ in range(PROJECTIONS):
        onto_energy(s, time, out, 0)
