"""Ideal valves: events around a switched junction that say effort and flow are complementary, and the form that all of them get."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import bondgraph
from compiler.algebra.expression import evaluate
from compiler.graph.elements import Kind
from compiler.graph.network import BondGraph, Quantity, Reading
from compiler.graph.switch import off_at_the_start
from compiler.graph.valves import Valve, switched_gaps, with_gaps
from tests.compiling import compiled

CONDUCT, BLOCK = "when not d and gap.e > 0 { d = true }", "when d and line.f < 0 { d = false }"
DIODE = f"""
  mode d = false
  Se s : e = 1
  R r : e = 2*f
  0 gap {{ active = not d }}
  1 line
  s -> line -> gap
  line -> r
  {CONDUCT}
  {BLOCK}"""
GRIP, OPEN = "when not d and a.f > b.f { d = true }", "when d and plates.e < 0 { d = false }"
CLUTCH = f"""
  mode d = false
  Sf s : f = 1
  1 a, b
  R r : e = 2*f
  0 plates {{ active = d }}
  s -> a -> plates -> b -> r
  {GRIP}
  {OPEN}"""
PASS, SHUT = "when not d and a.e > b.e { d = true }", "when d and line.f < 0 { d = false }"
CHECK = f"""
  mode d = false
  Se s : e = 1
  R r : e = 2*f
  0 a, b
  1 line {{ active = d }}
  s -> a -> line -> b -> r
  {PASS}
  {SHUT}"""


def graph_of(body: str) -> BondGraph:
    return compiled("plain model A {\n" + body + "\n}").whole_graph


def summary(graph: BondGraph, valve: Valve) -> tuple[str, float, float, str, str]:
    """Gap, value of the mode where it conducts, sign, and the words of the events that make it conduct and block."""
    conducts, blocks = (next(e.words for e in graph.events if (e.name, e.span.start) == key) for key in valve.events)
    return valve.junction, valve.conducting, valve.sign, conducts, blocks


def valves_of(body: str) -> list[tuple[str, float, float, str, str]]:
    graph = graph_of(body)
    return [summary(graph, v) for v in with_gaps(graph)[1]]


def words(event: str) -> str:
    return event.removeprefix("when ").partition(" {")[0]


def holds(graph: BondGraph, number: int, values: Mapping[str, float]) -> bool:
    """The condition of an event, for values of what it may read."""

    def value(argument: object) -> float:
        if isinstance(argument, float):
            return argument
        assert isinstance(argument, Reading | Quantity)
        name = argument.name if isinstance(argument, Quantity) else f"{argument.node}.{argument.variable}"
        return values[name]

    condition = graph.events[number].condition
    return evaluate(condition.formula.expression, lambda slot: value(condition.arguments[slot])) == 1.0


class TestFormsOfAValve:
    def test_a_gap_at_the_end_of_a_line_is_one_as_it_is(self) -> None:
        graph = graph_of(DIODE)
        same, (valve,) = with_gaps(graph)
        assert same is graph
        assert summary(graph, valve) == ("gap", 1.0, 1.0, words(CONDUCT), words(BLOCK))
        assert valve.mode == "d" and valve.span == graph.quantities["d"].span

    def test_the_order_of_the_events_does_not_matter(self) -> None:
        turned = DIODE.replace(CONDUCT, "").replace(BLOCK, f"{BLOCK}\n{CONDUCT}")
        assert valves_of(turned) == [("gap", 1.0, 1.0, words(CONDUCT), words(BLOCK))]

    def test_a_valve_for_the_other_direction_has_the_other_sign(self) -> None:
        turned = DIODE.replace("gap.e > 0", "gap.e < 0").replace("line.f < 0", "line.f > 0")
        assert valves_of(turned) == [("gap", 1.0, -1.0, "not d and gap.e < 0", "d and line.f > 0")]

    def test_a_mode_that_says_that_it_blocks(self) -> None:
        blocks = DIODE.replace("active = not d", "active = d")
        blocks = blocks.replace(CONDUCT, "when d and gap.e > 0 { d = false }")
        blocks = blocks.replace(BLOCK, "when not d and line.f < 0 { d = true }")
        assert valves_of(blocks) == [("gap", 0.0, 1.0, "d and gap.e > 0", "not d and line.f < 0")]

    def test_a_gap_whose_arrow_leaves_it_gets_one_with_an_arrow_into_it(self) -> None:
        """The arrow out of the gap turns its effort: e of the line's end is -e of the gap seen from the line."""
        text = DIODE.replace("s -> line -> gap", "s -> line\n gap -> line").replace("gap.e > 0", "gap.e < 0")
        graph = graph_of(text)
        opened, (valve,) = with_gaps(graph)
        assert summary(graph, valve) == ("gap.gap", 1.0, -1.0, "not d and gap.e < 0", words(BLOCK))
        bond = opened.bonds[-1]
        assert opened.nodes[bond.tail.node].name == "gap" and opened.nodes[bond.head.node].name == "gap.gap"
        # The arrow of the line points out of the gap, so the flow into what hangs on it is the negative of the line's.
        for f in (-2.0, -1e-12, 0.0, 1e-12, 2.0):
            assert holds(opened, 1, {"d": 1.0, "gap.gap.f": f}) == (f > 0)
            assert holds(opened, 0, {"d": 0.0, "gap.e": f}) == (f < 0)

    def test_a_clutch_opens_under_an_effort_and_grips_under_a_slip(self) -> None:
        """It conducts, as slip passes, while it is off."""
        graph = graph_of(CLUTCH)
        opened, (valve,) = with_gaps(graph)
        assert summary(graph, valve) == ("plates.gap", 0.0, -1.0, words(OPEN), words(GRIP))
        assert holds(opened, 0, {"d": 0.0, "plates.gap.f": 1e-15})  # what slips is the flow of the gap
        assert not holds(opened, 0, {"d": 0.0, "plates.gap.f": -1e-15})
        assert not holds(opened, 0, {"d": 1.0, "plates.gap.f": 1.0})
        assert opened.events[1] == graph.events[1]

    def test_a_line_that_opens_gets_a_gap_and_is_always_on(self) -> None:
        graph = graph_of(CHECK)
        opened, (valve,) = with_gaps(graph)
        assert summary(graph, valve) == ("line.gap", 1.0, 1.0, words(PASS), words(SHUT))
        gap, bond = opened.nodes[-1], opened.bonds[-1]
        assert (gap.name, gap.kind, gap.domain) == ("line.gap", Kind.ZERO, graph.bonds[0].domain)
        assert bond.tail == (graph.nodes.index(next(n for n in graph.nodes if n.name == "line")), 0)
        assert bond.head == (len(graph.nodes), 0)
        assert opened.nodes[:-1] == graph.nodes and opened.bonds[:-1] == graph.bonds
        assert opened.walls == {("line.gap", "in"): len(opened.bonds) - 1}
        assert holds(opened, 0, {"d": 0.0, "line.gap.e": 1e-15}) and not holds(opened, 0, {"d": 0.0, "line.gap.e": 0.0})
        # Off where the line was on.
        (switch,) = opened.switches
        assert switch.junction == "line.gap"
        assert [evaluate(switch.active.formula.expression, lambda _, d=d: d) for d in (0.0, 1.0)] == [1.0, 0.0]  # type: ignore[misc]
        assert off_at_the_start(graph, 0.0) == ("line",) and off_at_the_start(opened, 0.0) == ()

    def test_several_open_in_their_order_and_others_stay(self) -> None:
        second = """
  mode k = false
  1 more { active = k }
  1 by { active = time < 2 }
  0 c
  0 open { active = time < 1 }
  R l : e = f
  b -> more -> c -> l
  a -> by -> c
  c -> open
  when not k and b.e > c.e { k = true }
  when k and more.f < 0 { k = false }"""
        graph = graph_of(CHECK + second)
        opened, valves = with_gaps(graph)
        assert [v.junction for v in valves] == ["line.gap", "more.gap"]
        assert [v.mode for v in valves] == ["d", "k"]
        assert [s.junction for s in opened.switches] == ["line.gap", "more.gap", "by", "open"]
        assert [e.words for e in opened.events] == [e.words for e in graph.events]
        # The two-terminal switches: valves first, then gaps that something else decides; `by` is a line with two ends.
        assert switched_gaps(opened, valves) == ("line.gap", "more.gap", "open")
        assert switched_gaps(opened, valves[1:]) == ("more.gap", "line.gap", "open")


