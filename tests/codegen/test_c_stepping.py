"""The loop over fixed steps in C: compiled without a warning, and run beside our own runs, closed forms and programs in Python."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from tests.compiling import MODELS
from tests.event_models import HEATER, servo

COMPILER = shutil.which("gcc") or shutil.which("cc") or ""
needs_compiler = pytest.mark.skipif(not COMPILER, reason="no C compiler")
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror")


def stepped(
    text: str, step: float, end: float, folder: Path, inputs: str = "", status: int = 0
) -> dict[str, np.ndarray]:
    """Outputs of a file of C at each step. `inputs`: statements over `t` and `in` before each."""
    (name,) = re.findall(r"^void (\w+)_constants\(", text, re.MULTILINE)
    main = f"""
#include <stdio.h>
#include "model.c"
int main(void) {{
    struct {name}_model model; struct {name}_inputs in; struct {name}_outputs out;
    int i, k, status;
    {name}_defaults_of(&in);
    status = {name}_init(&model, {name}_defaults, ({"float" if "tgmath" in text else "double"}){step!r});
    for (i = 0; {name}_outputs[i][0]; i++) printf("%s ", {name}_outputs[i][0]);
    for (k = 0; k <= {round(end / step)} && !status; k++) {{
        const double t = k*{step!r}; (void)t; {inputs}
        status = {name}_step(&model, &in, &out);
        printf("\\n%.17g", t);
        for (i = 0; {name}_outputs[i][0]; i++) printf(" %.17g", (double)(({"float" if "tgmath" in text else "double"} *)&out)[i]);
    }}
    return status;
}}
"""
    (folder / "model.c").write_text(text, encoding="utf-8")
    (folder / "main.c").write_text(main, encoding="utf-8")
    for source, warnings in (("model.c", WARNINGS), ("main.c", ())):
        command = [COMPILER, "-O1", "-std=c11", "-ffp-contract=off", *warnings, "-c", source]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert not done.returncode and not done.stderr, done.stderr
    subprocess.run([COMPILER, "main.o", "-o", "run", "-lm"], cwd=folder, check=True)
    done = subprocess.run([str(folder / "run")], capture_output=True, text=True, check=False)
    assert done.returncode == status, (done.returncode, done.stdout[-300:])
    head, *rows = done.stdout.splitlines()
    if not rows:
        return {}
    table = np.array([[float(x) for x in row.split()] for row in rows]).T
    return {"time": table[0], **dict(zip(head.split(), table[1:], strict=True))}


BALL = """model Ball {
  parameter e = 0.8
  mode bounces = 0
  Se weight : F = -9.81 N
  1  body : translation
  I  mass : p = 1 kg*v
  weight -> body -> mass
  signal height = integral(mass.v, 1 m)
  when height < 0 m { mass.v = -e*mass.v, bounces = bounces + 1 }
  output h = height, n = bounces
}
"""
SWITCHED = "model A { mode on = true\n 1 a : electric { active = on }\n Se s : u = 1 V\n C c : q = 1 F*u\n R r : u = 1 ohm*i\n s -> a -> c, r\n when c.u > 0.5 V { on = false }\n output y = c.u }"
PARTS = "import Pid, DiscretePid from control\n"
STAIRS = "model Stairs { mode a = 0\n every 1 s { a = a + 1 }\n signal x = integral(1 + 2*sin(3*time/1 s), 0 s)\n output y = integral(floor(x/0.3 s), 0 s), n = floor(2*time/1 s) + a }"


@pytest.mark.few(3)
@needs_compiler
@pytest.mark.parametrize(
    ("text", "step", "end", "tolerance"),
    [
        (BALL, 1e-3, 2.0, 1e-9), (HEATER, 1e-2, 60.0, 1e-7), (servo(""), 1e-3, 1.0, 1e-8),
        (servo(" offset 3 ms delay 4.5 ms"), 2e-3, 1.0, 1e-8),
        (servo(" delay 2 ms jitter 5 ms seed 3"), 1e-3, 1.0, 1e-8), (STAIRS, 1e-2, 4.0, 1e-8),
        (SWITCHED, 1e-2, 2.0, 1e-9), (MODELS / "batch_tank.bg", 0.5, 1000.0, 1e-9),
    ],
)  # fmt: skip
def test_events_samples_and_stairs(text: str | Path, step: float, end: float, tolerance: float, tmp_path: Path) -> None:
    """Every output at every step is that of our own run."""
    model = bondgraph.load(text)
    count = round(end / step)
    found = stepped(model.compile("c"), step, end, tmp_path)
    ours = model.simulate(to=end, points=count + 1, rtol=1e-11)
    for name in [item.name for item, _ in ours.shown()]:
        size = np.abs(ours[name]).max()
        differs = np.abs(found[name] - ours[name]) > tolerance * size
        assert differs.sum() <= count // 50, name  # an instant may fall an ulp on either side of a step
        assert not differs[-1]


@needs_compiler
@pytest.mark.parametrize("single", [False, True])
def test_a_servo_in_fixed_steps(single: bool, tmp_path: Path) -> None:
    """`models/pid_dc_motor.bg`, the small step, against our run."""
    model = bondgraph.load(MODELS / "pid_dc_motor.bg")
    text = model.compile("c", single=single)
    inputs = "in.wanted = t >= 0.05 ? 0.2 : 0; in.torque = t >= 1.0 ? 2.0 : 0.0;".replace(
        "0.2", "0.2f" if single else "0.2"
    )
    found = stepped(text, 1e-4, 1.5, tmp_path, inputs)
    ours = model.simulate("small_step", to="1.5 s", points=15001, rtol=1e-10)
    for name, tolerance in (
        ("phi", 2e-6),
        ("current", 2e-4),
    ):  # an input that jumps within a step acts from the next on
        limit = (1e-3 if single else 0) + tolerance
        np.testing.assert_allclose(found[name], ours[name], atol=limit * np.abs(ours[name]).max())


@needs_compiler
def test_its_controller_alone(tmp_path: Path) -> None:
    """A continuous controller with its inputs held: P and I in closed form, and at its limit."""
    text = bondgraph.load(MODELS / "pid_dc_motor.bg").compile("c", part="pid")
    assert "struct pid_inputs {\n    double setpoint;\n    double measured;\n};" in text and "malloc" not in text
    found = stepped(text, 1e-3, 0.5, tmp_path, "in.setpoint = 0.01;")
    np.testing.assert_allclose(found["command"], 0.3 + 0.6 * found["time"], rtol=1e-12)
    far = stepped(text, 1e-3, 1.0, tmp_path, "in.setpoint = 2;")
    assert far["command"].max() == 24.0


CONTROLLED = f"""{PARTS}model Plant {{
  DiscretePid pid {{
    T = 10 ms, late = LATE, k_p = 4, k_i = 6 [1/s], k_d = 0.05 s, T_f = 20 ms, low = -1.2, high = 1.2, w_d = 0
    setpoint = 1, measured = y
  }}
  signal y = integral((pid.command - y)/(0.5 s), 0)
  output position = y, command = pid.command
}}
"""


@needs_compiler
@pytest.mark.parametrize("late", [0.0, 0.003])
def test_a_discrete_controller_alone_closes_the_loop(late: float, tmp_path: Path) -> None:
    """The controller in C beside an exact lag between its steps, against our run of both."""
    model = bondgraph.load(CONTROLLED.replace("LATE", f"{late} s"))
    text = model.compile("c", part="pid")
    plant = "static double y = 0; static double u = 0; if (k) y = u + (y - u)*exp(-0.002); in.measured = y; in.setpoint = 1;"
    (name,) = re.findall(r"^void (\w+)_constants\(", text, re.MULTILINE)
    found = stepped(
        text,
        1e-3,
        1.0,
        tmp_path,
        plant + f"u = 0; {{ struct {name}_model copy = model; {name}_step(&copy, &in, &out); u = out.command; }}",
    )
    ours = model.simulate(to=1, points=1001, rtol=1e-11)
    np.testing.assert_allclose(found["command"][1:], ours["command"][1:], atol=1e-9)


@needs_compiler
def test_what_cannot_go_on_has_a_status(tmp_path: Path) -> None:
    twice = "model A { mode a = 0\n every 1 s { a = 1 }\n when time > 1.5 s or a > 0 { a = 0 }\n every 1 s { a = 2 }\n output y = a }"
    endless = "model A { mode a = 0\n when a < 1 { a = 1 }\n when a > 0 { a = 0 }\n output y = a }"
    piled = BALL.replace("-e*mass.v", "-0.1*mass.v")
    limited = 'model A { signal x = integral(1, 0 s)\n require x < 0.5 s "too far"\n output y = x }'
    noisy = "model A { output y = integral(noise(time, 1 ms, 1), 0 s) }"
    sampled = "model A { parameter T = 1 s\n mode a = 0\n every T offset 0.5 s { a = 1 }\n output y = a }"
    stiff = "model A { C c : u = q/(1 nF)\n R r : u = 1 [kohm]*i\n Se s : u = 5 V\n s -> 1(c, r)\n output u = c.u }"
    root = "model A { output y = sqrt(0.5 - time/1 s) }"
    for text, step, status in (
        (stiff, 0.01, 6),
        (root, 0.1, 6),
        (twice, 0.1, 3),
        (endless, 0.1, 2),
        (piled, 0.01, 1),
        (limited, 0.1, 4),
        (noisy, 0.01, 5),
    ):
        stepped(bondgraph.load(text).compile("c"), step, 2.0, tmp_path, status=status)
    code = bondgraph.load(sampled).compile("c").replace("A_defaults[] = {1.0", "A_defaults[] = {0.4")
    stepped(code, 0.1, 1.0, tmp_path, status=5)
    table = "plain model A { parameter b = 1\n signal x = integral(1, 0)\n output y = linear(x, (0, b, 3), (0, 1, 2)) }"
    code = bondgraph.load(table).compile("c").replace("A_defaults[] = {1.0", "A_defaults[] = {3.5")
    stepped(code, 0.1, 1.0, tmp_path, status=7)
    lost = "plain model A { mode n = 0\n signal x = integral(1, 0)\n when x < 0.2 and sqrt(0.7 - x) > 0.1 { n = 1 }\n when log(1.45 - x) > 1 { n = 2 }\n output y = n }"
    assert len(stepped(bondgraph.load(lost).compile("c"), 0.1, 2.0, tmp_path, status=6)["y"]) == 16


@needs_compiler
def test_a_limit_that_holds_again_at_the_end_is_told(tmp_path: Path) -> None:
    text = "plain model A { signal x = integral(cos(time), 0)\n require x < 0.5\n output y = x }"
    (tmp_path / "model.c").write_text(bondgraph.load(text).compile("c"), encoding="utf-8")
    subprocess.run([COMPILER, "-DA_MAIN", "model.c", "-o", "run", "-lm"], cwd=tmp_path, check=True)
    done = subprocess.run([str(tmp_path / "run"), "0.1", "4"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr, len(done.stdout.splitlines())) == (4, "A: status 4 at 0.6 s\n", 42)


def test_what_other_compilers_warn_of_is_not_there() -> None:
    """One compiler warns of inline functions that nothing calls, and of a number that is negated as a condition."""
    moves = "plain model A { signal x = integral(1 if not (x > 0.5 and x < 0.7) else 2, 0)\n output y = x }"
    for text in (HEATER, BALL, moves, "plain model B { output y = integral(1, 0) }"):
        code = bondgraph.load(text).compile("c")
        names = re.findall(r"^static inline [\w ]*?\*?(\w+)\(", code, re.MULTILINE)
        assert [name for name in names if len(re.findall(rf"\b{name}\b", code)) < 2] == []
        assert not re.search(r"(!|&& |\|\| )mode\[|\bmode\[\d+\] (&&|\|\|)", code)


@needs_compiler
def test_names_of_c_are_fields(tmp_path: Path) -> None:
    text = 'model int { input double = 2, while = 1; output return = double*while, register = "x" }'.replace(
        ', register = "x"', ""
    )
    found = stepped(bondgraph.load(text).compile("c"), 0.5, 1.0, tmp_path, "in.v_double = 3;")
    assert found["return"].tolist() == [3, 3, 3]


def test_one_program_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "servo.bg").write_text(CONTROLLED.replace("LATE", "0 s"))
    done = CliRunner().invoke(
        commands, ["compile", str(tmp_path / "servo.bg"), "--part", "pid", "--float", "-o", str(tmp_path / "pid.c")]
    )
    assert done.exit_code == 0, done.output
    text = (tmp_path / "pid.c").read_text()
    assert "tgmath.h" in text and not re.search(r"\bdouble\b", re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL))
    if COMPILER:
        subprocess.run(
            [COMPILER, "-std=c11", *WARNINGS, "-Dpid_MAIN", "pid.c", "-o", "pid", "-lm"], cwd=tmp_path, check=True
        )
        lines = subprocess.run(
            [str(tmp_path / "pid"), "1e-2", "0.1"], capture_output=True, text=True, check=True
        ).stdout.splitlines()
        assert lines[0] == "time,command,error" and len(lines) == 12


@pytest.mark.parametrize("words", ["gcc", "clang", f"{sys.executable} -m ziglang cc"], ids=["gcc", "clang", "zig"])
def test_compilers_find_nothing_to_warn_of(words: str, tmp_path: Path) -> None:
    """In float, too: conditions on time are numbers, and what guards a divisor is not zero."""
    if not shutil.which(words.split()[0]) or ("zig" in words and not find_spec("ziglang")):
        pytest.skip(f"no {words}")
    model = "plain model A { parameter a = 0\n signal x = integral(step(time - a), 0)\n mode n = 0\n when x*exp(x) > a { n = 1 }\n output y = x/max(abs(a), 1e-290), z = n, w = cubic(x, (0, 1, 2), (0, 1, 0)) }"
    for single in (False, True):
        text = bondgraph.load(model).compile("c", single=single)
        assert ("e-290" in text, "1.17549435e-38f" in text) == (not single, single)
        (tmp_path / "model.c").write_text(text, encoding="utf-8")
        subprocess.run([*words.split(), "-std=c11", *WARNINGS, "-c", "model.c"], cwd=tmp_path, check=True)


@pytest.mark.skipif(not shutil.which("cppcheck"), reason="no cppcheck")
def test_static_analysis_finds_nothing(tmp_path: Path) -> None:
    """Of events, samples and a table; and of a linear system, whose functions come from the subset: what they read is constant, what a block uses is declared in it."""
    net = "model Net {\n Se s : u = 1 V\n R a, b, c, d : u = 2 ohm*i\n s -> 1(a, 0(b, 1(c, d)))\n output y = d.u }"
    texts = [servo("").replace("output ", "output k = cubic(sin(time/1 s), (-2, 1, 2), (0, 1, 0)), "), BALL, net]
    for number, text in enumerate(texts):
        code = bondgraph.load(text).compile("c", single=number == 1)
        (tmp_path / f"model{number}.c").write_text(code, encoding="utf-8")
        assert ("solve(" in code) == (text is net)
    checks = "--enable=warning,style,performance,portability"
    command = ["cppcheck", "--std=c11", checks, "--quiet", "--error-exitcode=1", *map(str, tmp_path.glob("*.c"))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr


TIED = SWITCHED.replace("-> c, r", "-> c, r, l\n I l : lambda = 1 H*i")  # a coil that is held still
# off, the junction shorts the capacitor by what the resistor has: nothing
SHORTED = "model A { parameter r = 0\n mode on = true\n Sf s : i = 1 A\n 0 z : electric { active = on }\n 1 x\n C c : u = q/(1 F)\n R f : u = r*i*(1 ohm)\n s -> z -> x -> c, f\n when time > 1 s { on = false }\n output u = c.u }"
DELAYED = "model A { mode a = 0\n signal x = integral(-delay(x, 1 s)/1 s, 1)\n every 1 s { a = x }\n output y = a + x }"
LOOP = "model A { mode a = 0\n signal z = exp(-z - a)\n every 1 s { a = z }\n output y = z }"


@pytest.mark.parametrize(
    ("text", "part", "code", "words"),
    [
        (TIED, None, "BG620", "the junction `a`, which goes on and off"), (SHORTED, None, "BG620", "the junction `z`"), (DELAYED, None, "BG620", "the delayed signal"),
        (CONTROLLED.replace("LATE", "0 s"), "pdi", "BG621", "no instance `pdi`"), (BALL, "pid", "BG621", "no instance `pid`"),
        ("import Resistor from electric\nmodel A { Resistor r\n Se s : u = 1 V\n 1 a\n s -> a -> r.pins\n output y = s.i }", "r", "BG622", "`r` is no controller"),
        ("model A { B part\n output y = part.x }\nmodel B { signal x = integral(1, 0 s) }", "part", "BG623", "`part` has no outputs"),
    ],
)  # fmt: skip
def test_what_is_refused(text: str, part: str | None, code: str, words: str) -> None:
    with pytest.raises(bondgraph.CompilationFailed) as caught:
        bondgraph.load(text).compile("c", part=part)
    (told,) = caught.value.diagnostics
    assert told.code == code and words in told.sentence, told.sentence


def test_only_c_has_float() -> None:
    with pytest.raises(UsageError, match="has no `float`"):
        bondgraph.load(BALL).compile("numpy", single=True)


@needs_compiler
def test_bounces_in_closed_form(tmp_path: Path) -> None:
    """Impacts at sqrt(2h/g)(1 + 2e + 2e^2 + ...), each found within a step."""
    found = stepped(bondgraph.load(BALL).compile("c"), 0.01, 2.5, tmp_path)
    first = math.sqrt(2 / 9.81)
    impacts = first * (1 + 2 * np.cumsum([0, *(0.8**k for k in range(1, 12))]))
    expected = np.searchsorted(impacts, found["time"])
    np.testing.assert_array_equal(found["n"], expected)


GROWING = "model Growing {{ signal x = integral(1 [m/s]*{law}, 0 m)\n output y = x }}"


@needs_compiler
@pytest.mark.parametrize(
    "law", ["(1 + floor(x/1 m))", "(1 if x < 1 m else 2 if x < 2 m else 3 if x < 3 m else 4 if x < 4 m else 5)"]
)
def test_jumps_of_states_without_events(law: str, tmp_path: Path) -> None:
    """A rate that grows by one at each metre: x is n where t is the sum of 1/k up to n, and goes straight between, at any step."""
    found = stepped(bondgraph.load(GROWING.format(law=law)).compile("c"), 0.2, 2.2, tmp_path)
    harmonic = np.cumsum([0, 1, 1 / 2, 1 / 3, 1 / 4, 1 / 5])
    np.testing.assert_allclose(found["y"], np.interp(found["time"], harmonic, np.arange(6.0)), rtol=1e-12, atol=1e-12)


@needs_compiler
def test_friction_that_is_a_jump_ends_at_rest(tmp_path: Path) -> None:
    """1 kg at 1 m/s under 1 N stands after 1 s: a sliding mode, which a run refuses too, stops with events without end."""
    text = "model Stop { I m : p = 1 kg*v { start v = 1 [m/s] }\n R f : F = 1 N if v > 0 [m/s] else -1 N\n 1(m) -> f\n output v = m.v }"
    found = stepped(bondgraph.load(text).compile("c"), 0.3, 2.0, tmp_path, status=1)
    np.testing.assert_allclose(found["v"], 1 - found["time"], atol=1e-15)
    assert len(found["v"]) == 4


RESTING = """model Resting {
  Se push : F = 3 N*pulse(time, 1.03 s, 1.53 s) - 5 N*pulse(time, 3 s, 3.2 s)
  I  mass : p = 1 kg*v                                  { start v = 1 [m/s] }
  R  rub  : F = 2 N*sign(v)
  push -> 1(mass, rub)
  I  ball : p = 1 kg*v                                  { start v = 1 [m/s] }
  C  well : energy = linear(x, (-9 m, 0 m, 4 m, 9 m), (18 J, 0 J, 8 J, 18 J))
  1(ball) -> well
  output v = mass.v, F = rub.F, x = well.x
}
"""


@needs_compiler
def test_friction_without_a_load_rests_and_tables_of_energy_bend_where_they_do(tmp_path: Path) -> None:
    """2 N brake 1 kg to a stand, 3 N move it again, 5 N the other way; in a well of 2 N a ball flies in parabolas of a second. Both are exact at any step."""
    model = bondgraph.load(RESTING)
    found, ours = stepped(model.compile("c"), 0.11, 4.4, tmp_path), model.simulate(to=4.4, points=41)
    t = found["time"]
    corners = (0, 0.5, 1.03, 1.53, 1.78, 3, 3.2, 3.5, 5), (1, 0, 0, 0.5, 0, 0, -0.6, 0, 0)
    np.testing.assert_allclose(found["v"], np.interp(t, *corners), atol=1e-14)
    # a load just jumped may be part of this instant or of the next
    resting = ((t > 0.51) & (t < 1.02)) | ((t > 1.79) & (t < 2.99)) | (t > 3.51)
    assert resting.sum() > 20 and not found["F"][resting].any() and np.abs(found["F"][t < 0.5]).min() == 2
    within = t % 1
    exact = np.where(t % 2 < 1, 1, -1) * (within - within**2)
    np.testing.assert_allclose(found["x"], exact, atol=1e-13)
    np.testing.assert_allclose(ours["x"], exact, atol=1e-10)


def test_jumps_beside_what_has_no_loop() -> None:
    """Functions without the loop have a comment that names the laws that jump."""
    text = "model A {\n signal z = exp(-z - x)\n signal x = integral((z + sign(x - 1))/1 s, 0)\n output y = x }"
    code = bondgraph.load(text).compile("c")
    assert "A_step" not in code and "a step must end there: x (line 3)." in code
    assert "a step must end there" not in bondgraph.load(text.replace("sign(", "sin(")).compile("c")
