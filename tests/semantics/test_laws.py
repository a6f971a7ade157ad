"""Laws: the form for each kind, letters that clash with names, and the prefix M."""

from __future__ import annotations

import pytest

from compiler.graph.network import Element
from tests.compiling import Running, compiled, mistake, mistakes, node_of

BODY = """
model A {{
  parameter k: N/m = 8, m = 2 kg, r: N*s/m = 0.5
  input u = 3 N
  1  body
  I  mass   : p = m*v
  C  spring : F = k*x
  {element}
  body -> mass, spring
  {bonds}
  output y = spring.x
}}
"""


def with_element(element: str, bonds: str = "body -> part") -> str:
    return BODY.format(element=element, bonds=bonds)


def codes(element: str, bonds: str = "body -> part") -> list[str]:
    return [d.code for d in mistakes(with_element(element, bonds))]


class TestForms:
    @pytest.mark.parametrize(
        "element",
        [
            "R part : F = r*v", "R part : v = F/r", "R part : F/r = v", "R part : r*v = F", "R part : e = r*f", "R part : F - r*v = 0", "R part : F = r*v + 1 N",
            "R part : F = r*v*abs(v)/1 [m/s]", "R part : F = r*v if v > 0 else 2*r*v", "C part : F = k*x + k*x^3/1 [m^2]", "C part : x = F/k", "C part : energy = 1/2*k*x^2",
            "C part : energy = 1/2*k*q^2", "I part : v = p/m", "I part : energy = p^2/(2*m)", "I part : f = p/m",
        ],
    )  # fmt: skip
    def test_any_direction_that_is_natural(self, element: str) -> None:
        assert [c for c in codes(element) if c not in ("BG403",)] == []

    @pytest.mark.parametrize(
        "source",
        [
            "Se part : F = 3 N",
            "Se part : e = 3 N*sin(2*pi*time/1 s)",
            "Se part : F = 3 N if time > 1 s else 0",
            "MSe part : F = u",
            "MSe part : F = -2*spring.F",
        ],
    )
    def test_sources(self, source: str) -> None:
        assert codes(source, "part -> body") == []

    @pytest.mark.parametrize(
        ("element", "word"),
        [
            ("R part", "R part : F = r*v"), ("C part", "F = k*x"), ("I part", "p = m*v"), ("Se part", "F = 1 N"), ("R part : translation", "R part : F = r*v"),
            ("R part : 3 N", "R part : e = 3 N*f"),
        ],
    )  # fmt: skip
    def test_a_law_is_asked_for_with_an_example(self, element: str, word: str) -> None:
        found = [
            d
            for d in mistakes(with_element(element, "part -> body" if element.startswith("Se") else "body -> part"))
            if d.code == "BG119"
        ]
        assert len(found) == 1 and word in found[0].help

    @pytest.mark.parametrize(
        ("element", "word"),
        [
            ("R part : F = 3 N", "flow"), ("R part : v = 3 [m/s]", "effort"), ("C part : F = 3 N", "displacement"), ("C part : x = 3 m", "effort"), ("I part : p = 3 [N*s]", "flow"),
            ("I part : v = 3 [m/s]", "momentum"), ("R part : r = r", "effort"),
        ],
    )  # fmt: skip
    def test_both_variables_must_occur(self, element: str, word: str) -> None:
        assert word in mistake(with_element(element), "BG119").sentence

    @pytest.mark.parametrize(
        ("element", "letter"),
        [
            ("C part : F = r*v", "v"),
            ("I part : F = 2 [N*s/m]*v + p/1 s", "F"),
            ("R part : F = k*x + r*v", "x"),
            ("R part : F = p/1 s + r*v", "p"),
            ("I part : p = m*v + x*1 [kg/s]", "x"),
        ],
    )
    def test_a_kind_relates_its_own_two(self, element: str, letter: str) -> None:
        """Loss in a C, stiffness in an R: reported with the right kind. No name is involved: `x`, `p` mean nothing else here."""
        text = with_element(element).replace("output y = spring.x", "output y = spring.q")
        found = mistake(text, "BG119")
        assert f"`{letter}`" in found.sentence and found.help

    def test_two_equations_for_one_port(self) -> None:
        assert codes("R part : F = r*v, v = F/r") == ["BG119"]

    @pytest.mark.parametrize(
        "source",
        ["Se part : v = 3 [m/s]", "Se part : 2*F = 3 N", "Se part : 3 N = F", "Se part : F = r*v", "Se part : F = F"],
    )
    def test_a_source_gives_its_own(self, source: str) -> None:
        assert "BG119" in codes(source, "part -> body")

    def test_a_junction_has_none(self) -> None:
        assert codes("1 part : F = r*v") == ["BG119"]


