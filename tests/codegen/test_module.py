"""The generated module: numpy and nothing else, the author's names one to one, the lines they come from, the same text each time."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from compiler.codegen.numpy.names import Identifiers
from compiler.compilation import Compilation
from compiler.errors import CompilationFailed
from compiler.scene import Scene
from compiler.source import Source
from tests.compiling import LIBRARY, MODELS, ROOT, Running, compiled

FILES = sorted(MODELS.glob("*.bg"))
OSCILLATOR = """\
model Oscillator {
  parameter m = 1 kg, k: N/m = 100, k3: N/m^3 = 2e4, r: N*s/m = 0.5
  input kick = 0 N
  Se push   : F = 1 N*step(time - 0.1 s)
  MSe extra : F = kick
  1  body
  I  mass   : p = m*v
  C  spring : F = k*x + k3*x^3        { start x = 1 mm }
  R  damper : F = r*v
  push, extra -> body -> mass, spring, damper
  output position = spring.x, force = spring.F
}
"""


# They have open ports or parameters without a value.
PARTS = {"Tyre", "Stokes", "Newton", "LeafSpring", "Flexure", "CombDrive", "SideComb", "Suspension", "Axis", "LeafInSpace"}  # fmt: skip


def models_of(path: Path) -> list[tuple[Path, str]]:
    """Names of the models of a file. It is parsed only: tests of three folders are made of these names."""
    source = Source(str(path), path.read_text(encoding="utf-8"), path)
    return [(path, name) for name in Compilation(source, Scene()).tree.models]


@cache
def compiled_model(path: Path, name: str, free: bool = False, everything: bool = False) -> Compilation:
    """One model of models/, compiled once for all tests of this folder."""
    return compiled(path, model=name, free=("*",) if free else (), everything=everything)


ALL_MODELS = [model for path in FILES for model in models_of(path)]
MODELS_OF_FILES = [(path, name) for path, name in ALL_MODELS if name not in PARTS]
every_model = pytest.mark.parametrize(
    ("path", "name"), MODELS_OF_FILES, ids=lambda v: v.stem if isinstance(v, Path) else v
)


def test_there_are_models() -> None:
    assert {p.stem for p, _ in MODELS_OF_FILES} >= {"manipulator", "feed_forward"}
    assert len(MODELS_OF_FILES) >= 5
    parts = [(path, name) for path, name in ALL_MODELS if name in PARTS]
    assert {name for _, name in parts} == PARTS
    for path, name in parts:
        with pytest.raises(CompilationFailed):
            _ = compiled_model(path, name).state_space


def imported(source: str) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found.update(a.name for a in node.names)
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module or ".")
    return found


@pytest.mark.few(8)
@every_model
def test_it_needs_numpy_alone(path: Path, name: str) -> None:
    source = compiled_model(path, name, free=True).program.source
    assert imported(source) == {"numpy"}
    names = {n.id for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Name)}
    assert not names & {"eval", "exec", "open", "__import__", "getattr", "compile", "globals"}


@pytest.mark.few(28)
@every_model
def test_it_states_its_names(path: Path, name: str) -> None:
    """Tables of (name, SI unit), as the program's."""
    program = compiled_model(path, name, free=True).program
    tables = {
        t.targets[0].id: ast.literal_eval(t.value)
        for t in ast.parse(program.source).body
        if isinstance(t, ast.Assign)
        and isinstance(t.targets[0], ast.Name)
        and t.targets[0].id in ("STATES", "OUTPUTS", "INPUTS", "PARAMETERS")
    }
    for table, names in (
        ("STATES", program.states),
        ("OUTPUTS", program.outputs),
        ("INPUTS", program.inputs),
        ("PARAMETERS", program.parameters),
    ):
        assert tables[table] == tuple(zip(names.names, names.units, strict=True))


@pytest.mark.few(28)
@every_model
def test_it_cites_lines_that_exist(path: Path, name: str) -> None:
    """Every comment names a file and a line, and that line says something."""
    source = compiled_model(path, name).program.source
    cited = re.findall(r"# (\w+\.bg):(\d+)", source)
    assert cited or "STATES = ()" in source
    for file, line in cited:
        home = MODELS if (MODELS / file).is_file() else LIBRARY
        assert (home / file).read_text(encoding="utf-8").splitlines()[int(line) - 1].strip()


