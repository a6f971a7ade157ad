"""Storages in derivative form: the physics of their constraints, from masses on a lever to a position-dependent ratio."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from tests.compiling import Running, compiled, mistake, refused


def running(text: str) -> Running:
    return Running(compiled(text, everything=True))


def test_two_masses_on_one_flow() -> None:
    """F = (m1 + m2) a."""
    found = running(
        "model A {\n  1 a\n  I m : p = 2 kg*v\n  I n : p = 3 kg*v\n  Se s : F = 10 N\n  s -> a -> m, n\n  output v = m.v, pn = n.p, Fn = n.F\n}\n"
    )
    assert found.program.states.names == ("m.p",)
    assert found.rates() == {"m.p": pytest.approx(4.0, rel=1e-15)}
    assert found.outputs({"m.p": 8.0}) == pytest.approx({"v": 4.0, "pn": 12.0, "Fn": 6.0}, rel=1e-15)


def test_masses_on_a_lever() -> None:
    """I - TF - I: v1 = 3 v2, so the second mass weighs a ninth; its momentum and force follow."""
    text = "model A {\n  Se s : F = 10 N\n  1 a, b : translation\n  TF lever : v1 = 3*v2\n  I m : p = 2 kg*v\n  I n : p = 9 kg*v\n  C k : F = 4 [N/m]*x\n  s -> a -> m, lever\n  lever -> b -> n, k\n  output v2 = b.v, Fn = n.F, Fm = m.F\n}\n"
    found = running(text)
    (state,) = (n for n in found.program.states.names if n.endswith(".p"))
    assert state == "m.p"
    x, p = 0.5, 6.0
    a1 = (10 - 4 * x / 3) / (2 + 9 / 9)
    assert found.rates({"m.p": p, "k.x": x}) == pytest.approx({"m.p": 2 * a1, "k.x": p / 2 / 3}, rel=1e-14)
    assert found.outputs({"m.p": p, "k.x": x}) == pytest.approx({"v2": 1.0, "Fn": 9 * a1 / 3, "Fm": 2 * a1}, rel=1e-14)


def test_three_masses_and_two_gears() -> None:
    text = "model A {\n  Se s : M = 12 [N*m]\n  1 a, b, c : rotation\n  TF g1 : omega1 = 2*omega2\n  TF g2 : omega1 = 5*omega2\n  I i : L = 1 [kg*m^2]*omega\n  I j : L = 8 [kg*m^2]*omega\n  I k : L = 300 [kg*m^2]*omega\n  s -> a -> i, g1\n  g1 -> b -> j, g2\n  g2 -> c -> k\n}\n"
    assert running(text).rates() == {"i.L": pytest.approx(12 / (1 + 8 / 4 + 300 / 100), rel=1e-14)}


def test_capacitors_in_parallel() -> None:
    """C || C behind a resistor: one charge, two currents that split by capacitance."""
    text = "model A {\n  Se s : u = 9 V\n  0 a\n  R r : u = 3 ohm*i\n  C c : u = q/2 F\n  C d : u = q/4 F\n  s -> 1(r) -> a -> c, d\n  output ic = c.i, id = d.i, qd = d.q\n}\n"
    found = running(text)
    assert found.program.states.names == ("c.q",)
    i = (9 - 1.5) / 3
    assert found.rates({"c.q": 3.0}) == {"c.q": pytest.approx(i * 2 / 6, rel=1e-14)}
    assert found.outputs({"c.q": 3.0}) == pytest.approx({"ic": i / 3, "id": i * 2 / 3, "qd": 6.0}, rel=1e-14)


def test_capacitors_in_series_through_a_gyrator() -> None:
    """An inertia behind a gyrator is a capacitance; beside another one it depends on it."""
    text = "model A {\n  Se s : u = 9 V\n  1 m\n  0 a\n  R r : u = 3 ohm*i\n  C c : u = q/2 F\n  GY g : u1 = 2 [V*s]*omega2\n  I j : L = 8 [kg*m^2]*omega\n  s -> 1(r) -> a -> c, m\n  m -> g -> j\n}\n"
    found = running(text)
    assert len(found.program.states.names) == 1
    ((state, rate),) = found.rates({found.program.states.names[0]: 0.0}).items()
    total = 3.0 / (1 + 8 / 2**2 / 2)  # the current divides between 2 F and 8/4 F
    assert rate == pytest.approx(total if state == "c.q" else 2 * 3.0 / 2, rel=1e-13)


def test_a_nonlinear_storage_in_derivative_form() -> None:
    """q = C(u) u beside a linear capacitance: the differential capacitance dq/du counts."""
    text = "model A {\n  Sf s : i = 6 A\n  0 a\n  C c : u = q/2 F\n  C d : q = 1 F*u + 1 [F/V^2]*u^3 { prefer = derivative }\n  s -> a -> c, d\n  output id = d.i\n}\n"
    found = running(text)
    assert found.program.states.names == ("c.q",)
    u = 1.5
    slope = 1 + 3 * u * u
    assert found.rates({"c.q": 2 * u})["c.q"] == pytest.approx(6 * 2 / (2 + slope), rel=1e-13)
    assert found.outputs({"c.q": 2 * u})["id"] == pytest.approx(6 * slope / (2 + slope), rel=1e-13)


def test_a_ratio_that_depends_on_position() -> None:
    """MTF v2 = n(x) v1: the inertia of the far mass is n^2 m, and its change with x gives a force of its own.

    From Lagrange: (m1 + n^2 m2) v' = F - n n' m2 v^2 with n = 1 + 2 x, v the first velocity.
    """
    text = "model A {\n  Se s : F = 10 N\n  1 a, b : translation\n  MTF crank : v2 = (1 + 2*k.x/1 m)*v1\n  I m : p = 2 kg*v\n  I n : p = 3 kg*v\n  C k : F = 0.5 [N/m]*x\n  s -> a -> m, k, crank\n  crank -> b -> n\n  output v2 = b.v\n}\n"
    found = running(text)
    assert set(found.program.states.names) == {"m.p", "k.x"}
    x, v = 0.4, 1.7
    n, slope = 1 + 2 * x, 2.0
    acceleration = (10 - 0.5 * x - 3 * n * slope * v * v) / (2 + 3 * n * n)
    assert found.rates({"m.p": 2 * v, "k.x": x}) == pytest.approx({"m.p": 2 * acceleration, "k.x": v}, rel=1e-13)
    assert found.outputs({"m.p": 2 * v, "k.x": x})["v2"] == pytest.approx(n * v, rel=1e-14)


def test_energy_is_kept_by_it() -> None:
    """The same crank without force: kinetic and stored energy change by nothing."""
    text = "model A {\n  1 a, b : translation\n  MTF crank : v2 = (1 + 2*k.x/1 m)*v1\n  I m : p = 2 kg*v\n  I n : p = 3 kg*v\n  C k : F = 5 [N/m]*x\n  a -> m, k, crank\n  crank -> b -> n\n  output E = 1/2*m.p*m.v + 1/2*n.p*n.v + 1/2*5 [N/m]*k.x^2\n}\n"
    found = running(text)
    x, v, h = 0.4, 1.7, 1e-6
    state = {"m.p": 2 * v, "k.x": x}
    rates = found.rates(state)
    ahead, behind = ({k: s + sign * h * rates[k] for k, s in state.items()} for sign in (1, -1))
    assert (found.outputs(ahead)["E"] - found.outputs(behind)["E"]) / (2 * h) == pytest.approx(
        0.0, abs=1e-8 * found.outputs(state)["E"]
    )


def test_the_jacobian_sees_through_it() -> None:
    text = "model A {\n  Se s : F = 10 N\n  1 a, b : translation\n  MTF crank : v2 = (1 + 2*k.x/1 m)*v1\n  I m : p = 2 kg*v\n  I n : p = 3 kg*v\n  C k : F = 0.5 [N/m]*x\n  s -> a -> m, k, crank\n  crank -> b -> n\n}\n"
    found = running(text)
    names = found.program.states.names
    state = dict(zip(names, (3.4, 0.4), strict=True))
    exact = np.asarray(found.program.jacobian(*found.arguments(0.0, state, None)))
    for column, name in enumerate(names):
        h = 1e-6
        ahead, behind = (found.rates({**state, name: state[name] + s * h}) for s in (1, -1))
        assert exact[:, column].tolist() == pytest.approx(
            [(ahead[n] - behind[n]) / (2 * h) for n in names], rel=1e-7, abs=1e-7
        )


def test_driven_by_a_source_of_flow() -> None:
    """A mass behind a resistor is free; right at a source of constant flow its force is zero."""
    text = "model A {\n  Sf s : v = 2 [m/s]\n  1 a\n  I m : p = 3 kg*v\n  C k : F = 4 [N/m]*x\n  s -> a -> m, k\n  output F = m.F, p = m.p\n}\n"
    assert running(text).outputs() == {"F": 0.0, "p": 6.0}


@pytest.mark.parametrize(
    ("source", "storage", "junction", "effort", "flow"),
    [
        ("Se s : u = 1 V*sin(time/1 s)", "C c : u = q/2 F", "0", np.sin, lambda t: 2 * np.cos(t)),
        ("Sf s : i = 1 A*(time/1 s)^2", "I c : lambda = 3 H*i", "1", lambda t: 6 * t, lambda t: t**2),
        (
            "Se s : u = 1 V*exp(time/1 s)",
            "C c : q = 1 F*u + 1 [C/V^3]*u^3",
            "0",
            np.exp,
            lambda t: np.exp(t) + 3 * np.exp(3 * t),
        ),
    ],
)
def test_forced_by_a_signal(source: str, storage: str, junction: str, effort: object, flow: object) -> None:
    """Index 2: the flow is the exact derivative of the author's signal, and the source supplies the energy."""
    text = f"model A {{\n  {source}\n  {junction} a : electric\n  {storage}\n  s -> a -> c\n  output e = c.e, f = c.f\n}}\n"
    space = compiled(text, everything=True).state_space
    assert space.index == 2 and not space.states and space.dependent == ("c",)
    found = bondgraph.load(text).simulate(to=2, points=9, energy=True)
    assert callable(effort) and callable(flow)
    assert found["e"] == pytest.approx(effort(found.time), rel=1e-13, abs=1e-13)
    assert found["f"] == pytest.approx(flow(found.time), rel=1e-13, abs=1e-13)
    assert abs(found.energy.residual) < 1e-9 * max(1.0, found.energy.stored)


