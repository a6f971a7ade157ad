"""Settings from outside: parameters, items of lists, nested paths, inputs; by an experiment or by the caller, who has priority."""

from __future__ import annotations

import pytest

from tests.compiling import Running, Setting, compiled, refused

TEXT = """
model Part {
  parameter k: N/m = 100, l = k/(1 [N/m])
  constant  twice = 2*k
  input     u = 1 V
  output    y = k, z = l, w = twice, v = u
}
model A {
  parameter g = 3, gap: um = (4, 5, 6), n = 2
  constant  c = 7
  input     volt = 2 V
  signal    s = 2*volt
  Part part { k = g*10 [N/m], u = s }
  Part free
  for i in 1..n { output a[i] = gap[i] }
  output gap3 = gap[3], g2 = 2*g, out = s, k = part.y, l = part.z, w = part.w, u = part.v, fk = free.y, fl = free.z, fw = free.w, fu = free.v
  experiment e {
    set g = 5
    set volt = 1 V*time/(1 s)
    set free.k = 11 [N/m]
    simulate 0 .. 1 s
  }
}
"""


def found(
    settings: dict[str, Setting] | None = None, experiment: str | None = None, time: float = 0.0
) -> dict[str, float]:
    return Running(compiled(TEXT, settings, experiment=experiment)).outputs(time=time)


def test_defaults() -> None:
    assert found() == {
        "a[1]": 4e-6, "a[2]": 5e-6, "gap3": 6e-6, "g2": 6.0, "out": 4.0, "k": 30.0, "l": 30.0, "w": 60.0, "u": 4.0,
        "fk": 100.0, "fl": 100.0, "fw": 200.0, "fu": 1.0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "value", "changed"),
    [
        ("g", "4", {"g2": 8.0, "k": 40.0, "l": 40.0, "w": 80.0}),
        ("g", 4.0, {"g2": 8.0, "k": 40.0, "l": 40.0, "w": 80.0}),
        ("gap[2]", "7 mm", {"a[2]": 7e-3}),
        ("gap[2]", 7e-3, {"a[2]": 7e-3}),
        ("gap[3]", "2*1 mm", {"gap3": 2e-3}),
        ("gap", "(1 m, 2 m, 3 m)", {"a[1]": 1.0, "a[2]": 2.0, "gap3": 3.0}),
        ("part.k", "1 [N/m]", {"k": 1.0, "l": 1.0, "w": 2.0}),
        ("part.l", "5", {"l": 5.0}),
        ("free.k", "g*1 [N/m]", {"fk": 3.0, "fl": 3.0, "fw": 6.0}),
        ("free.l", "9", {"fl": 9.0}),
        ("volt", "3 V", {"out": 6.0, "u": 6.0}),
        ("volt", 3.0, {"out": 6.0, "u": 6.0}),
        ("free.u", "5 mV", {"fu": 5e-3}),
        ("part.u", "5 mV", {"u": 5e-3}),
        ("n", "1", {"a[2]": None}),
        ("n", "3", {"a[3]": 6e-6}),
    ],
)
def test_one_setting(name: str, value: Setting, changed: dict[str, float | None]) -> None:
    """Dependent quantities follow, all others stay."""
    expected = {n: v for n, v in (found() | changed).items() if v is not None}
    assert found({name: value}) == pytest.approx(expected, rel=1e-15)


def test_an_input_is_set_to_an_expression_of_time() -> None:
    assert found({"volt": "2 V*sin(2*pi*time/(4 s))"}, time=1.0)["out"] == 4.0
    assert found({"volt": "1 V if time > 2 s else 5 V"}, time=3.0)["out"] == 2.0
    assert found({"volt": "g*1 V + time*2 [V/s]"}, time=3.0)["out"] == 18.0


def test_a_setting_needs_its_unit_whatever_was_declared() -> None:
    """A bare text is a bare number, as in an instance; a float of the library is in SI."""
    assert refused(compiled(TEXT, {"gap[1]": "7"}), "BG103").span.text == "7"
    assert found({"gap[1]": 7.0})["a[1]"] == 7.0


