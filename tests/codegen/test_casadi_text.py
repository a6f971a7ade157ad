"""The module for CasADi, run with sympy in the place of CasADi: its functions against the module for numpy, where no CasADi is installed."""

from __future__ import annotations

import math
import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy

from compiler.codegen.numpy.body import number
from compiler.compilation import Compilation
from compiler.errors import CompilationFailed
from tests.codegen.test_numpy_text import module_of, values
from tests.compiling import Running, compiled


class Vector(list[Any]):
    """A column of symbols or expressions."""

    def __add__(self, other: Any) -> Vector:
        return Vector([*self, *other])


class Remainder:
    """A remainder, whose comparison is a condition."""

    def __init__(self, a: Any, b: Any) -> None:
        self.value = sympy.Mod(a, b)

    def __eq__(self, other: object) -> Any:
        return sympy.Eq(self.value, other)


def _flat(parts: Any) -> Vector:
    return Vector(x for part in parts for x in (part if isinstance(part, list) else [part]))


def _function(name: str, arguments: list[Any], results: list[Any]) -> Any:
    symbols = _flat(arguments)

    def called(*given: Any) -> Any:
        values = _flat(given)
        assert len(values) == len(symbols), name
        at = dict(zip(symbols, values, strict=True))
        (result,) = results
        rows = result if isinstance(result, sympy.Matrix) else list(result)
        if isinstance(rows, sympy.Matrix):
            return np.array(rows.subs(at).evalf(), dtype=float)
        return [float(sympy.sympify(x).subs(at)) for x in rows]

    return called


def _solve(matrix: Any, right: Any) -> Any:
    return Vector(sympy.Matrix(matrix).LUsolve(sympy.Matrix(right)))


def _jacobian(rows: Any, columns: Any) -> Any:
    return sympy.Matrix(len(rows), len(columns), lambda i, j: sympy.diff(rows[i], columns[j]))


def _counted(name: str, count: int = 1) -> Any:
    found = Vector(sympy.Symbol(f"{name}_{i}", real=True) for i in range(count))
    return found if name != "t" else sympy.Symbol("t", real=True)


SUBSTITUTE = {
    "SX": SimpleNamespace(sym=_counted),
    "vertcat": lambda *parts: _flat(parts),
    "horzcat": lambda *parts: parts,
    "vertsplit": list,
    "solve": lambda matrix, right: _solve([list(row) for row in matrix], right),
    "jacobian": _jacobian,
    "Function": _function,
    "fabs": sympy.Abs,
    "fmin": sympy.Min,
    "fmax": sympy.Max,
    "fmod": Remainder,
    "if_else": lambda c, a, b: sympy.Piecewise((a, sympy.sympify(c)), (b, True)),
    "logic_and": sympy.And,
    "logic_or": sympy.Or,
    "logic_not": sympy.Not,
    "sin": sympy.sin,
    "exp": sympy.exp,
    "sign": lambda x: sympy.Piecewise((1, x > 0), (-1, x < 0), (0, True)),
}