def test_twice_differentiated() -> None:
    """Index 3: a voltage on a capacitor, whose current drives a second voltage on another one: i2 = C2 K C1 u''."""
    text = "model A {\n  Se s : u = 1 V*sin(3*time/1 s)\n  MSe t : u = 7 ohm*c1.i\n  C c1 : q = 2 F*u\n  C c2 : q = 5 F*u\n  s -> c1\n  t -> c2\n  output i1 = c1.i, i2 = c2.i\n}\n"
    assert compiled(text).state_space.index == 3
    found = bondgraph.load(text).simulate(to=2, points=9)
    assert found["i1"] == pytest.approx(6 * np.cos(3 * found.time), rel=1e-13)
    assert found["i2"] == pytest.approx(-5 * 7 * 18 * np.sin(3 * found.time), rel=1e-12)


def test_a_jump_on_a_storage_is_an_impulse() -> None:
    text = (
        "model A {\n  Se s : u = 1 V*step(time - 1 s)\n  0 a\n  C c : u = q/1 F\n  s -> a -> c\n  output y = c.u\n}\n"
    )
    with pytest.raises(RunFailed, match="impulse") as told:
        bondgraph.load(text).simulate(to=2)
    assert "t = 1 s" in str(told.value)


def test_an_input_on_a_storage_has_no_derivative() -> None:
    """A program that gets the voltage from outside cannot know its slope; with an expression of time it does."""
    text = "model A {\n  input drive = 1 V\n  MSe s : u = drive\n  0 a : electric\n  C c : u = q/1 F\n  s -> a -> c\n  output y = c.i\n}\n"
    assert refused(compiled(text, free=("*",)), "BG503").help
    found = bondgraph.load(text).simulate(settings={"drive": "2 V*time/1 s"}, to=1, points=2)
    assert found.final("y") == 2.0