NEITHER = {
    "a hysteresis": DIODE.replace("gap.e > 0", "gap.e > 0.5"),
    "a flow below which it blocks": DIODE.replace("line.f < 0", "line.f < -0.5"),
    "both events with one sign": DIODE.replace("line.f < 0", "line.f > 0"),
    "two events that conduct": DIODE.replace("d = false }", "d = true }"),
    "one event": DIODE.replace(CONDUCT, ""),
    "a third event": DIODE + "\n when d and time > 3 { d = false }",
    "an event that sets two modes": DIODE.replace("d = true }", "d = true; k = 1 }") + "\n mode k = 0",
    "a sampled event": DIODE.replace(BLOCK, "every 1 { d = false }"),
    "a value that is computed": DIODE.replace("d = true }", "d = line.f < 1 }"),
    "events of two modes": DIODE.replace("d = true }", "k = 1 }") + "\n mode k = 0",
    "a condition without the mode": DIODE.replace("not d and gap.e > 0", "gap.e > 0"),
    "a condition for both values of the mode": DIODE.replace("not d and gap.e > 0", "(not d or gap.e > 5) and gap.e > 0"),
    "a condition of the wrong value": DIODE.replace("not d and gap", "d and gap"),
    "a condition on the wrong side": DIODE.replace("gap.e > 0", "line.f > 0"),
    "a condition on time": DIODE.replace("gap.e > 0", "time > 0"),
    "a condition on another effort or its own": DIODE.replace("gap.e > 0", "gap.e > 0 or r.e > 0"),
    "a condition on one side and the other": DIODE.replace("gap.e > 0", "gap.e > 0 and line.f >= 0"),
    "a condition that has no value": DIODE.replace("gap.e > 0", "sqrt(gap.e) > 0"),
    "no condition on a sum of which it lacks a part": CHECK.replace("a.e > b.e", "a.e > 0"),
    "a condition on a mode alone": DIODE.replace("not d and gap.e > 0", "not d"),
    "a condition on what is stored": DIODE.replace("gap.e > 0", "x.q > 0") + "\n C x : e = q\n line -> x",
    "a parameter decides": DIODE.replace("active = not d", "active = k < 1") + "\n parameter k = 2",
    "an input decides": DIODE.replace("active = not d", "active = k < 1") + "\n input k = 2",
    "time decides": DIODE.replace("active = not d", "active = time < 1"),
    "a flow decides": DIODE.replace("active = not d", "active = line.f < 1"),
    "a flow decides, too": DIODE.replace("active = not d", "active = not d or line.f < 1"),
    "another mode decides, too": DIODE.replace("active = not d", "active = not d or k") + "\n mode k = false",
    "it is on for both values": DIODE.replace("active = not d", "active = not d or d"),
}  # fmt: skip


