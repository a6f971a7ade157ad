"""The module that users get: short, alone, and equal to native code and to the interpreted program at random states."""

from __future__ import annotations

import ast
import math
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph
from bondgraph.compiled_scene import chosen_target
from compiler.codegen.lower import lower
from compiler.codegen.numpy import generate_program
from compiler.codegen.program import Program
from compiler.compilation import Compilation
from tests.codegen.test_module import OSCILLATOR, compiled_model, every_model, imported
from tests.codegen.test_tables import LAWS, SPRINGS
from tests.compiling import MODELS, compiled
from tests.gallery.test_numpy_module import sizes

SAMPLES = 5
RTOL = 1e-13
CANCELLED = 1e-15  # of the largest entry of a Jacobian: what differences of large terms lose in every target


def module_of(compilation: Compilation) -> Any:
    """The module, imported."""
    module = ModuleType("generated")
    sys.modules["generated"] = module  # dataclasses look for it there
    exec(compile(compilation.text("numpy"), "generated.py", "exec"), module.__dict__)
    return module


def programs(compilation: Compilation) -> list[Program]:
    """The interpreted program, and machine code where there is LLVM and it takes the model."""
    lowered = lower(compilation.state_space, located=False)
    found = [generate_program(lowered)]
    if chosen_target(None) == "native" and not lowered.lags:
        from compiler.codegen.llvm.generate import generate_program as native

        found.append(native(lowered))
    return found


def close(found: Any, expected: Any, rtol: float = RTOL) -> None:
    """Values of several samples: each to `rtol` of its largest magnitude among them."""
    found, expected = (np.array(x, dtype=float) for x in (found, expected))
    found = found.reshape(expected.shape)
    magnitude = np.abs(np.where(np.isfinite(expected), expected, 0.0))
    tolerance = rtol * magnitude.max(axis=0, initial=0.0)
    same = (found == expected) | (np.isnan(found) & np.isnan(expected)) | (np.abs(found - expected) <= tolerance)
    assert same.all(), (np.argwhere(~same)[:5], found[~same][:5], expected[~same][:5])


def close_slopes(found: Any, expected: Any, spread: Any, rtol: float, cancelled: float) -> None:
    """Jacobians of several samples: to `rtol` of what the states' magnitudes make of a row, and to `cancelled` of the largest entry."""
    expected = np.array(expected, dtype=float)
    found = np.array(found, dtype=float).reshape(expected.shape)
    magnitude = np.abs(np.nan_to_num(expected))
    rows = (magnitude * spread).max(axis=(0, 2), initial=0.0)[:, None] / spread
    tolerance = rtol * (magnitude + rows) + cancelled * magnitude.max(initial=0.0)
    same = (found == expected) | (np.isnan(found) & np.isnan(expected)) | (np.abs(found - expected) <= tolerance)
    assert same.all(), (np.argwhere(~same)[:5], found[~same][:5], expected[~same][:5])


def agree(
    compilation: Compilation, size: Mapping[str, tuple[float, float]], rtol: float = RTOL, cancelled: float = CANCELLED
) -> None:
    """Rates, Jacobian and outputs at the start and around it, in every program; those of loops with their unknowns given.

    `size`: start and magnitude of each state.
    """
    module = module_of(compilation)
    p, n = module.Parameters(), len(module.STATES)
    for program in programs(compilation):
        generator = np.random.default_rng(4)
        names = (*program.states.names, *program.unknowns.names)
        assert [name for name, _ in module.STATES] == list(program.states.names)
        constants = program.constants(np.array(program.defaults, dtype=float))
        if n:
            close([module.start(p)], [program.start(constants)[:n]])
        centre, spread = (np.array([size.get(name, (0.0, 1e-6))[i] for name in names]) for i in (0, 1))
        found: list[tuple[Any, ...]] = []
        expected: list[tuple[Any, ...]] = []
        for sample in range(SAMPLES):
            x = centre + (sample > 0) * spread * generator.uniform(-1, 1, len(names))
            u = np.array(program.input_defaults) + (sample > 0) * generator.uniform(
                -1e-3, 1e-3, len(program.inputs.names)
            )
            t = float(generator.uniform(0, 1))
            point = (t, x, u, constants, program.mode_at(t, x, u, constants))
            with np.errstate(all="ignore"):
                expected.append((program.derivative(*point), program.output(*point), program.jacobian(*point)))
                found.append(values(module, t, x, p, u if len(u) else None))
        for i in range(2):
            close([f[i] for f in found], [e[i] for e in expected], rtol)
        close_slopes([f[2] for f in found], [e[2] for e in expected], spread, rtol, cancelled)