def test_it_cites_the_line_that_caused_it() -> None:
    source = compiled(OSCILLATOR, free=("*",)).program.source
    cited = {m.group(1): int(m.group(2)) for m in re.finditer(r"^ +(\w+) = .*# text\.bg:(\d+)", source, re.MULTILINE)}
    lines = OSCILLATOR.splitlines()
    assert "spring" in lines[cited["spring_F"] - 1]
    assert {lines[n - 1].split()[1] for n in cited.values() if len(lines[n - 1].split()) > 1} >= {"spring"}


def test_the_author_s_names_are_readable() -> None:
    source = compiled(OSCILLATOR, free=("*",)).program.source
    assert (
        re.search(r"\bspring_x\b", source)
        and re.search(r"\bmass_p\b", source)
        and re.search(r"\bk3\b", source)
        and re.search(r"\bkick\b", source)
    )


RUN = """
import importlib.util, json, sys
spec = importlib.util.spec_from_file_location("generated", sys.argv[1])
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
constants = module.constants(module.DEFAULTS)
state = module.start(constants) + json.loads(sys.argv[2])
mode = module.switches(0.2, constants)
arguments = (0.2, state, module.INPUT_DEFAULTS, constants, mode)
rates, jacobian, output = module.derivative(*arguments), module.jacobian(*arguments), module.output(*arguments)
loaded = sorted(m for m in sys.modules if m.split(".")[0] in ("compiler", "bondgraph", "sympy", "scipy", "networkx", "lark"))
print(json.dumps([rates.tolist(), jacobian.tolist(), output.tolist(), loaded]))
"""


