"""Peaks of laws within a tried step that no node of the method has seen, such as a narrow bell of a state.

The places of peaks (see `compiler/codegen/peaks.py`) are followed along the polynomial of the step. Where one is zero or turns, the value that may be narrow is
compared with the polynomial through its values at the nodes of the method. Other rates are evaluated only where it is off.
"""

from __future__ import annotations

from math import ulp

from compiler.api import Floats, Numbers

from .. import radau
from ..workspace import IntegratorWorkspace
from .evaluation import has_loops, rates
from .kinks import CLOSE, ROUNDS, crossed_at, false_position, put_peaks
from .newton_matrices import solve_real
from .trial_interpolant import tried_at

BENT = radau.BENT
MOST_CUTS = 8  # of one step
UNSEEN = 2.0  # least height of a peak, beside what the last node changes of the polynomial
OUTSIDE, NARROWEST = 0.25, 1e-13  # part of the height that is left outside of a peak, and fraction of a step
ROUNDED = 1e-9  # of a value: less is no peak
MOVED = 4.0  # about the number in front of the inverse of a step's size in the matrix of a method


def first_peak(s: IntegratorWorkspace, size: float, nodes: Numbers, first_node: int, count: int) -> float:
    """Return the fraction of a tried step at which it should end, so that the next one meets the first of its unseen peaks; 1 if there is none.

    `nodes`: fractions at which the method evaluates rates, `count` of them from an index on, some or all; the start is another one.
    """
    m = 2 * s.peak_count
    first = 1.0
    if s.peak_count == 0 or s.peak_cuts >= MOST_CUTS:
        return first
    s.peak_cuts += 1
    s.peak_node_count = count + 1
    for k in range(count + 1):
        s.peak_nodes[k] = 0.0 if k == 0 else nodes[first_node + k - 1]
        put_peaks(s, size, s.peak_nodes[k], k)
    for j in range(s.peak_count):
        for k in range(count):
            at_a = s.peak_seen[k * m + j]
            at_b = s.peak_seen[(k + 1) * m + j]
            if at_a * at_b < 0.0 and s.peak_nodes[k] < first:
                at = false_position(s, size, s.bend_count + j, s.peak_nodes[k], at_a, s.peak_nodes[k + 1], at_b)
                first = min(first, end_before_peak(s, size, j, at))
            at = peak_turning(s, size, j, k) if k > 0 else 0.0
            if at > 0.0 and at < first:
                i = k - 1 if at < s.peak_nodes[k] else k
                at_a = s.peak_seen[i * m + j]
                at_b = crossed_at(s, size, at, s.bend_count + j)
                if at_a * at_b < 0.0:  # there and back within the step
                    at = false_position(s, size, s.bend_count + j, s.peak_nodes[i], at_a, at, at_b)
                first = min(first, end_before_peak(s, size, j, at))
    return first


def peak_turning(s: IntegratorWorkspace, size: float, j: int, k: int) -> float:
    """Return where a place of a peak turns, by parabolas, the first one through its values at the k-th node and those beside; 0 if it does not."""
    m = 2 * s.peak_count
    a = s.peak_nodes[k - 1]
    b = s.peak_nodes[k]
    c = s.peak_nodes[k + 1]
    at_a = s.peak_seen[(k - 1) * m + j]
    at_b = s.peak_seen[k * m + j]
    at_c = s.peak_seen[(k + 1) * m + j]
    new = 0.0
    for _ in range(ROUNDS):
        slope = (at_b - at_a) / (b - a)
        bend = ((at_c - at_b) / (c - b) - slope) / (c - a)
        last = new
        new = 0.5 * (a + b - slope / bend) if bend != 0.0 else 0.0
        if not (new > a and new < c) or abs(new - b) < CLOSE:
            return last if last > 0.0 or not (new > a and new < c) else new
        value = crossed_at(s, size, new, s.bend_count + j)
        better = (value - at_b) * bend < 0.0
        if better == (new < b):
            c = b if better else new
            at_c = at_b if better else value
        else:
            a = b if better else new
            at_a = at_b if better else value
        if better:
            b = new
            at_b = value
    return b


