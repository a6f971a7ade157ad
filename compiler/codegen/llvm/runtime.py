"""Runtime functions that generated code calls: linear systems, roots, and those of `algebra/interpolate.py`.

They are written in the subset that `jit` compiles, and compute the same as the functions at the beginning of a numpy module
(`numpy/runtime.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import floor, isfinite, log, nan, pow
from typing import Any

from ...algebra.interpolate import hermite, inverse, linear, monotone_slope, natural_slope, noise
from ...jit.arrays import Floats, Record

# time, state, inputs, constants, mode, where the values go: every function of a program.
Function = Callable[[float, "Floats", "Floats", "Floats", "Floats", "Floats"], None]

INFINITE = float("inf")
WELL, ENOUGH = 1e-11, 1e-3  # by how much the solution 1 … 1 may be missed
MEANS = 12  # rounds of means of magnitudes


class BatchArrays(Record):
    """Arguments and results of a function at many points, and the stride between points in each array (0: the same for all)."""

    times: Floats
    states: Floats
    inputs: Floats
    constants: Floats
    modes: Floats
    out: Floats
    by_time: int
    by_state: int
    by_inputs: int
    by_constants: int
    by_mode: int
    size: int


def batch(function: Function, count: int, arrays: BatchArrays) -> None:
    """Call a function at `count` points."""
    times = arrays.times
    states = arrays.states
    inputs = arrays.inputs
    constants = arrays.constants
    modes = arrays.modes
    out = arrays.out
    by_time = arrays.by_time
    by_state = arrays.by_state
    by_inputs = arrays.by_inputs
    by_constants = arrays.by_constants
    by_mode = arrays.by_mode
    size = arrays.size
    for i in range(count):
        function(
            times[i * by_time], states[i * by_state :], inputs[i * by_inputs :], constants[i * by_constants :], modes[i * by_mode :], out[i * size :]
        )  # fmt: skip


# ---------------------------------------------------------------- linear systems


def room(count: int, lower: int, upper: int, slant: int) -> int:
    """Number of doubles that `solve` needs in `work`."""
    width = lower + upper + 1 if slant else count
    return count * (2 * width + slant * lower) + 5 * count


def solve(count: int, lower: int, upper: int, slant: int, entries: Floats, work: Floats, out: Floats) -> None:
    """Solve a linear system: the matrix by rows, then the right side. If it has no unique solution, the result is NaN.

    `lower` and `upper`: numbers of diagonals below and above the main one. `slant`: 1 if a row has only these entries, 0 if it has all.
    Entry (i, j) is item `i * (width - slant) + slant * lower + j` of rows of that width.
    """
    width = lower + upper + 1 if slant == 1 else count
    missed = solution(count, lower, upper, slant, entries, work, out)
    if not missed < WELL:
        # Unknowns of several units may make it look singular: means of magnitudes bring it to a scale without units.
        scaled = work[count * (width + slant * lower) + 2 * count :]
        rows = scaled[count * width :]
        columns = rows[count:]
        other = columns[count:]
        balance(count, lower, upper, slant, entries, scaled)
        for i in range(count):
            for j in range(max(0, i - lower), min(count, i + upper + 1)):
                place = i * (width - slant) + slant * lower + j
                scaled[place] = entries[place] / rows[i] / columns[j]
            rows[i] = entries[count * width + i] / rows[i]
        better = solution(count, lower, upper, slant, scaled, work, other)
        if not better > missed:
            missed = better
            for i in range(count):
                out[i] = other[i] / columns[i]
    if not missed < ENOUGH:
        for i in range(count):
            out[i] = nan


def balance(count: int, lower: int, upper: int, slant: int, entries: Floats, out: Floats) -> None:
    """Scale factors, powers of two, that bring rows and columns to similar magnitudes. They follow the matrix in `out`."""
    width = lower + upper + 1 if slant == 1 else count
    step = width - slant
    first = slant * lower
    rows = out[count * width :]
    columns = rows[count:]
    for i in range(count):
        columns[i] = 0.0
        for k in range(i * width, (i + 1) * width):
            size = abs(entries[k])
            out[k] = log(size) / log(2.0) if size != 0.0 else 0.0
    for _ in range(MEANS):
        for i in range(count):
            total = 0.0
            present = 0
            for j in range(max(0, i - lower), min(count, i + upper + 1)):
                if entries[i * step + first + j] != 0.0:
                    total += out[i * step + first + j] - columns[j]
                    present += 1
            rows[i] = total / float(max(1, present))
        for j in range(count):
            total = 0.0
            present = 0
            for i in range(max(0, j - upper), min(count, j + lower + 1)):
                if entries[i * step + first + j] != 0.0:
                    total += out[i * step + first + j] - rows[i]
                    present += 1
            columns[j] = total / float(max(1, present))
    for i in range(count):
        rows[i] = pow(2.0, floor(rows[i] + 0.5))
        columns[i] = pow(2.0, floor(columns[i] + 0.5))


def solution(count: int, lower: int, upper: int, slant: int, matrix: Floats, work: Floats, out: Floats) -> float:
    """Solve by partial pivoting; return the error of a second solution, known to be 1 … 1, which indicates a nearly singular matrix.

    The fill-in of pivoting is stored in `lower` more diagonals above the others.
    """
    width = lower + upper + 1 if slant == 1 else count
    right = matrix[count * width :]
    wide = width + slant * lower
    step = wide - slant
    first = slant * lower
    columns = work[count * wide :]
    ones = columns[count:]
    for j in range(count):
        columns[j] = 0.0
    for i in range(count):
        begin = max(0, i - lower)
        end = min(count, i + upper + 1)
        largest = 0.0
        for j in range(begin, end):
            largest = max(largest, abs(matrix[i * (width - slant) + first + j]))
        for k in range(i * wide, (i + 1) * wide):
            work[k] = 0.0
        for j in range(begin, end):
            share = matrix[i * (width - slant) + first + j] / largest
            work[i * step + first + j] = share
            columns[j] = max(columns[j], abs(share))
        out[i] = right[i] / largest
    for i in range(count):
        ones[i] = 0.0
        for j in range(max(0, i - lower), min(count, i + upper + 1)):
            place = i * step + first + j
            work[place] = work[place] / columns[j]
            ones[i] += work[place]
    for k in range(count):
        last = min(count, k + lower + 1)
        end = min(count, k + lower + upper + 1)
        best = k
        for i in range(k + 1, last):
            if abs(work[i * step + first + k]) > abs(work[best * step + first + k]):
                best = i
        if not abs(work[best * step + first + k]) > 0.0:
            return INFINITE
        if best != k:
            for j in range(k, end):
                kept = work[k * step + first + j]
                work[k * step + first + j] = work[best * step + first + j]
                work[best * step + first + j] = kept
            kept = out[k]
            out[k] = out[best]
            out[best] = kept
            kept = ones[k]
            ones[k] = ones[best]
            ones[best] = kept
        for i in range(k + 1, last):
            factor = work[i * step + first + k] / work[k * step + first + k]
            for j in range(k + 1, end):
                work[i * step + first + j] -= factor * work[k * step + first + j]
            out[i] -= factor * out[k]
            ones[i] -= factor * ones[k]
    missed = 0.0
    for i in range(count - 1, -1, -1):
        for j in range(i + 1, min(count, i + lower + upper + 1)):
            out[i] -= work[i * step + first + j] * out[j]
            ones[i] -= work[i * step + first + j] * ones[j]
        out[i] = out[i] / work[i * step + first + i]
        ones[i] = ones[i] / work[i * step + first + i]
        off = abs(ones[i] - 1.0)
        missed = off if not off <= missed else missed
    for i in range(count):
        out[i] = out[i] / columns[i]
    return missed


# ---------------------------------------------------------------- single values


def root(x: float, n: float) -> float:
    """The real n-th root of x for odd n; not defined for even n."""
    whole = isfinite(n) and n == floor(n)
    if whole and n == 2.0 * floor(n / 2.0):
        return nan
    sign = 1.0
    if whole:
        sign = 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)
    return sign * pow(x * sign, 1.0 / n)


# Functions by the operators that call them.
BY_OPERATOR: Mapping[str, Callable[..., Any]] = {
    "solve": solve, "banded": solve, "linear": linear, "cubic": hermite, "monotone": hermite, "inverse": inverse,
    "natural_slope": natural_slope, "monotone_slope": monotone_slope, "noise": noise, "root": root,
}  # fmt: skip
