"""Each function of the table of operators in every target: floats, intervals, numpy, machine code and C agree with sympy at 30 digits."""

from __future__ import annotations

import ctypes
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy

from compiler.algebra.derivative import partial
from compiler.algebra.expression import Apply, Expression, Number, Symbol, apply, evaluate
from compiler.algebra.intervals import TABLE, plain
from compiler.algebra.operators import OPERATORS, value_of
from compiler.algebra.sympy_form import to_sympy
from compiler.codegen.c.write import write_c
from tests.codegen.test_c import library, needs_compiler
from tests.codegen.test_native import X, Y, evaluated
from tests.compiling import compiled, mistakes

FUNCTIONS = sorted(name for name, row in OPERATORS.items() if row.units)
EXACT = 1e-15  # relative: a few roundings


def places(operator: str) -> Any:
    """Some operands within the domain, (points, operands)."""
    row = OPERATORS[operator]
    low, high = max(row.domain[0], -2.9), min(row.domain[1], 2.9)
    first = low + (high - low) * np.array([0.013, 0.21, 0.37, 0.55, 0.68, 0.93])
    return np.stack([first, np.roll(first, 2)], axis=1)[:, : row.arity]


def exact(operator: str, operands: Any) -> float:
    """Value by sympy."""
    numbers = [sympy.Float(float(x), 40) for x in operands]
    node = Apply(operator, tuple(Symbol(i) for i in range(len(numbers))))
    return float(sympy.N(to_sympy(node, lambda i: numbers[i]), 30))


def near(found: Any, operator: str) -> None:
    expected = [exact(operator, x) for x in places(operator)]
    np.testing.assert_allclose(found, expected, rtol=EXACT, atol=0)


@pytest.mark.parametrize("operator", FUNCTIONS)
def test_values(operator: str) -> None:
    at = places(operator)
    near([value_of(operator, x) for x in at.tolist()], operator)
    near(plain(operator, list(at.T)), operator)


@pytest.mark.parametrize("operator", FUNCTIONS)
def test_numpy_and_machine_code(operator: str) -> None:
    at = places(operator)
    states = np.zeros((len(at), 2))
    states[:, : at.shape[1]] = at
    for found in evaluated([Apply(operator, (X, Y)[: at.shape[1]])], states):
        near(found[:, 0], operator)


@pytest.mark.parametrize("operator", FUNCTIONS)
def test_ranges(operator: str) -> None:
    """Over a small box around each point: the range contains the values and is no wider than their variation allows."""
    for point in places(operator).tolist():
        boxes = [(x - 1e-6, x + 1e-6) for x in point]
        low, high = TABLE[operator](*((np.array([a]), np.array([b])) for a, b in boxes))
        for share in (0.0, 0.3, 1.0):
            assert low[0] <= value_of(operator, [a + share * (b - a) for a, b in boxes]) <= high[0]
        assert high[0] - low[0] < 1e-3 or OPERATORS[operator].course == "jumping" or not OPERATORS[operator].smooth


@pytest.mark.parametrize("operator", FUNCTIONS)
def test_derivatives_by_sympy(operator: str) -> None:
    row = OPERATORS[operator]
    names = tuple(sympy.Symbol(n, real=True) for n in "ab")[: row.arity]
    node = Apply(operator, tuple(Symbol(i) for i in range(row.arity)))
    if not row.smooth and operator != "atan2":
        return  # one-sided by definition
    for i, name in enumerate(names):
        slope = sympy.diff(to_sympy(node, lambda k: names[k]), name)
        for point in places(operator).tolist():
            expected = float(
                sympy.N(slope.subs({n: sympy.Float(float(x), 40) for n, x in zip(names, point, strict=True)}), 30)
            )
            assert evaluate(partial(node, i), lambda k, p=point: float(p[k])) == pytest.approx(
                expected, rel=1e-12, abs=1e-13
            )


@needs_compiler
def test_c(tmp_path: Path) -> None:
    lowered = compiled(
        "model A {\nsignal x = integral(0 [1/s], 0), y = integral(0 [1/s], 0)\noutput z = x + y\n}"
    ).lowered
    lowered.outputs = {name: Apply(name, (X, Y)[: OPERATORS[name].arity]) for name in FUNCTIONS}
    function = library(write_c(lowered), tmp_path).A_output
    found = np.zeros((6, len(FUNCTIONS)))
    for i, name in enumerate(FUNCTIONS):
        for j, point in enumerate(places(name)):
            state, out = np.zeros(2), np.zeros(len(FUNCTIONS))
            state[: len(point)] = point
            function(ctypes.c_double(0.0), *(ctypes.c_void_p(a.ctypes.data) for a in (state, out, out, out, out)))
            found[j, i] = out[i]
    for i, name in enumerate(FUNCTIONS):
        near(found[:, i], name)


@pytest.mark.parametrize("operator", [name for name in FUNCTIONS if OPERATORS[name].units == "bare"])
def test_operands_have_no_unit(operator: str) -> None:
    (found,) = mistakes(f"model A {{\nparameter a = 0.5 [m]\noutput y = {operator}(a)\n}}")
    assert found.code == "BG103", found


@pytest.mark.parametrize("operator", [name for name in FUNCTIONS if OPERATORS[name].inverse])
def test_inverses(operator: str) -> None:
    row = OPERATORS[operator]
    assert row.inverse is not None
    for (x,) in places(operator).tolist():
        y: Expression = Number(value_of(operator, [x]))
        found = row.inverse(apply, y)
        assert isinstance(found, Number) and math.isclose(found.value, x, rel_tol=1e-12)