class TestTransducers:
    TEXT = "model A {{\n  parameter n = 4, g = 2 [V*s]\n  1 a : electric\n  1 b, c : rotation\n  {kind} part : {law}\n  Se s : u = 6 V\n  R w : u = 1 ohm*i\n  I j : p = 3 [kg*m^2]*omega\n  C k : M = 5 [N*m]*phi\n  {bonds}\n}}\n"

    def text(self, kind: str, law: str) -> str:
        bonds = (
            "s -> a -> w, part\n  part -> b -> c -> j, k"
            if kind.endswith("GY")
            else "s -> a -> w\n  b -> part -> c -> j\n  b -> k"
        )
        return self.TEXT.format(kind=kind, law=law, bonds=bonds)

    @pytest.mark.parametrize(
        "law",
        [
            "u1 = g*omega2",
            "M2 = g*i1",
            "omega2 = u1/g",
            "i1 = M2/g",
            "u1 - g*omega2 = 0",
            "2*u1 = 2*g*omega2",
            "e1 = g*f2",
        ],
    )
    def test_a_gyrator_by_either_equation(self, law: str) -> None:
        """Power continuity gives the other: u1 i1 = M2 omega2, and g in V*s is N*m/A."""
        running = Running(compiled(self.text("GY", law), everything=True))
        rates = running.rates({"j.L": 6.0, "k.phi": 1.0})
        i = (6.0 - 2 * 2.0) / 1.0
        assert rates == pytest.approx({"j.L": 2 * i - 5.0, "k.phi": 2.0}, rel=1e-14)

    @pytest.mark.parametrize(
        "law", ["omega1 = n*omega2", "M2 = n*M1", "omega2 = omega1/n", "M1 = M2/n", "omega1/n = omega2", "f1 = n*f2"]
    )
    def test_a_transformer_by_either_equation(self, law: str) -> None:
        """M2 = 4 M1 and the inertia feels the spring through the square of the ratio."""
        running = Running(compiled(self.text("TF", law), everything=True))
        rates = running.rates({"j.L": 6.0, "k.phi": 1.0})
        assert rates["k.phi"] == pytest.approx(4 * 2.0, rel=1e-14)
        assert rates["j.L"] == pytest.approx(-4 * 5.0, rel=1e-14)

    @pytest.mark.parametrize(
        ("kind", "law", "word"),
        [
            ("TF", "M1 = n*omega2*1 [N*m*s]", "two efforts or two flows"), ("TF", "omega1 = n*omega2 + 1 [1/s]", "create energy"), ("TF", "omega1 = n*omega2^2*1 s", "linear"),
            ("TF", "omega1 = n*omega2, M2 = n*M1", "equations"), ("TF", "omega1 = n*1 [1/s]", "two efforts or two flows"), ("GY", "u1 = g*omega2 + 1 V", "create energy"),
            ("GY", "u1 = g*abs(omega2)", "linear"), ("GY", "u1*i1 = M2*omega2", "effort of one side"), ("TF", "omega1 = n*omega1", "two efforts or two flows"),
        ],
    )  # fmt: skip
    def test_what_is_no_transducer(self, kind: str, law: str, word: str) -> None:
        found = [d for d in mistakes(self.text(kind, law)) if d.code == "BG119"]
        assert len(found) == 1 and word in found[0].sentence + found[0].help

    def test_modulated(self) -> None:
        text = self.text("MGY", "u1 = g*omega2*(1 + k.phi)")
        rates = Running(compiled(text, everything=True)).rates({"j.L": 6.0, "k.phi": 1.0})
        g, w = 4.0, 2.0
        assert rates["j.L"] == pytest.approx(g * (6.0 - g * w) - 5.0, rel=1e-14)


