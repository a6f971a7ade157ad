"""Fields given by equations: symmetric ones pass, others are errors; resistors that create energy are noted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bondgraph
from tests.compiling import MODELS, compiled, mistake, mistakes

PUSH = "  Se s : e = 1\n  R w : e = f\n  Se t : e = 2\n  R y : e = f\n"


def field(law: str, kind: str = "C", more: str = "") -> str:
    """A two-port storage between two sources behind resistors."""
    return f"plain model A {{\n{PUSH}{more}  {kind} c(a, b) : {law}\n  s -> 1(w) -> c.a\n  t -> 1(y) -> c.b\n}}\n"


class TestMaxwell:
    @pytest.mark.parametrize(
        ("kind", "law"),
        [
            ("C", "a.e = 3*a + 0.5*b, b.e = 0.5*a + 2*b"),
            ("C", "a = 3*a.e + 0.5*b.e, b = 0.5*a.e + 2*b.e"),  # solved for what is stored
            ("C", "a.e = 3*a + 2*a*b, b.e = a^2 + b"),  # 3/2 a^2 + a^2 b + b^2/2
            ("C", "a.e = b*cos(a*b), b.e = a*cos(a*b)"),  # sin(a b)
            ("C", "a.e = a + b*g, b.e = g*a + 7*b"),  # by a parameter
            ("C", "a.e + b.e = a, a.e - b.e = b"),  # tied: a.e = (a+b)/2, b.e = (a-b)/2
            ("C", "a.e = 0.333333333*b + a, b.e = 0.333333334*a + b"),  # rounded by whoever wrote it
            ("I", "a.f = 3*a + 0.5*b, b.f = 0.5*a + 2*b"),
            ("IC", "a.e = 3*a.q + 0.5*b.p, b.f = 0.5*a.q + 2*b.p"),  # H = 3/2 q^2 + q p/2 + p^2: equal signs
            ("IC", "a.e = a.q + 2*a.q*b.p, b.f = b.p + a.q^2"),
        ],
    )
    def test_fields_with_an_energy(self, kind: str, law: str) -> None:
        assert mistakes(field(law, kind, "  parameter g = 0.25\n" if "g*" in law else "")) == ()

    @pytest.mark.parametrize(
        ("kind", "law", "one", "other"),
        [
            ("C", "a.e = 3*a + 0.5*b, b.e = 0.4*a + 2*b", "0.4", "0.5"),
            ("C", "a.e = 3*a - 0.5*b, b.e = 0.5*a + 2*b", "0.5", "-0.5"),
            ("C", "a = 3*a.e + 0.5*b.e, b = 0.25*a.e + 2*b.e", "-0.0425532", "-0.0851064"),  # the inverse, det 5.875
            ("I", "a.f = 3*a + 0.5*b, b.f = 0.4*a + 2*b", "0.4", "0.5"),
            ("IC", "a.e = 3*a.q + 0.5*b.p, b.f = -0.5*a.q + 2*b.p", "-0.5", "0.5"),
        ],
    )
    def test_fields_without_one(self, kind: str, law: str, one: str, other: str) -> None:
        told = mistake(field(law, kind), "BG405")
        assert f"is {one}," in told.sentence and f"is {other}" in told.sentence
        assert "`c`" in told.sentence and "energy" in told.help

    def test_a_nonlinear_field_is_told_with_the_point(self) -> None:
        """e_a = 2ab + a, e_b = b: slopes 2a and 0; at the point that is named they are so."""
        told = mistake(field("a.e = a + 2*a*b, b.e = b"), "BG405")
        assert "at `c.a` = " in told.sentence and "`c.b` = " in told.sentence
        a = float(told.sentence.split("at `c.a` = ")[1].split(",")[0])
        slopes = {
            float(w.strip(","))
            for w in told.sentence.replace("but", "").split()
            if w.strip(",-").replace(".", "").replace("e-", "").isdigit()
        }
        assert 0.0 in slopes and any(s == pytest.approx(2 * a, rel=1e-2) for s in slopes)

    def test_ports_of_different_size(self) -> None:
        """A plate actuator in SI: charge of pC, gap of um, slopes of 1e5 V/m that must be equal and are not."""
        text = (
            "model A {{\n  parameter area = 1 [mm^2], gap = 2 um, eps = 8.85e-12 [F/m]\n"
            "  Se s : u = 0.2 V\n  R lead : u = 1 kohm*i\n"
            "  C plates(q: electric, x: translation) : q.u = q*(gap - x)/(eps*area), x.F = {factor}*q^2/(eps*area)\n"
            "  I m : p = 5 ug*v\n  s -> 1(lead) -> plates.q\n  1(m) -> plates.x\n}}\n"
        )
        assert mistakes(text.format(factor="-0.5")) == ()
        told = mistake(text.format(factor="-1"), "BG405")
        assert "`plates.q.u` over `plates.x`" in told.sentence and "`plates.x.F` over `plates.q`" in told.sentence

    def test_a_law_that_can_be_solved_neither_way_is_said_to_be_unchecked(self) -> None:
        text = field("a.e + a.e^3 = a + a^3 + b, b.e + b.e^3 = b + b^3 + a")
        (note,) = bondgraph.load(text).certificate.notes
        assert "`c` may create energy" in note and "not checked" in note

    def test_it_holds_for_the_values_of_the_run(self) -> None:
        """Symmetric for the values in the text, not for those that are set."""
        text = field("a.e = 3*a + m*b, b.e = n*a + 2*b", more="  parameter m = 0.5, n = 0.5\n")
        assert mistakes(text) == ()
        with pytest.raises(bondgraph.CompilationFailed, match="BG405"):
            bondgraph.load(text).simulate(settings={"m": 0.6}, to=1)

    @settings(max_examples=40)
    @given(st.integers(2, 4), st.integers(0, 10**6), st.booleans())
    def test_random_matrices(self, n: int, seed: int, broken: bool) -> None:
        rng = np.random.default_rng(seed)
        root = rng.uniform(-1, 1, (n, n))
        matrix = root @ root.T + np.eye(n)
        if broken:
            i, j = rng.permutation(n)[:2]
            matrix[i, j] += 0.01
        names = "abcd"[:n]
        law = ", ".join(
            f"{names[i]}.e = " + " + ".join(f"{matrix[i, j]!r}*{names[j]}" for j in range(n)) for i in range(n)
        )
        law = law.replace("np.float64(", "").replace(")", "")
        lines = [f"  Se s{i} : e = 1\n  R w{i} : e = f\n  s{i} -> 1(w{i}) -> c.{names[i]}\n" for i in range(n)]
        found = mistakes(f"plain model A {{\n{''.join(lines)}  C c({', '.join(names)}) : {law}\n}}\n")
        assert [d.code for d in found] == (["BG405"] if broken else [])


def notes(resistor: str, ports: str = "") -> tuple[str, ...]:
    """Notes of the certificate on a resistor `r` (of two ports, if they are named) between masses."""
    hang = "  1 j\n  j -> m, r\n" if not ports else "  1(m) -> r.a\n  1(n) -> r.b\n  I n : p = 3*f\n"
    text = f"plain model A {{\n  parameter k = 2\n  I m : p = 2*f\n  R r{ports} : {resistor}\n{hang}}}\n"
    return bondgraph.load(text).certificate.notes


class TestPassivity:
    @pytest.mark.parametrize(
        "law", ["e = 2*f", "f = k*e", "e = f^3", "e = 3*f*abs(f)", "f = exp(e/0.026) - 1", "e = tanh(f*100)", "f = sqrt(abs(e))*sign(e)"]
    )  # fmt: skip
    def test_resistors_that_only_take(self, law: str) -> None:
        assert notes(law) == ()

    @pytest.mark.parametrize("law", ["e = -2*f", "f = -k*e", "e = f^3 - k*f", "e = 2*f + 1", "f = e^2", "e = -tanh(f)"])
    def test_resistors_that_give(self, law: str) -> None:
        (note,) = notes(law)
        assert "`r` creates energy" in note

    def test_the_point_is_one(self) -> None:
        """A tunnel diode: the note names a point at which e f < 0 by its law."""
        (note,) = notes("e = f^3 - 2*f")
        values = {
            part.split(" = ")[0].split(".")[-1]: float(part.split(" = ")[1])
            for part in note.split("at ")[1].split(", ")
        }
        assert values["e"] * values["f"] < 0
        assert values["e"] == pytest.approx(values["f"] ** 3 - 2 * values["f"], rel=0.05)

    def test_fields_of_resistors(self) -> None:
        assert notes("a.e = 2*a.f - b.f, b.e = 2*b.f - a.f", "(a, b)") == ()
        (skew,) = notes("a.e = 2*a.f - b.f, b.e = 2*b.f + a.f", "(a, b)")
        assert "`r` gyrates" in skew
        (creates,) = notes("a.e = 2*a.f - 3*b.f, b.e = 2*b.f - 3*a.f", "(a, b)")  # eigenvalues 5 and -1
        assert "`r` creates energy" in creates
        assert len(notes("a.e = 2*a.f - 9*b.f, b.e = 2*b.f", "(a, b)")) == 2  # both
        assert notes("a.e = a.f - b.f, b.e = b.f - a.f", "(a, b)") == ()  # semidefinite: one damper between two

    def test_what_moves_with_the_model_is_not_judged(self) -> None:
        text = "plain model A {\n  I m : p = 2*f\n  C c : e = q\n  MR r : e = c.q*f\n  1 j\n  j -> m, c, r\n}\n"
        assert bondgraph.load(text).certificate.notes == ()

    def test_the_heat_of_a_brake_is_no_energy_from_nothing(self) -> None:
        text = "model A {\n  1 axle : rotation\n  I wheel : L = 0.2 [kg*m^2]*omega\n  RS pad(shaft, heat) : shaft.M = 0.4 [N*m*s]*shaft.omega\n  C disc : T = 293 K*exp(S/500 [J/K])\n  axle -> wheel, pad.shaft\n  pad.heat -> disc\n}\n"
        assert bondgraph.load(text).certificate.notes == ()
        assert "`pad` creates energy" in bondgraph.load(text.replace("0.4", "-0.4")).certificate.notes[0]

    @pytest.mark.parametrize("law", ["f = (e - 293 K)*40 [W/K]", "e = 293 K + f/40 [W/K]"])
    def test_heat_times_temperature_is_no_power(self, law: str) -> None:
        """A wall to air of 293 K, which heats what is colder: the product is negative there, and no energy is made."""
        text = f"model A {{\n  C air : e = 280 K + q/50 [kJ/K]\n  R wall : {law}\n  0 room : pseudothermal\n  room -> air, wall\n}}\n"
        assert bondgraph.load(text).certificate.notes == ()

    def test_a_field_of_heat_has_no_energy_to_keep(self) -> None:
        """Heat that raises the temperature of another port more than the other way round: in `electric` it is refused, BG405."""
        law = "C c(a, b) : a.e = (a.q + 2*b.q)*k, b.e = (b.q + a.q)*k"
        ends = "".join(f"  Sf s{p} : f = 1 [{{unit}}]\n  0 n{p} : {{domain}}\n  s{p} -> n{p} -> c.{p}\n" for p in "ab")
        text = f"model A {{{{\n  parameter k = 1 [{{slope}}]\n  {law}\n{ends}}}}}\n"
        assert mistakes(text.format(unit="W", domain="pseudothermal", slope="K/J")) == ()
        assert [d.code for d in mistakes(text.format(unit="A", domain="electric", slope="V/C"))] == ["BG405"]

    def test_notes_are_printed_where_the_certificate_is(self) -> None:
        text = "plain model A {\n  I m : p = 2*f { start p = 1 }\n  R r : e = -0.1*f\n  1 j\n  j -> m, r\n  output p = m.p\n}\n"
        model = bondgraph.load(text)
        assert "note: `r` creates energy" in model.simulate(to=1, energy=True).summary()
        assert "note: `r` creates energy" in str(model.certificate)

    @pytest.mark.few(25)
    @pytest.mark.parametrize("file", sorted(p.name for p in MODELS.glob("*.bg") if p.name != "mems.bg"))
    def test_what_is_noted_of_the_shipped_models(self, file: str) -> None:
        """Nothing, but for van der Pol's oscillator, which lives on a diode that gives energy at small currents."""
        found = compiled(MODELS / file).certificate.notes
        assert [n.split(" at ")[0] for n in found] == ["`diode` creates energy, for example"] * (
            file == "van_der_pol.bg"
        )