def values(module: Any, t: float, x: Any, p: Any, u: Any) -> tuple[Any, ...]:
    """Rates and residuals, outputs, and partial derivatives of a module."""
    n, inputs = len(module.STATES), () if u is None else (u,)
    if len(x) > n:
        arguments = (t, x[:n], x[n:], p, *inputs)
        return module.equations(*arguments), module.outputs(t, x[:n], p, *inputs, z=x[n:]), module.partials(*arguments)
    arguments = (t, x, *([module.discrete_start(p)] if hasattr(module, "DISCRETES") else []), p, *inputs)
    outputs = module.outputs(*arguments)
    return (module.derivative(*arguments), outputs, module.jacobian(*arguments)) if n else ((), outputs, ())


@pytest.mark.few(9)
@every_model
def test_models(path: Path, name: str) -> None:
    agree(compiled_model(path, name, free=True), sizes(path, name))


@pytest.mark.parametrize("law", LAWS)
def test_tables_and_noise(law: str) -> None:
    agree(compiled(SPRINGS.format(law=LAWS[law], ys="-4, 0, 0.5, 4"), free=("*",)), {}, rtol=1e-11, cancelled=1e-14)


@pytest.mark.few(12)
@every_model
def test_it_needs_numpy_alone(path: Path, name: str) -> None:
    source = compiled_model(path, name, free=True).text("numpy")
    assert imported(source) <= {"numpy", "dataclasses", "types"}
    names = {n.id for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Name)}
    assert not names & {"eval", "exec", "open", "__import__", "getattr", "compile", "globals"}


def functions(source: str) -> list[str]:
    return [node.name for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]


def test_the_oscillator_fits_on_two_screens() -> None:
    source = bondgraph.load(MODELS / "oscillator.bg").compile()
    assert source.count("\n") < 100
    assert functions(source) == ["start", "derivative", "jacobian", "outputs", "indicators"]
    assert "spring_F = p.k*spring_x + p.k3*spring_x**3  # oscillator.bg:8  C spring : F = k*x + k3*x^3" in source
    assert "mass_v = mass_p/p.m" in source and "[-p.r/p.m, -p.k - 3*p.k3*spring_x**2]," in source
    assert "k3: float = 20000.0  # N/m^3" in source


def test_every_comment_cites_a_line() -> None:
    source = compiled(OSCILLATOR).text("numpy")
    lines = OSCILLATOR.splitlines()
    cited = re.findall(r"^ +\w+ = .*# text\.bg:(\d+)  (.*)$", source, re.MULTILINE)
    assert len(cited) > 4 and all(law in " ".join(lines[int(number) - 1].split()) for number, law in cited)


