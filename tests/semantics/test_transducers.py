"""Transformers and gyrators of many ports: some equations are given, power gives the transposed ones, for any directions of the arrows."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import bondgraph
from tests.compiling import Running, compiled, mistake


def lever(law: str, arrows: tuple[bool, bool, bool], kind: str = "TF") -> str:
    """Two masses and a spring on the ports a, b, c; an arrow goes into the transducer where it is True."""
    a, b, c = (
        f"{x} -> t.{p}" if into else f"t.{p} -> {x}" for x, p, into in zip(("l", "r", "m"), "abc", arrows, strict=True)
    )
    return f"""model A {{
      parameter n = 0.25
      {kind} t(a: translation, b: translation, c: translation) : {law}
      1 l, r, m
      I one : p = 1 kg*v
      I two : p = 2 kg*v
      C k : F = 3 [N/m]*x
      l -> one
      r -> two
      m -> k
      {a}
      {b}
      {c}
      output va = t.a.v, vb = t.b.v, vc = t.c.v, Fa = t.a.F, Fb = t.b.F, Fc = t.c.F
    }}
    """


@pytest.mark.parametrize("arrows", list(itertools.product((True, False), repeat=3)))
@pytest.mark.parametrize(
    "law", ["c.v = n*a.v + 2*b.v", "c.F = n*a.F - 3*b.F", "a.F = n*c.F, b.F = 2*c.F", "a.v = n*c.v, b.v = 2*c.v"]
)
def test_what_is_given_holds_and_power_is_kept(law: str, arrows: tuple[bool, bool, bool]) -> None:
    found = Running(compiled(lever(law, arrows), everything=True))
    rng = np.random.default_rng(1)
    state = {name: float(x) for name, x in zip(found.program.states.names, rng.normal(size=9), strict=False)}
    values = {k: float(v) for k, v in found.outputs(state).items()}
    power = sum((1 if into else -1) * values[f"F{p}"] * values[f"v{p}"] for p, into in zip("abc", arrows, strict=True))
    assert power == pytest.approx(0, abs=1e-13)
    scope = {"n": 0.25} | {p: p for p in "abc"}
    for equation in law.split(", "):
        left, right = equation.split(" = ")
        port, letter = left.split(".")
        total = 0.0
        for term in right.replace("- ", "+ -").split(" + "):
            factor, variable = term.split("*")
            number = scope[factor] if factor in scope else float(factor)
            total += float(number) * values[f"{variable.split('.')[1]}{variable.split('.')[0]}"]
        assert values[f"{letter}{port}"] == pytest.approx(total, abs=1e-13)


def test_a_gyrator_of_three_ports() -> None:
    """Two coils on one shaft: M = K1 i1 + K2 i2, so u1 = K1 omega and u2 = K2 omega."""
    text = """model A {
      GY motor(one: electric, two: electric, shaft: rotation) : shaft.M = 2 [N*m/A]*one.i + 3 [N*m/A]*two.i
      Sf i1 : i = 5 A
      Sf i2 : i = 7 A
      1 rotor
      I inertia : L = 4 [kg*m^2]*omega { start omega = 11 [rad/s] }
      i1 -> motor.one
      i2 -> motor.two
      motor.shaft -> rotor -> inertia
      output u1 = motor.one.u, u2 = motor.two.u, M = motor.shaft.M
    }
    """
    found = Running(compiled(text, everything=True)).outputs({"inertia.L": 44.0})
    assert found == pytest.approx({"u1": 22.0, "u2": 33.0, "M": 31.0})


def test_modulated_and_with_two_named_ports() -> None:
    """v = r(t) omega with named ports is what the sides 1 and 2 say: the same motion."""
    parts = "  1 wheel : rotation\n  1 cart : translation\n  I j : L = 1 [kg*m^2]*omega\n  I m : p = 2 kg*v\n  C k : F = 3 [N/m]*x { start x = 1 m }\n  cart -> m, k\n  wheel -> j\n"
    sides = (
        "model A {\n" + parts + "  MTF t : v2 = (1 + time/1 s)*1 m*omega1\n  wheel -> t -> cart\n  output v = m.v\n}\n"
    )
    named = (
        "model A {\n"
        + parts
        + "  MTF t(a: rotation, b: translation) : b.v = (1 + time/1 s)*1 m*a.omega\n  wheel -> t.a\n  t.b -> cart\n  output v = m.v\n}\n"
    )
    one, other = (bondgraph.load(t).simulate(to=2, points=5, rtol=1e-9) for t in (sides, named))
    assert np.abs(one["v"]).max() > 0.1 and other["v"] == pytest.approx(one["v"], abs=1e-12)


@pytest.mark.parametrize(
    ("law", "told"),
    [
        ("c.v = n*a.F*1 [m/(N*s)] + b.v", "flows by flows"),
        ("c.v = a.v*b.v*1 [s/m]", "not linear"),
        ("c.v = a.v + b.v + 1 [m/s]", "does not vanish"),
        ("c.v = a.v + c.v, b.v = a.v", "reads a port that it gives"),
        ("c.v = a.v", "leaves out"),
        ("c.v = a.v, b.F = a.F", "efforts and flows"),
        ("2*c.v = a.v + b.v", "on the left"),
    ],
)
def test_wrong_laws(law: str, told: str) -> None:
    found = mistake(lever(law, (True, True, False)), "BG119")
    assert told in found.sentence and "`t`" in found.sentence and found.help


def test_every_port_has_a_bond() -> None:
    text = lever("c.v = a.v + b.v", (True, True, False)).replace("t.c -> m\n", "\n")
    assert "`t.c`" in mistake(text.replace("m -> k", "Se s : F = 1 N\n      s -> m -> k"), "BG121").sentence
