"""Small graphs of every structure, with numbers derived by hand; each has its derivation."""

from __future__ import annotations

from math import cos, exp, expm1, log, pi, sin

import pytest

import bondgraph
from tests.compiling import compiled, mistakes


def final(text: str, to: float, rtol: float = 1e-10) -> dict[str, float]:
    """Outputs at the end of a run."""
    found = bondgraph.load("model A {\n" + text + "\n}\n").simulate(to=to, points=3, rtol=rtol)
    return {c.name: found.final(c.name) for c in found.columns}


class TestDependentStorages:
    def test_two_masses_on_a_lever_with_a_spring(self) -> None:
        """I - TF - I: v1 = 2 v2, so at side 2 lies 2^2*1 kg + 1 kg = 5 kg; w^2 = 20/5; from rest at x = 1: x = cos 2t."""
        text = """  1 a, b : translation
  TF lever : v1 = 2*v2
  I m : p = 1 kg*v
  I n : p = 1 kg*v
  C k : F = 20 [N/m]*x { start x = 1 m }
  a -> m
  a -> lever -> b -> n, k
  output x = k.x, v1 = a.v, F = n.F"""
        found = final(text, 1.0)
        # n.F = 1 kg * x'' = -4 cos 2t, and v1 = 2 x' = -4 sin 2t
        assert found == pytest.approx({"x": cos(2), "v1": -4 * sin(2), "F": -4 * cos(2)}, rel=1e-8)

    def test_linear_capacitors_in_parallel(self) -> None:
        """2 F and 4 F discharge together over 3 ohm: one time constant of 18 s; the charge divides 1 : 2."""
        text = """  0 a : electric
  C c : u = q/2 F { start u = 9 V }
  C d : u = q/4 F
  R r : u = 3 ohm*i
  a -> c, d, r
  output u = r.u, q_c = c.q, q_d = d.q"""
        u = 9 * exp(-1)
        assert final(text, 18.0) == pytest.approx({"u": u, "q_c": 2 * u, "q_d": 4 * u}, rel=1e-8)

    def test_a_nonlinear_capacitor_in_parallel(self) -> None:
        """2 u + u^3 = 3 t: u = 1 at 1 s, 2 at 4 s, 3 at 11 s. At 4 s du/dt = 3/(2 + 3*4), so 12 u^2/4 of it flows into the second."""
        text = """  Sf s : i = 3 A
  0 a
  C c : u = q/2 F
  C d : q = 1 [C/V^3]*u^3
  s -> a -> c, d
  output u = c.u, i_d = d.i"""
        assert final(text, 1.0)["u"] == pytest.approx(1, rel=1e-8)
        assert final(text, 4.0) == pytest.approx({"u": 2, "i_d": 12 * 3 / 14}, rel=1e-8)
        assert final(text, 11.0)["u"] == pytest.approx(3, rel=1e-8)

    def test_an_inertia_behind_a_gyrator_beside_a_capacitor(self) -> None:
        """J behind K is a capacitance J/K^2 = 8/4 F; with 1 F beside it and 2 ohm the time constant is 6 s."""
        text = """  Se s : u = 12 V
  R r : u = 2 ohm*i
  0 a
  C c : u = q/1 F
  GY g : u1 = 2 [V*s]*omega2
  I j : L = 8 [kg*m^2]*omega
  s -> 1(r) -> a -> c
  a -> g -> j
  output u = a.u, omega = j.omega"""
        u = -12 * expm1(-1)
        assert final(text, 6.0) == pytest.approx({"u": u, "omega": u / 2}, rel=1e-8)


