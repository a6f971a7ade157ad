"""Settings from outside: one program for all values; the model is compiled again if a value decides more than numbers."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.compiled_scene import chosen_target
from bondgraph.errors import UsageError
from bondgraph.simulation.settings import settle
from compiler.errors import CompilationFailed
from tests.compiling import MODELS

LOSSY = """
model A {
  parameter r: N*s/m = 0.5, extra: kg = 0.2, m: kg = 2, k: N/m = 3
  input push = 1 N
  1 body
  I mass   : p = m*v      { start v = 1 [m/s] }
  I more   : p = extra*v
  C spring : F = 8 [N/m]*x
  C second : F = k*x
  R loss   : F = r*v
  MSe drive : F = push
  drive -> body -> mass, spring, loss, second, more
  output x = spring.x, v = body.v
  experiment e { simulate 0 .. 1 s { rtol = 1e-9 } }
}
"""
CHAIN = """
model B {
  parameter n = 2, k: N/m = 4
  Se pull : F = 1 N
  1 top : translation
  pull -> top
  for i in 1..n { R drag[i] : F = k/(1 [1/s])*v
    top -> drag[i] }
  output v = top.v
  experiment e { simulate 0 .. 1 s }
}
"""


def by_hand(mass: float, r: float, stiffness: float, v: float, push: float = 1.0) -> float:
    """x at 1 s of m x'' + r x' + k x = push."""
    from scipy.linalg import expm

    if mass == 0:
        return push / stiffness * (1 - np.exp(-stiffness / r)) if r else push / stiffness
    matrix = np.array([[0, 1, 0], [-stiffness / mass, -r / mass, push / mass], [0, 0, 0]])
    return float((expm(matrix) @ [0, v, 1])[0])


@pytest.mark.parametrize("r", [-0.1, 0.0, 0.3])
@pytest.mark.parametrize("extra", [-0.1, 0.0, 0.5])
@pytest.mark.parametrize("push", [0.0, 2.0])
def test_sweeps_through_zero(r: float, extra: float, push: float) -> None:
    """A value of zero is no special case: an element that a zero in the text would remove is present if a setting is zero."""
    momentum = 2.0  # of the mass that holds it; the other follows its speed
    found = bondgraph.load(LOSSY).simulate(settings={"r": r, "extra": extra, "push": push}).final("x")
    start = 1.0 if extra else momentum / 2
    assert found == pytest.approx(by_hand(2 + extra, r, 11, start, push), rel=1e-7)


def test_a_mass_of_zero_is_another_order_and_told() -> None:
    """A setting `m = 0` gives the same as the text with `m = 0`, with a note that the equations are others."""
    text = LOSSY.replace("{ start v = 1 [m/s] }", "").replace("I more   : p = extra*v\n", "").replace(", more", "")
    for value in (0.0, "0 kg"):
        found = bondgraph.load(text).simulate(settings={"m": value})
        assert found.final("x") == pytest.approx(by_hand(0, 0.5, 11, 0), rel=1e-8)
        assert any("`m = 0`: the equations are others" in note for note in found.notes)
    without = bondgraph.load(text.replace("m: kg = 2", "m: kg = 0"))
    np.testing.assert_array_equal(without.simulate().values, found.values)
    analysed = bondgraph.load(text)
    np.testing.assert_array_equal(analysed.linearize(settings={"m": 0}).A, without.linearize().A)
    assert [mode.frequency for mode in analysed.modes(settings={"m": "0 kg"})] == [m.frequency for m in without.modes()]
    near = bondgraph.load(text).simulate(settings={"m": 1e-9})
    assert near.final("x") == pytest.approx(found.final("x"), rel=1e-6) and near.notes == ()


def test_sensitivity_at_zero_is_that_of_the_whole_program() -> None:
    """Central differences in r at r = 0, against the closed form; the program knows r although its default is zero."""
    model = bondgraph.load(LOSSY.replace("r: N*s/m = 0.5", "r: N*s/m = 0"))
    h = 1e-4
    plus, minus = (model.simulate(settings={"r": s * h}, rtol=1e-12).final("x") for s in (1, -1))
    exact = (by_hand(2.2, h, 11, 1) - by_hand(2.2, -h, 11, 1)) / (2 * h)
    assert (plus - minus) / (2 * h) == pytest.approx(exact, rel=1e-8)


def test_one_program_for_all_values() -> None:
    """Numbers and texts with units give the same scene, for all values, and the same bits."""
    model = bondgraph.load(LOSSY)
    target = chosen_target(None)
    scenes = {
        settle(model, "", {"r": r, "push": "3 N"}, None, False, target).scene for r in (0.25, 1e3, "250 [g/s]", 0.0)
    }
    assert len(scenes) == 1
    one, other = (bondgraph.load(LOSSY).simulate(settings={"r": r}) for r in (0.25, "250 [g/s]"))
    np.testing.assert_array_equal(one.values, other.values)
    program = model.compiled_scene(scenes.pop(), False, target).program
    assert {"r", "push"} <= set(program.parameters.names)