@pytest.mark.parametrize("body", NEITHER.values(), ids=[name.replace(" ", "-") for name in NEITHER])
def test_no_valve(body: str) -> None:
    graph = graph_of(body)
    same, valves = with_gaps(graph)
    assert same is graph and not valves


@pytest.mark.parametrize(
    ("condition", "sign"),
    [
        ("gap.e > 0", 1.0), ("gap.e >= 0", 1.0), ("not (gap.e <= 0)", 1.0), ("0 > -3*gap.e/7", 1.0), ("3*gap.e > -gap.e", 1.0),
        ("gap.e > 1e-30", None), ("gap.e > -1e-30", None), ("gap.e != 0", None), ("gap.e == 0", None), ("gap.e^3 > 0", None), ("abs(gap.e) > 0", None),
        ("gap.e > 0 and gap.e < 1e9", None), ("gap.e > 0 or gap.e < -1e9", None), ("gap.e - gap.e > 0", None), ("gap.e > 0*d", 1.0), ("gap.e > d + 1", None),
        ("gap.e > r.e", None), ("gap.e > far.e", None), ("gap.e + far.e > 0", None), ("d*gap.e + gap.e > 0", None), ("gap.e*time > 0", None),
    ],
)  # fmt: skip
def test_conditions_on_an_effort(condition: str, sign: float | None) -> None:
    """No threshold is near enough to zero, and no further condition far enough away, to be left out."""
    body = f"{DIODE}\n Sf i : f = 3\n R l : e = f\n 0 far\n i -> far -> l".replace("gap.e > 0", condition)
    assert [v[2] for v in valves_of(body)] == ([sign] if sign is not None else [])


