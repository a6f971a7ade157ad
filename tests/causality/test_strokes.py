"""Strokes of textbook graphs, the reason for each, and conflicts with both ends named."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bondgraph
from compiler.causality import CausalGraph, StrokeReason
from compiler.causality.strokes import HEAD, TAIL
from compiler.graph.elements import Kind
from compiler.graph.network import Element, Junction, MechanismNode
from tests.compiling import Running, compiled, mistake, mistakes


def causal(text: str) -> CausalGraph:
    return compiled(text, everything=True).causal


def decides(graph: CausalGraph, element: str, other: str | None = None) -> str:
    """`effort` or `flow`: the variable of its bond that an element determines (of the bond to another node, if it has several)."""
    for number, bond in enumerate(graph.graph.bonds):
        tail, head = graph.graph.nodes[bond.tail.node].name, graph.graph.nodes[bond.head.node].name
        if element in (tail, head) and (other is None or other in (tail, head)):
            side = TAIL if tail == element else HEAD
            return "effort" if graph.effort_from[number] == side else "flow"
    raise AssertionError(f"no bond of {element}")


def because(graph: CausalGraph, element: str) -> StrokeReason:
    number = next(i for i, n in enumerate(graph.graph.nodes) if n.name == element)
    return graph.reasons[graph.graph.incident[number][0]].because


def all_of(graph: CausalGraph) -> dict[str, str]:
    """For each one-port the variable that it determines."""
    return {n.name: decides(graph, n.name) for n in graph.graph.nodes if isinstance(n, Element) and len(n.ports) == 1}


SERIES = "model A {\n  Se s : u = 6 V\n  1 loop\n  R r : u = 2 ohm*i\n  I l : lambda = 3 H*i\n  C c : u = q/4 F\n  s -> loop -> r, l, c\n}\n"
PARALLEL = "model A {\n  Sf s : i = 6 A\n  0 node\n  R r : u = 2 ohm*i\n  I l : lambda = 3 H*i\n  C c : u = q/4 F\n  s -> node -> r, l, c\n}\n"


class TestTextbook:
    """Karnopp, Margolis and Rosenberg, System Dynamics, chapters 3 and 5."""

    def test_series_circuit(self) -> None:
        """The inductance brings the flow of the 1-junction, so the resistor computes its effort."""
        graph = causal(SERIES)
        assert all_of(graph) == {"s": "effort", "r": "effort", "l": "flow", "c": "effort"}
        assert graph.derivative == ()
        assert {n: because(graph, n) for n in "slcr"} == {
            "s": StrokeReason.SOURCE,
            "l": StrokeReason.INTEGRAL,
            "c": StrokeReason.FOLLOWS,
            "r": StrokeReason.FOLLOWS,
        }

    def test_parallel_circuit(self) -> None:
        graph = causal(PARALLEL)
        assert all_of(graph) == {"s": "flow", "r": "flow", "l": "flow", "c": "effort"}

    def test_mass_spring_damper(self) -> None:
        text = "model A {\n  Se push : F = 1 N\n  1 body\n  I mass : p = 2 kg*v\n  C spring : F = 8 [N/m]*x\n  R damper : F = 3 [N*s/m]*v\n  push -> body -> mass, spring, damper\n}\n"
        assert all_of(causal(text)) == {"push": "effort", "mass": "flow", "spring": "effort", "damper": "effort"}

    def test_quarter_car(self) -> None:
        text = "model A {\n  Sf road : v = 1 [m/s]\n  1 wheel, body : translation\n  C tyre : F = 9 [N/m]*x\n  C spring : F = 4 [N/m]*x\n  R damper : F = 3 [N*s/m]*v\n  I m1, m2 : p = 2 kg*v\n  road -> 0(tyre) -> wheel -> 0(1(spring, damper)) -> body\n  wheel -> m1\n  body -> m2\n}\n"
        graph = causal(text)
        assert all_of(graph) == {
            "road": "flow",
            "tyre": "effort",
            "spring": "effort",
            "damper": "effort",
            "m1": "flow",
            "m2": "flow",
        }
        assert graph.derivative == ()

    def test_motor_with_a_gyrator(self) -> None:
        """A GY turns effort into effort: both sides decide their flow, or both their effort."""
        text = "model A {\n  Se s : u = 6 V\n  1 arm, rotor\n  R w : u = 1 ohm*i\n  I l : lambda = 2 H*i\n  GY motor : u1 = 3 [V*s]*omega2\n  I j : p = 4 [kg*m^2]*omega\n  R b : M = 5 [N*m*s]*omega\n  s -> arm -> w, l\n  arm -> motor -> rotor -> j, b\n}\n"
        graph = causal(text)
        assert all_of(graph) == {"s": "effort", "w": "effort", "l": "flow", "j": "flow", "b": "effort"}
        assert (decides(graph, "motor", "arm"), decides(graph, "motor", "rotor")) == ("effort", "effort")

    def test_a_gyrator_the_other_way(self) -> None:
        text = "model A {\n  Sf s : i = 6 A\n  1 arm\n  0 rotor\n  GY motor : u1 = 3 [V*s]*omega2\n  C k : M = 5 [N*m]*phi\n  s -> arm -> motor -> rotor -> k\n  R w : u = 1 ohm*i\n  arm -> w\n}\n"
        graph = causal(text)
        assert decides(graph, "motor", "arm") == "effort" and decides(graph, "motor", "rotor") == "effort"
        assert decides(graph, "k") == "flow" and graph.derivative, (
            "a spring that the current twists is in derivative form"
        )

    def test_transformer_passes_the_stroke_on(self) -> None:
        text = "model A {\n  Se s : M = 6 [N*m]\n  1 a, b\n  TF gear : omega1 = 3*omega2\n  I j : p = 4 [kg*m^2]*omega\n  R r : M = 5 [N*m*s]*omega\n  s -> a -> gear -> b -> j, r\n}\n"
        graph = causal(text)
        assert (decides(graph, "gear", "a"), decides(graph, "gear", "b")) == ("flow", "effort")
        assert all_of(graph) == {"s": "effort", "j": "flow", "r": "effort"}
        spring = text.replace("I j : p = 4 [kg*m^2]*omega", "C j : M = 4 [N*m]*phi").replace(
            "Se s : M = 6 [N*m]", "Sf s : omega = 6 [1/s]"
        )
        graph = causal(spring)
        assert (decides(graph, "gear", "a"), decides(graph, "gear", "b")) == ("effort", "flow")

    def test_two_masses_on_a_lever_are_dependent(self) -> None:
        """I - TF - I: one in integral, the other in derivative form."""
        text = "model A {\n  Se s : F = 6 N\n  1 a, b : translation\n  TF lever : v1 = 3*v2\n  I m, n : p = 4 kg*v\n  s -> a -> m, lever\n  lever -> b -> n\n}\n"
        graph = causal(text)
        assert sorted(graph.graph.nodes[e.node].name for e in graph.derivative) == ["n"]
        assert (decides(graph, "m"), decides(graph, "n")) == ("flow", "effort")

    def test_two_capacitors_in_parallel_are_dependent(self) -> None:
        text = "model A {\n  Sf s : i = 6 A\n  0 a\n  C c, d : u = q/4 F\n  s -> a -> c, d\n}\n"
        graph = causal(text)
        assert [graph.graph.nodes[e.node].name for e in graph.derivative] == ["d"]

    def test_two_resistors_are_a_loop(self) -> None:
        """Nothing decides; in series the larger one decides the flow."""
        for r, t in ((2, 3), (3, 2)):
            text = f"model A {{\n  Se s : u = 6 V\n  1 a\n  R r : u = {r} ohm*i\n  R t : u = {t} ohm*i\n  s -> a -> r, t\n}}\n"
            graph = causal(text)
            assert (decides(graph, "r"), decides(graph, "t")) == (("effort", "flow") if r < t else ("flow", "effort"))
            assert because(graph, "r") is StrokeReason.CONDITIONED and because(graph, "t") is StrokeReason.FOLLOWS

    @pytest.mark.parametrize("law", ["i = u/3 ohm", "u = 3 ohm*i"])
    def test_equal_resistors_go_as_written(self, law: str) -> None:
        text = f"model A {{\n  Se s : u = 6 V\n  1 a\n  R r : {law}\n  R t : u = 3 ohm*i\n  s -> a -> r, t\n}}\n"
        graph = causal(text)
        assert (decides(graph, "r"), decides(graph, "t")) == (
            ("flow", "effort") if law.startswith("i") else ("effort", "flow")
        )
        assert because(graph, "r") is StrokeReason.PREFERRED and because(graph, "t") is StrokeReason.FOLLOWS

    def test_nonlinear_laws_choose_first(self) -> None:
        """A linear law can be turned, a nonlinear one may not be."""
        text = "model A {\n  Se s : u = 6 V\n  1 a\n  R r : u = 2 ohm*i\n  R diode : i = 1 uA*(exp(u/26 mV) - 1)\n  s -> a -> r, diode\n}\n"
        graph = causal(text)
        assert because(graph, "diode") is StrokeReason.PREFERRED and decides(graph, "diode") == "flow"
        assert because(graph, "r") is StrokeReason.FOLLOWS and decides(graph, "r") == "effort"

    def test_wheatstone_bridge(self) -> None:
        """Six resistors between four nodes: every junction is decided exactly once."""
        text = "model A {\n  Se s : u = 6 V\n  0 top, left, right\n  R r1, r2, r3, r4, r5 : u = 2 ohm*i\n  s -> top -> 1(r1) -> left -> 1(r5) -> right\n  top -> 1(r2) -> right -> r4\n  left -> r3\n}\n"
        graph = causal(text)
        _check(graph)

    def test_fields(self) -> None:
        text = "model A {\n  C plates(q: electric, x: translation) : energy = 1/2*q^2*(3 m - x)/1 [F*m]\n  1 wire, plate\n  R lead : u = 2 ohm*i\n  I mass : p = 2 kg*v\n  Se s : u = 1 V\n  s -> wire -> lead, plates.q\n  plate -> mass, plates.x\n}\n"
        graph = causal(text)
        assert decides(graph, "plates", "wire") == "effort" and decides(graph, "plates", "plate") == "effort"

    def test_mechanisms_take_efforts(self) -> None:
        text = "model A {\n  multibody m : planar {\n    body b { mass = 1 kg }\n    slide guide : ground to b { along = 0 }\n  }\n  Se s : F = 1 N\n  C c : F = 2 [N/m]*x\n  s -> m.guide -> c\n}\n"
        graph = causal(text)
        mechanism = next(n for n in graph.graph.nodes if isinstance(n, MechanismNode))
        number = graph.graph.nodes.index(mechanism)
        (bond,) = graph.graph.incident[number]
        assert not graph.decides_effort(bond, number) and graph.reasons[bond].because is StrokeReason.MECHANISM
        assert all_of(graph) == {"s": "effort", "c": "effort"}


def _check(graph: CausalGraph) -> None:
    """The rules that any assignment keeps."""
    assert len(graph.effort_from) == len(graph.reasons) == len(graph.graph.bonds)
    for number, node in enumerate(graph.graph.nodes):
        bonds = graph.graph.incident[number]
        by_node = [graph.decides_effort(b, number) for b in bonds]
        match node:
            case Junction(kind=Kind.ZERO):
                assert by_node.count(False) == 1, f"{node.name} takes its effort from one bond"
            case Junction():
                assert by_node.count(True) == 1, f"{node.name} takes its flow from one bond"
            case Element(kind=Kind.EFFORT_SOURCE):
                assert by_node == [True]
            case Element(kind=Kind.FLOW_SOURCE):
                assert by_node == [False]
            case Element(kind=Kind.TRANSFORMER):
                assert sorted(by_node) == [False, True]
            case Element(kind=Kind.GYRATOR):
                assert by_node[0] is by_node[1]
            case Element(kind=(Kind.CAPACITOR | Kind.INERTIA)):
                integral = node.kind is Kind.CAPACITOR
                derivative = {e.port for e in graph.derivative if e.node == number}
                assert {i for i, effort in enumerate(by_node) if effort is not integral} == derivative


@given(
    st.lists(st.sampled_from(["1r", "1i", "1c", "0r", "0c", "0i", "tf", "gy", "1", "0"]), min_size=1, max_size=12),
    st.booleans(),
)
def test_ladders_at_random_keep_the_rules(sections: list[str], effort: bool) -> None:
    """A source, a chain of junctions with elements, transducers between them, a resistor at the end."""
    lines, chain = [f"  {'Se s : e' if effort else 'Sf s : f'} = 1"], "  s"
    if sections[0] in ("tf", "gy"):
        sections = ["1r" if not effort else "0r", *sections]
    lines.append("  R first : e = f")
    chain += " -> 1(first)" if effort else " -> 0(first)"
    for i, section in enumerate(sections):
        if section in ("tf", "gy"):
            lines.append(f"  {section.upper()} t{i} : {'f1 = 2*f2' if section == 'tf' else 'e1 = 2*f2'}")
            chain += f" -> t{i} -> j{i}"
            lines.append(f"  1 j{i}")
            continue
        lines.append(f"  {section[0]} j{i}")
        chain += f" -> j{i}"
        if section[1:]:
            law = {"r": "R x{} : e = 3*f", "c": "C x{} : e = 4*q", "i": "I x{} : p = 5*f"}[section[1]].format(i)
            lines += [f"  {law}", f"  j{i} -> x{i}"]
    lines += [chain + " -> last", "  R last : e = 2*f"]
    _check(compiled("plain model A {\n" + "\n".join(lines) + "\n}\n").causal)


class TestConflicts:
    """Both ends are named, with their places and advice."""

    def test_two_effort_sources_on_a_zero(self) -> None:
        found = mistake(
            "model A {\n  Se first : u = 12 V\n  Se second : u = 6 V\n  0 line\n  R r : u = 2 ohm*i\n  first, second -> line -> r\n}\n",
            "BG301",
        )
        assert "`second`" in found.sentence and found.span.line == 3
        assert any("`first`" in why and span.line == 2 for span, why in found.related())

    def test_two_flow_sources_on_a_one(self) -> None:
        found = mistake(
            "model A {\n  Sf first : i = 12 A\n  Sf second : i = 6 A\n  1 line\n  R r : u = 2 ohm*i\n  first, second -> line -> r\n}\n",
            "BG301",
        )
        assert any("`first`" in why for _, why in found.related())

    def test_through_a_transformer_and_two_junctions(self) -> None:
        text = "model A {\n  Sf drive : omega = 12 [rad/s]\n  Sf other : omega = 2 [rad/s]\n  1 axle, shaft, third : rotation\n  TF gear : omega1 = 20*omega2\n  R bearing : M = 1 [N*m*s]*omega\n  drive -> axle -> gear -> shaft -> third -> bearing\n  other -> third\n}\n"
        found = mistake(text, "BG301")
        assert {
            "`drive`" in found.sentence + "".join(w for _, w in found.related()),
            "`other`" in found.sentence + "".join(w for _, w in found.related()),
        } == {True}

    def test_through_a_gyrator(self) -> None:
        text = "model A {\n  Se supply : u = 12 V\n  Se brake : M = 3 [N*m]\n  GY motor : u1 = 2 [V*s]*omega2\n  supply -> motor -> brake\n}\n"
        assert (
            Running(
                compiled(
                    text.replace("supply -> motor", "supply -> 1(w) -> motor").replace(
                        "  GY", "  R w : u = 1 ohm*i\n  GY"
                    ),
                    everything=True,
                )
            ).rates()
            == {}
        )
        flow = text.replace("Se brake : M = 3 [N*m]", "Sf brake : omega = 3 [rad/s]")
        found = mistake(flow, "BG301")
        assert any("`supply`" in why for _, why in found.related()) or "`supply`" in found.sentence

    def test_a_source_on_a_mechanism(self) -> None:
        text = "model A {\n  multibody m : planar {\n    body b { mass = 1 kg }\n    slide guide : ground to b { along = 0 }\n  }\n  Sf s : v = 1 [m/s]\n  s -> m.b.x\n}\n"
        found = mistake(text, "BG301")
        words = found.sentence + " ".join(w for _, w in found.related())
        assert "`s`" in words and ("`m`" in words or "`m.guide" in words)

    def test_what_is_required(self) -> None:
        found = mistake(
            "model A {\n  Se battery : u = 12 V\n  0 line\n  C cell : u = q/1 F { require = integral }\n  battery -> line -> cell\n}\n",
            "BG301",
        )
        assert "`cell`" in found.sentence and any("`battery`" in w for _, w in found.related())

    def test_several_conflicts_at_once(self) -> None:
        text = "model A {\n  Se a, b, c, d : u = 12 V\n  0 one, two\n  R r, t : u = 2 ohm*i\n  a, b -> one -> r\n  c, d -> two -> t\n}\n"
        assert [d.code for d in mistakes(text)] == ["BG301", "BG301"]

    def test_a_junction_that_nothing_can_decide(self) -> None:
        """Two flow sources around a 0-junction with nothing else: the bond between them has no effort."""
        found = mistake("model A {\n  Sf s, t : i = 1 A\n  0 node\n  s, t -> node\n}\n", "BG301")
        assert found.help


class TestReasons:
    def test_every_stroke_has_one(self) -> None:
        graph = causal(SERIES)
        assert [r.because for r in graph.reasons].count(StrokeReason.SOURCE) == 1
        for reason in graph.reasons:
            assert (reason.bond is not None) is (reason.because is StrokeReason.FOLLOWS)

    def test_what_follows_names_the_bond_it_follows_from(self) -> None:
        graph = causal(SERIES)
        inductor = next(i for i, b in enumerate(graph.graph.bonds) if graph.graph.nodes[b.head.node].name == "l")
        follows = [r for r in graph.reasons if r.because is StrokeReason.FOLLOWS]
        assert follows and all(r.bond == inductor for r in follows)

    @pytest.mark.parametrize("attribute", ["prefer = derivative", "require = derivative"])
    def test_what_the_author_asked_for(self, attribute: str) -> None:
        """Of two inductors on one flow."""
        text = SERIES.replace("  C c", f"  I m : lambda = 2 H*i {{ {attribute} }}\n  C c").replace(
            "r, l, c", "r, m, l, c"
        )
        graph = causal(text)
        assert decides(graph, "m") == "effort" and [graph.graph.nodes[e.node].name for e in graph.derivative] == ["m"]


class TestBondsToAndFro:
    """Two bonds between a 0 and a 1, one each way: the flow of the 1 enters the 0 and leaves it, its effort likewise."""

    TEXT = "plain model A {\n  0 z\n  1 o\n  I a : p = 2*f\n  I b : p = 4*f { start p = 3 }\n  R r : e = 6*f\n  z -> a\n  o -> b, r\n  z -> o\n  o -> z\n  output fa = a.f, fb = b.f, ez = z.e\n}\n"

    @pytest.mark.parametrize("order", ["a, b", "b, a"])
    def test_they_decide_nothing(self, order: str) -> None:
        """Either storage could be the state by strokes alone, but if the bonds decided one another they would form a loop of gain 1."""
        text = self.TEXT
        if order == "b, a":
            a, b = (next(x for x in text.splitlines(True) if x.startswith(f"  I {n} ")) for n in "ab")
            text = text.replace(a + b, b + a)
        graph = causal(text)
        assert [graph.graph.nodes[e.node].name for e in graph.derivative] == ["a"]
        assert sum(r.because is StrokeReason.CANCELS for r in graph.reasons) >= 1
        run = bondgraph.load(text).simulate(to=2, points=5)
        assert run["fb"] == pytest.approx(0.75 * np.exp(-1.5 * run.time), rel=1e-6)  # p' = -6 p/4
        assert run["fa"] == pytest.approx(np.zeros(5), abs=1e-15) and run["ez"] == pytest.approx(np.zeros(5), abs=1e-15)

    @pytest.mark.parametrize("kind", ["0", "1"])
    def test_junctions_of_one_kind_in_between_count_as_one(self, kind: str) -> None:
        """Without a start that says which storage is the state."""
        text = self.TEXT.replace(" { start p = 3 }", "").replace("  z -> o\n", "  z -> m -> o\n")
        text = text.replace("  0 z\n", f"  {kind} m\n  0 z\n")
        assert [causal(text).graph.nodes[e.node].name for e in causal(text).derivative] == ["a"]
        assert bondgraph.load(text).simulate(to=1, points=3).final("fb") == 0

    def test_two_the_same_way_decide(self) -> None:
        """Then the 0 gets the flow twice, and the 1 the effort: C' = 2 f, p' = -2 e."""
        text = "plain model A {\n  0 z\n  1 o\n  C a : e = q { start q = 1 }\n  I b : p = f\n  z -> a\n  o -> b\n  o -> z\n  o -> z\n  output e = a.e\n}\n"
        run = bondgraph.load(text).simulate(to=3, points=7, rtol=1e-9)
        assert run["e"] == pytest.approx(np.cos(2 * run.time), abs=1e-7)


def test_propagation_is_linear() -> None:
    """A ladder of a thousand sections takes a choice each, not a search."""
    text = "plain model A {\n  parameter n = 400\n  Se s : e = 1\n  1 first\n  s -> first\n  0 k[0]\n  for i in 1..n {\n    1 a[i]\n    0 k[i]\n    I m[i] : p = f\n    C c[i] : e = q\n    k[i-1] -> a[i] -> m[i], k[i]\n    k[i] -> c[i]\n  }\n  R r : e = f\n  first -> r, k[0]\n}\n"
    graph = compiled(text).causal
    _check(graph)
    assert graph.derivative == ()
    assert {decides(graph, f"m[{i}]") for i in (1, 200, 400)} == {"flow"}