def test_without_end() -> None:
    """A capacitor that must be in derivative form behind a resistor alone is determined by nothing."""
    text = "model A {\n  R r : u = 3 ohm*i\n  C c : q = 1 F*u { require = derivative }\n  r -> c\n  output y = c.u\n}\n".replace(
        "r -> c", "0 a\n  a -> r, c"
    )
    assert "`c`" in mistake(text, "BG504").sentence


class TestStarts:
    TWO = "model A {\n  1 a\n  I m : p = 2 kg*v {%s}\n  I n : p = 3 kg*v {%s}\n  Se s : F = 0 N\n  s -> a -> m, n\n  output v = a.v\n}\n"

    @pytest.mark.parametrize(
        ("m", "n"), [("start v = 4 [m/s]", ""), ("", "start v = 4 [m/s]"), ("start v = 4 [m/s]", "start p = 12 [N*s]")]
    )
    def test_of_dependent_storages(self, m: str, n: str) -> None:
        """A start on the storage that depends is as good as one on the other; both may be said if they agree."""
        assert bondgraph.load(self.TWO % (m, n)).simulate(to=1, points=2)["v"] == pytest.approx([4, 4], rel=1e-12)

    def test_contradictions_are_named(self) -> None:
        with pytest.raises(RunFailed, match="cannot hold") as told:
            bondgraph.load(self.TWO % ("start v = 4 [m/s]", "start v = 5 [m/s]")).simulate(to=1)
        assert "`n`" in str(told.value) and "`m.p`" in str(told.value)

    def test_of_an_effort_that_the_law_does_not_give_back(self) -> None:
        """`start F` of one port of a field: the displacement of that port gives it, and the other one stays zero."""
        text = "model A {\n  C field(a: translation, b: translation) : energy = (a^2 + b^2 + a*b)*1 [N/m] { start a.F = 5 N }\n  1 l, r\n  I m : p = 1 kg*v\n  I n : p = 1 kg*v\n  l -> m, field.a\n  r -> n, field.b\n  output F = field.a.F, a = field.a, b = field.b\n}\n"
        found = bondgraph.load(text).simulate(to=1e-9, points=2)
        assert [found[n][0] for n in "Fab"] == pytest.approx([5, 2.5, 0], rel=1e-9)