def test_scipy_integrates_it_as_the_text_at_its_beginning_says(tmp_path: Path) -> None:
    """Also in an isolated process, which sees neither the project nor the environment."""
    file = tmp_path / "generated.py"
    file.write_text(bondgraph.load(MODELS / "lotka_volterra.bg").compile(), encoding="utf-8")
    recipe = (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").split("\n\n")[1].replace("    ", "")
    script = f"import scipy.integrate, sys\nsys.path.insert(0, '.')\nfrom generated import *\n{recipe}\nprint(y.shape[1], sorted(m for m in sys.modules if m in ('compiler', 'sympy')))"
    done = subprocess.run(
        [sys.executable, "-I", "-c", script], capture_output=True, text=True, cwd=tmp_path, check=True
    )
    assert done.stdout.split() == ["3", "[]"]


def test_a_run_is_that_of_the_product() -> None:
    model = bondgraph.load(MODELS / "four_bar.bg")
    module = module_of(compiled(MODELS / "four_bar.bg", free=("*",)))
    p, t = module.Parameters(), 0.02
    expected = model.simulate(None, to=t, points=2, outputs=model.outputs, rtol=1e-10)
    start = [expected[name][0] for name in model.outputs]
    np.testing.assert_allclose(module.outputs(0.0, module.start(p), p), start, rtol=1e-9, atol=1e-12)
    run = solve_ivp(
        module.derivative, (0.0, t), module.start(p), "Radau", jac=module.jacobian, args=(p,), rtol=1e-10, atol=1e-12
    )
    end = module.outputs(t, run.y[:, -1], p)
    np.testing.assert_allclose(end, [expected[name][-1] for name in model.outputs], rtol=1e-6, atol=1e-8)


LOOP = """plain model Loop {
  1 j
  I m : p = 2*f
  R d : e = 0.5*f + f^3
  C c : q = e + 0.1*e^3 { start q = 1 }
  j -> m, d, c
  output e = c.e, f = m.f
}
"""


def test_a_nonlinear_loop_is_solved_by_newton() -> None:
    """The residuals are zero at the unknowns, and the Jacobian is that of the rates: differences of them show it to 1e-6."""
    compilation = compiled(LOOP, free=("*",))
    module = module_of(compilation)
    agree(compilation, {})
    p, x, n = module.Parameters(), np.array([0.3, 0.7]), 2
    z = module.unknowns(0.0, x, p)
    assert np.abs(module.equations(0.0, x, z, p)[n:]).max() < 1e-15
    h = 1e-6
    differences = np.array(
        [(module.derivative(0.0, x + d, p) - module.derivative(0.0, x - d, p)) / (2 * h) for d in h * np.eye(n)]
    ).T
    np.testing.assert_allclose(module.jacobian(0.0, x, p), differences, rtol=1e-6, atol=1e-9)


HIGH_AND_SOFT = """model Two {
  Se high : u = 1e9 V
  R steep : u = 1 ohm*i + 1e-24 [ohm/A^2]*i^3
  R load : i = u/1 [ohm] + 1e-24 [A/V^3]*u^3
  1 a : electric
  high -> a -> steep, load
  Se push : M = 1e-9 [N*m]
  R soft : M = 1 [N*m*s]*omega + 1e20 [N*m*s^3]*omega^3
  R hard : omega = 1 [1/(N*m*s)]*M + 1e20 [1/(N^3*m^3*s)]*M^3
  1 b : rotation
  push -> b -> soft, hard
  output i = load.i, omega = soft.omega
}
"""


def test_a_loop_of_volts_does_not_end_that_of_newtons() -> None:
    """Each unit has a magnitude of its own: moments of 1e-10 N*m were rounding beside 5e8 V, and omega 180 times too large."""
    module = module_of(bondgraph.load(HIGH_AND_SOFT).compilation())
    current, omega = module.outputs(0.0, np.zeros(0), module.Parameters())
    assert current == pytest.approx(5e8, rel=1e-6)
    moment = omega + 1e20 * omega**3  # of the soft one; the rest of 1e-9 N*m turns the hard one equally fast
    assert (1e-9 - moment) + 1e20 * (1e-9 - moment) ** 3 == pytest.approx(omega, rel=1e-9)


BALL = """model Ball {
  parameter e = 0.8, g = 9.81 [m/s^2]
  mode bounces = 0
  Se weight : F = -1 kg*g
  1  body : translation
  I  mass : p = 1 kg*v { start p = 1 [N*s] }
  weight -> body -> mass
  signal height = integral(mass.v, 1 m)
  when height < 0 m { mass.v = -e*mass.v, bounces = bounces + 1 }
  every 0.5 s { bounces = 0 }
  output h = height, v = mass.v, n = bounces
}
"""


def test_jumps_are_indicators() -> None:
    """Of `sign` its argument, of `floor` a sine that is zero where it jumps; the recipe says to end steps there."""
    text = "plain model A { signal x = integral(sign(x - 1) + floor(x/2) + ceil(3*x), 0.5); output y = x }"
    module = module_of(compiled(text))
    found = module.indicators(0.0, np.array([4.0 + 1 / 3]), module.Parameters())
    np.testing.assert_allclose(sorted(found), sorted([10 / 3, math.sin(math.pi / 6), 0.0]), atol=1e-13)
    assert "end the steps there" in (module.__doc__ or "")


def test_events() -> None:
    """Indicators, truth of the conditions, resets of computed quantities and of discrete variables, periods."""
    module = module_of(compiled(BALL, free=("*",)))
    p, m = module.Parameters(e=0.5), None
    m = module.discrete_start(p)
    assert m.tolist() == [0.0]
    names = [name for name, _ in module.STATES]
    x = np.zeros(2)
    x[names.index("height")], x[names.index("mass.p")] = -0.25, -3.0
    assert -0.25 in module.indicators(0.0, x, m, p)
    assert module.events(0.0, x, m, p).tolist()[0] == 1.0
    after, modes = module.reset(0, 0.0, x, m, p)
    assert module.outputs(0.0, after, modes, p).tolist() == pytest.approx([-0.25, 1.5, 1.0], rel=1e-14)
    _, modes = module.reset(1, 0.5, after, modes, p)
    assert modes.tolist() == [0.0]
    assert module.periods(p).tolist() == [0.5]
    assert x[names.index("mass.p")] == -3.0, "the caller's state is not written to"


def test_what_decides_which_parts_there_are_is_no_argument() -> None:
    """With n an argument the number of parts stayed, and each of them took its share of another number."""
    text = """plain model A {
      parameter n = 3, order = 2, w = 2
      for i in 1..n { signal x[i] = integral(w/n - order*x[i], 0) }
      if order == 2 { output first = order*x[1] }
      output y = n*x[1]
    }"""
    made = compiled(text, free=("*",))
    assert [made.lowered.space.variables[i].name for i in made.lowered.parameters] == ["w"]
    module = module_of(made)
    assert [name for name, _ in module.Parameters().__dict__.items() if name != "w"] == []
    assert module.outputs(0.0, np.array([1.0]), module.Parameters()).tolist() == [3.0, 2.0]
    kept = compiled(text)  # a run compiles each number for itself
    assert {"n", "order", "w"} <= set(kept.whole_graph.quantities)
    assert kept.whole_graph.quantities["n"].role == "parameter"
