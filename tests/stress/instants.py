"""Conditions on time: duties and frequencies of gates, windows anywhere, products and sums of them, in every way; closed forms."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from tests.stress.report import Section
from tests.stress.trial import RTOL, Case, run_all
from tests.stress.ways import Way, ways

EXACT = 1e-9 / RTOL  # of an open time: all that a run may be off, whatever its tolerance
DUTIES = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 0.99, 0.997, 0.999)
FREQUENCIES = (5, 20, 50, 200, 1000, 20000)
WIDTHS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
GATE = """model Gate {
  parameter f = 50 Hz, duty = 0.01
  signal gate = 1 if cos(2*pi*f*time) > cos(pi*duty) else 0
  signal half = 1 if time > 0.3 s and time < 0.7123 s else 0
  MSe a : F = 1 N*gate
  MSe b : F = 1 N*gate*half
  MSe c : F = 1 N if gate + half > 0.5 else 0 N
  I m : p = 1 kg*v
  I n : p = 1 kg*v
  I o : p = 1 kg*v
  a -> m
  b -> n
  c -> o
  output one = m.p, both = n.p, either = o.p
}
"""
WINDOWS = {
    "distance": "abs(time - c) < w",
    "square": "(time - c)^2 < w^2",
    "bell": "exp(-((time - c)/w)^2) > exp(-1)",
    "sides": "time > c - w and time < c + w",
    "sine": "abs(sin(time/1 s - c/1 s)) < sin(w/1 s)",
}


def last(value: float) -> Callable[[Any], Any]:
    """A value that is known at the end of a run alone."""
    return lambda times: np.where(times == times[-1], value, np.nan)


def gate(frequency: float, duty: float) -> Case:
    """Open for `duty` of each period, about whole numbers of periods."""
    centres = np.arange(frequency + 1) / frequency
    reach = 0.5 * duty / frequency

    def within(start: float, stop: float) -> float:
        return float(np.clip(np.minimum(centres + reach, stop) - np.maximum(centres - reach, start), 0, None).sum())

    one, both = within(0.0, 1.0), within(0.3, 0.7123)
    sums = {"one": one, "both": both, "either": one + 0.4123 - both}
    rounding = max(EXACT, 2e-16 / reach / RTOL)  # an instant is rounded by 1e-16 s
    return Case(
        f"gate of {frequency:g} Hz", "duty", duty, GATE, {"f": float(frequency), "duty": duty}, 1.0,
        lambda t: {name: last(value)(t) for name, value in sums.items()}, points=3, allowed=rounding, longest=600.0,
        only=lambda way: frequency <= 1000 or (way.target != "numpy" and duty in (0.001, 0.5, 0.999)),
    )  # fmt: skip


def window(form: str, width: float, start: float) -> Case:
    """Open for twice its width, at a random place."""
    place = start + random.Random(f"{form} {width} {start}").uniform(0.05, 0.95)
    text = (
        f"model Window {{\n  parameter c = {place!r} s, w = 1 s\n  Se a : F = 1 N if {WINDOWS[form]} else 0 N\n  I m : p = 1 kg*v\n"
        f"  a -> m\n  output p = m.p\n  experiment go {{ simulate {start!r} s .. {start + 1.0!r} s }}\n}}\n"
    )
    allowed = EXACT + 64 * float(np.spacing(max(abs(start), 1.0))) / width / RTOL
    return Case(
        f"window as {form} from {start:g} s", "width", width, text, {"w": width}, start + 1.0,
        lambda t: {"p": last(2 * width)(t)}, points=3, experiment="go", allowed=allowed,
    )  # fmt: skip


def cases(short: bool) -> Iterator[Case]:
    """All of them, or some."""
    for frequency in (5, 50) if short else FREQUENCIES:
        for duty in (0.001, 0.5, 0.999) if short else DUTIES:
            yield gate(frequency, duty)
    for form in ("distance", "bell") if short else WINDOWS:
        for width in (1e-3, 1e-9) if short else WIDTHS:
            for start in (0.0,) if short else (0.0, -7.0, 1e6):
                yield window(form, width, start)


def lossy(way: Way) -> bool:
    """Return True if a solver takes models with sources."""
    return way.solver != "energy"


def section(short: bool) -> Section:
    """Everything above."""
    found = Section("Conditions on time")
    chosen = [way for way in ways() if lossy(way)]
    run_all(found, list(cases(short)), chosen[:3] if short else chosen)
    for finding in found.refused:
        found.fail(finding.where, finding.what)  # all of them can be run
    return found
