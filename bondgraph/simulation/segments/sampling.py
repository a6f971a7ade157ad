"""Instants of sampled events: tick k at k*period + (offset + delay + jitter*u), u of the numbers of a seed, each rounded on its own."""

from __future__ import annotations

from math import ulp

import numpy as np

from compiler.api import Array, random_number

from ...errors import RunFailed

MOST_SAMPLES = 1_000_000  # samples of one sampled event
COLUMNS = 5  # period, offset, delay, jitter, seed
CLOSE = 16  # units in the last place: instants closer than this are one


def sampling_of(values: Array) -> Array:
    """Return the rows of all sampled events (events, 5) from a program's `sampling`. Raises `RunFailed` for values out of range."""
    rows = np.asarray(values, dtype=float).reshape(-1, COLUMNS)
    for period, offset, delay, jitter, seed in rows.tolist():
        times = 0 < period < np.inf and 0 <= offset < period and delay >= 0 and jitter >= 0 and delay + jitter < period
        if not (times and 0 <= seed < 2**31 and seed == int(seed)):
            raise RunFailed(
                "BR760", f"an event every {period:g} s has an offset of {offset:g} s, a delay of {delay:g} s, a jitter of {jitter:g} s and the seed {seed:g}:",
                "a period is longer than nothing, an offset less than it, and so are delay and jitter together, none is negative, and a seed is whole",
            )  # fmt: skip
    return rows


def ticks(row: Array, numbers: Array) -> Array:
    """Return the instants of ticks of one event by their numbers."""
    period, offset, delay, jitter, seed = row.tolist()
    late = offset + delay
    if jitter:
        late = late + jitter * np.array([0.5 + 0.5 * random_number(int(k), int(seed)) for k in numbers])
    return np.asarray(period * numbers + late)


def ticks_between(row: Array, start: float, stop: float) -> Array:
    """Return the instants of one event behind `start` and before `stop`. Raises `RunFailed` for too many."""
    period = float(row[0])
    if (stop - start) / period > MOST_SAMPLES:
        raise too_often(period, stop - start)
    most = float(row[1:4].sum())  # no tick is later than this, less than two periods
    times = ticks(row, np.arange(np.floor((start - most) / period), np.ceil(stop / period) + 1))
    return times[(times > start) & (times < stop)]


def too_often(period: float, length: float) -> RunFailed:
    """Return the error of an event that acts too often."""
    return RunFailed(
        "BR761", f"an event every {period:g} s for {length:g} s acts more than {MOST_SAMPLES} times, or never"
    )


def due_at(rows: Array, time: float) -> list[int]:
    """Return the numbers of the rows with a tick at an instant."""
    due = []
    for number, (period, offset, delay, jitter, _) in enumerate(rows.tolist()):
        plain = offset + delay
        missed = abs(time - (round((time - plain) / period) * period + plain))
        if jitter:
            near = np.floor((time - plain) / period) + np.array([-1.0, 0.0, 1.0])
            missed = np.abs(time - ticks(rows[number], near)).min()
        if missed <= CLOSE * ulp(max(abs(time), period)):
            due.append(number)
    return due
