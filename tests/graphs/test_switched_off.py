"""Junctions that are off: sources of zero in their place, and which ones the start values switch off."""

from __future__ import annotations

from dataclasses import replace

import pytest

from compiler.algebra.expression import ZERO, Symbol
from compiler.algebra.formula import Bound
from compiler.graph.elements import Kind
from compiler.graph.network import BondEnd, BondGraph, Element, PortVariable, Quantity
from compiler.graph.switch import off_at_the_start, switch_off
from tests.compiling import compiled

STAR = """plain model A {
  Se s : e = 1
  R a, b, c : e = 2*f
  KIND middle { active = time < 1 }
  KIND other { active = time < 2 }
  s -> middle -> a
  middle -> b
  middle -> other
  other -> c
}"""


def star(kind: str) -> BondGraph:
    return compiled(STAR.replace("KIND", kind)).whole_graph


class TestSources:
    @pytest.mark.parametrize(
        ("letter", "kind", "variable"), [("0", Kind.EFFORT_SOURCE, "e"), ("1", Kind.FLOW_SOURCE, "f")]
    )
    def test_each_bond_ends_at_a_source_of_its_own(self, letter: str, kind: Kind, variable: str) -> None:
        graph = star(letter)
        number = next(i for i, n in enumerate(graph.nodes) if n.name == "middle")
        made = switch_off(graph, ["middle"])
        assert len(made.nodes) == len(graph.nodes) + 3 and len(made.bonds) == len(graph.bonds)
        ends = [number, len(graph.nodes), len(graph.nodes) + 1, len(graph.nodes) + 2]
        for bond, end in zip(graph.incident[number], ends, strict=True):
            before, after = graph.bonds[bond], made.bonds[bond]
            at_head = before.head.node == number
            assert (after.head if at_head else after.tail) == BondEnd(end, 0)
            assert (after.tail if at_head else after.head) == (before.tail if at_head else before.head)
            assert (after.domain, after.span) == (before.domain, before.span)
        for place, name in zip(ends, ["middle", "middle (2)", "middle (3)", "middle (4)"], strict=True):
            source = made.nodes[place]
            assert isinstance(source, Element)
            assert (source.name, source.kind, source.modulated, source.arguments) == (name, kind, False, ())
            assert source.law.equations == ((Symbol(PortVariable(0, variable)), ZERO),)
            assert source.law.energy is None and source.law.arity == 0
        assert [n for i, n in enumerate(made.nodes[: len(graph.nodes)]) if i != number] == [
            n for i, n in enumerate(graph.nodes) if i != number
        ]
        assert [b for i, b in enumerate(made.bonds) if i not in graph.incident[number]] == [
            b for i, b in enumerate(graph.bonds) if i not in graph.incident[number]
        ]

    @pytest.mark.parametrize("letter", "01")
    def test_a_bond_between_two_of_them_has_a_source_at_both_ends(self, letter: str) -> None:
        graph = star(letter)
        made = switch_off(graph, ("other", "middle"))
        assert {n.name for n in made.nodes} == {
            "s",
            "a",
            "b",
            "c",
            "middle",
            "middle (2)",
            "middle (3)",
            "middle (4)",
            "other",
            "other (2)",
        }
        assert all(len(bonds) == 1 for bonds in made.incident)
        (between,) = (b for b in made.bonds if made.nodes[b.head.node].name.startswith("other") and made.nodes[b.tail.node].name.startswith("middle"))  # fmt: skip
        assert (made.nodes[between.tail.node].name, made.nodes[between.head.node].name) == ("middle (4)", "other")

    def test_without_any_the_graph_is_the_same(self) -> None:
        graph = star("1")
        assert switch_off(graph, ()) is graph

    def test_an_element_of_that_name_stays(self) -> None:
        graph = star("1")
        made = switch_off(graph, ("a",))
        assert made.nodes == graph.nodes and made.bonds == graph.bonds


STARTS = [
    ("d", "mode d = false", True),
    ("d", "mode d = true", False),
    ("not d", "mode d = false", False),
    ("d < 2.5", "mode d = 2", False),
    ("d < 2", "mode d = 2", True),
    ("time < 3", "", False),
    ("time < 2", "", True),
    ("time > 2 or d", "mode d = false", True),
    ("k > 1", "parameter k = 2", False),
    ("k > 2", "parameter k = 2", True),
    ("k > 1", "input k = 2", False),
    ("k > 2", "input k = 2", True),
    ("k > 5", "signal k = 2*x + time\n signal x = 2", False),
    ("k > 6", "signal k = 2*x + time\n signal x = 2", True),
    ("k > 1", "output k = 2 + time", False),
    ("k > 4", "output k = 2 + time", True),
    ("x.f > 5", "Se x : e = 1\n x -> n", None),  # what the network decides
    ("k > 5", "signal k = a.f", None),
    ("k > 5", "signal k = integral(1, 0)", None),
    ("k > 5", "signal k = delay(time, 1)", None),
    ("1/k > 5", "parameter k = 1\n signal j = 0*time", True),
    ("1/(time - 2) > 5", "", None),  # no value
    ("sqrt(time - 3) > 5", "", None),
]


@pytest.mark.parametrize(("condition", "declared", "off"), STARTS)
def test_the_start_decides(condition: str, declared: str, off: bool | None) -> None:
    """At 2 s. None: it does not, so that the junction is on."""
    text = f"""plain model A {{
  Se s : e = 1
  R a, b : e = 2*f
  0 n {{ active = {condition} }}
  1 always {{ active = time > 1 }}
  1 never {{ active = time > 2 }}
  1 line
  s -> line -> n
  line -> a
  always -> b
  never -> b2
  R b2 : e = f
  s2 -> always
  s3 -> never
  Se s2, s3 : e = 1
  {declared}
}}"""
    found = off_at_the_start(compiled(text).whole_graph, 2.0)
    assert found == (("n", "never") if off else ("never",))


def test_an_argument_may_be_a_number() -> None:
    graph = star("1")
    first, second = graph.switches
    slot = Bound(first.active.formula, (0.5,)), Bound(first.active.formula, (1.0,))
    switches = tuple(replace(s, active=a) for s, a in zip((first, second), slot, strict=True))
    assert off_at_the_start(replace(graph, switches=switches), 0.0) == ("other",)
    unknown = replace(graph, switches=(replace(first, active=Bound(first.active.formula, (Quantity("nothing"),))),))
    assert off_at_the_start(unknown, 5.0) == ()
