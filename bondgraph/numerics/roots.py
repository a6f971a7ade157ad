"""Zero of a function of one number between two places (Chandrupatla, Advances in Engineering Software 28, 1997).

A step of the search is in the subset that becomes machine code.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from compiler.api import Array, Record

MOST = 200  # evaluations; bisection alone needs about a hundred for any two doubles

Function = Callable[[Any], Any]
Place = tuple[float, float]  # a place and the value there


class Bracket(Record):
    """Two places with different signs: `a`, the last one, and `b`; `c` was given up last."""

    a: float
    at_a: float
    b: float
    at_b: float
    c: float
    at_c: float
    share: float  # of the way from a to b: the next place


def begin_bracket(k: Bracket, low: float, at_low: float, high: float, at_high: float) -> None:
    """Begin with two places and the values there."""
    k.b = low
    k.at_b = at_low
    k.a = high
    k.at_a = at_high
    k.c = high
    k.at_c = at_high
    k.share = 0.5


def bracket_place(k: Bracket) -> float:
    """Return the place at which the function is to be evaluated next."""
    return k.a + k.share * (k.b - k.a)


def closes_at(k: Bracket, place: float, value: float, tolerance: float) -> bool:
    """Take the value at this place; return True if both places are closer than twice the tolerance, or one is a zero.

    The next place is by inverse quadratic interpolation where it is safe, else by bisection.
    """
    if (value > 0.0) == (k.at_a > 0.0):
        k.c = k.a
        k.at_c = k.at_a
    else:
        k.c = k.b
        k.at_c = k.at_b
        k.b = k.a
        k.at_b = k.at_a
    k.a = place
    k.at_a = value
    least = tolerance / abs(k.b - k.a) if k.b != k.a else 1.0
    if least > 0.5 or k.at_a == 0.0 or k.at_b == 0.0:
        return True
    xi = (k.a - k.b) / (k.c - k.b)
    phi = (k.at_a - k.at_b) / (k.at_c - k.at_b)
    share = 0.5
    if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:  # a power would raise where it overflows
        share = k.at_a / (k.at_b - k.at_a) * k.at_c / (k.at_b - k.at_c) + (k.c - k.a) / (k.b - k.a) * k.at_a / (
            k.at_c - k.at_a
        ) * k.at_b / (k.at_c - k.at_b)
    k.share = min(1.0 - least, max(least, share))
    return False


def crossing(function: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Return a zero between two places with different signs, to `tolerance`."""
    low, high = float(low), float(high)
    k = Bracket(a=0.0, at_a=0.0, b=0.0, at_b=0.0, c=0.0, at_c=0.0, share=0.0)
    begin_bracket(k, low, function(low), high, function(high))
    for _ in range(MOST):
        place = bracket_place(k)
        if closes_at(k, place, function(place), tolerance):
            break
    return k.a if abs(k.at_a) < abs(k.at_b) else k.b


def zeros_between(
    function: Function, low: Array, high: Array, at_low: Array, at_high: Array, least: Function
) -> tuple[Any, Any, Any, Any]:
    """Return the last two places, and the values there, of a search between each two places of different sign: for many functions at once.

    `function`: places (k,) -> values (k,); `least`: the better of two places (k,) -> width at which a search ends (k,).
    """
    b, a, at_b, at_a = low, high, at_low, at_high
    c, at_c, share = a, at_a, np.full(len(low), 0.5)
    going = (at_low != 0) & (at_high != 0)
    for _ in range(MOST):
        if not going.any():
            break
        place = a + share * (b - a)
        value = function(place)
        same = (value > 0) == (at_a > 0)
        c, at_c = np.where(going, np.where(same, a, b), c), np.where(going, np.where(same, at_a, at_b), at_c)
        b, at_b = np.where(going & ~same, a, b), np.where(going & ~same, at_a, at_b)
        a, at_a = np.where(going, place, a), np.where(going, value, at_a)
        part = np.where(b != a, least(np.where(np.abs(at_a) < np.abs(at_b), a, b)) / np.abs(b - a), 1.0)
        going &= (part <= 0.5) & (at_a != 0) & (at_b != 0)
        xi, phi = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
        safe = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
        inverse = at_a / (at_b - at_a) * at_c / (at_b - at_c) + (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (
            at_c - at_b
        )
        share = np.clip(np.where(safe & np.isfinite(inverse), inverse, 0.5), part, 1 - part)
    return a, b, at_a, at_b
