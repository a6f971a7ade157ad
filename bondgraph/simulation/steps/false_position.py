"""A zero of one of several functions of a place, by false position."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

CLOSE, ROUNDS = 1e-9, 12  # distance of two places that count as one, and most iterations


def false_position(function: Callable[[float], Any], item: Any, a: float, b: float, at_a: float, at_b: float) -> float:
    """Return an approximate zero between two places of different signs (Illinois: Dowell and Jarratt, BIT 11, 1971)."""
    for _ in range(ROUNDS):
        new = b - at_b * (b - a) / (at_b - at_a)
        value = float(function(new)[item])
        if value * at_b < 0:
            a, at_a = b, at_b
        else:
            at_a *= 0.5
        b, at_b = new, value
        if value == 0 or abs(b - a) < CLOSE:
            break
    return b
