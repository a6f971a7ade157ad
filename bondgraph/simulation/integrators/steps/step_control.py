"""Control of steps: sizes of tries, limits of rounding, and for implicit methods Newton's iteration and the filtered estimate."""

from __future__ import annotations

from math import isfinite, sqrt, ulp

from compiler.api import Numbers

from ...segments import timeline
from .. import radau, tolerances
from ..workspace import IntegratorWorkspace
from .evaluation import drop_noise, look_at_side, rates, renew
from .kinks import after_bend
from .newton_matrices import solve_real
from .norms import factor, most_left

STUBBORN, PATIENT, SHORTER, GROWN = radau.STUBBORN, radau.PATIENT, radau.SHORTER, radau.GROWN
SMALLEST, LARGEST = float(radau.SMALLEST), float(radau.LARGEST)
FLAT = 1e-3  # relative to the largest value within some last places of time: less is no jump
NEAREST, BEYOND = radau.NEAREST, radau.BEYOND
STAGNANT, ASIDE, FINEST, RINGING = tolerances.STAGNANT, tolerances.ASIDE, tolerances.FINEST, tolerances.RINGING
LOOKS, BETWEEN = tuple(timeline.LOOKS.tolist()), tuple(timeline.BETWEEN.ravel().tolist())
CUBIC = tuple(timeline.CUBIC.ravel().tolist())
SEEN, UNSEEN = len(timeline.SEEN), len(timeline.LOOKS) - len(timeline.SEEN)


def first_try(s: IntegratorWorkspace) -> float:
    """Return the size of the first try of a step with a Jacobian; the Jacobian and the scales of the norms are ready then."""
    if s.known == 0:
        renew(s)
    for i in range(s.n):
        s.per_tolerance[i] = 1.0 / (s.absolute[i] + abs(s.state[i]) * s.relative)
    return first_size(s, s.size, SEEN, UNSEEN, LOOKS, BETWEEN, CUBIC)


def first_size(
    s: IntegratorWorkspace, size: float, seen: int, unseen: int, looks: Numbers, between: Numbers, through: Numbers
) -> float:
    """Return the size of the first try of a step, at most `size`: up to the end if that is near, and short enough to resolve the signals of time."""
    size = min(size, s.stop - s.time, s.longest)
    if s.peak_ahead > 0.0:
        size = min(size, s.peak_ahead)
    s.peak_ahead = 0.0
    s.peak_cuts = 0
    if s.time + 1.01 * size >= s.stop:
        size = s.stop - s.time
    least = 10.0 * ulp(s.time)
    wish = size
    while size > 2.0 * least and not follows(s, s.time + size, seen, unseen, looks, between, through):
        size *= 0.5
    if size < wish and size <= 2.0 * least and is_flat(s, seen + unseen):
        return wish
    return size


def is_flat(s: IntegratorWorkspace, count: int) -> bool:
    """Return True if all signals hardly change between the nodes seen last: what no step resolves is no jump, but rounding of time next to a pole."""
    for j in range(s.signal_count):
        low = s.seen[j]
        high = s.seen[j]
        for k in range(count):
            low = min(low, s.seen[k * s.signal_count + j])
            high = max(high, s.seen[k * s.signal_count + j])
        if not high - low <= FLAT * max(abs(low), abs(high)):
            return False
    return True


def follows(
    s: IntegratorWorkspace, end: float, seen: int, unseen: int, looks: Numbers, between: Numbers, through: Numbers
) -> bool:
    """Return True if a step from the present time to `end` resolves the signals of time (see `timeline.follower`).

    `looks`: the nodes of the step, and then the places where the polynomial through them (weights in `between`) must fit; `through`: matrix from the
    values at the nodes to the coefficients of that polynomial, highest degree first.
    """
    start = s.time
    m = s.signal_count
    if m == 0:
        return True
    for k in range(seen + unseen):
        at = min(max(start + (end - start) * looks[k], s.earliest), s.latest)
        s.signals(at, s.state, s.inputs, s.constants, s.mode, s.seen[k * m :])
    for j in range(m):
        for q in range(unseen):
            off = -s.seen[(seen + q) * m + j]
            for k in range(seen):
                off += between[q * seen + k] * s.seen[k * m + j]
            if abs(off) > s.allowed[j]:
                return False
    if s.steady != 0 and is_steady(s, seen):
        return True
    while s.node_next < s.signal_nodes and s.node_time[s.node_next] < start:
        s.node_next += 1
    node = s.node_next
    while node < s.signal_nodes and s.node_time[node] < end:
        at = (s.node_time[node] - start) / (end - start)
        for j in range(m):
            off = -s.node_value[node * m + j]
            for k in range(seen):
                weight = through[k]
                for row in range(1, seen):
                    weight = weight * at + through[row * seen + k]
                off += weight * s.seen[k * m + j]
            if abs(off) > s.allowed[j]:
                return False
        node += 1
    return True


