"""Functions of CasADi against the module for numpy: rates, Jacobian by CasADi's own differentiation, outputs, and an integration."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import bondgraph
from compiler.compilation import Compilation
from compiler.errors import CompilationFailed
from tests.codegen.test_module import compiled_model, every_model
from tests.codegen.test_numpy_text import module_of, values
from tests.codegen.test_tables import LAWS, SPRINGS
from tests.compiling import MODELS, compiled

ca = pytest.importorskip("casadi")


def casadi_of(compilation: Compilation) -> Any:
    module = ModuleType("functions")
    exec(compile(compilation.text("casadi"), "functions.py", "exec"), module.__dict__)
    return module


EVENTS = {"BatchTank", "SampledServo"}  # which act


@every_model
def test_models(path: Path, name: str) -> None:
    compilation = compiled_model(path, name, free=True)
    if name in EVENTS:
        with pytest.raises(CompilationFailed, match="BG605"):
            casadi_of(compilation)
        return
    functions, module = casadi_of(compilation), module_of(compilation)
    p, generator = module.Parameters(), np.random.default_rng(3)
    n, m = len(module.STATES), len(getattr(module, "UNKNOWNS", ()))
    start = np.concatenate([np.array(functions.START).ravel(), np.zeros(m)])
    u = np.array(functions.INPUT_DEFAULTS)
    for _ in range(3):
        x = start + generator.normal(size=n + m) * np.where(start != 0, np.abs(start), 1e-6)
        arguments = [0.3, x[:n], *([x[n:]] if m else []), functions.DEFAULTS, *([u] if len(u) else [])]
        rates = np.array(functions.derivative(*arguments)).ravel()
        if m:
            rates = np.concatenate([rates, np.array(functions.residual(*arguments)).ravel()])
        found = (rates, np.array(functions.outputs(*arguments)).ravel(), functions.jacobian(*arguments).full())
        with np.errstate(all="ignore"):
            expected = values(module, 0.3, x, p, u if len(u) else None)
        for a, b in zip(found, expected, strict=True):
            np.testing.assert_allclose(
                a, np.reshape(b, a.shape), rtol=1e-9, atol=1e-13 * np.nanmax(np.abs(b), initial=0.0)
            )


def test_an_integrator_of_casadi_gives_the_run_of_the_product() -> None:
    functions = casadi_of(compiled(MODELS / "lotka_volterra.bg", free=("*",)))
    run = ca.integrator("run", "cvodes", functions.dae, 0.0, 5.0, {"reltol": 1e-10, "abstol": 1e-12})
    end = np.array(run(x0=functions.START, p=functions.DEFAULTS)["xf"]).ravel()
    model = bondgraph.load(MODELS / "lotka_volterra.bg")
    found = model.simulate(None, to=5.0, points=2, rtol=1e-10)
    last = {"prey": found["x"][-1], "predators": found["y"][-1]}
    np.testing.assert_allclose(end, [last[name] for name in model.states], rtol=1e-7)


def test_tables_are_refused_with_a_place() -> None:
    with pytest.raises(CompilationFailed, match="Tables and noise cannot be written in CasADi") as failed:
        compiled(SPRINGS.format(law=next(iter(LAWS.values())), ys="-4, 0, 0.5, 4"), free=("*",)).text("casadi")
    assert [d.code for d in failed.value.diagnostics] == ["BG605"]