def peak_height(s: IntegratorWorkspace, size: float, j: int, at: float, count: int, but: int) -> float:
    """Return by how much a value at a fraction of a step is off the polynomial through those at the first nodes, without the node number `but`."""
    off = crossed_at(s, size, at, s.bend_count + s.peak_count + j)
    for k in range(count):
        weight = s.peak_seen[(2 * k + 1) * s.peak_count + j] if k != but else 0.0
        for i in range(count):
            if i != k and i != but:
                weight *= (at - s.peak_nodes[i]) / (s.peak_nodes[k] - s.peak_nodes[i])
        off -= weight
    return off


def end_before_peak(s: IntegratorWorkspace, size: float, j: int, at: float) -> float:
    """Return where a step should end because of a peak at a fraction of it that its nodes have not seen; 1 if they have, or if it does not count."""
    count = s.peak_node_count
    but = 1
    for k in range(2, count):
        but = k if abs(s.peak_nodes[k] - at) < abs(s.peak_nodes[but] - at) else but
    off = peak_height(s, size, j, at, count, but)
    height = abs(off)
    least = UNSEEN * abs(peak_height(s, size, j, at, count - 1, but) - off)
    low = 0.0
    high = 1.0
    for k in range(count):
        least = max(least, ROUNDED * abs(s.peak_seen[(2 * k + 1) * s.peak_count + j]))
        low = s.peak_nodes[k] if s.peak_nodes[k] < at and k != but else low
        i = count - 1 - k
        high = s.peak_nodes[i] if s.peak_nodes[i] > at and i != but else high
    if not height > least:
        return 1.0
    narrowest = max(NARROWEST, 1e3 * ulp(s.time) / size)
    gap = high - low
    while at - low > narrowest and abs(peak_height(s, size, j, 0.5 * (low + at), count, but)) <= OUTSIDE * height:
        low = 0.5 * (low + at)
    while high - at > narrowest and abs(peak_height(s, size, j, 0.5 * (at + high), count, but)) <= OUTSIDE * height:
        high = 0.5 * (at + high)
    if high - low == gap or min(at - low, high - at) <= narrowest or not peak_area(s, size, low, at, high) > BENT:
        return 1.0
    s.peak_ahead = 0.5 * (high - low) * size
    return low if low > 0.0 else min(high, 0.5)


def peak_area(s: IntegratorWorkspace, size: float, low: float, at: float, high: float) -> float:
    """Return by how many tolerances a state moves by what the rates are in a peak, and not outside, at the fractions `low` and `high` of a step.

    A force that changes its sign in a peak is zero in its middle: rates at both sides of it are looked at, too.
    """
    n = s.n
    near = 0.125 * min(at - low, high - at)
    put_misses(s, size, low, near, s.beside[n:])
    put_misses(s, size, high, near, s.beside[2 * n :])
    most = 0.0
    for k in range(3):
        place = 0.5 * (low + at) if k == 0 else (at if k == 1 else 0.5 * (at + high))
        share = (place - low) / (high - low)
        put_misses(s, size, place, near, s.beside)
        for i in range(n):
            s.beside[i] -= (1.0 - share) * s.beside[n + i] + share * s.beside[2 * n + i]
        unit = size
        if has_loops(s):  # what residuals are off moves states by the unknowns
            solve_real(s, s.beside)
            unit = MOVED
        for i in range(s.differential):
            scale = s.absolute[i] + abs(s.state[i]) * s.relative
            most = max(most, abs(s.beside[i]) * unit * 0.5 * (high - low) / scale)
    return most


def put_misses(s: IntegratorWorkspace, size: float, at: float, near: float, out: Floats) -> None:
    """Compute by how much the rates at a fraction of a tried step differ from the slope of its polynomial, by its values `near`."""
    share = 0.5 / (near * size)
    tried_at(s, at, s.rest)
    rates(s, s.time + at * size, s.rest, out)
    tried_at(s, at - near, s.rest)
    for i in range(s.n):
        out[i] += share * s.rest[i]
    tried_at(s, at + near, s.rest)
    for i in range(s.n):
        out[i] -= share * s.rest[i]
