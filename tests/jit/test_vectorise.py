"""Loops as array operations: each rule of the rewriting against the loop as it stands, and the loops that stay as they are."""

from __future__ import annotations

import ast
from collections.abc import Callable
from math import isfinite, pow, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compiler.jit.vectorise import _Vectoriser

KNOWN: dict[str, Any] = {
    "FEW": 3, "WEIGHTS": (1.0, 2.0, 3.0), "isfinite": isfinite, "sqrt": sqrt, "pow": pow, "np": np,
}  # fmt: skip
# Bodies of functions of n, floats a and b (2 n), whole numbers w (n) and p (n, a permutation), and a number x; `r` is the result.
REWRITTEN = {
    "a value for all": "for i in range(n):\n    a[i] = 1.5",
    "an elementwise expression": "for i in range(n):\n    a[i] = -b[i] * x + abs(a[i]) / 2.0",
    "a row at an offset": "for i in range(n):\n    a[n + i] = b[i + n] - a[i]",
    "from a start": "for i in range(1, n):\n    a[i] = b[i] * 2.0",
    "elements one place earlier": "for i in range(1, n):\n    a[i] = b[i - 1]",
    "two statements with a local": "for i in range(n):\n    c = a[i] + b[i]\n    a[i] = c * c\n    b[i] = c - x",
    "a local read before it changes": "for i in range(n):\n    c = a[i]\n    a[i] = b[i]\n    b[i] = c",
    "a local that is equal in all rounds": "for i in range(n):\n    c = 2.0\n    if a[i] > 0.0:\n        c = b[i]\n    a[i] = c",
    "an assignment with an operator": "for i in range(n):\n    a[i] += x * b[i]\n    b[i] *= 0.5",
    "a sum": "for i in range(n):\n    r += a[i] * b[i]",
    "a sum under a condition": "for i in range(n):\n    if w[i] != 0:\n        r += a[i]",
    "a count": "for i in range(n):\n    if a[i] > b[i]:\n        r += 1.0",
    "a local sum": "for i in range(n):\n    c = a[i]\n    c += b[i]\n    a[i] = c",
    "the largest": "for i in range(n):\n    r = max(r, abs(a[i]))",
    "the smallest under a condition": "for i in range(n):\n    if w[i] == 0:\n        r = min(r, a[i])",
    "the largest that keeps NaN": "for i in range(n):\n    c = abs(a[i])\n    r = c if not c <= r else r",
    "a condition with two sides": "for i in range(n):\n    if a[i] > 0.0:\n        a[i] = b[i]\n    else:\n        a[i] = -b[i]",
    "a condition in a condition": "for i in range(n):\n    if a[i] > 0.0:\n        if b[i] > 0.0:\n            a[i] = 7.0",
    "a condition that its own values change": "for i in range(n):\n    if a[i] > 0.0:\n        a[i] = -1.0\n        b[i] = x",
    "a condition without the index": "for i in range(n):\n    if x > 0.0:\n        a[i] = b[i]\n    else:\n        a[i] = 0.0",
    "and, or, not": "for i in range(n):\n    if a[i] > 0.0 and (b[i] > 0.0 or not w[i] == 1):\n        a[i] = x",
    "a choice": "for i in range(n):\n    a[i] = b[i] if a[i] < b[i] else x",
    "a choice without the index": "for i in range(n):\n    a[i] = b[i] if x > 0.0 else a[i]",
    "functions": "for i in range(n):\n    a[i] = sqrt(abs(a[i])) + max(a[i], b[i]) - min(x, b[i]) + pow(abs(b[i]), 2.0)",
    "whether a number is finite": "for i in range(n):\n    a[i] = 1.0 if isfinite(a[i]) else 0.0",
    "the index as a number": "for i in range(n):\n    a[i] = float(i) + 0.5 * float(w[i])",
    "a return where anything holds": "for i in range(n):\n    if a[i] > b[i]:\n        return 1.0",
    "a fact that holds anywhere": "for i in range(n):\n    if a[i] > 2.0:\n        r = 3.0",
    "elements by an index array": "for i in range(n):\n    a[i] = b[p[i]]",
    "elements written by an index array": "for i in range(n):\n    a[p[i]] = b[i]",
    "sums into elements that repeat": "for i in range(n):\n    a[w[i]] += b[i]\n    a[w[i]] -= 0.5 * b[i]",
    "the largest of elements that repeat": "for i in range(n):\n    a[w[i]] = max(a[w[i]], b[i])",
    "a few rounds within": "for i in range(n):\n    c = 0.0\n    for k in range(FEW):\n        c += b[i]\n    a[i] = c",
    "diagonal elements": "for i in range(n):\n    a[2 * i] = b[i]",
}  # fmt: skip
KEPT = {
    "a literal number of rounds": "for i in range(3):\n    r += a[i]",
    "a recurrence": "for i in range(1, n):\n    a[i] = a[i - 1] + b[i]",
    "a product of all": "for i in range(n):\n    r *= a[i]",
    "a number that another round changes": "c = 0.0\nfor i in range(n):\n    c = c + a[i]\n    b[i] = c",
    "a sum into one element": "for i in range(n):\n    a[0] += b[i]",
    "an element that is written and read by all": "for i in range(1, n):\n    a[i] = a[0] + b[i]\n    b[i] = a[1]",
    "a literal list": "for i in range(FEW - 1):\n    r += WEIGHTS[i] * a[i]",
    "an early end": "for i in range(n):\n    if a[i] > 0.0:\n        break\n    r += b[i]",
    "an unknown function": "for i in range(n):\n    a[i] = other(b[i])",
    "backwards": "for i in range(n - 1, -1, -1):\n    a[i] = b[i]",
}  # fmt: skip