@pytest.mark.parametrize("further", ["b.e < 2", "a.e > -9", "b.e > 1e9*a.e", "b.e > far.e", "r.e == 0"])
@pytest.mark.parametrize("how", ["and", "or"])
def test_a_condition_on_a_part_of_the_sum_is_no_valve(how: str, further: str) -> None:
    body = CHECK.replace("a.e > b.e", f"(a.e > b.e {how} {further})")
    assert not valves_of(f"{body}\n Sf i : f = 3\n R l : e = f\n 0 far\n i -> far -> l")


@pytest.mark.parametrize("body", [DIODE, CHECK, CLUTCH])
@pytest.mark.parametrize("gate", ["k > 0.5", "time > 1", "(k > 2 or time > 3) and x.q > 1", "w.f > x.e"])
def test_a_gate_is_an_event_of_its_own(body: str, gate: str) -> None:
    """The one that makes it conduct asks for it: an effort or a flow alone remains, and the gate sets the same under a place of its own."""
    first = GRIP if body is CLUTCH else PASS if body is CHECK else CONDUCT
    ends = OPEN if body is CLUTCH else first
    more = "\n input k = 1\n C x : e = q\n Se w : e = 0\n w -> x"
    opened, (plain,) = with_gaps(graph_of(body + more))
    gated, (valve,) = with_gaps(graph_of(body.replace(ends, ends.replace(" {", f" and {gate} {{")) + more))
    assert valve.gate is not None and valve.gate[0] == valve.events[0][0]
    assert (valve.junction, valve.sign) == (plain.junction, plain.sign) and plain.gate is None
    place = next(i for i, e in enumerate(gated.events) if (e.name, e.span.start) == valve.gate)
    read = {a for a in gated.events[place].condition.arguments if isinstance(a, Reading)}
    assert {a.node for a in read} <= {"w", "x"}
    assert len(gated.events) == len(opened.events) + 1


@pytest.mark.parametrize("gate", ["(not d or time > 1)", "d + time < 2"])
def test_a_gate_that_reads_the_mode_is_none(gate: str) -> None:
    assert not valves_of(DIODE.replace("gap.e > 0", f"gap.e > 0 and {gate}"))


@pytest.mark.parametrize("threshold", ["5", "fire.e", "t.e"])
def test_a_threshold_may_be_read_from_another_part(threshold: str) -> None:
    """A thyristor on 10 V*sin(t) before 2 + 2 ohm that fires above 5 V, not above 0: at pi/6 s."""
    body = f"""
  mode d = false
  Se s : e = 10*sin(time)
  Se fire : e = 5
  R r, load : e = 2*f
  1 line
  0 gap {{ active = not d }}
  0 t
  fire -> t -> load
  s -> line -> gap
  line -> r
  when not d and gap.e > {threshold} {{ d = true }}
  when d and line.f < 0 {{ d = false }}
  output i = line.f"""
    found = bondgraph.load("plain model A {" + body + "\n}").simulate(to=1.0, points=11, rtol=1e-8)
    expected = [5 * math.sin(t) if t > math.pi / 6 else 0.0 for t in found.time]
    np.testing.assert_allclose(found["i"], expected, atol=1e-7)