class TestFields:
    def test_equations_in_any_order(self) -> None:
        law = "a.F = 2 [N*s/m]*a.v - 1 [N*s/m]*b.v, b.F = 3 [N*s/m]*b.v - 1 [N*s/m]*a.v"
        text = "model A {{\n  R pair(a, b) : {law}\n  1 x, y : translation\n  I m, n : p = 1 kg*v\n  x -> m, pair.a\n  y -> n, pair.b\n}}\n"
        rates = Running(compiled(text.format(law=law), everything=True)).rates({"m.p": 1.0, "n.p": 2.0})
        assert rates == {"m.p": -0.0, "n.p": -5.0}
        turned = ", ".join(reversed(law.split(", ")))
        assert Running(compiled(text.format(law=turned), everything=True)).rates({"m.p": 1.0, "n.p": 2.0}) == rates

    def test_a_missing_equation(self) -> None:
        text = "model A {\n  R pair(a, b) : a.F = 2 [N*s/m]*a.v\n  1 x, y : translation\n  I m, n : p = 1 kg*v\n  x -> m, pair.a\n  y -> n, pair.b\n}\n"
        assert "needs 2" in mistake(text, "BG119").sentence

    def test_an_energy_gives_all_efforts(self) -> None:
        """W = x^2 y + y^2: F_x = 2 x y, F_y = x^2 + 2 y."""
        text = "model A {\n  C field(x: translation, y: translation) : energy = x^2*y*1 [N/m^2] + y^2*1 [N/m]\n  1 a, b\n  I m, n : p = 1 kg*v\n  a -> m, field.x\n  b -> n, field.y\n}\n"
        rates = Running(compiled(text, everything=True)).rates(
            {"field.x": 3.0, "field.y": 5.0, "m.p": 7.0, "n.p": 11.0}
        )
        assert rates == {"m.p": -30.0, "n.p": -19.0, "field.x": 7.0, "field.y": 11.0}

    def test_an_inertia_field(self) -> None:
        text = "model A {\n  I field(a: translation, b: translation) : energy = a^2/(2*1 kg) + a*b/(4 kg) + b^2/(2*2 kg)\n  1 x, y\n  C k, l : F = 3 [N/m]*x\n  x -> k, field.a\n  y -> l, field.b\n}\n"
        rates = Running(compiled(text, everything=True)).rates({"field.a": 2.0, "field.b": 4.0, "k.x": 1.0, "l.x": 2.0})
        assert rates == {"field.a": -3.0, "field.b": -6.0, "k.x": 3.0, "l.x": 2.5}

    def test_indexed_names_are_no_ports(self) -> None:
        assert mistakes("model A {\n  R pair(a, a) : a.F = 2 [N*s/m]*a.v\n  1 x : translation\n  x -> pair.a\n}\n")


class TestEnergies:
    @pytest.mark.parametrize(
        ("element", "word"),
        [
            ("C part : energy = 1/2*k*x^2*spring.x/1 m", "port"), ("C part : energy = 1/2*k*x^2*(1 + time/1 s)", "port"), ("C part : energy = 1/2*k*x^2 + u*x", "port"),
        ],
    )  # fmt: skip
    def test_what_moves_a_storage_is_one_of_its_ports(self, element: str, word: str) -> None:
        """It may read only its own displacement or momentum and parameters; else the missing port is suggested."""
        assert word in mistake(with_element(element), "BG117").help

    @pytest.mark.parametrize(
        "element",
        [
            "C part : energy = 1/2*k*x^2 + F*x",
            "C part : energy = 3 J",
            "I part : energy = 1/2*m*v^2",
            "R part : energy = 1/2*k*x^2",
            "C part : energy = 1/2*k*x^2, F = k*x",
        ],
    )
    def test_other_variables(self, element: str) -> None:
        assert codes(element) == ["BG119"]

    def test_its_unit(self) -> None:
        assert codes("C part : energy = 1/2*k*x") == ["BG103"]