def pair(body: str) -> tuple[Callable[..., Any], Callable[..., Any], str]:
    """Return a function as it stands, with array operations, and the text of the latter."""
    lines = "\n    ".join([*body.splitlines(), "return r"])
    tree = ast.parse(f"def f(n, a, b, w, p, x, r):\n    {lines}\n")
    plain, home = dict(KNOWN) | {"other": abs}, dict(KNOWN) | {"other": abs}
    exec(compile(tree, "plain", "exec"), plain)
    made = ast.fix_missing_locations(_Vectoriser(KNOWN).visit(tree))
    exec(compile(made, "arrays", "exec"), home)
    return plain["f"], home["f"], ast.unparse(made)


numbers = st.floats(-10, 10, allow_subnormal=False)


@st.composite
def arguments(draw: st.DrawFn) -> tuple[Any, ...]:
    n = draw(st.integers(3, 7))
    a, b = (np.array(draw(st.lists(numbers, min_size=2 * n, max_size=2 * n))) for _ in range(2))
    w = np.array(draw(st.lists(st.integers(0, n - 1), min_size=n, max_size=n)))
    return n, a, b, w, np.array(draw(st.permutations(range(n)))), draw(numbers), draw(numbers)


def agree(body: str, values: tuple[Any, ...]) -> None:
    """Result and arrays are the same, sums to rounding."""
    plain, arrays, _ = pair(body)
    one, other = (tuple(v.copy() if isinstance(v, np.ndarray) else v for v in values) for _ in range(2))
    np.testing.assert_allclose(arrays(*other), plain(*one), rtol=1e-12, atol=1e-11)
    for mine, expected in zip(other[1:5], one[1:5], strict=True):
        np.testing.assert_allclose(mine, expected, rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize("name", REWRITTEN)
def test_a_loop_becomes_array_operations(name: str) -> None:
    assert "for i in" not in pair(REWRITTEN[name])[2]


@pytest.mark.parametrize("name", KEPT)
def test_a_loop_stays_as_it_is(name: str) -> None:
    body = KEPT[name]
    assert body.splitlines()[-1].strip() in pair(body)[2] and "for i in" in pair(body)[2]


@pytest.mark.few(22)
@pytest.mark.parametrize("name", [*REWRITTEN, *KEPT])
@given(values=arguments())
@settings(max_examples=30, deadline=None)
def test_both_compute_the_same(name: str, values: tuple[Any, ...]) -> None:
    agree((REWRITTEN | KEPT)[name], values)


def test_not_a_number_is_seen() -> None:
    n = 3
    a = np.array([1.0, 2.0, np.nan, 0.0, 0.0, 0.0])
    for name in (
        "the largest",
        "the largest that keeps NaN",
        "whether a number is finite",
        "a condition with two sides",
    ):
        agree(REWRITTEN[name], (n, a, np.ones(6), np.zeros(n, dtype=int), np.arange(n), 1.0, 0.0))
