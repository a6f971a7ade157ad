"""The C target, compiled by any C compiler that is installed, against the numpy target; it compiles without a warning."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from compiler.codegen import loop_rolling
from compiler.codegen.c.write import write_c
from compiler.compilation import Compilation
from compiler.scene import Scene
from compiler.source import Source
from tests.codegen.test_banded import row_of_resistors
from tests.codegen.test_module import MODELS_OF_FILES
from tests.codegen.test_native import FUNCTIONS, somewhere
from tests.codegen.test_tables import LAWS, SPRINGS
from tests.compiling import MODELS, compiled

COMPILER = shutil.which("gcc") or shutil.which("cc") or ""
WARNINGS = ("-Wall", "-Wextra", "-Wno-unused-function", "-Werror", "-pedantic")
needs_compiler = pytest.mark.skipif(not COMPILER, reason="no C compiler")


def library(text: str, folder: Path) -> ctypes.CDLL:
    (folder / "model.c").write_text(text, encoding="utf-8")
    command = [
        COMPILER,
        "-O1",
        "-std=c11",
        "-ffp-contract=off",
        *WARNINGS,
        "-shared",
        "-fPIC",
        "model.c",
        "-o",
        "model.so",
        "-lm",
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert not done.returncode and not done.stderr, done.stderr
    return ctypes.CDLL(str(folder / "model.so"))


def agree(compilation: Compilation, folder: Path, rtol: float = 1e-13) -> None:
    text, reference = write_c(compilation.lowered), compilation.program
    if compilation.lowered.events.present or compilation.lowered.lags:
        library(text, folder)
        pytest.skip("compiles; what happens at instants is told by Python")
    loaded, arguments = library(text, folder), somewhere(reference, ())
    prefix = compilation.lowered.space.name
    with np.errstate(all="ignore"):
        for name, wanted in FUNCTIONS.items():
            if name == "jacobian":
                continue
            expected = np.asarray(getattr(reference, name)(*[arguments[w] for w in wanted]), dtype=float)
            given = arguments | ({"constants": arguments["parameters"]} if name == "constants" else {})
            found = np.full(expected.size + 1, 7.0)
            arrays = [np.ascontiguousarray(given[w], dtype=float) for w in ("state", "inputs", "constants", "mode")]
            function = getattr(loaded, f"{prefix}_{name}")
            function(ctypes.c_double(float(given["time"])), *(ctypes.c_void_p(a.ctypes.data) for a in (*arrays, found)))
            assert found[-1] == 7.0
            cancelled = 0.01 * rtol * np.abs(np.where(np.isfinite(expected), expected, 0.0)).max(initial=0.0)
            np.testing.assert_allclose(found[:-1], expected, rtol=rtol, atol=cancelled, err_msg=name)


@pytest.mark.few(7)
@needs_compiler
@pytest.mark.parametrize(("path", "name"), MODELS_OF_FILES[::4], ids=lambda x: x if isinstance(x, str) else x.name)
def test_models(path: Path, name: str, tmp_path: Path) -> None:
    agree(compiled(path, model=name, experiment="", everything=True), tmp_path)


@needs_compiler
@pytest.mark.parametrize("law", LAWS)
def test_tables_noise_and_parameters(law: str, tmp_path: Path) -> None:
    agree(compiled(SPRINGS.format(law=LAWS[law], ys="-4, 0, 0.5, 4"), free=("*",)), tmp_path, 1e-11)


@needs_compiler
def test_a_program_of_its_own(tmp_path: Path) -> None:
    """Euler's method in C over the oscillator, with nothing but the file."""
    model = bondgraph.load(MODELS / "oscillator.bg")
    text = model.compile("c")
    main = """
#include <stdio.h>
int main(void) {
    double c[Oscillator_constants_count + 1], x[8], f[8], mode[8];
    Oscillator_constants(0, 0, 0, Oscillator_defaults, 0, c);
    Oscillator_start(0, 0, 0, c, 0, x);
    for (int k = 0; k < 1000; k++) {
        Oscillator_switches(k*1e-4, 0, 0, c, 0, mode);
        Oscillator_derivative(k*1e-4, x, Oscillator_input_defaults, c, mode, f);
        for (int i = 0; i < Oscillator_derivative_count; i++) x[i] += 1e-4*f[i];
    }
    printf("%s %s %.17g\\n", Oscillator_states[0][0], Oscillator_states[0][1], x[0]);
}
"""
    (tmp_path / "model.c").write_text(text + main)
    subprocess.run([COMPILER, "-O1", "-std=c11", "model.c", "-o", "model", "-lm"], cwd=tmp_path, check=True)
    name, unit, value = subprocess.run(
        [str(tmp_path / "model")], capture_output=True, text=True, check=True
    ).stdout.split()
    program = model.compilation().program
    constants = program.constants(np.array(program.defaults))
    x: Any = program.start(constants)
    for k in range(1000):
        x = x + 1e-4 * program.derivative(k * 1e-4, x, (), constants, program.switches(k * 1e-4, constants))
    assert (name, unit) == (program.states.names[0], program.states.units[0])
    assert float(value) == pytest.approx(x[0], rel=1e-9)