def test_a_parameter_is_not() -> None:
    assert refused(compiled(TEXT, {"g": "time/(1 s)"}), "BG106").span.text == "time"
    assert refused(compiled(TEXT, {"free.k": "volt*1 [N/m/V]"}), "BG106").span.text == "volt"


def test_an_experiment_sets_and_the_caller_wins() -> None:
    assert found(experiment="e", time=0.5)["g2"] == 10.0
    assert found(experiment="e", time=0.5)["out"] == 1.0
    assert found(experiment="e")["fk"] == 11.0
    assert found({"g": "6"}, experiment="e")["g2"] == 12.0
    assert found({"volt": "9 V"}, experiment="e", time=0.5)["out"] == 18.0
    assert found(experiment=None)["g2"] == 6.0


@pytest.mark.parametrize(
    ("name", "word"),
    [("nothing", "gap"), ("c", "constant"), ("s", "signal"), ("g2", "output"), ("part.nothing", "part.k"), ("part.twice", "constant"), ("gap[4]", "gap[3]"), ("gap[0]", "gap["),
     ("part", "part."), ("part.y", "output"), ("gapp", "gap"), ("frei.k", "free.k"), ("time", "")],
)  # fmt: skip
def test_what_cannot_be_set(name: str, word: str) -> None:
    """Reported with the names that can be set."""
    diagnostic = refused(compiled(TEXT, {name: "1"}), "BG101")
    assert f"`{name}`" in diagnostic.sentence and word in diagnostic.help


def test_the_structure_may_depend_on_it() -> None:
    assert found({"gap": "(1 m, 2 m, 3 m, 4 m)", "n": "4"})["a[4]"] == 4.0


def test_several_at_once() -> None:
    both = found({"g": "4", "part.l": "1", "volt": "0 V", "gap[1]": "1 m"})
    assert (both["k"], both["l"], both["out"], both["a[1]"]) == (40.0, 1.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [
        ("g", "1/0", "BG133"),
        ("g", "log(-1)", "BG133"),
        ("g", "unknown", "BG101"),
        ("g", "(1, 2)", "BG111"),
        ("gap[1]", "(1 m, 2 m)", "BG111"),
        ("volt", "(1 V, 2 V)", "BG111"),
    ],
)
def test_values_that_are_none(name: str, value: str, code: str) -> None:
    assert refused(compiled(TEXT, {name: value}), code).span.source.name == "setting"


def test_a_zero_that_is_set_is_kept_as_a_value_not_as_structure() -> None:
    """`r = 0` by default leaves no trace; overridden it is there."""
    text = "model A {\n  parameter r: N*s/m = 0\n  1 a\n  I m : p = 2 kg*v\n  R loss : F = r*v\n  a -> m, loss\n  output v = m.v\n}\n"
    assert "loss" not in {n.name for n in compiled(text).graph.nodes}
    assert "loss" in {n.name for n in compiled(text, {"r": "3 [N*s/m]"}).graph.nodes}
    assert Running(compiled(text, {"r": "4 [N*s/m]"})).rates({"m.p": 3.0}) == {"m.p": -6.0}
    assert "loss" in {n.name for n in compiled(text, free=("r",)).graph.nodes}
    assert "loss" in {n.name for n in compiled(text, free=("*",)).graph.nodes}


def test_free_quantities_are_arguments_of_the_program() -> None:
    program = compiled(TEXT, free=("volt", "free.u")).program
    assert program.inputs.names == ("volt", "free.u") and program.input_defaults == (2.0, 1.0)
    running = Running(compiled(TEXT, free=("*",)))
    assert set(running.program.inputs.names) == {"volt", "free.u"}
    assert {"g", "free.k", "gap[1]"} <= set(running.program.parameters.names)
    assert running.outputs(inputs={"volt": 5.0})["out"] == 10.0