def is_steady(s: IntegratorWorkspace, seen: int) -> bool:
    """Return True if all signals have the same values at the nodes of a step as throughout a segment on which none is known to change."""
    for k in range(seen):
        for j in range(s.signal_count):
            if s.seen[k * s.signal_count + j] != s.node_value[j]:
                return False
    return True


def next_try(s: IntegratorWorkspace, size: float, norm: float, safety: float, power: float, rejected: int) -> float:
    """Return the size of the try after a rejected one, whose number is `rejected`; 0 if much shorter steps have not reduced the error."""
    wish = max(SMALLEST, safety * (factor(s, size, norm, power) if isfinite(norm) else 0.1))
    if is_stubborn(s, rejected, size, norm):
        return 0.0
    return size * (wish if rejected <= PATIENT else SMALLEST)


def is_stubborn(s: IntegratorWorkspace, rejected: int, size: float, norm: float) -> bool:
    """Return True if much shorter steps have not reduced the error; `rejected`: the number of this try."""
    last = (rejected - 1) % STUBBORN
    first = rejected % STUBBORN
    s.norms[last] = norm
    s.sizes[last] = size
    return rejected >= STUBBORN and size < SHORTER * s.sizes[first] and norm > 0.5 * s.norms[first]


def is_rounding(s: IntegratorWorkspace, norm: float, careful: float, size: float) -> bool:
    """Return whether an estimate is rounding, which a shorter step has more of: followed, it leads to modes far below the tolerance.

    `careful`: the factor of the method on its estimates; `size`: as for `rounding`.
    """
    if s.relative >= FINEST or not norm <= careful * s.stagnation_tolerance:
        return False
    for i in range(s.n):
        s.per_tolerance[i] = 1.0 / (s.absolute[i] + abs(s.state[i]) * s.relative)
    if norm > careful * RINGING * rounding(s, size):
        return False
    s.rounded = max(s.rounded, norm / careful)
    return True


def rounding(s: IntegratorWorkspace, size: float) -> float:
    """Return the norm of the rounding error of a stage, in units of the tolerance, from a second difference of the rates over a very short distance.

    Laws with large numbers that nearly cancel, as lengths of a mechanism next to its displacements, have larger rounding errors than the states.
    `size`: that of an explicit step, or 0: the matrix of the method tells how the rates' rounding reaches the stage.
    """
    n = s.n
    for i in range(n):
        s.rest[i] = s.state[i] * (1.0 + (ASIDE if i % 2 == 0 else -ASIDE))
    rates(s, s.time, s.rest, s.error)
    for i in range(n):
        s.rest[i] = s.state[i] * (1.0 - (ASIDE if i % 2 == 0 else -ASIDE))
    rates(s, s.time, s.rest, s.f)
    for i in range(n):
        s.error[i] += s.f[i] - 2.0 * s.rate[i]
        if not isfinite(s.error[i]):
            s.error[i] = 0.0
        s.error[i] *= size if size > 0.0 else 1.0
    if size == 0.0:
        solve_real(s, s.error)
    total = 0.0
    for i in range(n):
        part = s.error[i] * s.per_tolerance[i]
        total += part * part
    return sqrt(total) / sqrt(float(n))


def growth(s: IntegratorWorkspace, size: float, norm: float, safety: float, power: float, rejected: int) -> float:
    """Return the ratio of the next step to this one; behind one whose estimate is rounding a shorter step rounds by more."""
    grown = GROWN if norm == 1.0 else min(LARGEST, safety * factor(s, size, norm, power))
    return min(grown, 1.0) if rejected > 0 else grown


