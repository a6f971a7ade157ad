"""`start`, `nominal`, `prefer` and `require`: valid targets and effects."""

from __future__ import annotations

import pytest

import bondgraph
from compiler.causality import StrokeReason
from compiler.graph.network import Element
from tests.compiling import Running, compiled, mistake, mistakes, node_of

TEXT = """
model A {{
  parameter k: N/m = 8, m = 2 kg, x0 = 3 mm
  1  body
  I  mass   : p = m*v            {mass}
  C  spring : F = k*x            {spring}
  R  damper : F = 0.5 [N*s/m]*v  {damper}
  body -> mass, spring, damper
  output y = spring.x
}}
"""


def text(mass: str = "", spring: str = "", damper: str = "") -> str:
    return TEXT.format(
        mass=f"{{ {mass} }}" if mass else "",
        spring=f"{{ {spring} }}" if spring else "",
        damper=f"{{ {damper} }}" if damper else "",
    )


class TestStart:
    @pytest.mark.parametrize(
        ("mass", "spring", "p", "x"),
        [
            ("", "", 0.0, 0.0), ("start p = 3 [N*s]", "start x = 1 mm", 3.0, 1e-3), ("start v = 1.5 [m/s]", "start F = 16 N", 3.0, 2.0), ("start f = 1.5 [m/s]", "start e = 16 N", 3.0, 2.0),
            ("", "start q = 1 mm", 0.0, 1e-3), ("", "start x = x0", 0.0, 3e-3), ("", "start x = 2*x0 + 1 mm", 0.0, 7e-3), ("", "start x = 0", 0.0, 0.0),
        ],
    )  # fmt: skip
    def test_any_own_variable_that_the_law_turns_into_the_stored_one(
        self, mass: str, spring: str, p: float, x: float
    ) -> None:
        assert Running(compiled(text(mass, spring))).starts() == pytest.approx({"mass.p": p, "spring.x": x}, rel=1e-15)

    def test_it_follows_parameters(self) -> None:
        assert Running(compiled(text(spring="start x = x0"), {"x0": "5 mm"})).starts()["spring.x"] == 5e-3
        assert Running(compiled(text(spring="start F = 16 N"), {"k": "4 [N/m]"})).starts()["spring.x"] == 4.0

    def test_through_a_nonlinear_law(self) -> None:
        hard = text(spring="start F = 27 N").replace("F = k*x ", "F = 1 [N/m^3]*x^3 ")
        assert Running(compiled(hard)).starts()["spring.x"] == pytest.approx(3.0, rel=1e-15)

    def test_through_an_energy(self) -> None:
        soft = (
            text(spring="start F = 16 N")
            .replace("F = k*x ", "energy = 1/2*k*x^2 ")
            .replace("1  body", "1  body : translation")
        )
        assert Running(compiled(soft)).starts()["spring.x"] == pytest.approx(2.0, rel=1e-15)

    def test_a_law_that_cannot_be_inverted(self) -> None:
        bent = text(spring="start F = 16 N").replace("F = k*x ", "F = k*x + 1 N*sin(x/1 m)*exp(x/1 m) ")
        """The start is found where the law has that force."""
        bent = bent.replace("output y = spring.x", "output F = spring.F")
        found = bondgraph.load(bent).simulate(None, to=1e-9, points=2, outputs=("F",))
        assert found["F"][0] == pytest.approx(16, rel=1e-12)

    @pytest.mark.parametrize(
        ("mass", "spring"),
        [
            ("start x = 1 mm", ""),
            ("start F = 1 N", ""),
            ("", "start v = 1 [m/s]"),
            ("", "start p = 1 [N*s]"),
            ("start q = 1", ""),
        ],
    )
    def test_other_variables(self, mass: str, spring: str) -> None:
        found = [d for d in mistakes(text(mass, spring)) if d.code == "BG120"]
        assert len(found) == 1

    def test_once(self) -> None:
        assert [d.code for d in mistakes(text(spring="start x = 1 mm, start F = 1 N"))] == ["BG120"]

    @pytest.mark.parametrize("value", ["damper.v*1 s", "time*1 [m/s]", "u"])
    def test_known_before_the_run(self, value: str) -> None:
        found = mistakes(text(spring=f"start x = {value}").replace("parameter k", "input u = 1 mm\n  parameter k"))
        assert [d.code for d in found] == ["BG106"]

    def test_fields_name_the_port(self) -> None:
        field = "model A {{\n  C field(x: translation, y: translation) : energy = (x^2 + 2*y^2)*1 [N/m] {{ {} }}\n  1 a, b\n  I m, n : p = 1 kg*v\n  a -> m, field.x\n  b -> n, field.y\n}}\n"
        starts = Running(compiled(field.format("start x = 1 m, start y = 2 m"), everything=True)).starts()
        assert (starts["field.x"], starts["field.y"]) == (1.0, 2.0)
        starts = Running(compiled(field.format("start x.q = 1 m, start y.x = 2 m"), everything=True)).starts()
        assert (starts["field.x"], starts["field.y"]) == (1.0, 2.0)
        assert [d.code for d in mistakes(field.format("start z = 1 m"))] == ["BG120"]

    def test_a_junction_or_resistor_has_none(self) -> None:
        assert [d.code for d in mistakes(text(damper="start x = 1 mm"))] == ["BG120"]
        assert [d.code for d in mistakes(text().replace("1  body", "1  body : translation { start v = 1 [m/s] }"))] == [
            "BG120"
        ]

    def test_on_several_names(self) -> None:
        several = "model A {\n  1 a, b\n  C c, d : F = 2 [N/m]*x { start x = 1 mm }\n  I m, n : p = 1 kg*v\n  a -> c, m\n  b -> d, n\n}\n"
        starts = Running(compiled(several, everything=True)).starts()
        assert (starts["c.x"], starts["d.x"]) == (1e-3, 1e-3)