class TestSums:
    """A condition on a sum names all that the sum has, except for what adds nothing while the junction is off."""

    @pytest.mark.parametrize(
        ("declaration", "is_valve"),
        [
            ("R more : e = 2*f", True), ("R more : f = 2*e", True), ("MR more : e = (1 + s.f)*f", True),
            ("MR more : e = f + a.f", False), ("R more : e = 2*f + 1", False), ("C more : e = 3*q", True),
            ("I more : p = 3*f", False), ("Sf more : f = 0", False), ("Se more : e = 1", False),
        ],
    )  # fmt: skip
    def test_beside_a_clutch(self, declaration: str, is_valve: bool) -> None:
        """No effort: neither a flow through a resistor nor into a spring."""
        assert bool(valves_of(f"{CLUTCH}\n {declaration}\n plates -> more")) == is_valve

    @pytest.mark.parametrize(
        ("declaration", "is_valve"),
        [
            ("R more : e = 2*f", True), ("R more : f = 2*e", True), ("R more : e = 2*f + 1", False),
            ("C more : e = 3*q", False), ("I more : p = 3*f", True), ("Se more : e = 0", False),
        ],
    )  # fmt: skip
    def test_in_line_with_a_check_valve(self, declaration: str, is_valve: bool) -> None:
        """No flow: neither an effort over a resistor nor at a mass."""
        graph = graph_of(f"{CHECK}\n {declaration}\n line -> more")
        opened, valves = with_gaps(graph)
        assert bool(valves) == is_valve
        if valves:
            assert holds(opened, 0, {"d": 0.0, "line.gap.e": 1e-15})
            assert not holds(opened, 0, {"d": 0.0, "line.gap.e": -1e-15})

    def test_a_resistor_with_two_ports_does_not_rest(self) -> None:
        """Its other port may give an effort to the line."""
        body = f"{CHECK}\n R both(x, y) : x.e = x.f + y.f, y.e = x.f + y.f\n line -> both.x\n b -> both.y"
        assert not valves_of(body)

    def test_a_storage_of_two_ports_does_not_rest(self) -> None:
        body = f"{CLUTCH}\n C both(x, y) : x.e = x.q, y.e = y.q\n plates -> both.x\n a -> both.y"
        assert not valves_of(body)

    def test_what_rests_may_be_named_and_counts_as_nothing(self) -> None:
        body = f"{CHECK}\n R more : e = 2*f\n line -> more".replace("a.e > b.e", "a.e - more.e > b.e")
        graph = graph_of(body)
        opened, valves = with_gaps(graph)
        assert [v.junction for v in valves] == ["line.gap"]
        assert holds(opened, 0, {"d": 0.0, "line.gap.e": 1e-15})

    def test_a_line_whose_sum_is_of_resistors_alone_is_no_valve(self) -> None:
        """Nothing in its sum could move it."""
        body = """
  mode d = false
  R r, l : e = 2*f
  1 line { active = d }
  line -> r, l
  when not d and r.e > l.e { d = true }
  when d and line.f < 0 { d = false }"""
        assert not valves_of(body)

    @pytest.mark.parametrize(
        ("condition", "sign"),
        [("a.e > b.e + v.e", 1.0), ("b.e + v.e > a.e", -1.0), ("2*(v.e + b.e) < 2*a.e", 1.0), ("a.e > v.e - b.e", None), ("a.e > b.e - v.e", None)],
    )  # fmt: skip
    def test_arrows_into_the_line_add_and_arrows_out_of_it_subtract(self, condition: str, sign: float | None) -> None:
        body = f"{CHECK}\n Se v : e = 1\n 0 c\n line -> c -> v".replace("a.e > b.e", condition)
        body = body.replace("line.f < 0", "line.f > 0") if sign == -1.0 else body
        graph = graph_of(body)
        opened, valves = with_gaps(graph)
        assert [v.sign for v in valves] == ([sign] if sign is not None else [])
        if sign is not None:
            for x in (-3.0, -1e-15, 1e-15, 3.0):
                assert holds(opened, 0, {"d": 0.0, "line.gap.e": x}) == (sign * x > 0)

    def test_a_condition_may_name_the_sum_from_its_far_end(self) -> None:
        """The first group of the sum is that of b, with a minus: where it stands the gap's effort stands, turned."""
        body = CHECK.replace("s -> a -> line -> b -> r", "line -> b -> r\n s -> a -> line")
        opened, valves = with_gaps(graph_of(body))
        assert [v.sign for v in valves] == [1.0]
        for x in (-3.0, -1e-15, 0.0, 1e-15, 3.0):
            assert holds(opened, 0, {"d": 0.0, "line.gap.e": x}) == (x > 0)

    @pytest.mark.parametrize("between", ["1 m\n b -> r", "1 m, n\n n -> x\n R x : e = f\n b -> r"])
    def test_junctions_of_its_kind_beside_it_are_one_with_it(self, between: str) -> None:
        chain = "m -> n" if "n ->" in between else "m"
        body = CHECK.replace("s -> a -> line -> b -> r", f"{between}\n s -> a -> {chain} -> line -> b")
        graph = graph_of(body)
        opened, valves = with_gaps(graph)
        assert [summary(graph, v) for v in valves] == [("line.gap", 1.0, 1.0, words(PASS), words(SHUT))]
        assert holds(opened, 0, {"d": 0.0, "line.gap.e": 1e-15})

    def test_its_flow_may_be_read_at_a_junction_beside_it(self) -> None:
        body = CHECK.replace("line.f < 0", "m.f < 0").replace("s -> a -> line", "1 m\n s -> a -> m -> line")
        assert [v[0] for v in valves_of(body)] == ["line.gap"]

    def test_a_ring_of_junctions_beside_it_is_walked_once(self) -> None:
        body = CHECK.replace("a -> line", "a -> m\n 1 m, n, o\n m -> n -> line\n m -> o -> line").replace(
            "-> r", "\n b -> r"
        )
        body = body.replace("s -> a -> m", "s -> a\n a -> m").replace("-> line -> b", "-> line\n line -> b")
        graph = graph_of(body)
        assert [n.name for n in graph.nodes if n.kind is Kind.ONE] == ["line", "m", "n", "o"]
        assert len(with_gaps(graph)[1]) <= 1

    def test_a_switched_junction_of_its_kind_beside_it_is_an_end(self) -> None:
        """What lies behind it is not in the sum while it is off."""
        body = CHECK.replace("s -> a -> line", "1 m { active = time < 2 }\n s -> a -> m -> line")
        assert not valves_of(body)

    def test_a_loop_through_a_node_cancels(self) -> None:
        """An arrow into the line and one out of it, from the same node: its effort is not in the sum."""
        body = CHECK.replace("-> b -> r", "-> b -> r\n 0 c\n Se v : e = 3\n v -> c\n c -> line -> c")
        assert [v[0] for v in valves_of(body)] == ["line.gap"]
        assert not valves_of(body.replace("a.e > b.e", "a.e > b.e + c.e"))