def test_fields_of_mixed_causality() -> None:
    """One port of the field is driven in flow (derivative form would be effort): Legendre's transform of its energy."""
    text = "model A {\n  C field(a: translation, b: translation) : energy = (a^2 + b^2 + a*b)*1 [N/m]\n  Se s : F = 3 N*sin(time/1 s)\n  1 l\n  I m : p = 1 kg*v\n  s -> field.a\n  l -> m, field.b\n  output xa = field.a, Fb = field.b.F, xb = field.b, va = field.a.v\n}\n"
    found = bondgraph.load(text).simulate(to=2, points=9, rtol=1e-9, energy=True)
    a, b = found["xa"], found["xb"]
    assert 2 * a + b == pytest.approx(3 * np.sin(found.time), abs=1e-12)
    assert found["Fb"] == pytest.approx(2 * b + a, abs=1e-12)
    # b'' = -(3/2) b - (3/2) sin t, from rest: b = 3 (sqrt(2/3) sin(sqrt(3/2) t) - sin t)
    exact = 3 * (np.sqrt(2 / 3) * np.sin(np.sqrt(1.5) * found.time) - np.sin(found.time))
    assert b == pytest.approx(exact, abs=1e-8)
    assert abs(found.energy.residual) < 1e-7


def test_a_storage_behind_an_algebraic_loop() -> None:
    """A capacitance at a node whose voltage is an algebraic loop through resistors alone: computed, or refused by name."""
    text = "model A {\n  Se s : u = 6 V\n  0 node, other\n  R r : u = 2 ohm*i\n  R t : u = 3 ohm*i\n  TF ideal : u1 = 2*u2\n  C c : u = q/5 F\n  C d : u = q/7 F\n  s -> 1(r) -> node -> t, c, ideal\n  ideal -> other -> d\n}\n"
    found = running(text)
    (state,) = found.program.states.names
    u = 1.5
    rate = ((6 - u) / 2 - u / 3) / (5 + 7 / 4)
    assert found.rates({state: 5 * u if state == "c.q" else 7 * u / 2})[state] == pytest.approx(
        5 * rate if state == "c.q" else 7 * rate / 2, rel=1e-13
    )
