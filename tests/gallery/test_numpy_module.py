"""The module of `bondgraph compile` against sympy's evaluation of the state equations, in forty digits, at random states."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
import sympy

import bondgraph
from bondgraph.analysis.symbolic import state_equations
from bondgraph.errors import UsageError
from bondgraph.simulation.segments.timeline import segments
from tests.codegen.test_module import MODELS_OF_FILES
from tests.compiling import Running, compiled, magnitudes

SAMPLES = 8


def module(path: Path, name: str, folder: Path) -> Any:
    """The file that a user gets, imported by Python."""
    file = folder / "generated.py"
    file.write_text(bondgraph.load(path, name).compile(), encoding="utf-8")
    spec = importlib.util.spec_from_file_location("generated", file)
    assert spec is not None
    assert spec.loader is not None
    generated = importlib.util.module_from_spec(spec)
    sys.modules["generated"] = generated  # dataclasses look for it there
    spec.loader.exec_module(generated)
    return generated


def exact_rates(path: Path, name: str) -> tuple[list[str], Any]:
    """The names that the state equations are over, and their right sides as a function of mpmath numbers in that order."""
    compilation = compiled(path, model=name, free=("*",), everything=True)
    equations = state_equations(compilation.state_space)
    symbols = sorted({s for right in equations.values() for s in right.free_symbols}, key=str)
    return [str(s) for s in symbols], {
        state: sympy.lambdify(symbols, right, "mpmath", cse=True) for state, right in equations.items()
    }


def sizes(path: Path, name: str) -> dict[str, tuple[float, float]]:
    """Start and magnitude of each state as the first experiment has them; without one, as small inputs make them.

    The size matters: a mechanism a metre away from where its micrometres belong has lost digits before it begins.
    """
    compilation = compiled(path, model=name, experiment="", everything=True)
    stop = compilation.plan.stop
    if stop is None:
        compilation = compiled(path, model=name, free=("*",), everything=True)
    running = Running(compilation)
    program = running.program
    if stop is None:
        running.inputs[:] = 1e-9
    magnitude = magnitudes(running, segments(program, running.constants, 0.0, stop or 1.0))
    names = (*program.states.names, *program.unknowns.names)
    return dict(zip(names, zip(running.start.tolist(), magnitude.tolist(), strict=True), strict=True))


@pytest.mark.few(8)
@pytest.mark.parametrize(("path", "name"), MODELS_OF_FILES, ids=[name for _, name in MODELS_OF_FILES])
def test_module_and_sympy_agree(path: Path, name: str, tmp_path: Path) -> None:
    generated = module(path, name, tmp_path)
    states = [n for n, _ in generated.STATES]
    inputs = [n for n, _ in getattr(generated, "INPUTS", ())]
    moving = [*states, *(n for n, _ in getattr(generated, "UNKNOWNS", ()))]
    if not states:
        pytest.skip("no states")
    try:
        names, exact = exact_rates(path, name)
    except UsageError as refused:
        pytest.skip(str(refused))  # mechanisms in space have witnesses of their own
    parameters = generated.Parameters()
    known = {n: p.value for n, p in bondgraph.load(path, name).parameters.items()}
    names_of_parameters = compiled(path, model=name, free=("*",)).program.parameters.names
    known |= dict(zip(names_of_parameters, vars(parameters).values(), strict=True))
    size = sizes(path, name)
    start, magnitude = (np.array([size[n][i] for n in moving]) for i in (0, 1))
    generator = np.random.default_rng(11)
    found, expected = [], []
    with mpmath.workdps(40):
        for _ in range(SAMPLES):
            time = float(generator.uniform(0, 1))
            x = start + magnitude * generator.uniform(-1, 1, len(moving))
            u = generator.uniform(-1, 1, len(inputs))
            arguments_of_inputs = (u,) if inputs else ()
            if len(moving) > len(states):
                rates = generated.equations(time, x[: len(states)], x[len(states) :], parameters, *arguments_of_inputs)
            else:
                rates = generated.derivative(time, x, parameters, *arguments_of_inputs)
            found.append(dict(zip(moving, rates.tolist(), strict=True)))
            values = known | {"time": time} | dict(zip(moving, x.tolist(), strict=True))
            values |= dict(zip(inputs, u.tolist(), strict=True))
            arguments = [mpmath.mpf(values[n]) for n in names]
            expected.append({state: rate(*arguments) for state, rate in exact.items()})
    assert set(states) <= set(exact)
    for state in states:
        scale = max(abs(e[state]) for e in expected)
        off = max(abs(f[state] - e[state]) for f, e in zip(found, expected, strict=True))
        assert off <= 1e-13 * scale, (state, float(off / scale))
