"""Machine code against C by gcc -O2, and time against error of the manipulator's 20 ms against scipy's Radau with sympy's lambdify.

    python tests/benchmarks/bench_native.py

writes results/native.md and, with matplotlib, results/native.png. Times are the least of several; ratios within one run are what holds.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import bondgraph
from bondgraph.analysis.symbolic import state_equations
from bondgraph.compiled_scene import CompiledScene
from bondgraph.simulation.integration import native_integrator
from bondgraph.simulation.integrators.compiled import run as compiled
from bondgraph.simulation.integrators.compiled.advance import advance, begin
from bondgraph.simulation.integrators.pilot.step import euler
from compiler.codegen.c.write import write_c
from compiler.codegen.llvm.evaluate import _arrays, _Many
from compiler.jit.c_source import BEGINNING, c_source

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "models" / "manipulator.bg"
RESULTS = Path(__file__).parent / "results"
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
CALLS = 20_000
POINTS = 201


def least(function: Any, times: int = 7) -> float:
    """The least time of several calls, in s."""
    found = []
    for _ in range(times):
        began = time.perf_counter()
        function()
        found.append(time.perf_counter() - began)
    return min(found)


def gcc(text: str, folder: Path, name: str) -> ctypes.CDLL:
    (folder / f"{name}.c").write_text(text)
    command = [
        "gcc",
        "-O2",
        "-march=native",
        "-std=c11",
        "-ffp-contract=off",
        "-shared",
        "-fPIC",
        f"{name}.c",
        "-o",
        f"{name}.so",
        "-lm",
    ]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / f"{name}.so"))


def address(library: ctypes.CDLL, name: str) -> int:
    found = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
    assert found is not None
    return found


def evaluations(compiled_scene: CompiledScene, library: ctypes.CDLL) -> list[tuple[str, float, float]]:
    """Name, ns of machine code by LLVM, ns by gcc; one call after another in a loop that both share."""
    program = compiled_scene.program
    assert program.native is not None
    constants = program.constants(np.array(program.defaults))
    state = np.asarray(program.start(constants)) + 1e-7
    mode, inputs = program.switches(1e-3, constants), np.array(program.input_defaults)
    arrays = [
        np.ascontiguousarray(a, dtype=float) for a in (np.full(1, 1e-3), state, inputs, constants, mode, np.zeros(1000))
    ]
    many = _Many(program.native.code.address("batch"))  # type: ignore[attr-defined]
    rows = []
    for name in ("derivative", "jacobian_entries"):
        both = []
        for place in (program.native.addresses[name], address(library, f"{program.name}_{name}")):
            both.append(
                least(lambda place=place: many(place, CALLS, _arrays(*(a.ctypes.data for a in arrays), *([0] * 6))))
                / CALLS
                * 1e9
            )  # type: ignore[misc]
        rows.append((name, both[0], both[1]))
    return rows


class Clock:
    """Adds up the time inside of `CompiledMethod.advance`."""

    def __init__(self) -> None:
        self.total, self.steps, original = 0.0, 0, compiled.CompiledMethod.advance

        def timed(solver: compiled.CompiledMethod, most: int) -> int:
            began = time.perf_counter()
            answer = original(solver, most)
            self.total += time.perf_counter() - began
            return answer

        compiled.CompiledMethod.advance = timed  # type: ignore[method-assign]

    def least(self, run: Any, times: int = 7) -> float:
        found = []
        for _ in range(times):
            self.total = 0.0
            run()
            found.append(self.total)
        return min(found)


def stepping_by_gcc(model: bondgraph.Model, clock: Clock, folder: Path, library: ctypes.CDLL) -> tuple[float, float]:
    """Seconds of stepping through the 20 ms: by LLVM, and the same source written as C, by gcc, over gcc's functions."""
    here = clock.least(lambda: model.simulate(target="native"))
    text = (
        "#include <math.h>\n#include <stdint.h>\n#include <stdlib.h>\n" + BEGINNING + c_source([begin, advance, euler])
    )
    stepping = gcc(text, folder, "stepping")

    class Code:
        def address(self, name: str) -> int:
            return address(stepping, name)

    compiled_scene = model.compiled_scene(model.scene(), False, "native")
    native = compiled_scene.program.native
    assert native is not None
    kept, places = compiled.machine_code, dict(native.addresses)
    compiled.machine_code = Code  # type: ignore[assignment]
    for name in ("derivative", "jacobian_entries", "signals"):
        native.addresses[name] = address(library, f"{compiled_scene.program.name}_{name}")  # type: ignore[index]
    there = clock.least(lambda: model.simulate(target="native"))
    native.addresses.update(places)  # type: ignore[attr-defined]
    compiled.machine_code = kept
    return here, there


def error(values: Any, reference: Any) -> float:
    """Lengths together, angles together: the largest difference over the largest magnitude."""
    kinds = [[0, 1, 3, 4, 5], [2]]
    return max(float(np.abs(values[:, k] - reference[:, k]).max() / np.abs(reference[:, k]).max()) for k in kinds)