def test_names_are_data() -> None:
    """The author's words are in strings and comments that they cannot end."""
    text = 'model A {\n"*/ int main() { /*"\nsignal x = integral(1 [1/s], 0)\noutput y = x "*/"\n}\n'
    source = bondgraph.load(text).compile("c")
    assert re.sub(r"/\*.*?\*/", "", source, flags=re.DOTALL).count("*/") == 0
    own = source.partition("#ifdef A_MAIN")[0]  # behind it, a program of ours
    assert "main" not in re.sub(r"/\*.*?\*/", "", own, flags=re.DOTALL)


LADDER = """plain model Ladder {
  parameter r = 2
  Se s : e = 3
  for i in 1..%d { R a[i] : e = r*i*f }
  C c : e = q
  s -> 1(a[1])%s -> 1(c)
  output f = a[1].f, last = a[%d].e
}"""


@needs_compiler
@pytest.mark.parametrize("count", [5, 30])
def test_linear_loops(count: int, tmp_path: Path) -> None:
    """A ladder of resistors without storages between them: dense systems."""
    rungs = "".join(f" -> {i % 2}(a[{i}])" for i in range(2, count + 1))
    compilation = compiled(LADDER % (count, rungs, count), free=("*",))
    text = write_c(compilation.lowered)
    assert "solve(" in text
    agree(compilation, tmp_path, 1e-12)


@needs_compiler
def test_a_long_loop_is_a_band(tmp_path: Path) -> None:
    compilation = Compilation(Source("row.bg", row_of_resistors(30)), Scene(None, None))
    assert re.search(r"solve\(29, 2, 2, 1, ", write_c(compilation.lowered))
    agree(compilation, tmp_path, 1e-11)


@needs_compiler
@pytest.mark.parametrize("kind", ["ladder", "table"])
def test_kernels_compute_what_lines_compute(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops over rows of integers: dense systems, long sums and tables; as lines the same texts are tested above."""
    monkeypatch.setattr(loop_rolling, "LONGEST_IN_LINES", 0)
    monkeypatch.setattr(loop_rolling, "SAVING", 0)
    text = SPRINGS.format(law=LAWS[next(iter(LAWS))], ys="-4, 0, 0.5, 4")
    if kind == "ladder":
        text = LADDER % (9, "".join(f" -> {i % 2}(a[{i}])" for i in range(2, 10)), 9)
    compilation = compiled(text, free=("*",))
    assert "kernel_0(" in write_c(compilation.lowered)
    agree(compilation, tmp_path, 1e-11)


def test_a_root_of_a_square_bends_where_the_absolute_value_does() -> None:
    """Fixed steps look for the bends that they know; `sqrt(v^2)` was passed over."""
    body = "Se push : F = 1 N*sin(time*3 [1/s])\n  I mass : p = 1 kg*v\n  R r : F = 2 [N*s/m]*v + 1 [N*s/m]*{}\n  push -> 1(mass, r)\n  output v = mass.v"
    first, *others = (
        bondgraph.load(f"model Bent {{\n  {body.format(size)}\n}}\n").compile("c")
        for size in ("abs(v)", "sqrt(v^2)", "norm((v, 0 [m/s]))")
    )
    assert others == [first, first] and "fabs(" in first