def test_what_decides_more_than_numbers_is_compiled() -> None:
    model = bondgraph.load(CHAIN)
    assert model.simulate(settings={"n": 5, "k": 2}).final("v") == pytest.approx(0.1)
    assert model.simulate(settings={"n": "4", "k": "5 [N/m]"}).final("v") == pytest.approx(0.05)
    settled = settle(model, "", {"n": 3.0, "k": 2.0}, None, False, "numpy")
    assert dict(settled.values) == {"k": 2.0}  # only the length is compiled


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"r": "3 kg"}, "`r`"),
        ({"r": "3"}, "`r`"),
        ({"nothing": 1.0}, "`nothing`"),
        ({"r": float("nan")}, "no finite value"),
    ],
)  # fmt: skip
def test_what_cannot_be_set_is_told_as_ever(settings: dict[str, str | float], words: str) -> None:
    with pytest.raises((bondgraph.CompilationFailed, bondgraph.RunFailed), match=words):
        bondgraph.load(LOSSY).simulate(settings=settings)


def test_a_negative_mass_of_a_body_is_refused() -> None:
    text = (MODELS / "pendulum.bg").read_text()
    name = next(n for n, p in bondgraph.load(text).parameters.items() if p.unit == "kg")
    with pytest.raises(bondgraph.CompilationFailed, match="negative"):
        bondgraph.load(text).simulate(settings={name: -1.0})


def test_a_loop_that_a_value_makes_singular_is_refused() -> None:
    loop = "model B {\n  parameter gain = 0.5\n  MSf source : i = 1 A + gain*r.i\n  0 node\n  R r : u = 2 ohm*i\n  source -> node -> r\n  output y = r.i\n}\n"
    assert bondgraph.load(loop).simulate(to=1, settings={"gain": 0.75}).final("y") == pytest.approx(4.0)
    with pytest.raises(bondgraph.CompilationFailed, match="gain = 1"):
        bondgraph.load(loop).simulate(to=1, settings={"gain": 1.0})


@pytest.mark.machine_code
def test_another_value_compiles_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("BONDGRAPH_CACHE", str(tmp_path / "kept"))
    bondgraph.load(LOSSY).simulate(settings={"r": 0.1}, target="native")
    count = len(list((tmp_path / "kept").iterdir()))

    def never(*_: object) -> None:
        raise AssertionError("compiled again")

    monkeypatch.setattr("compiler.compilation.build_graph", never)
    assert np.isfinite(bondgraph.load(LOSSY).simulate(settings={"r": 0.2}, target="native").final("x"))
    assert len(list((tmp_path / "kept").iterdir())) == count


def test_a_value_with_which_nothing_begins_is_told() -> None:
    """The search for magnitudes ends where it cannot make its first step."""
    text = """model M {
      parameter k = 8 [N/m]
      1 body : translation; I mass : p = 1 kg*v; C spring : F = 1 [N^0.5/m^0.5]*sqrt(k)*x { start x = 1 mm }
      body -> mass, spring
      output x = spring.x
    }"""
    with pytest.raises(bondgraph.RunFailed, match="the square root of -1"):
        bondgraph.load(text).simulate(None, settings={"k": -1.0}, to="1 s")


@pytest.mark.few(6)
@pytest.mark.parametrize(
    "name", ["a", "s", "l_s", "d[1]", "E[2]", "h", "pitch", "r", "r_phi", "m_p", "I_z", "push1", "fx"]
)
def test_parameters_of_the_manipulator_are_arguments(name: str) -> None:
    """Also those that say where its joints are: a mechanism is compiled for all places."""
    model = bondgraph.load(MODELS / "manipulator.bg")
    assert settle(model, "", {name: 1e-4}, None, False, "numpy").values == {name: 1e-4}


ZEROS = [  # text of a model with parameters a and b, settings that are zero, whether the equations are others
    ("I m : p = a*v\n C k : F = b*x\n R r : F = 0.5 [N*s/m]*v", "N*s^2/m", "N/m", {"a"}, True),
    ("I m : p = a*v\n C k : F = b*x\n R r : F = 0.5 [N*s/m]*v", "N*s^2/m", "N/m", {"b"}, False),
    ("I m : p = a*v\n C k : F = b*x\n R r : F = 0.5 [N*s/m]*v", "N*s^2/m", "N/m", {"a", "b"}, True),
    ("I m : p = (a + b)*v\n C k : F = 2 [N/m]*x\n R r : F = 0.5 [N*s/m]*v", "kg", "kg", {"a"}, False),
    ("I m : p = (a + b)*v\n C k : F = 2 [N/m]*x\n R r : F = 0.5 [N*s/m]*v", "kg", "kg", {"a", "b"}, True),
    ("I m[1] : p = a*v\n I m[2] : p = b*v\n C k : F = 2 [N/m]*x\n R r : F = 0.5 [N*s/m]*v", "kg", "kg", {"a", "b"}, True),
]  # fmt: skip