def by_scipy(model: bondgraph.Model, magnitude: Any) -> Any:
    """rtol -> seconds and values: scipy's Radau over what sympy's lambdify writes."""
    import sympy
    from scipy.integrate import solve_ivp

    compilation = model.compilation(model.scene())
    equations = state_equations(compilation.state_space)
    names = {s.name: s for e in equations.values() for s in e.free_symbols}
    states = [names.get(n, sympy.Symbol(n, real=True)) for n in equations]
    moment = names.get("time", sympy.Symbol("time", real=True))
    rates = list(equations.values())
    others = sorted({s for r in rates for s in r.free_symbols} - {*states, moment}, key=str)
    program = compilation.program
    known = dict(zip(program.parameters.names, program.defaults, strict=True)) | dict(
        zip(program.inputs.names, program.input_defaults, strict=True)
    )
    known |= {name: parameter.value for name, parameter in model.parameters.items()}
    given = {s: known[s.name] for s in others}
    rates = [r.subs(given) for r in rates]
    f = sympy.lambdify((moment, *states), rates, cse=True)
    jacobian = sympy.lambdify((moment, *states), sympy.Matrix(rates).jacobian(states), cse=True)
    constants = program.constants(np.array(program.defaults))
    start = np.asarray(program.start(constants))
    instants = np.linspace(0, 20e-3, POINTS)

    def run(rtol: float) -> tuple[float, Any]:
        began = time.perf_counter()
        parts, x = [], start
        for a, b in ((0.0, 5e-3), (5e-3, 20e-3)):  # the force bends there
            at = instants[(instants >= a) & (instants <= b)]
            done = solve_ivp(
                lambda t, y: f(t, *y),
                (a, b),
                x,
                "Radau",
                at,
                jac=lambda t, y: jacobian(t, *y),
                rtol=rtol,
                atol=rtol * magnitude,
            )
            parts.append(done.y.T[1 if a else 0 :])
            x = done.y[:, -1]
        taken = time.perf_counter() - began
        full = np.concatenate(parts)
        return taken, program.output(
            instants, full, np.array(program.input_defaults), constants, program.switches(instants, constants)
        )

    return run


def magnitudes(model: bondgraph.Model) -> Any:
    """Magnitudes to which the tolerances of the run are relative."""
    found: list[Any] = []
    original = native_integrator.in_machine_code

    def look(stepper: Any, stretch: Any, x: Any) -> Any:
        found.append(stepper.tolerances.magnitude)
        return original(stepper, stretch, x)

    native_integrator.in_machine_code = look  # type: ignore[method-assign]
    model.simulate(target="native")
    native_integrator.in_machine_code = original  # type: ignore[method-assign]
    return found[0]


def main() -> None:
    model = bondgraph.load(MODEL)
    compiled_scene = model.compiled_scene(model.scene(), False, "native")
    lines = ["# Machine code", "", "`bench_native.py`; the least of several times, in one run on one machine.", ""]
    clock = Clock()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        library = gcc(write_c(model.compilation(model.scene()).lowered), folder, "model")
        lines += ["| manipulator | LLVM, ns | gcc -O2, ns | ratio |", "|---|---|---|---|"]
        lines += [f"| {n} | {a:.0f} | {b:.0f} | {a / b:.2f} |" for n, a, b in evaluations(compiled_scene, library)]
        here, there = stepping_by_gcc(model, clock, folder, library)
    lines += [f"| the steps of 20 ms | {here * 1e9:.0f} | {there * 1e9:.0f} | {here / there:.2f} |", ""]
    reference = model.simulate(points=POINTS, rtol=1e-12, target="native").values
    scipy_run = by_scipy(model, magnitudes(model))
    lines += [
        "| rtol | steps, ms | whole run, ms | error | numpy target, ms | error | scipy Radau + lambdify, ms | error | scipy / steps |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    rows = []
    for rtol in TOLERANCES:
        steps = clock.least(lambda rtol=rtol: model.simulate(points=POINTS, rtol=rtol, target="native"))  # type: ignore[misc]
        whole = least(lambda rtol=rtol: model.simulate(points=POINTS, rtol=rtol, target="native"))  # type: ignore[misc]
        mine = error(model.simulate(points=POINTS, rtol=rtol, target="native").values, reference)
        numpy = least(lambda rtol=rtol: model.simulate(points=POINTS, rtol=rtol, target="numpy"), 2)  # type: ignore[misc]
        other = error(model.simulate(points=POINTS, rtol=rtol, target="numpy").values, reference)
        taken, values = min((scipy_run(rtol) for _ in range(2)), key=lambda found: found[0])
        theirs = error(values, reference)
        rows.append((rtol, steps, whole, mine, numpy, other, taken, theirs))
        lines.append(
            f"| {rtol:.0e} | {steps * 1e3:.2f} | {whole * 1e3:.1f} | {mine:.1e} | {numpy * 1e3:.0f} | {other:.1e} | {taken * 1e3:.0f} | {theirs:.1e} | {taken / steps:.0f} |"
        )
    lines += [
        "",
        "The whole run has in it the search for magnitudes, by which tolerances are measured; scipy is given them.",
        "",
    ]
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "native.md").write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines))
    picture(rows)


def picture(rows: list[tuple[float, ...]]) -> None:
    """Time against error."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.4, 4.4))
    for name, when, wrong, mark in (
        ("machine code: steps", 1, 3, "o-"),
        ("machine code: whole run", 2, 3, "o--"),
        ("numpy target: whole run", 4, 5, "s-"),
        ("scipy Radau + lambdify", 6, 7, "^-"),
    ):
        axes.loglog([r[wrong] for r in rows], [r[when] * 1e3 for r in rows], mark, label=name)
    axes.set(xlabel="error", ylabel="ms", title="Manipulator, 20 ms")
    axes.grid(True, which="major", alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(RESULTS / "native.png", dpi=110)


if __name__ == "__main__":
    main()
