"""Distributions of parameters, from texts such as `normal(1.95 um, 50 nm)`, `truncated(normal(…), 1.8 um, 2.1 um)`.

The quantile function of each (inverse of the distribution function) converts quasi-random points in the unit cube, and correlations by a Gaussian
copula, into values.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from compiler.api import DISTRIBUTIONS, SPREAD, Array, Distribution, fault, kinds_told

from ..errors import UsageError
from ..quantities import quantity, unit_written

EDGE = 2.0**-53  # distance from the edge of the cube, where an unbounded distribution has no value
_CALL = re.compile(r"\s*([a-z]+)\s*\((.*)\)\s*", re.DOTALL)


def quantiles(given: Distribution, shares: Array) -> Array:
    """Return the quantiles at these probabilities."""
    frozen = _frozen(given)
    first, last = float(frozen.cdf(given.low)), float(frozen.cdf(given.high))
    shares = np.clip(first + shares * (last - first), EDGE, 1 - EDGE)
    return np.asarray(np.clip(frozen.ppf(shares), given.low, given.high))


def _frozen(given: Distribution) -> Any:
    from scipy import stats

    match given.kind, given.numbers:
        case "normal", (mean, spread):
            return stats.norm(mean, spread)
        case "lognormal", (mean, spread):
            sigma = math.sqrt(math.log1p((spread / mean) ** 2))
            return stats.lognorm(sigma, scale=mean * math.exp(-(sigma**2) / 2))
        case "uniform", (low, high):
            return stats.uniform(low, high - low)
        case _, (low, mode, high):
            return stats.triang((mode - low) / (high - low), low, high - low)
    raise AssertionError(given.kind)


def distribution(text: str, unit: str, name: str) -> Distribution:
    """Return the distribution of a text; `unit` is one of the parameter's kind, `name` the parameter's. Raises `UsageError`."""
    call = _CALL.fullmatch(text)
    if call is None or call[1] not in (*DISTRIBUTIONS, "truncated"):
        raise UsageError("BR401", f"{name}: `{text.strip()}` is no distribution; there are {kinds_told()}")
    parts = _parts(call[2])
    if call[1] == "truncated":
        return _truncated(parts, unit, name, text)
    words = DISTRIBUTIONS[call[1]]
    if len(parts) != len(words):
        raise UsageError(
            "BR402", f"{name}: {call[1]} takes {len(words)} numbers: {', '.join(words)}; this is `{text.strip()}`"
        )
    numbers = tuple(
        _spread(p, unit, name) if word == SPREAD else quantity(p, unit, name)
        for p, word in zip(parts, words, strict=True)
    )
    return checked(Distribution(call[1], numbers), name)


def _spread(text: str, unit: str, name: str) -> float:
    """Return a difference in SI: for temperatures without the offset, for ratios in dB as a number."""
    for own, written in (("degC", "K"), ("degF", "K"), ("dB", "[1]")):
        if unit_written(text) == own:
            raise UsageError("BR403", f"{name}: a standard deviation is a difference;", f"write it in {written}")
    return quantity(text, unit, name)


def _truncated(parts: Sequence[str], unit: str, name: str, text: str) -> Distribution:
    if len(parts) != 3:
        raise UsageError("BR404", f"{name}: truncated takes a distribution, low and high; this is `{text.strip()}`")
    inner = distribution(parts[0], unit, name)
    low, high = (quantity(p, unit, name) for p in parts[1:])
    return checked(Distribution(inner.kind, inner.numbers, max(low, inner.low), min(high, inner.high)), name)


def checked(found: Distribution, name: str) -> Distribution:
    """Return the same distribution, if it is valid. Raises `UsageError`."""
    wrong = fault(found)
    if wrong:
        raise UsageError("BR405", f"{name}: {wrong}")
    ends = _frozen(found).cdf([found.low, found.high])
    if not ends[1] - ends[0] > 1e-12:
        raise UsageError("BR406", f"{name}: nothing of the distribution lies between {found.low:g} and {found.high:g}")
    return found


def _parts(text: str) -> list[str]:
    """Split at the commas outside parentheses."""
    found, depth, begin = [], 0, 0
    for i, mark in enumerate(text):
        depth += (mark in "([") - (mark in ")]")
        if mark == "," and depth == 0:
            found.append(text[begin:i])
            begin = i + 1
    return [*found, text[begin:]]
