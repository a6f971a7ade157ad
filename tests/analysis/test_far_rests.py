"""Rests far from the start, and models without any: what a drift makes large hides nothing that drives it."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from compiler.api import Source, scene_of
from tests.compiling import LIBRARY, MODELS
from tests.second_opinion.scales import in_other_units

OTHER = ({}, {"length": -6, "mass": -12, "time": -4, "charge": -10}, {"length": 4, "mass": 6, "time": 4, "charge": 6})


def row(count: int, drag: str, k: float, r: float, push: tuple[float, float] = (1.0, 0.0), masses: float = 1.0) -> str:
    """Masses joined by springs and dampers, pushed at both ends; the last has a drag."""
    lines = [f"Se first : F = {push[0]!r} N", f"Se last : F = {push[1]!r} N", f"last -> s{count - 1}"]
    for i in range(count):
        lines += [f"1 s{i} : translation", f"I m{i} : p = {masses**i * (1 + i)!r} kg*v", f"s{i} -> m{i}"]
    for i in range(count - 1):
        lines += [f"C c{i} : F = {k} [N/m]*x", f"R d{i} : F = {r} [N*s/m]*v", f"0 j{i} : translation"]
        lines += [f"s{i} -> j{i} -> s{i + 1}", f"j{i} -> 1(c{i}, d{i})"]
    lines += [f"R drag : {drag}", f"s{count - 1} -> drag"] if drag else []
    return "\n  ".join(["model M {", "first -> s0", *lines, "output y = m0.v, T = c0.F" if count > 1 else "output y = m0.v\n}"]) + ("\n}" if count > 1 else "")  # fmt: skip


ROPE = """import Rope from mechanics
model M {{
  Se w1 : F = 2 kg*9.81 [m/s^2]
  Se w2 : F = {1} kg*9.81 [m/s^2]
  I m1 : p = 2 kg*v
  I m2 : p = {1} kg*v
  Rope part {{ length = 0, x_0 = 13.08e-5 m, r = {0} N*s/m }}
  w1 -> 1(m1) -> part.a
  w2 -> 1(m2) -> part.b
  output y = part.pull
}}"""
LADDER = """model M {
  Sf drive : i = 1 A
  C c1 : u = q/1 [F]
  C c2 : u = q/2 [F]
  R wire : u = 1e-6 ohm*i
  0 j1 : electric
  0 j2 : electric
  drive -> j1 -> c1
  j1 -> 1(wire) -> j2 -> c2
  output y = c1.u
}"""
GEARED = """model M {
  Se drive : M = 1 N*m
  I rotor : L = 1e-9 [kg*m^2]*omega
  I body : p = 1 kg*v
  TF drum : omega1 = 10 [1/m]*v2
  C rope : F = 1e6 [N/m]*x
  R loss : F = 100 [N*s/m]*v
  0 j : translation
  1 s : translation
  drive -> 1(rotor) -> drum -> j -> s -> body
  j -> 1(rope, loss)
  output y = body.v
}"""
LEAK = "model M {{\n  Sf drive : i = 1 A\n  C c : u = q/1 [F]\n  R leak : i = {0} [A/V]*u\n  drive -> 0(c, leak)\n  output y = c.u\n}}"
WHEEL = "model M {{\n  Se drive : M = 1 N*m\n  I w : L = 1 [kg*m^2]*omega\n  R loss : M = {0} [N*m*s]*omega\n  drive -> 1(w, loss)\n  output y = w.omega\n}}"
SATURATED = "F = 0.5 N*v/(1 [m/s] + abs(v))"
NONE = {
    **{f"rope, r = {r}": ROPE.format(r, 1) for r in ("1e-3", "10", "1e5", "1e7")},
    **{f"pair, {k}, {r}": row(2, "", k, r) for k, r in ((1e5, 10), (1e9, 1e6), (1e-3, 1e-6), (1.0, 1e9), (1e5, 0.0))},
    **{f"light one, {m}": row(2, "", 1e5, 10, masses=m) for m in (1e-9, 1e9)},
    **{f"nearly, {p}": row(2, "", 1e5, 10, (1.0, -p)) for p in (1.001, 1.0000001)},
    "three": row(3, "", 1e5, 10), "six, soft": row(6, "", 1e-3, 1), "a drag that saturates": row(1, SATURATED, 0, 0),
    "free": row(1, "", 0, 0), "ladder": LADDER, "geared": GEARED,
}  # fmt: skip
FAR = {
    "rope": (ROPE.format(10, 2), "y", 19.62), "held from both sides": (row(2, "", 1e5, 10, (1.0, -1.0)), "T", 1.0),
    **{f"leak {g}": (LEAK.format(g), "y", 1 / g) for g in (1e-12, 1e-20, 1e15)},
    **{f"wheel {b}": (WHEEL.format(b), "y", 1 / b) for b in (1e-9, 1e6)},
    **{f"cubic {r}": (row(1, f"F = {r} [N*s^3/m^3]*v^3", 0, 0), "y", r ** (-1 / 3)) for r in (1e-20, 1e-3, 1e6, 1e15)},
    **{f"{n} and a drag of {b}": (row(n, f"F = {b} [N*s/m]*v", 1e5, 10), "y", 1 / b) for n, b in ((2, 1e-9), (3, 1e-6), (6, 1e-9))},
    "six, cubic": (row(6, "F = 1e-12 [N*s^3/m^3]*v^3", 1e5, 10), "y", 1e4),
}  # fmt: skip


def rest(text: str, output: str, powers: dict[str, int]) -> float:
    """The output at rest, in SI, of a model in other units."""
    changed, own = in_other_units(scene_of(Source("m", text), LIBRARY, (None, None), None, {}).text, powers)
    found = bondgraph.load(changed, model="M").equilibrium()
    return found[output] / own.of_unit(found.units[output])


@pytest.mark.few(10)
@pytest.mark.parametrize("name", NONE)
def test_nothing_that_is_driven_for_ever_rests(name: str) -> None:
    for powers in OTHER[: 1 + len(name) % 3]:
        with pytest.raises(RunFailed, match="no equilibrium was found"):
            rest(NONE[name], "y", powers)


@pytest.mark.parametrize("name", FAR)
def test_a_far_rest_is_found(name: str) -> None:
    text, output, truth = FAR[name]
    for powers in OTHER:
        assert rest(text, output, powers) == pytest.approx(truth, rel=1e-8)


@pytest.mark.parametrize("settings", [{}, {"round": 1.0}, {"round": -5.0}, {"speed": 30.0}])
def test_a_rotor_that_nothing_stops_has_no_rest(settings: dict[str, float]) -> None:
    """Its angle went on to 1e17 rad, where the search lost it: the rest that was told had other speeds in other units."""
    text = (MODELS / "gyroscope.bg").read_text(encoding="utf-8")
    for powers in OTHER:
        changed, own = in_other_units(text, powers)
        with pytest.raises(RunFailed, match=r"`stand\.axle\.phi` turns for ever"):
            bondgraph.load(changed).equilibrium(settings={k: v * own.of_unit("1/s") for k, v in settings.items()})


@pytest.mark.parametrize("stiffness", [1.0, 1e-6, 1e-12, 1e-15])
def test_a_soft_spring_turns_far(stiffness: float) -> None:
    """An angle of 1e15 rad, which a spring restores, is a rest."""
    spring = WHEEL.format(1.0).replace(
        "drive -> 1(w,", f"C spring : M = {stiffness} [N*m]*phi\n  drive -> 1(w, spring,"
    )
    assert rest(spring.replace("y = w.omega", "y = spring.phi"), "y", {}) == pytest.approx(1 / stiffness, rel=1e-9)


def test_a_large_model_has_its_slow_rest() -> None:
    """Of 239 states a drag of 1e-6 N s/m was lost beside 1e5 N/m: 1.7 % off."""
    assert rest(row(120, "F = 1e-6 [N*s/m]*v", 1e5, 10), "y", {}) == pytest.approx(1e6, rel=1e-6)


def test_a_linear_model_that_runs_away_has_its_rest() -> None:
    """One step of Newton's method from the start, beside numpy; where the matrix is singular or something drifts there is none."""
    row, random = " signal x{0} = integral({1}, 0)\n output y{0} = x{0}\n", np.random.default_rng(3)
    for count in (1, 2, 4):
        A, b = random.standard_normal((count, count)) + np.eye(count), random.standard_normal(count)
        sums = [" + ".join([*(f"({A[i, j]:.17g})*x{j}" for j in range(count)), f"({b[i]:.17g})"]) for i in range(count)]
        text = "plain model A {\n" + "".join(row.format(i, sums[i]) for i in range(count)) + "}"
        found = bondgraph.load(text).equilibrium()
        np.testing.assert_allclose(list(found.outputs.values()), -np.linalg.solve(A, b), rtol=1e-12)
        assert found.verdict.stable is False
    for rates in ("x - y, 1", "x + 1, x + 2"):
        first, second = rates.split(", ")
        with pytest.raises(bondgraph.RunFailed):
            bondgraph.load(
                f"plain model A {{ signal x = integral({first}, 0)\n signal y = integral({second}, 0)\n output o = y }}"
            ).equilibrium()


TABLE = "monotone(q, (0.636, 0.655, 1.476, 1.519, 1.979), (-1.313, -0.204, -0.154, 2.56, 2.85))"


@pytest.mark.parametrize("law", [TABLE, "min(max(0.06*q, 66*q - 66), 2.9)"])
def test_a_law_that_is_straight_beyond_an_end_is_no_stair_of_rounding(law: str) -> None:
    """The way of a correction led beyond, where few rates differ, and the start, which nothing holds, was told as a stable rest."""
    model = bondgraph.load(
        f"plain model A {{ parameter x0 = 0.3\n Se s : e = 0.607\n C c : e = {law} {{ start q = x0 }}\n R r : e = f\n I m : p = f\n s -> 1(c, r, m)\n output z = c.e }}"
    )
    for start in (0.3, 0.4, 0.8, 0.933, 0.94):
        if "monotone" in law and start < 0.7:
            continue
        try:
            found = model.equilibrium(settings={"x0": start})
        except RunFailed:
            continue
        assert found["z"] == pytest.approx(0.607, rel=1e-6)
