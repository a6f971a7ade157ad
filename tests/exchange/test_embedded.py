"""C that chooses its steps: the numbers of a run, in static memory, compiled without a warning."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from compiler.codegen.c import write
from tests.compiling import MODELS

pytestmark = pytest.mark.machine_code
COMPILER = shutil.which("gcc") or shutil.which("cc") or ""
needs_compiler = pytest.mark.skipif(not COMPILER, reason="no C compiler")
OPTIONS = ("-std=c11", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror")
BALL = """model Ball {
  parameter e = 0.8
  input wind: N = 0
  mode bounces = 0
  MSe weight : F = -9.81 N + wind
  1  body : translation
  I  mass : p = 1 kg*v
  weight -> body -> mass
  signal height = integral(mass.v, 1 m)
  when height < 0 m { mass.v = -e*mass.v, bounces = bounces + 1 }
  require height < 2 m "it flies away"
  output h = height, n = bounces
  experiment fall { simulate 0 .. 6 s { points = 61 }; stop when bounces > 4 }
}
"""
# The file's own program, then two instances in turn, of which one gets wind and one another parameter, and what is refused.
MAIN = """#define Ball_MAIN
#define main tried
#include "ball.c"
#undef main
int main(int count, char **words)
{
    static struct Ball_model models[2];
    struct Ball_inputs in[2];
    struct Ball_outputs out;
    double parameters[] = {0.5}, wrong[] = {NAN};
    int status = tried(count, words), i, k;
    for (i = 0; i < 2; i++) {
        Ball_defaults_of(&in[i]);
        status |= Ball_init(&models[i], i ? parameters : Ball_defaults, &in[i], 0, 2, 1e-9);
    }
    for (k = 1; k <= 9; k++) {
        in[0].wind = k > 5 ? 9.81 : 0;
        for (i = 0; i < 2; i++) {
            status |= Ball_go(&models[i], &in[i], 0.1 * k);
            status |= Ball_outputs_of(&models[i], &out);
            printf("%d,%.17g,%.17g\\n", status, out.h, out.n);
        }
    }
    status = Ball_go(&models[0], &in[0], 0.5);
    printf("%d,%s\\n", status, Ball_message(&models[0]));
    in[0].wind = 100;
    status = Ball_go(&models[0], &in[0], 2);
    printf("%d,%s\\n", status, Ball_message(&models[0]));
    status = Ball_init(&models[0], wrong, &in[0], 0, 2, 1e-9);
    printf("%d,%s\\n", status, Ball_message(&models[0]));
    return 0;
}
"""
VOLUME = "Sf s : f = sin(3*time)\n C t : e = q\n R v : f = e/(e^2 + 1e-60)^0.375 + 1e-30*max(e, 0)\n s -> 0(t, v)\n output y = t.e"


def rows_of(folder: Path, source: str, *more: str) -> list[str]:
    """Lines that a program prints which is compiled without a warning."""
    done = subprocess.run(
        [COMPILER, *OPTIONS, *more, source, "-o", "run", "-lm"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert not done.returncode and not done.stderr, done.stderr
    return subprocess.run([str(folder / "run")], capture_output=True, text=True, check=True).stdout.splitlines()


@needs_compiler
def test_a_ball(tmp_path: Path) -> None:
    """The printed run is ours, up to the bounce that ends it; parabolas and times of impact are exact, whoever else is in the program."""
    (tmp_path / "ball.bg").write_text(BALL)
    (tmp_path / "main.c").write_text(MAIN)
    words = [str(tmp_path / "ball.bg"), "--steps", "variable", "-e", "fall", "-o", str(tmp_path / "ball.c")]
    done = CliRunner().invoke(commands, ["compile", *words])
    assert done.exit_code == 0, done.output
    code = (tmp_path / "ball.c").read_text()
    functions = re.findall(r"^(?:static )?(?:inline )?\w+ \*?(\w+)\(", code + write._OWN, re.MULTILINE)
    variables = re.findall(r"^\s+(?:struct )?\w+ \*?(\w+)(?: = [^;]*)?;", code, re.MULTILINE)
    assert len(functions) > 100 and len(variables) > 500 and not {*functions} & {*variables}  # what cppcheck warns of
    lines = rows_of(tmp_path, "main.c")
    ours = bondgraph.load(BALL).simulate("fall")
    table = np.array([[float(x) for x in row.split(",")] for row in lines[1 : 1 + len(ours.time)]]).T
    assert lines[0] == "time,h,n" and len(ours.time) == 27
    for found, expected in zip(table, (ours.time, ours["h"], ours["n"]), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-5)
    told = [row.split(",", 2) for row in lines[1 + len(ours.time) :]]
    first, t = np.sqrt(2 / 9.81), np.arange(1, 10) * 0.1
    for number, e in enumerate((0.8, 0.5)):
        status, heights, bounces = np.array(told[number:18:2], dtype=float).T
        late = t - first
        flight = np.where(late > 0, e * 9.81 * first * late - 9.81 / 2 * late**2, 1 - 9.81 / 2 * t**2)
        blown = 9.81 / 2 * np.maximum(t - 0.5, 0) ** 2 if number == 0 else 0
        # wind holds the first ball from 0.5 s on, just after its bounce
        np.testing.assert_allclose(heights, flight + blown, atol=1e-7)
        np.testing.assert_array_equal([status, bounces], [0 * t, late > 0])
    assert [row[0] for row in told[18:]] == ["3", "1", "3"]
    for row, words in zip(told[18:], ("not the time", "`height < 2 m` (line 11)", "not finite"), strict=True):
        assert words in row[1], row


@needs_compiler
@pytest.mark.parametrize(
    ("lines", "status", "rows", "words"),
    [
        ('require x < 0.5 "low"\n output y = x', 1, 5, "`x < 0.5` (line 3) does not hold any more. (1 s)"),
        ("output y = sqrt(0.8 - x)", 3, 1, "not finite. (1 s)"),
        (VOLUME, 1, 5, "has missed rates"),
    ],
)  # fmt: skip
def test_what_a_program_tells(lines: str, status: int, rows: int, words: str, tmp_path: Path) -> None:
    """It ended in silence where an output has no value, and where a limit that it had left held again at the end."""
    model = bondgraph.load(
        f"plain model P {{\n signal x = integral(cos(time), 0)\n {lines}\n experiment e {{ simulate 0 .. 4 {{ points = 5, rtol = 1e-3 }} }}\n}}"
    )
    (tmp_path / "p.c").write_text(model.compile("c", steps="variable", experiment="e"))
    subprocess.run([COMPILER, "-DP_MAIN", "p.c", "-o", "p", "-lm"], cwd=tmp_path, check=True)
    done = subprocess.run([str(tmp_path / "p")], capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, len(done.stdout.splitlines())) == (status, rows + 1), done
    assert words in done.stderr and done.stderr.count("\n") == 1


@pytest.mark.few(0)
@needs_compiler
@pytest.mark.parametrize("name", [p.stem for p in sorted(MODELS.glob("*.bg"))[::2]])
def test_models(name: str, tmp_path: Path) -> None:
    """Optimised, models give the numbers of our run at a tolerance a thousand times tighter; those that no unit holds are refused."""
    model = bondgraph.load(MODELS / f"{name}.bg")
    experiment = next(iter(model.experiments), None)
    try:
        text = model.compile("c", steps="variable", experiment=experiment)
    except bondgraph.CompilationFailed as refused:
        assert {d.code for d in refused.diagnostics} == {"BG606"}
        return
    (main,) = re.findall(r"^#ifdef (\w+_MAIN)$", text, re.MULTILINE)
    (tolerance,) = re.findall(r"tolerance = .* : ([^;]*);", text)
    (tmp_path / "model.c").write_text(text)
    head, *rows = rows_of(tmp_path, "model.c", "-O2", f"-D{main}")
    table = np.array([[float(x) for x in row.split(",")] for row in rows]).T
    ours = model.simulate(experiment, rtol=1e-3 * float(tolerance))
    for output, found in zip(head.split(",")[1:], table[1:], strict=True):
        size = np.abs(ours[output]).max()
        assert np.sum(np.abs(found - ours[output]) > 10 * float(tolerance) * size) <= len(found) // 100, output


def test_what_is_refused() -> None:
    delayed = bondgraph.load("model A { signal x = integral(-delay(x, 1 s)/1 s, 1)\n output y = x }")
    with pytest.raises(bondgraph.CompilationFailed, match="C that chooses its steps, cannot hold delayed signals"):
        delayed.compile("c", steps="variable")
    for words, options in {
        "no `long` steps": {"steps": "long"},
        "C in `double`": {"steps": "variable", "single": True},
        "steps of variable size alone": {"experiment": "fall"},
    }.items():
        with pytest.raises(UsageError, match=words):
            delayed.compile("c", **options)
    with pytest.raises(UsageError, match="of a whole model"):
        delayed.compile("numpy", steps="variable")