def functions_of(compilation: Compilation, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The module, imported with sympy's functions under the names of CasADi."""
    module, casadi = ModuleType("functions"), ModuleType("casadi")
    casadi.__dict__.update(SUBSTITUTE)
    monkeypatch.setitem(sys.modules, "casadi", casadi)
    exec(compile(compilation.text("casadi"), "functions.py", "exec"), module.__dict__)
    return module


def same(compilation: Compilation, monkeypatch: pytest.MonkeyPatch, *states: float) -> Any:
    """Compare all functions with those of the module for numpy at given states and unknowns, then return the module."""
    functions, numpy = functions_of(compilation, monkeypatch), module_of(compilation)
    n = len(numpy.STATES)
    x, z = list(states[:n]), list(states[n:])
    inputs = [functions.INPUT_DEFAULTS] if functions.INPUT_DEFAULTS else []
    given = [0.7, x, *([z] if z else []), functions.DEFAULTS, *inputs]
    p = numpy.Parameters()
    expected = values(numpy, 0.7, np.array(states), p, np.array(inputs[0]) if inputs else None)
    rates = functions.derivative(*given) + (functions.residual(*given) if z else [])
    for a, b in zip((rates, functions.outputs(*given), functions.jacobian(*given)), expected, strict=True):
        np.testing.assert_allclose(a, np.reshape(b, np.shape(a)), rtol=1e-11, atol=1e-14)
    assert pytest.approx(numpy.start(p)[:n]) == functions.START
    letters = "txzpu" if z and inputs else "txzp" if z else "txpu" if inputs else "txp"
    assert all(a is getattr(functions, name) for a, name in zip(functions.arguments, letters, strict=True))
    assert set(functions.dae) == ({"t", "x", "p", "ode", "z", "alg"} if z else {"t", "x", "p", "ode"})
    assert [*functions.dae["p"]] == [*functions.p, *(functions.u if inputs else [])]
    assert functions.dae["ode"] is functions.ode and (not z or functions.dae["alg"] is functions.alg)
    assert hasattr(functions, "residual") == bool(z)
    return functions


MODEL = """plain model M {
  parameter k = 3, m = 2, r = 0.5 "of the damper", t = 0.25
  input push = 4
  I mass : p = m*f { start p = 1 }
  C spring : e = k*q + t*q^3 { start q = 2*t }
  R damper : e = r*f*abs(f) + (sin(f) if f > 0 and not f > 5 or f < -7 else 2*f)
  MSe drive : e = push*exp(-time)
  drive -> 1(mass, spring, damper)
  output q = spring.q, least = min(spring.q, mass.f), most = max(spring.q, mass.f)
}
"""


def test_a_model_with_an_input(monkeypatch: pytest.MonkeyPatch) -> None:
    compilation = compiled(MODEL, free=("*",))
    found = same(compilation, monkeypatch, 1.5, 0.75)
    same(compilation, monkeypatch, -2.5, 0.75)
    assert (found.DEFAULTS, found.INPUT_DEFAULTS) == ([2.0, 3.0, 0.25, 0.5], [4.0])
    text = compilation.text("casadi")
    assert "_solve" not in text and "_root" not in text and "x = ca.SX.sym('x', 2)" in text
    assert "[3]  # r, 1, of the damper" in text


def test_a_model_without_inputs_or_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    found = same(compiled("plain model M { signal a = integral(1 - a, 0.5); output y = a }"), monkeypatch, 0.25)
    assert (found.DEFAULTS, found.INPUT_DEFAULTS, found.START) == ([], [], [0.5])
    assert found.p == [] and not hasattr(found, "u") and not hasattr(found, "z")


def test_a_loop_with_unknowns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dampers whose laws have no inverse in closed form."""
    text = """plain model M {
      parameter r = 2
      input u = 3
      MSe s : e = u
      R a : e = r*f + f^3
      R b : e = f + f^5/7
      C c : e = q
      R d : e = f
      s -> 1(a) -> 0(b) -> 1(c, d)
      output f = a.f
    }"""
    compilation = compiled(text, free=("*",))
    same(compilation, monkeypatch, 0.5, *[0.3] * len(module_of(compilation).UNKNOWNS))


def test_a_power_that_is_turned_round_has_a_value_below_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    """The exponent is a parameter: the texts call a real root, as the program does, where a power has no value."""
    text = """plain model M {
      parameter r = 2, n = 3
      Se s : e = -3
      R a : e = r*f^n
      C c : e = q
      s -> 1(a, c)
      output f = a.f
    }"""
    compilation = compiled(text, free=("*",))
    assert "_root(" in compilation.text("casadi") and "_solve" not in compilation.text("casadi")
    found = same(compilation, monkeypatch, 0.5)
    (rate,) = found.derivative(0.0, [0.5], found.DEFAULTS)
    assert rate == pytest.approx(-((3.5 / 2) ** (1 / 3)), rel=1e-14)
    assert Running(compilation).rates({"c.q": 0.5}) == {"c.q": pytest.approx(rate, rel=1e-14)}
    assert "root((-3 - c.q)/r, n)" in compilation.state_equations


def test_a_linear_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    text = """plain model M {
      parameter r = 2
      Se s : e = 3
      for i in 1..6 { R a[i] : e = r*i*f }
      C c : e = q
      R d : e = f
      s -> 1(a[1]) -> 0(a[2]) -> 1(a[3]) -> 0(a[4]) -> 1(a[5]) -> 0(a[6]) -> 1(c, d)
      output f = a[1].f
    }"""
    compilation = compiled(text, free=("*",))
    assert "_solve(" in compilation.text("casadi") and "_root" not in compilation.text("casadi")
    same(compilation, monkeypatch, 0.5)


@pytest.mark.parametrize("law", ["linear(x, (0, 1 m, 2 m), (0, 2 N, 5 N))", "cubic(x, (0, 1 m, 2 m), (0, 2 N, 5 N))"])
def test_tables_are_refused_with_a_place(law: str) -> None:
    text = f"model M {{ C c : F = {law}; I m : p = 1 kg*v; 1 j : translation; j -> c, m; output x = c.x }}"
    with pytest.raises(CompilationFailed, match="Tables and noise cannot be written in CasADi") as failed:
        compiled(text, free=("*",)).text("casadi")
    assert [(d.code, d.span.line) for d in failed.value.diagnostics] == [("BG605", 1)]


def test_parameters_without_anumber() -> None:
    assert [number(v) for v in (1.5, -2, math.inf, -math.inf, None)] == [
        "1.5", "-2.0", "float('inf')", "float('-inf')", "float('nan')",
    ]  # fmt: skip
    assert number(math.nan) == "float('nan')"
