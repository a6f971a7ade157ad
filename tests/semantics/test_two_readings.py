"""Notes on text that can be read in two ways: names after a unit."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from bondgraph import UsageError, check, load
from bondgraph.commands import commands
from compiler.errors import CompilationFailed
from compiler.graph.units import UNITS
from tests.compiling import compiled

SYMBOLS = sorted(set(UNITS) - {"degC", "degF", "dB", "%"})


def notes(text: str, settings: dict[str, str | float] | None = None, experiment: str | None = None) -> tuple[str, ...]:
    return compiled(text, settings, experiment=experiment).certificate.notes


@pytest.mark.parametrize("symbol", SYMBOLS)
def test_a_symbol_that_is_a_parameter(symbol: str) -> None:
    for sign in "*/":
        (note,) = notes(f"model A {{\n  parameter {symbol} = 2\n  output y = 5 N{sign}{symbol}\n}}")
        assert f"line 3: `5 N{sign}{symbol}` is read as `5 [N]{sign}{symbol}`" in note
        assert f"write `5 [N{sign}{symbol}]`" in note


TEXT = "model A {\n  parameter m = 2 kg, s = 3\n  DECLARED\n  output y = VALUE\n}\n"


@pytest.mark.parametrize(
    ("value", "written"),
    [
        ("5 N*m", "5 [N]*m"), ("-5 N*m", "5 [N]*m"), ("2*5 N*m", "5 [N]*m"), ("s*5 N*m", "5 [N]*m"), ("1/5 N*m", "5 [N]*m"),
        ("5 m/s^2", "5 [m]/s^2"), ("5 kN*m/s", "5 [kN]*m/s"), ("2.5e3 mN * m", "2.5e3 [mN]*m"), ("(1 kg + 3 g)*s + 4 g/s", "4 [g]/s"),
        ("sqrt(5 N*m)", "5 [N]*m"), ("5 N*m if time < 1 s else 5 [N*kg]", "5 [N]*m"), ("f(5 N*m)", "5 [N]*m"), ("part.y", "5 [N]*m"),
        ("integral(5 N*m, 0 [N*kg*s])", "5 [N]*m"), ("5 N * m^-1", "5 [N]*m^-1"), ("g[1]", "5 [N]*m"), ("loop[2]", "5 [N]*m"),
    ],
)  # fmt: skip
def test_wherever_it_stands(value: str, written: str) -> None:
    declared = {
        "f(5 N*m)": "function f(x) = 2*x",
        "part.y": "B part",
        "g[1]": "parameter g = (5 N*m, 1 [N*kg])",
        "loop[2]": "for i in 1..2 { signal loop[i] = i*5 N*m }",
    }
    text = TEXT.replace("DECLARED", declared.get(value, "")).replace("VALUE", value)
    found = notes(text + "model B { parameter m = 1 kg; output y = 5 N*m }\n" * (value == "part.y"))
    assert len(found) == 1 and f"is read as `{written}`" in found[0]


@pytest.mark.parametrize(
    "value", ["5 [N*m]", "5 [N]*m", "5*m", "m*5 N", "5 N + m*1 [N/kg]", "5 N*mass", "5 N*part.m", "5 N*l[1]", "5 N*s_", "5 N*sin(s)"]
)  # fmt: skip
def test_one_reading_only(value: str) -> None:
    declared = "parameter mass = 1 kg, l = (1, 2), s_ = 2; B part"
    text = TEXT.replace("DECLARED", declared).replace("VALUE", value)
    assert notes(text + "model B { parameter m = 1 kg; output y = m }\n") == ()


def test_settings() -> None:
    text = TEXT.replace(
        "DECLARED", "parameter torque: N*kg = 1; experiment e { set torque = 3 N*m; simulate 0 .. 1 s }"
    )
    text = text.replace("VALUE", "torque")
    assert len(notes(text, experiment="e")) == 1
    told = notes(text, {"torque": "7 N*m"})
    assert any(n.startswith("setting") and "`7 [N*m]`" in n for n in told)


def test_it_is_told_by_check_and_run(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "a.bg"
    text = TEXT.replace("DECLARED", "mode a = 0, b = 0; every 1 s { a = a + 1; b = a }").replace("VALUE", "b*5 N*m")
    path.write_text(text)
    for arguments in (["check", str(path)], ["run", str(path), "--to", "2 s"], ["certificate", str(path)]):
        done = CliRunner().invoke(commands, arguments)
        assert done.exit_code == 0, done.output
        assert "note: line 4: `5 N*m` is read as" in done.output


@pytest.mark.parametrize(
    ("settings", "step"), [({"k": "250 N/m"}, "simulate 0 .. 1 s"), ({}, "set k = 250 N/m; simulate 0 .. 1 s"), ({}, "sweep k = 250 N/m, 1 [N/m]; modes")]
)  # fmt: skip
def test_the_advice_works_where_the_reading_as_a_name_is_refused(settings: dict[str, str | float], step: str) -> None:
    """`N/m` divides by a parameter m, as anywhere in a text; "check the units" was the advice, of a text without a wrong unit."""
    text = f"model A {{\n  parameter m = 2 kg, k: N/m = 100\n  output y = k*m\n  experiment e {{ {step} }}\n}}"
    with pytest.raises(CompilationFailed) as told:
        notes(text, settings, "e")
    found = re.search(r"for the unit write `(.*)`\.", str(told.value))
    assert found is not None
    notes(text.replace("250 N/m", found[1]), dict.fromkeys(settings, found[1]), "e")


BOTH = (
    "model A {\n  parameter m = 2 m, k: N/m = 100\n  Se push : F = 1 N\n  1 body\n  C spring : F = k*x\n  R damper : F = 1 [N*s/m]*v\n"
    "  push -> body -> spring, damper\n  output x = spring.x\n  experiment e { set k = 3 N/m; equilibrium }\n}"
)


def test_analyses_tell_it_too(tmp_path: Path) -> None:
    """The force over the length is meant by the text of a setting, as by that of the model: 1.5 N/m, in an analysis with a note."""
    path = tmp_path / "a.bg"
    path.write_text(BOTH)
    for arguments, where in (
        (["run", str(path)], "line 9"),
        (["equilibrium", str(path), "-e", "none", "--set", "k=3 N/m", "--json"], "setting of k"),
        (
            ["sweep", str(path), "-e", "none", "--set", "k=3 N/m", "--over", "m=2 m", "--of", "equilibrium"],
            "setting of k",
        ),
    ):
        done = CliRunner().invoke(commands, arguments)
        assert done.exit_code == 0, done.output
        assert f"note: {where}: `3 N/m` is read as `3 [N]/m`" in done.stderr
        assert "0.666666" in done.stdout


def test_a_number_with_two_readings_is_refused() -> None:
    """Lists, ranges and distributions have numbers with units alone: 3 N/m there and 1.5 N/m as a setting was one text with two values."""
    model, told = load(BOTH), r"k: .* has two readings, since `m` is a name of the model"
    for act in (
        lambda k: model.sweep({"k": f"{k}, 4 [N/m]"}, "equilibrium", experiment=None),
        lambda k: model.sweep({"k": [f"-{k}"]}, "equilibrium", experiment=None),
        lambda k: model.montecarlo({"k": f"uniform({k}, 4 [N/m])"}, "equilibrium", 4, None),
        lambda k: model.continuation("k", k, "4 [N/m]", experiment=None),
        lambda k: model.fit([], {"k": f"{k} .. 4 [N/m]"}, None),
    ):
        with pytest.raises(UsageError, match=told):
            act("3 N/m")
    assert model.sweep({"k": "3 [N/m]"}, "equilibrium", experiment=None).table()[0, 1] == pytest.approx(1 / 3)
    mass = load(BOTH.replace("m = 2 m", "m = 2 kg").replace("3 N/m", "3 [N/m]"))  # one reading alone fits
    assert mass.sweep({"k": "3 N/m"}, "equilibrium", experiment=None).table()[0, 1] == pytest.approx(1 / 3)


COUNTED = """model Part { parameter a: deg = 30, share = 5 %, gain = 20 dB, T = 20 degC, turns: rev = (1, 2)
  output y = a }