def choose_next(s: IntegratorWorkspace, size: float, norm: float, grown: float, iterations: int) -> None:
    """Choose the size of the next step, and whether it has a new Jacobian."""
    s.last_size = size
    s.last_error = max(norm, 1e-2)
    if iterations > 2 and s.contraction > 1e-3:
        renew(s)
    else:
        s.current = 0
        if grown < 1.2:
            grown = 1.0  # the factorisation is used once more
    s.size = size * grown


def look_beyond(s: IntegratorWorkspace, size: float, cut: float, bent: int) -> None:
    """Prepare the next step for the kinks of laws; `cut`: fraction of the planned size at which the last of `bent` kinks has ended this step."""
    if bent > 0:
        after_bend(s, size / max(cut, NEAREST))
    if s.bend_count > 0:
        look_at_side(s, BEYOND * size if bent > 0 else 0.0)


# ------------------------------------------------------------ Newton's iteration
def stage_rates(s: IntegratorWorkspace, size: float, stages: int, nodes: Numbers, first: int) -> bool:
    """Compute the rates of the stages into `f`; return False if one is not finite. `first`: index of the first node."""
    n = s.n
    for i in range(stages):
        stage = s.z[i * n :]
        for k in range(n):
            s.rest[k] = s.state[k] + stage[k]
        rates(s, s.time + size * nodes[first + i], s.rest, s.f[i * n :])
    for i in range(stages * n):
        if not isfinite(s.f[i]):
            return False
    for i in range(stages):
        drop_noise(s, s.f[i * n :])
    return True


def diverges(s: IntegratorWorkspace, norm: float, last: float, remaining: int) -> bool:
    """Update the contraction from the norms of two changes; return True if the remaining iterations will not do."""
    if last <= 0.0:
        return False
    s.contraction = norm / last
    left = 1.0
    for _ in range(remaining):
        left *= s.contraction
    return s.contraction >= 1.0 or left / (1.0 - s.contraction) * norm > s.newton_tolerance


def has_converged(s: IntegratorWorkspace, norm: float, last: float, allowed: float, stages: int) -> bool:
    """Return True if further iterations would change the stages by less than allowed."""
    left = s.contraction / (1.0 - s.contraction) * norm
    return norm == 0.0 or (last > 0.0 and left < allowed and most_left(s, stages) < s.creeping_tolerance)


def stagnant(s: IntegratorWorkspace, iterations: int, norm: float) -> int:
    """Return the number of iterations that no longer improve, if the remainder is rounding; else 0."""
    if norm > s.stagnation_tolerance or not norm <= STAGNANT * rounding(s, 0.0):
        return 0
    s.contraction = 0.0
    s.rounded = max(s.rounded, norm)
    return iterations


# ------------------------------------------------------------ estimate
def filtered_norm(s: IntegratorWorkspace, rejected: bool) -> float:
    """Return the norm of the error in units of the tolerance, filtered through the real matrix as often as needed for stiff parts.

    `rest`: the part of the stages; the error replaces the rate at the start in it.
    """
    for i in range(s.n):
        s.error[i] = s.rate[i]
    filter_error(s)
    norm = share(s)
    if norm > 1.0 and (rejected or s.last_size == 0.0):
        for i in range(s.n):
            s.w[i] = s.state[i] + s.error[i]
        rates(s, s.time, s.w, s.error)
        filter_error(s)
        norm = share(s)
    for i in range(s.n):
        s.error[i] /= s.allowed_estimate * (s.absolute[i] + max(abs(s.state[i]), abs(s.new[i])) * s.relative)
    return norm


def filter_error(s: IntegratorWorkspace) -> None:
    """Solve the real system for a rate in `error`, with the stages' part in `rest`."""
    drop_noise(s, s.error)
    for i in range(s.n):
        s.error[i] += s.rest[i]
    solve_real(s, s.error)


def share(s: IntegratorWorkspace) -> float:
    """Return the norm of the error in units of the tolerance."""
    total = 0.0
    for i in range(s.n):
        part = s.error[i] / (s.allowed_estimate * (s.absolute[i] + max(abs(s.state[i]), abs(s.new[i])) * s.relative))
        total += part * part
    return sqrt(total) / sqrt(float(s.n))
