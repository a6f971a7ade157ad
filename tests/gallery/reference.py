"""References for the gallery: hand-written rates, integrated by another method than the product's, and driven linear systems."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import bondgraph

RTOL = 1e-9
GALLERY = Path(__file__).resolve().parents[2] / "models"
MARGIN = 100  # a solver holds rtol step by step; what a run adds up to is allowed a hundred times that
BETWEEN = 10  # times as much between the steps, where the solver's polynomial is of lower order than its steps


def run(name: str, experiment: str | None = "", **what: Any) -> bondgraph.Result:
    """A model of the gallery at the tolerance of these tests, with all its outputs."""
    model = bondgraph.load(GALLERY / f"{name}.bg")
    return model.simulate(experiment, **{"rtol": RTOL, "points": 41, "outputs": model.outputs, **what})


def near(found: Any, expected: Any, scale: float = 0.0, margin: float = MARGIN) -> None:
    """A trajectory within the tolerance of its largest magnitude (or of `scale`), and its end ten times as well."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    magnitude = max(float(np.max(np.abs(expected))), scale)
    off = np.abs(found - expected) / magnitude
    assert off.max() <= BETWEEN * margin * RTOL, f"off by {off.max():.3g} of {magnitude:.6g} at instant {off.argmax()}"
    assert off[-1] <= margin * RTOL, f"off by {off[-1]:.3g} of {magnitude:.6g} at the end"


def driven(
    a: Any, b: Any, start: Sequence[float], times: Any, frequency: float = 0.0, powers: int = 1
) -> Any:  # shape (times, states)
    """x' = A x + b u from a start, exactly: u = sin(frequency t), or without one u = t^(powers - 1).

    The input is made part of the state: an oscillator, or a chain of integrators; then the matrix exponential is the answer.
    """
    n = len(start)
    inner = 2 if frequency else powers
    whole, first = np.zeros((n + inner, n + inner)), np.zeros(n + inner)
    whole[:n, :n], whole[:n, n], first[:n] = a, b, start
    if frequency:
        whole[n, n + 1], whole[n + 1, n], first[n + 1] = frequency, -frequency, 1.0
    else:
        for i in range(powers - 1):
            whole[n + i, n + i + 1] = powers - 1 - i
        first[n + powers - 1] = 1.0
    return np.array([(expm(whole * t) @ first)[:n] for t in times])


def integrated(
    rates: Callable[..., Any], start: Any, times: Any, corners: Sequence[float] = (), method: str = "DOP853"
) -> Any:  # shape (times, states)
    """Hand-written rates at 1e-12 by DOP853 (stiff ones by LSODA), restarted at the instants where they jump or bend."""
    times = np.asarray(times, dtype=float)
    found = np.empty((len(times), len(start)))
    edges = [times[0], *(c for c in corners if times[0] < c < times[-1]), times[-1]]
    state = np.array(start, dtype=float)
    for left, right in pairwise(edges):
        inside = (times >= left) & (times <= right)

        def within(
            t: float, y: Any, left: float = left, right: float = right
        ) -> Any:  # never on the far side of a corner
            return rates(min(max(t, np.nextafter(left, right)), np.nextafter(right, left)), y)

        wanted = np.unique(np.append(times[inside], [left, right]))
        solved = solve_ivp(within, (left, right), state, method, wanted, rtol=1e-12, atol=1e-15)
        assert solved.success
        found[inside] = solved.y.T[np.isin(wanted, times[inside])]
        state = solved.y[:, -1]
    return found