class TestLetters:
    """Only the letters that the kind has can clash: `e f q` in C, `e f p` in I, `e f` in R — and a clash is an error."""

    @pytest.mark.parametrize(
        ("name", "element"),
        [
            ("F", "R part : F = r*v"),
            ("v", "R part : F = r*v"),
            ("x", "C part : F = k*x"),
            ("F", "C part : F = k*x"),
            ("p", "I part : p = m*v"),
            ("v", "I part : p = m*v"),
            ("e", "R part : e = r*f"),
            ("q", "C part : F = k*q"),
        ],
    )
    def test_a_clash_is_told_at_the_letter(self, name: str, element: str) -> None:
        text = f"model A {{\n  parameter {name} = 3, k: N/m = 1, m = 1 kg, r: N*s/m = 1\n  1 body : translation\n  {element}\n  body -> part\n}}\n"
        found = [d for d in mistakes(text) if d.code == "BG116"]
        assert len(found) == 1 and found[0].span.line == 4 and found[0].span.text == name
        assert "`part`" in found[0].sentence

    @pytest.mark.parametrize("role", ["parameter {} = 3", "constant {} = 3", "signal {} = 3", "input {} = 3"])
    def test_whatever_the_name_is(self, role: str) -> None:
        text = (
            "model A {\n  %s\n  1 body : translation\n  R part : F = 2 [N*s/m]*v\n  I m : p = 1 kg*f\n  body -> part, m\n}\n"
            % role.format("F")
        )
        assert "BG116" in [d.code for d in mistakes(text)]

    @pytest.mark.parametrize(
        ("name", "element"),
        [
            ("x", "R part : F = 2 [N*s/m]*v"),
            ("p", "C part : F = 2 [N/m]*x"),
            ("q", "I part : p = 2 kg*v"),
            ("u", "R part : F = 2 [N*s/m]*v"),
            ("omega", "I part : p = 2 kg*v"),
            ("F", "R part : e = 2 [N*s/m]*f"),
        ],
    )
    def test_letters_that_the_kind_has_not_are_free(self, name: str, element: str) -> None:
        text = f"model A {{\n  parameter {name} = 3\n  1 body : translation\n  R loss : e = 1 [N*s/m]*f\n  {element}\n  body -> loss, part\n  output y = {name}\n}}\n"
        assert mistakes(text) == ()

    def test_the_generic_letter_helps(self) -> None:
        """Advice of the message: write the variable as `q`."""
        text = "model A {\n  parameter x = 2 m\n  1 body : translation\n  I mass : p = 1 kg*v\n  C part : F = 2 [N/m]*%s\n  body -> mass, part\n  output y = part.q + x\n}\n"
        assert "`q`" in mistake(text % "x", "BG116").help
        assert Running(compiled(text % "q")).outputs({"part.x": 1.0}) == {"y": 3.0}

    def test_an_output_is_no_clash(self) -> None:
        """`output x = spring.x` is allowed beside `C spring : F = k*x`."""
        assert mistakes(with_element("R part : F = r*v").replace("output y", "output x")) == ()

    def test_ports_of_fields_clash_too(self) -> None:
        text = "model A {\n  parameter a = 3\n  C field(a: translation, b: translation) : energy = (a^2 + b^2)*1 [N/m]\n  1 x, y\n  I m, n : p = 1 kg*v\n  x -> m, field.a\n  y -> n, field.b\n  output y1 = a\n}\n"
        assert [d.code for d in mistakes(text)] == ["BG116"]