model A {
  parameter a: deg = 30, share = 5 %, gain = 20 dB, T = 20 degC, turns: rev = (1, 2)
  input u = -30 deg
  Part part { BRACES }
  output y = a, z = part.a
  experiment go { STEP; simulate 0 .. 1 s }
}"""


@pytest.mark.parametrize(
    "value", ["a = 45", "a = -0.5", "share = 7", "gain = 6", "gain = 0", "T = 0", "turns = (1, 2)"]
)
def test_a_bare_number_where_the_unit_makes_another_one(value: str) -> None:
    """45 of an angle in deg was 45 rad, 0 of a temperature in degC 0 K."""
    name, _, number = value.partition(" = ")
    for braces, step in ((value, "set u = 1 rad"), ("a = 1 rad", f"set {value}")):
        told = [d.sentence for d in check(COUNTED.replace("BRACES", braces).replace("STEP", step))]
        assert told and all(f"`{name}` is in " in words and "is a bare number" in words for words in told)
    model = load(COUNTED.replace("BRACES", "a = pi/4").replace("STEP", "set u = pi"))
    with pytest.raises(CompilationFailed, match="is a bare number"):
        model.simulate(settings={name: number}, points=2)


@pytest.mark.parametrize(
    ("default", "name", "number"),
    [
        ("(10 deg, 20 deg)", "d[2]", "3"), ("(10 deg, 20 deg)", "d", "(1, 2)"), ("[[1 %, 2 %], [3 %, 4 %]]", "d[1,2]", "3"),
        ("[[1 %, 2 %], [3 %, 4 %]]", "d", "[[1 %, 2], [3 %, 4 %]]"), ("2*30 deg", "d", "3"), ("20 degC + 5 K", "d", "0"), ("(10 deg, 2)", "d[1]", "3"),
    ],
)  # fmt: skip
def test_items_and_sums_of_numbers_with_a_unit(default: str, name: str, number: str) -> None:
    """20 deg of a list, set to 3, were 3 rad; each item has its own unit."""
    text = f"model A {{ parameter d = {default}; output y = {'d[1,2]' if '[[' in default else 'd[1]' if ',' in default else 'd'} STEP }}"
    with pytest.raises(CompilationFailed, match="is a bare number"):
        load(text.replace("STEP", "")).simulate(settings={name: number}, points=2, to=1)
    told = [d.sentence for d in check(text.replace("STEP", f"; experiment e {{ set {name} = {number}; equilibrium }}"))]
    assert told and "is a bare number" in told[0]
    if "," not in number:
        assert any(
            "is a bare number" in d.sentence
            for d in check(text.replace("STEP", f"; experiment e {{ sweep {name} = {number}; equilibrium }}"))
        )


NAMED = """model Part { parameter a = 30 deg, d = (10 deg, 20 deg), T = 20 degC, b = a, c = b, half = -c/2, list = d, warm = T, ratio = half/a, inverse = 1/a, own: rad = a
  output y = a }