class TestNominal:
    def test_it_is_passed_on(self) -> None:
        running = Running(compiled(text("nominal p = 5 [N*s]", "nominal x = 1 um")))
        found = dict(
            zip(running.program.states.names, running.program.nominal(running.constants).tolist(), strict=True)
        )
        assert found == {"mass.p": 5.0, "spring.x": 1e-6}

    def test_none_is_zero(self) -> None:
        running = Running(compiled(text()))
        assert running.program.nominal(running.constants).tolist() == [0.0, 0.0]

    def test_only_of_what_is_stored(self) -> None:
        assert [d.code for d in mistakes(text(spring="nominal F = 1 N"))] == ["BG120"]


class TestPreferAndRequire:
    def test_prefer_derivative(self) -> None:
        """Of two masses on one flow the one that prefers it is in derivative form."""
        both = (
            "model A {{\n  1 a\n  I m : p = 2 kg*v {}\n  I n : p = 3 kg*v {}\n  Se s : F = 10 N\n  s -> a -> m, n\n}}\n"
        )
        assert compiled(both.format("", "")).state_space.dependent == ("n",)
        assert compiled(both.format("{ prefer = derivative }", "")).state_space.dependent == ("m",)
        assert compiled(both.format("{ prefer = integral }", "{ prefer = integral }")).state_space.dependent == ("n",)
        for first in ("", "{ prefer = derivative }"):
            running = Running(compiled(both.format(first, ""), everything=True))
            ((state, rate),) = running.rates().items()
            assert rate == pytest.approx(10.0 * (2 if state == "m.p" else 3) / 5, rel=1e-15)

    def test_require_integral_is_an_error_where_it_cannot_be(self) -> None:
        forced = "model A {\n  1 a\n  I m : p = 2 kg*v { require = integral }\n  Sf s : v = 1 [m/s]\n  s -> a -> m\n}\n"
        assert "`m`" in mistake(forced, "BG301").sentence

    @pytest.mark.parametrize(("word", "effort"), [("effort", True), ("flow", False)])
    def test_what_a_resistor_must_decide(self, word: str, effort: bool) -> None:
        both = "model A {{\n  Se s : u = 1 V\n  1 a\n  R r : u = 2 ohm*i\n  R t : u = 3 ohm*i {{ {} }}\n  s -> a -> r, t\n}}\n"
        causal = compiled(both.format(f"require = {word}"), everything=True).causal
        number = next(i for i, n in enumerate(causal.graph.nodes) if n.name == "t")
        (bond,) = causal.graph.incident[number]
        assert causal.decides_effort(bond, number) is effort
        assert causal.reasons[bond].because is StrokeReason.REQUIRED

    def test_they_are_on_the_graph(self) -> None:
        graph = compiled(text(mass="prefer = derivative", spring="require = integral")).whole_graph
        mass, spring = node_of(graph, "mass"), node_of(graph, "spring")
        assert isinstance(mass, Element) and isinstance(spring, Element)
        assert (mass.prefer, mass.require, spring.prefer, spring.require) == ("derivative", None, None, "integral")

    @pytest.mark.parametrize(
        ("attribute", "word"),
        [
            ("prefer = derivate", "derivative"),
            ("require = 3", "integral"),
            ("prefer = k", "integral"),
            ("require = integral*2", "integral"),
        ],
    )
    def test_other_words(self, attribute: str, word: str) -> None:
        found = mistake(text(spring=attribute), "BG122")
        assert word in found.help

    def test_resistors_know_no_integral(self) -> None:
        assert mistakes(text(damper="prefer = integral"))


def test_every_wrong_attribute_is_told() -> None:
    found = mistakes(text(mass="start x = 1 m, colour = 3", spring="prefer = derivate, nominal x = 3"))
    assert [d.span.line for d in found] == [5, 5, 6, 6]


def test_unknown_attributes_are_told_with_those_that_exist() -> None:
    assert "start" in mistake(text(spring="begin = 3 m"), "BG120").help
    assert "`nominal`" in mistake(text(spring="nominl x = 3 m"), "BG120").help