@pytest.mark.parametrize("path", [MODELS / "manipulator.bg", None], ids=["manipulator", "oscillator"])
def test_it_runs_by_itself(path: Path | None, tmp_path: Path) -> None:
    """In an isolated process that sees neither the project nor the environment; the same numbers to the last bit."""
    running = Running(compiled(path if path is not None else OSCILLATOR, free=("*",)))
    module, script = tmp_path / "generated.py", tmp_path / "run.py"
    module.write_text(running.program.source, encoding="utf-8")
    script.write_text(RUN, encoding="utf-8")
    shift = [1e-7 * (i + 1) for i in range(len(running.start))]
    done = subprocess.run(
        [sys.executable, "-I", str(script), str(module), json.dumps(shift)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
    )
    rates, jacobian, output, loaded = json.loads(done.stdout)
    assert loaded == []
    state = dict(zip(running.program.states.names, (running.start + shift).tolist(), strict=True))
    arguments = running.arguments(0.2, state, None)
    assert rates == running.program.derivative(*arguments).tolist()
    assert jacobian == running.program.jacobian(*arguments).tolist()
    assert output == running.program.output(*arguments).tolist()


def test_the_same_text_whatever_the_hash_seed() -> None:
    """Sets and dictionaries must not shuffle what is written: text diffs and caches depend on it."""
    script = "from tests.compiling import MODELS, compiled\nimport sys\nsys.stdout.write(compiled(MODELS / 'manipulator.bg', free=('*',)).program.source)"
    texts = set()
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)}
        texts.add(
            subprocess.run(
                [sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, env=environment, check=True
            ).stdout
        )
    assert len(texts) == 1


class TestNames:
    """Names that Python reserves, that the module uses, or that look alike as identifiers: one to one."""

    WORDS = ("lambda", "class", "def", "None", "True", "import", "np", "state", "inputs", "constants", "out", "PARAMETERS", "match", "type", "derivative", "start", "batch", "PATTERN", "STATES",
             "DEFAULTS", "_pack", "_select", "__name__", "matrix", "entries", "t", "v_lambda", "print", "float")  # fmt: skip

    def test_parameters(self) -> None:
        names = [w for w in self.WORDS if w not in ("import",)]
        text = (
            "model A {\n"
            + "".join(f"  parameter {n} = {i + 2}\n" for i, n in enumerate(names))
            + "  output total = "
            + " + ".join(f"{10 ** (i % 5)}*{n}" for i, n in enumerate(names))
            + "\n}\n"
        )
        expected = float(sum(10 ** (i % 5) * (i + 2) for i in range(len(names))))
        for free in ((), ("*",)):
            running = Running(compiled(text, free=free))
            assert running.outputs() == {"total": expected}
        assert set(running.program.parameters.names) == set(names)

    def test_states_inputs_and_elements(self) -> None:
        text = "model A {\n  input lambda = 3 N, state = 5 N\n  MSe np : F = lambda + state\n  1 class, state_ : translation\n  I inputs : p = 2 kg*v\n  C def : F = 4 [N/m]*x\n  np -> class -> inputs, def\n  I out : p = 1 kg*v\n  C np2 : F = 7 [N/m]*x\n  state_ -> out, np2\n  output time_ = inputs.v, constants = def.F, x = np2.F, v = out.v\n}\n"
        running = Running(compiled(text, free=("*",)))
        assert running.program.states.names == ("inputs.p", "def.x", "out.p", "np2.x")
        assert running.rates({"def.x": 1.0, "inputs.p": 4.0, "np2.x": 2.0}) == {
            "inputs.p": 4.0,
            "def.x": 2.0,
            "out.p": -14.0,
            "np2.x": 0.0,
        }

    def test_names_that_look_alike(self) -> None:
        """`a[1].b`, `a_1.b`, `a_1_b`, `a[1, 2]` and `a[12]` are five things."""
        text = "model P {\n  parameter b = 1\n  output y = b\n}\nmodel A {\n  P a[1] { b = 2 }\n  P a_1 { b = 3 }\n  parameter a_1_b = 4\n  parameter c = (5, 6)\n  parameter c_1 = 7\n  signal d[1, 2] = 8*c[1]\n  signal d[12] = 9*c[2]\n  signal d_1_2 = 10*c_1\n  output v1 = a[1].b, v2 = a_1.b, v3 = a_1_b, v4 = c[1], v5 = c_1, v6 = d[1, 2], v7 = d[12], v8 = d_1_2\n}\n"
        for free in ((), ("*",)):
            assert Running(compiled(text, free=free)).outputs() == {
                "v1": 2,
                "v2": 3,
                "v3": 4,
                "v4": 5,
                "v5": 7,
                "v6": 40,
                "v7": 54,
                "v8": 70,
            }

    def test_a_module_cannot_be_broken_out_of(self) -> None:
        """File names and descriptions are text of the author: they stay in comments and strings."""
        hostile = 'x"""\nimport os\n"""\n#\\u000aimport os\r\x1b[31m'
        source = Source(
            hostile,
            OSCILLATOR.replace(
                "model Oscillator {", 'model Oscillator {\n  "text \\""" import os # \\n"'.replace('\\"""', "'''")
            ),
        )
        text = Compilation(source, Scene(None, None, free=frozenset({"*"})), LIBRARY).program.source
        assert imported(text) == {"numpy"}
        assert all(c.isprintable() or c == "\n" for c in text)


def test_many_equal_names() -> None:
    """Unnamed intermediate results by the ten thousand: each gets its own name at once, not after counting through all others."""
    identifiers = Identifiers()
    began = time.perf_counter()
    names = {identifiers.of("t") for _ in range(30_000)}
    assert len(names) == 30_000
    assert time.perf_counter() - began < 5.0  # 0.05 s if each is found at once, a minute if all are counted


class TestNumbers:
    @pytest.mark.parametrize(
        "value", ["0.1", "1e-300", "8.8541878128e-12", "1e299", "123456789012345678", "38 um", "-2.5"]
    )
    def test_every_bit_of_a_number_survives(self, value: str) -> None:
        text = f"model A {{\n  constant c = {value}\n  1 a : translation\n  I m : p = 1 kg*v\n  a -> m\n  output y = c, z = c*m.v\n}}\n"
        expected = 38e-6 if "um" in value else float(value)
        found = Running(compiled(text)).outputs({"m.p": 1.0})
        assert (found["y"], found["z"]) == (expected, expected)

    @pytest.mark.parametrize(
        ("expression", "value"),
        [("a - (b - c)", 4.0), ("a/(b/c)", 10 / 3), ("a/b/c", 2 / 15), ("-a^2", -4.0), ("(-a)^2", 4.0), ("a^-2", 0.25), ("a^(-1/2)", 2**-0.5), ("2^-a", 0.25), ("a*(b + c)/(a - b)", -16.0), ("-(a + b)*-c", 25.0), ("a - -b", 5.0),
         ("(a if a > b else b)*2", 6.0), ("a^b^a", 512.0), ("1 if a < b and not b > c or a == c else 0", 1.0), ("min(a, b) - max(a, -b)", 0.0), ("(a - b)^3", -1.0), ("a*(-b)", -6.0), ("a/(-b)", -2 / 3), ("-a/b*c", -10 / 3)],
    )  # fmt: skip
    def test_operators_are_written_with_the_brackets_they_need(self, expression: str, value: float) -> None:
        """With states, so that nothing folds before it is written."""
        text = f"plain model A {{\n  1 j, k, l\n  I ia : p = f\n  I ib : p = f\n  I ic : p = f\n  j -> ia\n  k -> ib\n  l -> ic\n  signal a = ia.f, b = ib.f, c = ic.f\n  output y = {expression}\n}}\n"
        state = {"ia.p": 2.0, "ib.p": 3.0, "ic.p": 5.0}
        assert Running(compiled(text, everything=True)).outputs(state)["y"] == pytest.approx(value, rel=1e-15)

    @pytest.mark.parametrize(
        "function",
        [
            "sin",
            "cos",
            "tan",
            "asin",
            "acos",
            "atan",
            "sinh",
            "cosh",
            "tanh",
            "asinh",
            "atanh",
            "exp",
            "log",
            "log10",
            "sqrt",
            "abs",
            "sign",
            "floor",
            "ceil",
        ],
    )
    def test_every_function_means_the_same_at_run_time(self, function: str) -> None:
        """In the generated code with a state as in the compiler with a number."""
        text = f"plain model A {{\n  1 j\n  I m : p = f\n  j -> m\n  parameter a = 0.37\n  output run = {function}(m.p), known = {function}(a)\n}}\n"
        found = Running(compiled(text)).outputs({"m.p": 0.37})
        assert found["run"] == pytest.approx(found["known"], rel=1e-15)

    def test_the_branch_not_taken_does_not_matter(self) -> None:
        """Neither for a single state nor in a batch: no division by zero, no log of zero gets through."""
        text = "plain model A {\n  1 j\n  I m : p = f\n  j -> m\n  output y = 1/m.p if m.p > 0 else 0, z = log(m.p) if m.p > 0 else 0\n}\n"
        running = Running(compiled(text))
        with np.errstate(all="ignore"):
            assert running.outputs({"m.p": 0.0}) == {"y": 0.0, "z": 0.0}
            time, _, inputs, constants, mode = running.arguments(0.0, None, None)
            both = running.program.output(time, np.array([[0.0], [2.0]]), inputs, constants, mode)
        assert both.tolist() == [[0.0, 0.0], [0.5, float(np.log(2.0))]]


def test_a_storage_behind_a_junction_that_is_off_has_no_line() -> None:
    """Its law would read a parameter that the equations of the start do not have; the module says that they are those of the start."""
    text = """model Late {
  parameter L_0 = 50 mH
  mode closed = false
  Se mains : u = 10 V
  I coil   : lambda = L_0*i
  R load   : u = 10 ohm*i
  1 line   : electric { active = closed }
  when time > 1 ms { closed = true }
  mains -> line -> coil, load
  output i = coil.i
}
"""
    source = Compilation(Source("late.bg", text), Scene()).text("numpy")
    assert "L_0" not in source and "hold as long as `on`" in source
    module: dict[str, object] = {"__name__": "late"}
    exec(compile(source, "late.py", "exec"), module)
    assert module["OUTPUTS"] == (("i", "A"),)