model A { Part part { BRACES }; output z = part.a }"""


@pytest.mark.parametrize(
    ("value", "unit"),
    [
        ("b = 45", "deg"),
        ("c = 45", "deg"),
        ("half = 45", "deg"),
        ("list = (1, 2)", "deg"),
        ("warm = 0", "degC"),
        ("ratio = 2", ""),
        ("inverse = 2", ""),
        ("own = 2", ""),
        ("b = 1 rad", ""),
        ("b = 0", ""),
    ],
)
def test_a_bare_number_where_the_default_is_a_name(value: str, unit: str) -> None:  # fmt: skip
    """45 of `b = a`, with a in deg, was 45 rad, which tables showed as 2578 deg."""
    told = [d.sentence for d in check(NAMED.replace("BRACES", value))]
    name = value.partition(" = ")[0]
    assert all(f"`{name}` is in {unit}, but" in words for words in told) and bool(told) == bool(unit)


STUDIED = """model A {
  parameter a: deg = 30, share = 5 %, gain = 20 dB, T = 20 degC, gap = 1 mm, M: deg = [[1, 2], [3, 4]], n = 2
  input u: deg = 30
  output phi: deg = u, y = u, m = M[1, 2] + n*a + share + gain + T/(1 K) + gap/(1 m)
  experiment go { STEP; report phi, y in deg, m }
}"""


@pytest.mark.parametrize(
    ("name", "number"),
    [("a", "3"), ("share", "3"), ("gain", "3"), ("gain", "0"), ("T", "0"), ("gap", "3"), ("M[1,2]", "3")],
)
def test_a_bare_number_of_a_study_is_refused_as_that_of_a_setting(name: str, number: str) -> None:
    """`--over a=45` of a quantity in deg was 45 rad, as were ranges, distributions, bounds, and what is wanted of an output."""
    model = load(STUDIED.replace("STEP", "equilibrium"))
    for act in (
        lambda: model.sweep({name: f"{number}, {number}"}, "equilibrium"),
        lambda: model.sweep({name: f"{number} .. 4 : 3"}, "equilibrium"),
        lambda: model.montecarlo({name: f"uniform({number}, {number})"}, "equilibrium", 4),
        lambda: model.continuation(name, number, "4"),
        lambda: model.fit([], {name: f"{number} .. 4"}),
    ):
        with pytest.raises(UsageError, match="is a bare number"):
            act()
    numbers = {"a": "3 deg", "share": "3 %", "gain": "3 dB", "T": "3 degC", "gap": "3 mm"}
    assert model.sweep({name: numbers.get(name, "3 deg")}, "equilibrium").points[0].settings
    for step in (
        f"montecarlo {name} = uniform({number}, {number}); equilibrium",
        f"continue {name} over {number} .. 4",
        f'fit {name} = {number} .. 4 to "d.csv"',
    ):
        assert any("bare number" in d.sentence for d in check(STUDIED.replace("STEP", step)))


def test_a_bare_number_that_is_wanted_or_measured_is_refused(tmp_path: Path) -> None:
    model, file = load(STUDIED.replace("STEP", "equilibrium")), tmp_path / "d.csv"
    for wanted in ("phi", "y"):  # by its declaration, by the report
        with pytest.raises(UsageError, match="is in deg, but `45` is a bare number; write `45 deg` or `45 rad`"):
            model.invert({wanted: "45"}, ["u"])
        assert (
            model.invert({wanted: "45 deg"}, ["u"]).inputs["u"]
            == model.invert({wanted: math.pi / 4}, ["u"]).inputs["u"]
        )
    with pytest.raises(UsageError, match="is a bare number"):
        model.invert({"phi": "1 deg*smoothstep9(time, 0 s, 1 s)"}, ["u"], to="1 s", limits={"u": "2"})
    for heading, right in (("phi", False), ("phi [1]", True), ("phi [deg]", True)):
        file.write_text(f"{heading}\n1\n")
        if right:
            assert model.invert_file(file, ["u"]).points
            continue
        with pytest.raises(UsageError, match="`phi` is in deg; it stands there without a unit"):
            model.invert_file(file, ["u"])
        with pytest.raises(UsageError, match="`phi` is in deg; it stands there without a unit"):
            model.fit(file, {"a": ""})
    for step in (
        "invert u to phi = 45",
        "simulate 0 .. 1 s { tolerance phi = 1 }",
        "invert u to phi = 45 deg*smoothstep9(time, 0 s, 1 s) over 0 .. 1 s { limit u = 45 }",
    ):
        assert any("bare number" in d.sentence for d in check(STUDIED.replace("STEP", step)))


def test_numbers_that_are_the_same_with_the_unit() -> None:
    model = load(COUNTED.replace("BRACES", "a = 2*pi/8, share = 0").replace("STEP", "sweep a = 0, 45 deg"))
    assert model.run()("y").tolist() == pytest.approx([0, math.pi / 4])
    assert model.run()("z").tolist() == pytest.approx([math.pi / 4] * 2)
    assert model.simulate(settings={"a": "0", "gain": "6 dB", "T": "0 K"}, points=2).final("y") == 0
    assert model.simulate(settings={"a": 45}, points=2).final("y") == 45  # a number of Python is one in SI