@pytest.mark.parametrize(("parts", "of_a", "of_b", "zero", "others"), ZEROS)
def test_zeros_that_change_the_equations_are_known_before_the_run(
    parts: str, of_a: str, of_b: str, zero: set[str], others: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One run, of the program that the text with the zeros has; without a run that fails before."""
    from bondgraph.simulation import run

    runs = []
    monkeypatch.setattr(run, "run", lambda *a, made=run.run: (runs.append(a), made(*a))[1])
    names = ", ".join(line.split(":")[0].split()[1] for line in parts.split("\n"))
    text = f"model A {{\n parameter a: {of_a} = 2, b: {of_b} = 3\n Se drive : F = 1 N\n 1 body\n {parts}\n drive -> body -> {names}\n output v = body.v\n}}"
    found = bondgraph.load(text).simulate(to=1, settings=dict.fromkeys(sorted(zero), 0.0))
    assert len(runs) == 1 and any("the equations are others" in note for note in found.notes) is others
    for name in zero:
        text = text.replace(f"{name}: {of_a if name == 'a' else of_b} = {2 if name == 'a' else 3}", f"{name}: {of_a if name == 'a' else of_b} = 0")  # fmt: skip
    said = bondgraph.load(text).simulate(to=1)
    np.testing.assert_allclose(found.values[-1], said.values[-1], rtol=0 if others else 1e-6)


def test_zeros_of_a_mechanism_and_of_resistors() -> None:
    """A pendulum without length, two resistors without resistance."""
    text = (MODELS / "pendulum.bg").read_text()
    found = bondgraph.load(text).simulate(to=0.1, settings={"l": 0.0})
    np.testing.assert_array_equal(
        found.values, bondgraph.load(text.replace("l = 1 m", "l = 0 m")).simulate(to=0.1).values
    )
    net = "model A {\n parameter r: ohm = 2, s: ohm = 3\n Se u : u = 1 V\n R a : u = r*i\n R b : u = s*i\n C q : u = q/(1 F)\n u -> 1(a, 0(q, b))\n output y = q.u\n}"
    assert bondgraph.load(net).simulate(to=1, settings={"r": 0}).final("y") == 1
    assert bondgraph.load(net).simulate(to=1, settings={"s": 0}).final("y") == 0


def test_a_truth_is_no_other_number() -> None:
    text = "model T {{\n  parameter stiff = true\n  {}output x = 1 if stiff else 0\n  experiment e {{ {}simulate 0 .. 1 s }}\n}}\n"
    model = bondgraph.load(text.format("", ""))
    for value, x in [(True, 1), (False, 0), (1, 1), (0.0, 0), ("true", 1), ("1 > 2", 0)]:
        assert model.simulate(settings={"stiff": value}).final("x") == x
    for wrong in [0.5, -1, 2, "0.5", "2"]:
        with pytest.raises(CompilationFailed, match="`stiff` of `T` cannot be"):
            model.simulate(settings={"stiff": wrong})
    assert [d.code for d in bondgraph.check(text.format("", "set stiff = 0.5; "))] == ["BG122"]
    part = "model P { parameter stiff = true; output x = 1 if stiff else 0 }\nmodel Q { P p { stiff = 3 }; output x = p.x }\n"
    assert [d.code for d in bondgraph.check(part, "Q")] == ["BG122"]


@pytest.mark.parametrize("values", ["false, true", "0, 1", [False, True], [0, 1.0]])
def test_a_sweep_compares_both_truths(values: Any) -> None:
    model = bondgraph.load(
        "model T {\n  parameter stiff = true\n  output x = 1 if stiff else 0\n  experiment e { simulate 0 .. 1 s }\n}\n"
    )
    assert [p.run.final("x") for p in model.sweep({"stiff": values}).points] == [0, 1]
    with pytest.raises(UsageError, match="it can be false, true"):
        model.sweep({"stiff": [0, 0.5]})


@pytest.mark.parametrize("first", [1.0, "1 [N/m]"])
def test_a_name_that_is_set_twice_is_refused(first: str | float) -> None:
    """Spaces do not make it another quantity: the last one counted."""
    model = bondgraph.load(LOSSY)
    for call in (model.simulate, model.modes):
        with pytest.raises(UsageError, match="`k` is set twice"):
            call(settings={"k": first, " k": "3 [N/m]"})
    with pytest.raises(bondgraph.CompilationFailed, match="it is not a number"):
        model.simulate(settings={"k": float("nan")})
    result = model.simulate(to=1, points=3)
    for copied in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        assert copied.simulate(to=1, points=3).values.tolist() == result.values.tolist()
