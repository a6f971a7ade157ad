"""Functions of JAX against the module for numpy, where JAX is installed; numpy stands in for it otherwise."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.special

import bondgraph
from bondgraph.errors import MissingPackage
from compiler.api import load_module
from compiler.errors import CompilationFailed
from tests.codegen.test_casadi_text import MODEL
from tests.codegen.test_numpy_text import module_of, values
from tests.codegen.test_tables import LAWS, SPRINGS
from tests.compiling import MODELS, compiled

CHOICES = """plain model Choices {
  parameter n = 3, a = 0.7
  I mass : p = f { start p = 0.4 }
  R rough : e = (2*f if (f > 0.1 and f < 0.9) or not f < 5 else erf(f)) + atan2(f, a) + log10(a) + acosh(2 + f) + atanh(f) + sign(f)*ceil(f)
  R worn : e = min(min(f, a), n*f) + max(max(f, 0.2), a*f) + floor(f/a) + abs(f) + sqrt(f)
  1 body
  body -> mass, rough, worn
  output f = mass.f, r = rough.e, w = worn.e
}
"""


def stand_in() -> dict[str, ModuleType]:
    """Modules of the names of JAX that compute by numpy."""
    jax, jnp = ModuleType("jax"), ModuleType("jax.numpy")
    jnp.__dict__.update(vars(np))
    jax.__dict__.update(numpy=jnp, scipy=scipy, config=SimpleNamespace(update=lambda *_: None))
    return {"jax": jax, "jax.numpy": jnp}


@pytest.fixture
def jax(monkeypatch: pytest.MonkeyPatch) -> Any:
    """JAX, or None where numpy stands in."""
    try:
        import jax
    except ImportError:
        for name, module in stand_in().items():
            monkeypatch.setitem(sys.modules, name, module)
        return None
    return jax


@pytest.mark.parametrize("name", ["", "choices", "pid_dc_motor", "crank_linkage", "rectifier"])
def test_models(name: str, jax: Any) -> None:
    """Conditions, inputs, a linear and a nonlinear loop."""
    text = {"": MODEL, "choices": CHOICES}.get(name, MODELS / f"{name}.bg")
    compilation = compiled(text, free=("*",))
    functions, module = load_module("functions", compilation.text("jax")), module_of(compilation)
    n, m = len(module.STATES), len(getattr(module, "UNKNOWNS", ()))
    start = np.concatenate([np.asarray(functions.start()), np.zeros(m)])
    assert start[:n] == pytest.approx(module.start(module.Parameters())[:n], rel=1e-14)
    u = getattr(functions, "INPUT_DEFAULTS", ())
    for seed in range(3):
        x = start + np.random.default_rng(seed).normal(size=n + m) * np.where(start != 0, np.abs(start), 1e-6)
        arguments = [0.3, x[:n], *([x[n:]] if m else []), functions.DEFAULTS, *([u] if len(u) else [])]
        rates = [functions.derivative(*arguments), *([functions.residual(*arguments)] if m else [])]
        with np.errstate(all="ignore"):
            expected = values(module, 0.3, x, module.Parameters(), np.asarray(u) if len(u) else None)
        found = [np.concatenate([np.asarray(r) for r in rates]), np.asarray(functions.outputs(*arguments))]
        if jax is not None:
            slopes = np.asarray(jax.jacfwd(functions.derivative, 1)(*arguments))
            expected = (*expected[:2], np.reshape(expected[2], (-1, n + m))[: len(slopes), :n])
            found.append(slopes)
        for a, b in zip(found, expected, strict=False):
            assert a.dtype == np.float64
            np.testing.assert_allclose(a, np.reshape(b, a.shape), rtol=1e-9, atol=1e-13 * np.abs(b).max(initial=0.0))


def test_models_give_their_functions(jax: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """p' = F - k x - k3 x^3 - r p/m, x' = p/m."""
    model = bondgraph.load(MODELS / "oscillator.bg")
    functions, x = model.to_jax(), np.array([0.3, 2e-3])
    assert model.states == ("mass.p", "spring.x")
    rates = np.array([-100 * 2e-3 - 2e4 * 2e-3**3 - 0.5 * 0.3, 0.3])
    assert np.asarray(functions.derivative(0.0, x)) == pytest.approx(rates, rel=1e-14)
    assert np.asarray(functions.derivative(0.2, x)) == pytest.approx(rates + np.array([1, 0]), rel=1e-14)
    assert np.asarray(functions.outputs(0.0, x)) == [2e-3]
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(MissingPackage, match="functions of casadi need its package"):
        model.to_casadi()


def test_casadi_gets_its_functions_from_a_model() -> None:
    pytest.importorskip("casadi")
    functions = bondgraph.load(MODELS / "oscillator.bg").to_casadi()
    found = functions.derivative(0.0, [0.3, 2e-3], functions.DEFAULTS)
    assert np.array(found).ravel() == pytest.approx([-0.35016, 0.3], rel=1e-14)


def test_what_cannot_be_written_is_refused() -> None:
    with pytest.raises(CompilationFailed, match="Tables and noise cannot be written in JAX"):
        compiled(SPRINGS.format(law=next(iter(LAWS.values())), ys="-4, 0, 0.5, 4"), free=("*",)).text("jax")
    with pytest.raises(CompilationFailed, match="JAX"):
        bondgraph.load("plain model M { mode n = 0\n every 1 { n = n + 1 }\n output y = n }").to_jax()
