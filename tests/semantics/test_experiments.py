"""Steps of experiments: what a scene gets of them, in SI, and what is wrong with them, at its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from compiler.compilation import Compilation
from compiler.errors import CompilationFailed, ValuesNeeded
from compiler.scene import (
    Analysis,
    BoundedParameter,
    ContinuationRequest,
    Differentiating,
    Fitting,
    Inverting,
    Linearizing,
    Override,
    Plan,
    Reported,
    Scene,
    Study,
    TargetValue,
)
from compiler.source import Source, Span
from tests.compiling import compiled, outputs_of, units_of

MODEL = """model A {
  parameter k = 100 [N/m], r = 1 [N*s/m], many: N/m = (1, 2), m = 2 kg
  constant g = 3 mm, ratio = 2, many_lengths: m = (1 mm, 2 mm)
  input F0 = 0 N, F1 = 0 N, u = 1 V
  signal twice = 2*F0
  function pull(t) = 2*t
  function half(t) = t/2
  MSe push : F = twice + F1
  I mass : p = m*v
  C spring : F = k*x
  R damper : F = r*v
  push -> 1(mass, spring, damper)
  output x = spring.x
  output y = 2*spring.x
  output v = mass.p/m
  output pair: m = (spring.x, 3*spring.x)
  experiment go { %s }
}
"""
PLAIN = """plain model P {
  parameter k = 2
  input u = 1
  I mass : p = 3*f
  C spring : e = k*q
  MSe push : e = u
  push -> 1(mass, spring)
  output q = spring.q
  experiment go { %s }
}
"""


def plan(steps: str, model: str = MODEL) -> Plan:
    return compiled(model % steps, experiment="go").plan


def read(steps: str, model: str = MODEL) -> Analysis:
    (only,) = plan(steps, model).studies
    return only


def test_an_output_is_shown_in_the_unit_in_which_it_is_declared() -> None:
    text = MODEL.replace("output v = mass.p/m", "output v: km/h = mass.p/m")
    shown = [(r.name, r.unit, r.scale) for r in plan("simulate 0 .. 1 s", text).report]
    assert shown[:3] == [("x", "m", 1), ("y", "m", 1), ("v", "km/h", pytest.approx(3.6))] and len(shown) == 5
    shown = [(r.name, r.unit) for r in plan("simulate 0 .. 1 s; report v, x, v in mm/s", text).report]
    assert shown == [("v", "km/h"), ("x", "m"), ("v", "mm/s")]
    assert not plan("simulate 0 .. 1 s", MODEL.replace(" pair: m ", " pair ")).report


def wrong(steps: str, model: str | Path = MODEL) -> list[tuple[str, str, str]]:
    """Code, marked words and sentence of all that is wrong with an experiment."""
    with pytest.raises(CompilationFailed) as failed:
        _ = compiled(model if isinstance(model, Path) else model % steps, experiment="go").plan
    return [(d.code, d.span.text, d.sentence) for d in failed.value.diagnostics]


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        ("linearize F0, k, g, twice to x, spring.F", Linearizing(("F0", "k", "g", "twice"), ("x", "spring.F"))),
        ("linearize", Linearizing((), ())),
        ("sensitivity k, m", Differentiating(("k", "m"))),
        ("continue F0 over 1 mN .. 3 kN", ContinuationRequest("F0", 1e-3, 3e3)),
        (
            "continue k over 2 [N/mm] .. 1 [N/m] { points = 7, most = 40, branches = true }",
            ContinuationRequest("k", 2e3, 1.0, 7, 40, True),
        ),
        ("modes", Study("modes")),
        ("bode { points = 200 }", Study("bode", points=200)),
    ],
)
def test_names_and_numbers_of_a_step_are_in_si(steps: str, expected: Analysis) -> None:
    assert read(steps) == expected


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        (
            "invert F0, F1 to x = 8 um, v = 2 [mm/s]",
            Inverting(("F0", "F1"), (TargetValue("x", 8e-6), TargetValue("v", 2e-3))),
        ),
        ("invert F0/F1 to y = 2*g", Inverting(("F0/F1",), (TargetValue("y", 6e-3),))),
        (
            "invert F0 to x = g*ratio over 2 ms .. 6 ms",
            Inverting(("F0",), (TargetValue("x", text="(0.003 [m])*(2.0)"),), 2e-3, 6e-3),
        ),
        (
            "invert F0/F1 to x = (g + g)*smoothstep9(time, 0 s,   5 ms) over 0 .. 6 ms { points = 11, moving = true, limit F1 = 3 mN, limit F0 = 1 N }",
            Inverting(
                ("F0/F1",),
                (TargetValue("x", text="((0.003 [m]) + (0.003 [m]))*smoothstep9(time, 0 s, 5 ms)"),),
                0.0,
                6e-3,
                11,
                True,
                (("F1", 3e-3), ("F0", 1.0)),
            ),
        ),
        (
            "invert F0 to x = time*2 [mm/s] over 0 .. 1 s",
            Inverting(("F0",), (TargetValue("x", text="time*2 [mm/s]"),), 0.0, 1.0),
        ),
        (
            "invert F0 to x = 1 mm*sin(pi*time*k/(3 [kg/s])) over 0 .. 1 s",
            Inverting(("F0",), (TargetValue("x", text="1 mm*sin(pi*time*(100.0 [N/m])/(3 [kg/s]))"),), 0.0, 1.0),
        ),
    ],
)
def test_an_inverse_has_its_targets_and_its_path(steps: str, expected: Analysis) -> None:
    assert read(steps) == expected


def test_a_plain_model_has_no_units() -> None:
    path = TargetValue("q", text="(2.0)*time")
    assert read("invert u to q = k*time over 1 .. 3", PLAIN) == Inverting(("u",), (path,), 1.0, 3.0)
    assert read("continue u over 0 .. 2", PLAIN) == ContinuationRequest("u", 0.0, 2.0)


NOT_AN_INPUT = "A linear model leads from an input, which `{}` is not"
NOT_SETTABLE = "{}, which `{}` cannot be"
A_LIST = "A single number is expected here, this is a list"
TAKEN = "The name `{}` is already taken in this model"


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        ("linearize spring.x, many to x", [("BG150", n, NOT_AN_INPUT.format(n)) for n in ("spring.x", "many")]),
        ("linearize F0 to pair", [("BG111", "pair", A_LIST)]),
        ("sensitivity k, r, k", [("BG104", "k", TAKEN.format("k"))]),
        ("sensitivity g", [("BG150", "g", NOT_SETTABLE.format("A derivative is taken by one that can be set", "g"))]),
        ("continue k over 2 [N/m] .. 2 [N/m]", [("BG150", "2 [N/m] .. 2 [N/m]", "The range has no length")]),
        ("continue k over 2 m .. 2 [N/m]", [("BG103", "2 m", "`k` is in [N/m], but `2 m` is in [m]")]),
        (
            "continue g over 1 mm .. 2 mm { points = 1 }",
            [
                ("BG150", "g", NOT_SETTABLE.format("A branch is followed along one that can be set", "g")),
                ("BG150", "points = 1", "`points = 1` makes no sense"),
            ],
        ),
        ("invert F0 to q = 1 mm", [("BG101", "q", "There is no `q` in the outputs")]),
        ("invert F0, F1 to x = 1 mm", [("BG150", "F0, F1 to x = 1 mm", "1 output and 2 inputs or pairs")]),
        ("invert F0 to x = 0, v = 0", [("BG150", "F0 to x = 0, v = 0", "2 outputs and 1 input or pairs")]),
        ("invert F0, F0 to x = 0, v = 0", [("BG104", "F0", TAKEN.format("F0"))]),
        ("invert F0, F1 to x = 0, x = 0", [("BG104", "x", TAKEN.format("x"))]),
        ("invert F0/u to x = 0", [("BG103", "F0/u", "`F0` is in [N] and `u` is in [V]")]),
        ("invert F0/g to x = 0", [("BG150", "g", NOT_SETTABLE.format("What is found is one that can be set", "g"))]),
        ("invert F0 to x = 1 V", [("BG103", "1 V", "What is wanted of `x` is in [m], but `1 V` is in [V]")]),
        ("invert F0 to x = 0 { points = 9 }", [("BG120", "points = 9", "`invert` has no attribute `points`")]),
        (
            "invert F0 to x = 1 mm*sin(time/1 s)",
            [("BG150", "1 mm*sin(time/1 s)", "What is wanted of `x` goes with time, and no path is asked for")],
        ),
    ],
)
def test_mistakes_in_a_step_are_told_at_their_place(steps: str, expected: list[tuple[str, str, str]]) -> None:
    assert wrong(steps) == expected


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("0 over 2 ms .. 2 ms", [("BG150", "2 ms .. 2 ms", "The path ends before it begins")]),
        (
            "0 over 2 m .. 3 V",
            [
                ("BG103", "2 m", "The start of a path is in [s], but `2 m` is in [m]"),
                ("BG103", "3 V", "The end of a path is in [s], but `3 V` is in [V]"),
            ],
        ),
        (
            "0 over 0 .. 3 ms { limit F1 = 1 N, limit F0 = 0 N }",
            [
                ("BG101", "F1", "There is no `F1` in what is found here"),
                ("BG150", "limit F0 = 0 N", "A limit is larger than zero"),
            ],
        ),
        (
            "0 over 0 .. 3 ms { limit F0 = 1 V }",
            [("BG103", "1 V", "The limit of `F0` is in [N], but `1 V` is in [V]")],
        ),
        ("time over 0 .. 1 s", [("BG103", "time", "`x` is in [m], but `time` is in [s]")]),
        ("many_lengths over 0 .. 1 s", [("BG111", "many_lengths", A_LIST)]),
        (
            "spring.x over 0 .. 1 s",
            [
                (
                    "BG106",
                    "spring.x",
                    "What a path of `x` reads besides time must be known before the run, but `spring.x` changes during it",
                )
            ],
        ),
        ("1 mm*pull(half(2)) over 0 .. 1 s", [("BG150", "pull(half(2))", "A path cannot call your function `pull`")]),
    ],
)
def test_mistakes_in_a_path_are_told_at_their_place(path: str, expected: list[tuple[str, str, str]]) -> None:
    assert wrong(f"invert F0 to x = {path}") == expected


# ---------------------------------------------------------------- fit
def beside(folder: Path, columns: str, step: str, model: str = MODEL) -> Path:
    """A model with `fit … to "a.csv"`, and that file with one line of ones."""
    (folder / "a.csv").write_text(f"{columns}\n{','.join('1' * (columns.count(',') + 1))}\n", encoding="utf-8")
    (folder / "model.bg").write_text(model % step, encoding="utf-8")
    return folder / "model.bg"


def fitting(model: Path) -> Fitting:
    (only,) = compiled(model, experiment="go").plan.studies
    assert isinstance(only, Fitting)
    return only


def test_a_fit_has_its_bounds_and_scales(tmp_path: Path) -> None:
    step = 'fit k = 1 [N/m] .. 3 [N/mm], m = -1 kg .. 2 g, r to "a.csv", "a.csv" { scale k = log, explain = true, scale r = log, scale m = linear }'
    assert fitting(beside(tmp_path, "time [ms], v [mm/s]", step)) == Fitting(
        (
            BoundedParameter("k", 1.0, 3e3, True),
            BoundedParameter("m", -1.0, 2e-3),
            BoundedParameter("r", logarithmic=True),
        ),
        ("a.csv", "a.csv"),
        ("v",),
        True,
    )
    zero = fitting(beside(tmp_path, "x [mm]", 'fit k = 0 [N/m] .. 1 [N/m] to "a.csv" { scale k = log }'))
    assert zero.sought == (BoundedParameter("k", 0.0, 1.0, True),)


@pytest.mark.parametrize(
    ("step", "code", "place", "sentence"),
    [
        ("k = 1 [N/m] .. 1 [N/m]", "BG150", "1 [N/m] .. 1 [N/m]", "The bounds of `k` do not go from low to high"),
        ("m = 2 kg .. 1 kg", "BG150", "2 kg .. 1 kg", "The bounds of `m` do not go from low to high"),
        ("g", "BG150", "g", "What is looked for is one that can be set, which `g` cannot be"),
        ("k, k", "BG104", "k", TAKEN.format("k")),
    ],
)
def test_mistakes_in_what_is_looked_for(tmp_path: Path, step: str, code: str, place: str, sentence: str) -> None:
    assert wrong("", beside(tmp_path, "x [mm]", f'fit {step} to "a.csv"')) == [(code, place, sentence)]


def test_mistakes_in_a_scale(tmp_path: Path) -> None:
    some = 'fit k = -1 [N/m] .. 3 [N/m], m to "a.csv" {{ scale {} }}'
    assert wrong("", beside(tmp_path, "x [mm]", some.format("k = log"))) == [
        ("BG150", "-1 [N/m] .. 3 [N/m]", "A logarithmic scale has no bounds below zero, and `k` has one")
    ]
    assert wrong("", beside(tmp_path, "x [mm]", some.format("m = log, scale r = log"))) == [
        ("BG101", "scale r = log", "There is no `r` in what is looked for")
    ]
    assert wrong("", beside(tmp_path, "x [mm]", some.format("m = lg"))) == [
        ("BG150", "scale m = lg", "A scale is `log` or `linear`")
    ]


@pytest.mark.parametrize(
    ("columns", "measured"),
    [
        (
            "x [mm], F0 [N], sigma x [m], frequency 1 [Hz], damping 2, frequency 10 [kHz]",
            ("x", "frequency 1", "damping 2", "frequency 10"),
        ),
        ("time [ms], spring.x [um], m [g]", ("spring.x",)),
        ("x [mm], x [um], sigma time [s], v [m/s]", ("x", "v")),
    ],
)
def test_what_is_measured_is_neither_set_nor_time_nor_a_deviation(
    tmp_path: Path, columns: str, measured: tuple[str, ...]
) -> None:
    assert fitting(beside(tmp_path, columns, 'fit k to "a.csv"')).measured == measured


def test_columns_of_a_plain_model_have_no_units(tmp_path: Path) -> None:
    columns = "q, time, u, frequency 1, damping 1"
    assert fitting(beside(tmp_path, columns, 'fit k to "a.csv"', PLAIN)).measured == ("q", "frequency 1", "damping 1")
    for head, name in (("time [s]", "time"), ("frequency 1 [Hz]", "frequency 1")):
        ((_, _, sentence),) = wrong("", beside(tmp_path, f"q, {head}", 'fit k to "a.csv"', PLAIN))
        assert sentence.startswith(f"`{name}` is a bare number, but a.csv has it in [")


@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        ("x", "`x` is in [m], but a.csv has it without a unit"),
        ("sigma x [N]", "`x` is in [m], but a.csv has it in [N]"),
        ("time [m]", "`time` is in [s], but a.csv has it in [m]"),
        ("frequency 1 [s]", "`frequency 1` is in [1/s], but a.csv has it in [s]"),
        ("damping 1 [s]", "`damping 1` is a bare number, but a.csv has it in [s]"),
        ("frequency 0 [Hz]", "`frequency 0` in a.csv is nothing that the model has"),
        ("many [N/m]", "`many` in a.csv is nothing that the model has"),
        ("2*x [mm]", "`2*x` in a.csv is nothing that the model has"),
        ("1 + [mm]", "`1 +` in a.csv is nothing that the model has"),
        ("zzz [mm]", "`zzz` in a.csv is nothing that the model has"),
        ("time [s], F0 [N]", "Nothing is measured in a.csv"),
        ("sigma k [N/m], x [mm]", "`k` is looked for, and set line by line"),
    ],
)
def test_mistakes_in_headings(tmp_path: Path, columns: str, sentence: str) -> None:
    assert wrong("", beside(tmp_path, columns, 'fit k to "a.csv"')) == [("BG152", '"a.csv"', sentence)]


# ---------------------------------------------------------------- simulate, equilibrium, report
def test_a_simulation_has_its_time_and_settings() -> None:
    found = plan(
        "simulate 1 ms .. 2 s { rtol = 1e-13, points = 2, atol = 1e-9, solver = radau, tolerance spring.x = 1 nm }; bandwidth 2 kHz"
    )
    assert (found.start, found.stop, found.solver, found.bandwidth) == (1e-3, 2.0, "radau", 2e3)
    assert (dict(found.settings), dict(found.tolerances)) == (
        {"rtol": 1e-13, "points": 2.0, "atol": 1e-9},
        {"spring.x": pytest.approx(1e-9, rel=1e-15)},
    )
    assert plan("bandwidth 2; simulate 0 .. 3 { rtol = 0.1 }", PLAIN).settings == {"rtol": 0.1}
    assert plan("bandwidth 2; simulate 0 .. 3", PLAIN).bandwidth == 2.0


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        ("simulate 1 ms .. 1 ms", ("BG150", "1 ms .. 1 ms", "The simulation ends before it begins")),
        ("simulate 0 .. 1 s; simulate 0 .. 2 s", ("BG150", "0 .. 2 s", "A second `simulate` in one experiment")),
        (
            "simulate 0 .. 1 s { tolerance many = 1 [N/m] }",
            ("BG111", "many", "One quantity is expected here, this is a list"),
        ),
        (
            "simulate 0 .. 1 s { tolerance x = 0 m }",
            ("BG150", "tolerance x = 0 m", "A tolerance is positive"),
        ),
        ("simulate 0 .. 1 s { points = 1 }", ("BG150", "points = 1", "`points = 1` makes no sense")),
        ("simulate 0 .. 1 s { points = 2.5 }", ("BG150", "points = 2.5", "`points = 2.5` makes no sense")),
        ("simulate 0 .. 1 s { rtol = 0.11 }", ("BG150", "rtol = 0.11", "`rtol = 0.11` makes no sense")),
        ("simulate 0 .. 1 s { rtol = 9e-14 }", ("BG150", "rtol = 9e-14", "`rtol = 9e-14` makes no sense")),
        ("simulate 0 .. 1 s { atol = 0 }", ("BG150", "atol = 0", "`atol = 0` makes no sense")),
        ("simulate 0 .. 1 s { rtol k = 1 }", ("BG120", "rtol k = 1", "`simulate` has no attribute `rtol`")),
        ("simulate 0 .. 1 s { solver = rad }", ("BG101", "solver = rad", "There is no `rad` in the solvers")),
        ("bandwidth 0 Hz", ("BG150", "0 Hz", "A bandwidth of 0 Hz makes no sense")),
        ("bandwidth 1 Hz; bandwidth 2 Hz", ("BG150", "2 Hz", "A second `bandwidth` in one experiment")),
        ("bandwidth 2 m", ("BG103", "2 m", "A bandwidth is in [1/s], but `2 m` is in [m]")),
        ("report x in V", ("BG103", "V", "`x` is in [m], so it cannot be reported in V")),
        ("report pair", ("BG111", "pair", A_LIST)),
    ],
)
def test_mistakes_in_a_run_are_told_at_their_place(steps: str, expected: tuple[str, str, str]) -> None:
    assert wrong(steps) == [expected]


def test_an_equilibrium_is_a_start_only_before_a_simulation() -> None:
    before, after = plan("equilibrium; simulate 0 .. 1 s"), plan("simulate 0 .. 1 s; equilibrium")
    assert (before.equilibrium, before.studies) == (True, ())
    assert (after.equilibrium, after.studies) == (False, (Study("equilibrium"),))


def test_reports_have_scale_and_offset() -> None:
    model = "model T { parameter t = 300 K; output warm = t, cold = 2*t; experiment go { %s } }"
    first, second, third = plan("report warm in degC, cold in mK, warm", model).report
    assert first == Reported("warm", "degC", 1.0, -273.15) and second == Reported("cold", "mK", 1e3, 0.0)
    assert third == Reported("warm", "K", 1.0, 0.0)


def test_an_output_may_be_another_name_of_a_quantity() -> None:
    text = """model M {
      parameter k = 3 m, many: N = (4, 5)
      signal s = 2*k
      C spring : F = 7 [N/m]*x { start x = 2 m }
      R damper : F = 1 [N*s/m]*v
      1 j : translation
      j -> spring, damper
      output a = k "of a parameter", b = s, c: m = spring.x, d = spring.F, e: N = (many[1], many[2]), f = 0.5
    }"""
    model = compiled(text)
    assert outputs_of(model) == {"a": 3.0, "b": 6.0, "c": 2.0, "d": 14.0, "e[1]": 4.0, "e[2]": 5.0, "f": 0.5}
    assert units_of(model) == {"a": "m", "b": "m", "c": "m", "d": "N", "e[1]": "N", "e[2]": "N", "f": "1"}


def test_a_step_with_numbers_of_the_run_is_left_out_but_a_response_needs_them() -> None:
    def later(step: str) -> Plan:
        source = Source("text.bg", MODEL % step)
        unknown = Override("k", None, Span(source, 0, 0))
        return Compilation(source, Scene(None, "go", (unknown,))).plan

    assert later("continue F0 over 0 N .. k*1 mm; modes").studies == (Study("modes"),)
    with pytest.raises(ValuesNeeded):
        later("response F0 to x over 1 Hz .. 2 Hz*k/(1 [N/m])")