class TestM:
    """The prefix M is needed exactly if a law reads a varying quantity (`time` in a source excepted)."""

    @pytest.mark.parametrize(
        ("element", "bonds"),
        [
            ("MSe part : F = u", "part -> body"), ("MSe part : F = 2*spring.F", "part -> body"), ("MR part : F = r*v*(1 + spring.x/1 m)", "body -> part"),
            ("MR part : F = r*v*(1 + time/1 s)", "body -> part"), ("MSf part : v = spring.v", "part -> 0(extra) -> body\n  C extra : F = k*x"),
            ("Se part : F = 1 N*sin(time/1 s)", "part -> body"), ("Se part : F = m*9.81 [m/s^2]", "part -> body"), ("R part : F = r*v", "body -> part"),
        ],
    )  # fmt: skip
    def test_right(self, element: str, bonds: str) -> None:
        assert codes(element, bonds) == []

    @pytest.mark.parametrize(
        ("element", "bonds", "right"),
        [
            ("Se part : F = u", "part -> body", "MSe part"), ("Se part : F = 2*spring.F", "part -> body", "MSe part"), ("R part : F = r*v*(1 + spring.x/1 m)", "body -> part", "MR part"),
            ("R part : F = r*v*(1 + time/1 s)", "body -> part", "MR part"),
        ],
    )  # fmt: skip
    def test_missing(self, element: str, bonds: str, right: str) -> None:
        assert f"`{right}`" in mistake(with_element(element, bonds), "BG117").help

    @pytest.mark.parametrize(
        ("element", "bonds", "right"),
        [
            ("MSe part : F = 3 N", "part -> body", "Se part"),
            ("MSe part : F = 3 N*time/1 s", "part -> body", "Se part"),
            ("MR part : F = r*v", "body -> part", "R part"),
        ],
    )
    def test_needless(self, element: str, bonds: str, right: str) -> None:
        assert f"`{right}`" in mistake(with_element(element, bonds), "BG118").help

    @pytest.mark.parametrize("kind", ["MC", "MI"])
    def test_there_is_no_mc_and_no_mi(self, kind: str) -> None:
        found = mistake(with_element(f"{kind} part : F = k*x"), "BG105")
        assert found.help

    def test_a_signal_between_changes_nothing(self) -> None:
        text = with_element("Se part : F = s", "part -> body").replace("input u", "signal s = 2*spring.F\n  input u")
        assert mistake(text, "BG117").span.text == "s"

    def test_graph_says_it(self) -> None:
        graph = compiled(with_element("MR part : F = r*v*(1 + spring.x/1 m)")).whole_graph
        part, spring = node_of(graph, "part"), node_of(graph, "spring")
        assert isinstance(part, Element) and isinstance(spring, Element)
        assert (part.kind.value, part.modulated, spring.modulated) == ("R", True, False)


def test_laws_may_read_lists_indices_and_functions() -> None:
    text = "function cubic(a, b, s) = a*s + b*s^3\nmodel A {\n  parameter k: N/m = (1, 8), b = 2 [N/m^3]\n  1 body\n  I mass : p = 2 kg*v\n  C spring : F = cubic(k[2], b, x)\n  body -> mass, spring\n}\n"
    assert Running(compiled(text, everything=True)).rates({"spring.x": 3.0}) == {
        "mass.p": -(24.0 + 54.0),
        "spring.x": 0.0,
    }


def test_equal_laws_are_one_object() -> None:
    """Equal flat laws too, with any names: they are solved and differentiated once."""
    text = "model A {\n  parameter a: N/m = 1, b: N/m = 2\n  1 x, y\n  C c : F = a*x + 3*a*x\n  C d : F = b*x + 3*b*x\n  I m, n : p = 1 kg*v\n  x -> c, m\n  y -> d, n\n}\n"
    graph = compiled(text).whole_graph
    laws = {n.name: n.law for n in graph.nodes if isinstance(n, Element)}
    assert laws["c"] is laws["d"] and laws["m"] is laws["n"]