class TestReadings:
    """Efforts and flows may be read wherever the bonds share them."""

    @pytest.mark.parametrize("condition", ["s.e > r.e", "a.e > r.e", "s.e > b.e"])
    def test_of_elements_and_of_junctions(self, condition: str) -> None:
        opened, valves = with_gaps(graph_of(CHECK.replace("a.e > b.e", condition)))
        assert [v.junction for v in valves] == ["line.gap"]
        assert holds(opened, 0, {"d": 0.0, "line.gap.e": 1e-15})

    def test_of_ports_of_a_model(self) -> None:
        body = """model Pipe {
  port inlet: translation "arrow in", outlet: translation "arrow out"
  mode d = false
  1 line : translation { active = d }
  inlet -> line -> outlet
  when not d and inlet.F > outlet.F { d = true }
  when d and inlet.v < 0 [m/s] { d = false }
}
model A {
  Se s : F = 1 N
  R r : F = 2 [N*s/m]*v
  0 a, b : translation
  Pipe pipe
  s -> a -> pipe.inlet
  pipe.outlet -> b -> r
}"""
        graph = compiled(body, model="A").whole_graph
        opened, valves = with_gaps(graph)
        assert [(v.junction, v.mode, v.sign) for v in valves] == [("pipe.line.gap", "pipe.d", 1.0)]
        assert holds(opened, 0, {"pipe.d": 0.0, "pipe.line.gap.e": 1e-15})
        assert opened.walls == {**graph.walls, ("pipe.line.gap", "in"): len(graph.bonds)}

    def test_of_one_port_of_several(self) -> None:
        """Only one port of the resistor is at the line, although both have efforts."""
        body = f"{CHECK}\n R both(x, y) : x.e = 3*x.f + y.f, y.e = x.f + 2*y.f\n a -> both.x\n line -> both.y"
        assert [v[0] for v in valves_of(body.replace("a.e > b.e", "a.e > b.e + both.y.e"))] == ["line.gap"]
        assert not valves_of(body.replace("a.e > b.e", "a.e > b.e + both.x.e"))

    def test_of_nothing_that_a_bond_carries(self) -> None:
        graph = graph_of(CHECK)
        stored = replace(
            graph.events[0].condition, arguments=(Quantity("d"), Reading("r", "", "q"), Reading("s", "", "e"))
        )
        unknown = replace(stored, arguments=(Quantity("d"), Reading("nothing", "", "e"), Reading("s", "", "e")))
        for condition in (stored, unknown):
            events = (replace(graph.events[0], condition=condition), graph.events[1])
            assert not with_gaps(replace(graph, events=events))[1]
