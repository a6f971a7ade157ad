"""Jacobians of all models in models/ against finite differences, at random states of the size that a run has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bondgraph.simulation.segments.timeline import segments
from compiler.compilation import Compilation
from compiler.scene import Scene
from compiler.source import Source
from compiler.syntax import tree
from tests.codegen.test_module import MODELS_OF_FILES
from tests.compiling import Running, compiled, magnitudes


def experiments(path: Path, name: str) -> list[str | None]:
    """None, and every experiment of a model."""
    found = Compilation(Source(path.name, path.read_text(encoding="utf-8"), path), Scene(name)).tree.models[name]
    return [None, *(s.name for s in found.statements if isinstance(s, tree.Experiment))]


CASES = [(path, name, experiment) for path, name in MODELS_OF_FILES for experiment in experiments(path, name)]


def differences(f: Any, state: Any, steps: Any) -> Any:
    """df/dx * step by central differences of fourth order, column by column."""
    columns = []
    for i, h in enumerate(steps):
        e = np.zeros_like(state)
        e[i] = h
        columns.append((8 * (f(state + e) - f(state - e)) - (f(state + 2 * e) - f(state - 2 * e))) / 12)
    return np.stack(columns, axis=-1)


@pytest.mark.few(26)
@pytest.mark.parametrize(("path", "name", "experiment"), CASES, ids=[f"{n}-{e}" for _, n, e in CASES])
def test_jacobian(path: Path, name: str, experiment: str | None) -> None:
    compilation = compiled(path, model=name, experiment=experiment, everything=True)
    running = Running(compilation)
    if not running.program.states.names:
        pytest.skip("no states")
    stop = compilation.plan.stop or 1.0
    stretches = segments(running.program, running.constants, 0.0, stop)
    magnitude = magnitudes(running, stretches)
    angles = np.array([u == "1" for u in (*running.program.states.units, *running.program.unknowns.units)])
    magnitude = np.where(
        angles, np.minimum(magnitude, 1.0), magnitude
    )  # a crank turns many times; differences are of one turn
    generator = np.random.default_rng(7)
    for stretch in stretches[:4]:
        time = stretch.start + 0.37 * (stretch.stop - stretch.start)
        state = running.start + magnitude * generator.uniform(-1, 1, len(magnitude))

        def rates(x: Any, time: float = time, mode: Any = stretch.mode) -> Any:
            return running.program.derivative(time, x, running.inputs, running.constants, mode)

        exact = running.program.jacobian(time, state, running.inputs, running.constants, stretch.mode) * magnitude
        coarse, fine = (differences(rates, state, h * magnitude) / h for h in (2e-3, 1e-3))
        noise = np.abs(coarse - fine)  # what the differences themselves do not know
        scale = np.abs(exact).sum(axis=1, keepdims=True)
        assert (np.abs(exact - fine) <= 1e-8 * scale + 3 * noise).all(), (running.program.states.names, exact - fine)
        assert np.abs(exact - fine).max() <= 1e-5 * np.abs(exact).max()


@pytest.mark.parametrize(
    ("law", "point"),
    [
        ("e = 3*q + q^3", 0.7), ("e = 3*q + q^3", 0.0), ("e = sin(q)*exp(q)", -0.4), ("e = tanh(q)/(1 + q^2)", 1.1), ("e = sqrt(1 + q^2)", 0.3), ("e = q*abs(q)", -0.5), ("e = q if q > 0 else 2*q", 0.5), ("e = q if q > 0 else 2*q", -0.5),
        ("e = max(q, q^3)", 0.5), ("e = atan2(q, 2)", 0.5), ("e = log(2 + q)", 0.1), ("e = (2 + q)^q", 0.4), ("e = 2^q", 0.4), ("energy = q^4/4 + q^2", 0.6), ("energy = cosh(q)", 0.6), ("e = asinh(q) + atan(q)", -2.0), ("q = e/3", 0.6), ("e = sign(q)*sqrt(abs(q))", 0.3),
    ],
)  # fmt: skip
def test_jacobian_of_laws(law: str, point: float) -> None:
    """A mass on a spring of any law: d(p')/dq = -d(e)/dq, and the rest of the matrix."""
    text = f"plain model A {{\n  1 j\n  I m : p = 2*f\n  C c : {law}\n  R r : e = f + f^3\n  j -> m, c, r\n}}\n"
    running = Running(compiled(text, everything=True))
    state = np.array([0.8, point])
    arguments = list(running.arguments(0.0, {"m.p": 0.8, "c.q": point}, None))
    exact = running.program.jacobian(*arguments)

    def rates(x: Any) -> Any:
        return running.program.derivative(0.0, x, *arguments[2:])

    assert exact == pytest.approx(differences(rates, state, [1e-4, 1e-4]) / 1e-4, rel=1e-8, abs=1e-9)
    assert running.program.states.names == ("m.p", "c.q")


def test_finite_at_the_kink_of_the_controller() -> None:
    """V = gain sqrt(abs(c)) sign(c) with the force V^2, from a state that starts at 0: a slope between those of the two sides."""
    text = "plain model A {\n  1 j\n  I m : p = f\n  C c : e = q\n  signal volt = 3*sqrt(abs(c.q))*sign(c.q)\n  MSe drive : e = volt^2\n  drive -> j -> m, c\n}\n"
    running = Running(compiled(text, everything=True))
    row, column = (running.program.states.names.index(n) for n in ("m.p", "c.q"))
    for q, low, high in ((0.0, -9.0, 9.0), (1e-9, 9.0, 9.0), (-1e-9, -9.0, -9.0)):
        with np.errstate(all="ignore"):
            jacobian = running.program.jacobian(*running.arguments(0.0, {"c.q": q}, None))
        assert np.isfinite(jacobian).all()
        assert low - 1e-6 <= jacobian[row, column] + 1.0 <= high + 1e-6