class TestResistors:
    def test_bridge(self) -> None:
        """Wheatstone, out of balance. Nodes a, b behind 1, 2 and 2, 1 ohm from 7 V to earth, 1 ohm between them:
        (7 - a)/1 = a/2 + (a - b)/1 and (7 - b)/2 = b/1 + (b - a)/1: 2.5 a - b = 7, 2.5 b - a = 3.5: a = 4, b = 3."""
        text = """  Se s : u = 7 V
  0 top, a, b : electric
  R r1, r4, gauge : u = 1 ohm*i
  R r2, r3 : u = 2 ohm*i
  s -> top -> 1(r1) -> a -> r2
  top -> 1(r3) -> b -> r4
  a -> 1(gauge) -> b
  output ua = a.u, i = gauge.i, total = s.i"""
        found = final(text, 1.0)
        assert found == pytest.approx({"ua": 4, "i": 1, "total": 5}, rel=1e-13)

    def test_two_in_series_one_of_them_cubic(self) -> None:
        """2 i + i^3 = 12: i = 2."""
        text = """  Se s : u = 12 V
  R r : u = 2 ohm*i
  R t : u = 1 [V/A^3]*i^3
  s -> 1(r, t)
  output i = r.i, u = t.u"""
        assert final(text, 1.0) == pytest.approx({"i": 2, "u": 8}, rel=1e-13)

    def test_two_in_parallel_on_a_flow(self) -> None:
        """i = u/4 + u^3/8 = 3/2 at u = 2."""
        text = """  Sf s : i = 1.5 A
  R r : u = 4 ohm*i
  R t : i = u^3/(8 [V^3/A])
  s -> 0(r, t)
  output u = r.u, i = t.i"""
        assert final(text, 1.0) == pytest.approx({"u": 2, "i": 1}, rel=1e-13)

    def test_nothing_but_time(self) -> None:
        """No storage: outputs follow the source, 6 V sin(pi/6) over 2 + 1 ohm."""
        text = """  Se s : u = 6 V*sin(time/1 s)
  R r : u = 2 ohm*i
  R t : u = 1 ohm*i
  s -> 1(r, t)
  output i = r.i"""
        assert final(text, pi / 6)["i"] == pytest.approx(1, rel=1e-14)


class TestDiodes:
    LAW = "R d : i = 1 A*(exp(u/1 V) - 1)"

    def test_behind_a_resistor(self) -> None:
        """u = 1 V makes i = e - 1; the source that makes it over 2 ohm is 1 + 2 (e - 1)."""
        text = f"""  Se s : u = {1 + 2 * expm1(1)!r} V
  R r : u = 2 ohm*i
  {self.LAW}
  s -> 1(r, d)
  output u = d.u, i = d.i"""
        assert final(text, 1.0) == pytest.approx({"u": 1, "i": expm1(1)}, rel=1e-13)

    def test_empties_a_capacitor(self) -> None:
        """C u' = -I (exp(u/U) - 1): with w = 1 - exp(-u/U), w' = -w I/(C U); so w = w0 exp(-t)."""
        text = f"""  C c : u = q/1 F {{ start u = 3 V }}
  {self.LAW}
  0 a : electric
  a -> c, d
  output u = c.u"""
        w = (1 - exp(-3)) * exp(-2)
        assert final(text, 2.0)["u"] == pytest.approx(-log(1 - w), rel=1e-8)

    def test_a_capacitor_through_a_resistor_and_a_diode(self) -> None:
        """A loop of R and diode on a state: the time from u0 to u1 is the integral of C du/i over v + 2 i(v) = u; with v as the
        variable, du = (1 + 2 e^v) dv: t = int (1 + 2 e^v)/(e^v - 1) dv = [-v + 3 ln(e^v - 1)] from v1 to v0."""
        v0, v1 = 2.0, 0.5
        t = (-v0 + 3 * log(expm1(v0))) - (-v1 + 3 * log(expm1(v1)))
        text = f"""  C c : u = q/1 F {{ start u = {v0 + 2 * expm1(v0)!r} V }}
  R r : u = 2 ohm*i
  {self.LAW}
  0 top : electric
  top -> c, 1(r, d)
  output u = d.u"""
        assert final(text, t)["u"] == pytest.approx(v1, rel=1e-8)


class TestNoSources:
    def test_a_pendulum_of_spring_and_mass(self) -> None:
        """x = sin(w t)/w from v = 1, w^2 = 9."""
        text = """  I m : p = 2 kg*v { start v = 1 [m/s] }
  C k : F = 18 [N/m]*x
  1 a : translation
  a -> m, k
  output x = k.x, v = m.v"""
        assert final(text, 1.0) == pytest.approx({"x": sin(3) / 3, "v": cos(3)}, rel=1e-8)

    def test_no_source_and_no_storage(self) -> None:
        """A loop of two resistors alone is at rest."""
        text = """  1 a : electric
  R r : u = 2 ohm*i
  R t : u = 3 ohm*i + 1 [V/A^3]*i^3
  a -> r, t
  output i = a.i"""
        assert final(text, 1.0)["i"] == pytest.approx(0, abs=1e-30)


