"""Instants of an `every`: its period, and `offset`, `delay`, `jitter` and `seed`."""

from __future__ import annotations

from ...algebra.formula import Bound
from ...graph.network import Sampling
from ...graph.units import ONE, SECOND
from ...syntax import tree
from ..names.errors import SamplingOutOfRange, WrongSampling, WrongType
from ..names.scope import Scalar, Scope
from ..names.statement_errors import Wrong
from .elaborate import Elaborator
from .values import read_value

LARGEST_SEED = 2.0**31


def read_sampling(elaborator: Elaborator, event: tree.EventSyntax, scope: Scope) -> Sampling:
    """Instants of an event, all known before the run. Raises `Wrong`."""
    bounds = {"period": _time(elaborator, event.condition, scope, "What stands after `every`")}
    for timing in event.timing:
        if timing.word in bounds:
            hint = f"Leave one of the two out: `every 1 ms {timing.word} …` has one."
            raise Wrong(WrongSampling(timing.span, f"`{timing.word}` is given twice", hint))
        what = f"What stands after `{timing.word}`"
        bounds[timing.word] = _time(elaborator, timing.value, scope, what, timing.word == "seed")
    if "seed" in bounds and "jitter" not in bounds:
        span = next(t.span for t in event.timing if t.word == "seed")
        hint = "Say how late an instant may be: `every 1 ms jitter 10 us seed 1 { … }`."
        raise Wrong(WrongSampling(span, "A seed without jitter", hint))
    _check_range(elaborator, event, bounds)
    return Sampling(**bounds)


def _time(elaborator: Elaborator, value: tree.ExpressionSyntax, scope: Scope, what: str, bare: bool = False) -> Bound:
    """A time that is known before the run, or a bare number. Raises `Wrong`."""
    target = Scalar(0.0, ONE if scope.plain or bare else SECOND, "number", "period")
    return read_value(elaborator, value, scope, target, what, static=True)


def _check_range(elaborator: Elaborator, event: tree.EventSyntax, bounds: dict[str, Bound]) -> None:
    """Raise `Wrong` for a period, offset, delay, jitter or seed that is known and out of its range; others are looked at by the run."""
    spans = {"period": event.condition.span} | {t.word: t.value.span for t in event.timing}
    numbers = {word: elaborator.value_of(bound, spans[word]) for word, bound in bounds.items()}
    period = numbers["period"]
    if period is not None and not period > 0:
        hint = "A period is longer than nothing: `every 1 ms { … }`."
        raise Wrong(WrongType(spans["period"], "A time", f"{period:g} s", hint))
    for word in ("offset", "delay", "jitter"):
        value = numbers.get(word)
        if value is None:
            continue
        jitter = (numbers.get("jitter") or 0.0) if word == "delay" else 0.0
        if not value >= 0 or (period is not None and not value + jitter < period):
            what = f"`{word}` is {value:g} s" + (f" and `jitter` {jitter:g} s" if jitter else "")
            rest = "" if period is None else f", of a period of {period:g} s"
            raise Wrong(SamplingOutOfRange(spans[word], what + rest, RANGES[word]))
    seed = numbers.get("seed")
    if seed is not None and not (0 <= seed < LARGEST_SEED and seed == int(seed)):
        raise Wrong(
            SamplingOutOfRange(spans["seed"], f"The seed is {seed:g}", "It is a whole number from 0 to 2^31 - 1.")
        )


RANGES = {
    "offset": "It is the instant of the first sample behind zero: zero or more, and less than the period.",
    "delay": "What one sample computes takes effect before the next sample: delay and jitter together are less than the period. A longer one is "
    "written where the value is used: `delay(u, 3 ms)`.",
    "jitter": "An instant is late by something from zero to this: zero or more, and less than the period.",
}