class TestPlates:
    """Energy q^2/(2 C(x)), C = eps A/(g - x) with eps A = 8e-18 F m, g = 2 um: C = 4 pF, C' = 2e-6 F/m at x = 0."""

    LAW = "C plates(q: electric, x: translation) : energy = q^2*(2 um - x)/(2*8e-18 [F*m])"

    def test_on_a_voltage(self) -> None:
        """F = -V^2 C'(x)/2. At x = 1 um and 10 V: C = 8 pF, C' = 8e-6 F/m: F = -4e-4 N, q = 80 pC; i = V C' v."""
        text = f"""  Se s : u = 10 V
  {self.LAW}
  Sf pull : v = 1 [um/s]
  s -> plates.q
  pull -> plates.x
  output F = plates.x.F, q = plates.q, i = plates.q.i, x = plates.x"""
        found = final(text, 1.0)
        assert found == pytest.approx({"F": -4e-4, "q": 80e-12, "i": 10 * 8e-6 * 1e-6, "x": 1e-6}, rel=1e-8)

    def test_on_a_charge(self) -> None:
        """F = -q^2/(2 eps A) for every position of the plate: (4e-11)^2/1.6e-17 = 1e-4 N; u = q/C falls from 10 V to 5 V at x = 1 um."""
        text = f"""  Sf s : i = 0 A
  {self.LAW.replace("8e-18 [F*m])", "8e-18 [F*m]) { start q = 40 pC }")}
  Sf pull : v = 1 [um/s]
  s -> plates.q
  pull -> plates.x
  output F = plates.x.F, u = plates.q.u"""
        assert final(text, 1.0) == pytest.approx({"F": -1e-4, "u": 5}, rel=1e-8)

    def test_against_a_spring(self) -> None:
        """k x = V^2 eps A/(2 (g - x)^2); with k = 4e-16/(g/4 (3 g/4)^2) N/m it rests at x = g/4, before it pulls in at g/3."""
        g = 2e-6
        k = 4e-16 / (g / 4 * (0.75 * g) ** 2)
        text = f"""  Se s : u = 10 V
  {self.LAW}
  1 arm : translation
  C spring : F = {k!r} [N/m]*x
  R air : F = 1e-3 [N*s/m]*v
  s -> plates.q
  arm -> plates.x, spring, air
  output x = spring.x, q = plates.q"""
        assert final(text, 1.0) == pytest.approx({"x": g / 4, "q": 10 * 8e-18 / (0.75 * g)}, rel=1e-8)


class TestRefused:
    def told(self, text: str) -> str:
        found = mistakes("model A {\n" + text + "\n}\n")
        assert found and all(d.help for d in found)
        return " ".join(" ".join([d.sentence, d.help, *(text for _, text in d.related())]) for d in found)

    def test_two_sources_of_effort_on_one_junction(self) -> None:
        told = self.told(
            "  Se battery : u = 6 V\n  Se charger : u = 7 V\n  0 node\n  R load : u = 1 ohm*i\n  battery -> node -> load\n  charger -> node\n  output i = load.i"
        )
        assert "`battery`" in told and "`charger`" in told and "`node`" in told

    def test_a_port_without_a_bond(self) -> None:
        told = self.told(
            "  C plates(q: electric, x: translation) : energy = q^2*(1 m - x)/(1 [F*m])\n  Se s : u = 1 V\n  s -> plates.q\n  output q = plates.q"
        )
        assert "`plates.x`" in told

    def test_a_ring_of_junctions_that_nothing_decides(self) -> None:
        """Around 1 - 0 - 1 - 0 a flow may circulate for which there is no equation."""
        told = self.told(
            "  Se s : u = 1 V\n  1 a, d\n  0 b, c\n  R r : u = 1 ohm*i\n  s -> a -> b -> d -> r\n  a -> c -> d\n  output y = d.i"
        )
        assert any(f"`{name}`" in told for name in "abcd")

    def test_two_sources_of_flow_on_one_lever(self) -> None:
        """Sf on both sides of a lever."""
        told = self.told(
            "  Sf left : v = 1 [m/s]\n  Sf right : v = 1 [m/s]\n  TF lever : v1 = 2*v2\n  1 a, b : translation\n  R r : F = 1 [N*s/m]*v\n  left -> a -> lever -> b -> r\n  right -> b\n  output F = lever.F1"
        )
        assert "`left`" in told and "`right`" in told


def test_structure_is_what_it_should_be() -> None:
    """A lever ties one of two masses; a voltage ties a plate's charge; nothing is left for the solver to iterate."""
    space = compiled(
        "model A {\n  Se s : u = 1 V\n  C plates(q: electric, x: translation) : energy = q^2*(1 um - x)/(1e-18 [F*m])\n  I m : p = 1 kg*v\n  R r : F = 1 [N*s/m]*v\n  s -> plates.q\n  1(m, r) -> plates.x\n  output x = plates.x\n}\n",
        everything=True,
    ).state_space
    assert len(space.states) == 2 and space.dependent == ("plates",) and not space.unknowns
