"""The companion network: one step of the implicit Euler method, against its equations solved by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from compiler.algebra.expression import evaluate, symbols
from compiler.compilation import Compilation
from compiler.equations.companion import companion, companion_inputs, is_curved
from compiler.graph.elements import Kind
from compiler.graph.network import BondGraph, Bound, Element, Named, PortVariable, Quantity, Reading
from compiler.scene import Scene
from compiler.source import Source
from tests.compiling import LIBRARY, Running, compiled

SWITCHED = """
  mode d = false
  0 gap { active = not d }
  when not d and gap.e > 0 { d = true }
  when d and line.f < 0 { d = false }
  Se s : e = 7
  R r : e = 2*f
  1 line
  s -> line -> gap
  line -> r
"""
H, Z, WAVE = 0.01, 2.5, 0.3
STEPPED = {"step of the companion": H, "impedance of the valves": Z, "wave of gap": WAVE}


def stepped(body: str, values: Mapping[str, float], state: Mapping[str, float] | None = None) -> dict[str, float]:
    """Outputs of the companion of a model with a gap."""
    made = Compilation(
        Source("text.bg", "plain model A {\n" + SWITCHED + body + "\n}"), Scene(companion=True, off=()), LIBRARY
    )
    running = Running(made)
    assert set(running.rates().values()) <= {0.0}  # what is stored does not move
    return running.outputs(state, inputs=values)


def companion_of(body: str, ports: tuple[str, ...] = ("gap",)) -> tuple[BondGraph, BondGraph]:
    graph = compiled("plain model A {\n" + SWITCHED + body + "\n}").whole_graph
    return graph, companion(graph, ports)


def element(graph: BondGraph, name: str) -> Element:
    (found,) = (n for n in graph.nodes if n.name == name)
    assert isinstance(found, Element)
    return found


class TestOneStep:
    @pytest.mark.parametrize("wave", [0.0, WAVE, -3.0])
    def test_a_capacitor_in_line(self, wave: float) -> None:
        """7 = 2 f + (q_0 + h f)/3 + a + z f."""
        values = STEPPED | {"wave of gap": wave}
        found = stepped(" C c : e = q/3 { start q = 5 }\n line -> c", values)
        f = (7 - 5 / 3 - wave) / (2 + H / 3 + Z)
        assert found == pytest.approx({"gap e": wave + Z * f, "gap f": f}, rel=1e-13)

    def test_an_inertia_in_line(self) -> None:
        """f = (p_0 + h e)/4 with 7 = 2 f + e + a + z f."""
        found = stepped(" I l : p = 4*f { start p = 2 }\n line -> l", STEPPED)
        f = (2 + H * (7 - WAVE)) / (4 + H * (2 + Z))
        assert found == pytest.approx({"gap e": WAVE + Z * f, "gap f": f}, rel=1e-13)

    @pytest.mark.parametrize("jump", [0.0, 0.2])
    def test_a_curved_capacitor_is_a_straight_line_where_it_is(self, jump: float) -> None:
        """e = e(q) + e'(q) (h f - jump) with e = 2 q + q^3."""
        body = " C c : e = 2*q + q^3 { start q = 0.5 }\n line -> c"
        found = stepped(body, STEPPED | {"jump of c.q": jump}, {"c.q": 0.7})
        e, slope = 2 * 0.7 + 0.7**3, 2 + 3 * 0.7**2
        f = (7 - e + slope * jump - WAVE) / (2 + slope * H + Z)
        expected = {"gap e": WAVE + Z * f, "gap f": f, "rate of what passes to c.q": f}
        assert found == pytest.approx(expected, rel=1e-13)

    @pytest.mark.parametrize("jump", [0.0, -0.4])
    def test_a_curved_inertia(self, jump: float) -> None:
        """f = f(p) + f'(p) (h e - jump) with f = p + p^3."""
        found = stepped(
            " I l : f = p + p^3 { start p = 0.5 }\n line -> l", STEPPED | {"jump of l.p": jump}, {"l.p": 0.6}
        )
        flow, slope = 0.6 + 0.6**3, 1 + 3 * 0.6**2
        e = ((7 - WAVE) - (2 + Z) * (flow - slope * jump)) / (1 + (2 + Z) * slope * H)
        f = flow + slope * (H * e - jump)
        expected = {"gap e": WAVE + Z * f, "gap f": f, "rate of what passes to l.p": e}
        assert found == pytest.approx(expected, rel=1e-13)

    @pytest.mark.parametrize("jumps", [(0.0, 0.0), (0.3, 0.0), (0.0, -0.2), (0.3, -0.2)])
    def test_a_curved_storage_of_two_ports(self, jumps: tuple[float, float]) -> None:
        """energy q1^2 + q1^2 q2 + 2 q2^2, one port in the line of the valve and the other on its own source over 5."""
        body = """
  C c(x, y) : energy = x.q^2 + x.q^2*y.q + 2*y.q^2
  Se t : e = 4
  R l : e = 5*f
  1 more
  t -> more -> l
  more -> c.y
  line -> c.x"""
        q = {"c.x": 0.6, "c.y": 0.9}
        found = stepped(body, STEPPED | {"jump of c.x": jumps[0], "jump of c.y": jumps[1]}, q)
        x, y = q.values()
        stored, slopes = np.array([2 * x + 2 * x * y, x**2 + 4 * y]), np.array([[2 + 2 * y, 2 * x], [2 * x, 4.0]])
        f = np.linalg.solve(
            np.diag([2 + Z, 5]) + H * slopes, np.array([7 - WAVE, 4]) - stored + slopes @ np.array(jumps)
        )
        expected = {"gap e": WAVE + Z * f[0], "gap f": f[0]}
        expected |= {"rate of what passes to c.x": f[0], "rate of what passes to c.y": f[1]}
        assert found == pytest.approx(expected, rel=1e-12)

    def test_a_storage_of_a_displacement_and_a_momentum(self) -> None:
        """energy 3 q^2 + p^2/8 + 0.1 q p; the port of the momentum between a source over 5 and the ground."""
        body = """
  IC c(x, y) : energy = 3*x.q^2 + y.p^2/8 + 0.1*x.q*y.p
  Se t : e = 4
  R l : e = 5*f
  1 more
  t -> more -> l
  more -> c.y
  line -> c.x"""
        found = stepped(body, STEPPED, {"c.x": 0.6, "c.y": 0.9})
        # e_x = 6 q + 0.1 p + h (6 f_x + 0.1 e_y), f_y = p/4 + 0.1 q + h (e_y/4 + 0.1 f_x); 7 = (2 + z) f_x + a + e_x; 4 = 5 f_y + e_y
        matrix = np.array([[2 + Z + 6 * H, 0.1 * H], [5 * 0.1 * H, 1 + 5 * H / 4]])
        right = np.array([7 - WAVE - 6 * 0.6 - 0.1 * 0.9, 4 - 5 * (0.9 / 4 + 0.1 * 0.6)])
        f, _ = np.linalg.solve(matrix, right)
        assert found == pytest.approx({"gap e": WAVE + Z * f, "gap f": f}, rel=1e-12)

    def test_two_ports_in_their_order(self) -> None:
        body = """
  0 other { active = time < 1 }
  1 more
  0 n
  line -> n -> more -> other
  n -> l
  R l : e = 3*f"""
        found = stepped(body, {"impedance of the valves": Z, "wave of gap": WAVE, "wave of other": -0.7})
        # The node n has f in, into l and `other`: 3 (f - g) = -0.7 + z g and 7 = 2 f + 0.3 + z f + 3 (f - g).
        f, g = np.linalg.solve([[5 + Z, -3], [3, -3 - Z]], [7 - WAVE, -0.7])
        expected = {"gap e": WAVE + Z * f, "gap f": f, "other e": -0.7 + Z * g, "other f": g}
        assert found == pytest.approx(expected, rel=1e-12)
        assert list(found) == ["gap e", "other e", "gap f", "other f"]

    def test_rates_and_factors_of_integrals(self) -> None:
        """The capacitor is read over the step, and its charge as it is."""
        body = " C c : e = q/3 { start q = 5 }\n line -> c\n signal w = integral(c.e*line.f + c.q*s.f, 0)"
        found = stepped(body, STEPPED)
        f = (7 - 5 / 3 - WAVE) / (2 + H / 3 + Z)
        e = (5 + H * f) / 3
        expected = {"gap e": WAVE + Z * f, "gap f": f, "rate of w": e * f + 5 * f, "rate of what passes to c.q": f}
        factors = {name: value for name, value in found.items() if name.startswith("factor")}
        assert {n: v for n, v in found.items() if n not in factors} == pytest.approx(expected, rel=1e-13)
        assert sorted(factors) == ["factor 0 of w", "factor 1 of w", "factor 2 of w"]
        assert sorted(factors.values()) == pytest.approx(sorted([e, f, f]), rel=1e-13)

    def test_a_signal_and_a_law_read_what_a_storage_has_over_the_step(self) -> None:
        """The resistance is 3 + c.e, with the effort after the step: 7 = (2 + 1) f + a + z f + e + e f is solved by its own fixed point."""
        body = " C c : e = q/3 { start q = 5 }\n line -> c\n signal w = 1 + k.f\n MR x : e = w*f\n line -> x\n Sf k : f = 0.5\n 0 n\n k -> n -> y\n C y : e = 4*q"
        found = stepped(body.replace("1 + k.f", "1 + y.e"), STEPPED)
        y = 4 * H * 0.5
        f = (7 - 5 / 3 - WAVE) / (2 + 1 + y + H / 3 + Z)
        assert found == pytest.approx({"gap e": WAVE + Z * f, "gap f": f}, rel=1e-13)


CURVED = {"e = q^3": True, "e = 4*q": False, "e = 4*q + 1": False, "q = 2*e": False, "q = exp(e)": True, "q = e - e^3": False}  # fmt: skip


@pytest.mark.parametrize(("law", "curved"), CURVED.items())
def test_curved_laws(law: str, curved: bool) -> None:
    """The last one is not curved, as it has no integral form at all."""
    graph, made = companion_of(f" C c : {law}\n line -> c")
    assert is_curved(element(graph, "c")) == curved
    jumps = ("jump of c.q",) if curved else ()
    assert companion_inputs(graph, ("gap", "b")) == (
        "step of the companion", "impedance of the valves", "wave of gap", "wave of b", *jumps,
    )  # fmt: skip
    assert ("rate of what passes to c.q" in made.outputs) == curved
    names = {n.name for n in made.nodes}
    # Without an integral form it stays as it is, on its own bond.
    assert ("c over one step" in names) == ("c at rest" in names) == (law != "q = e - e^3")
    if law == "q = e - e^3":
        assert element(made, "c") == element(graph, "c") and made.bonds == graph.bonds


@pytest.mark.parametrize("law", ["y.e = x.q*y.q, x.e = y.q^2/2", "x.e = y.q + 0*x.q, y.e = x.q"])
def test_curved_laws_of_two_ports(law: str) -> None:
    """Two storages of one part, one of them linear in each alone."""
    graph, _ = companion_of(f" C c(x, y) : {law}\n line -> c.x\n line -> c.y")
    assert is_curved(element(graph, "c")) == ("^2" in law)


class TestParts:
    BODY = """
  C c : e = q^3 + k { start q = 5; nominal q = 3; prefer = derivative }
  parameter k = 1
  IC f(x, y) : energy = 3*x.q^2 + y.p^2/8 { prefer = integral }
  line -> c
  line -> f.x
  n -> f.y
  0 n
  line -> n
  output y = c.e, g = gap.e
  require c.e < 100 "too much"
"""

    def test_each_law_has_its_arguments(self) -> None:
        """The number of slots is that of the arguments, and each slot of a law that is made is used or belongs to the law as written."""
        _, made = companion_of(self.BODY)
        for node in made.nodes:
            if isinstance(node, Element):
                slots = {
                    s.key
                    for pair in node.law.equations
                    for x in pair
                    for s in symbols(x)
                    if not isinstance(s.key, PortVariable)
                }
                assert node.law.arity == len(node.arguments) and slots <= {*range(node.law.arity)}
        port = element(made, "gap")
        assert port.modulated and port.kind is Kind.RESISTOR
        assert port.arguments == (Quantity("wave of gap"), Quantity("impedance of the valves"))
        resistor = element(made, "c over one step")
        assert resistor.modulated and resistor.kind is Kind.RESISTOR and resistor.stored == ()
        assert resistor.arguments == (
            Quantity("k"), Reading("c", "", "e"), Reading("c", "", "q"), Quantity("step of the companion"), Quantity("jump of c.q"),
        )  # fmt: skip
        field = element(made, "f over one step")
        assert field.arguments == (
            Reading("f", "x", "e"), Reading("f", "y", "f"), Reading("f", "x", "q"), Reading("f", "y", "p"), Quantity("step of the companion"),
        )  # fmt: skip

    def test_what_is_stored_stands_between_sources_of_nothing(self) -> None:
        graph, made = companion_of(self.BODY)
        places = {n.name: i for i, n in enumerate(made.nodes)}
        for name, kinds in (("c", [("c at rest", Kind.FLOW_SOURCE, "f")]), ("f", [("f at rest", Kind.FLOW_SOURCE, "f"), ("f at rest 2", Kind.EFFORT_SOURCE, "e")])):  # fmt: skip
            stored = element(made, name)
            assert (stored.starts, stored.nominals, stored.law) == (
                element(graph, name).starts,
                element(graph, name).nominals,
                element(graph, name).law,
            )
            assert stored.prefer is None and element(made, f"{name} over one step").prefer is None
            for port, (rest, kind, variable) in enumerate(kinds):
                source = element(made, rest)
                ((left, right),) = source.law.equations
                assert source.kind is kind and left.key == PortVariable(0, variable) and evaluate(right, float) == 0.0  # type: ignore[attr-defined]
                assert not source.modulated and source.law.arity == 0
                (bond,) = (made.bonds[b] for b in made.incident[places[rest]])
                assert bond.tail == (places[rest], 0) and bond.head == (places[name], port)

    def test_inputs_outputs_and_what_is_left_out(self) -> None:
        graph, made = companion_of(self.BODY)
        assert graph.requirements and graph.events
        assert not made.requirements and not made.events
        assert {n: q.name for n, q in made.outputs.items()} == {n: n for n in made.outputs}
        assert all(b.formula.arity == len(b.arguments) for b in made.definitions())
        assert list(made.outputs) == ["gap e", "gap f", "rate of what passes to c.q"]
        starts = {"step of the companion": 1e-6, "impedance of the valves": 1.0, "wave of gap": 0.0, "jump of c.q": 0.0}
        assert {n: value(q) for n, q in made.quantities.items() if q.role == "input"} == starts
        assert [n for n, q in made.quantities.items() if q.role != "input"] == [*graph.quantities]

    def test_a_model_without_integrals_tells_what_passes_to_curved_storages_alone(self) -> None:
        _, made = companion_of(f"{self.BODY}\n signal w = integral(line.f, 0)")
        passing = [n for n in made.outputs if n.startswith("rate of what")]
        assert passing == ["rate of what passes to c.q", "rate of what passes to f.x", "rate of what passes to f.y"]
        readings = [bound(made.outputs[n]).arguments for n in passing]
        resistor = "f over one step"
        assert readings == [(Reading("c over one step", "", "f"),), (Reading(resistor, "x", "f"),), (Reading(resistor, "y", "e"),)]  # fmt: skip

    def test_readings_of_efforts_and_flows_go_to_the_resistors(self) -> None:
        """Charges, other elements and what is not read stay as they are."""
        body = f"""{self.BODY}
  signal w = c.e + c.q + r.f, v = delay(c.f, 1)
  signal i = integral(c.f*c.q, 0)
  R l : e = f
  MR m : e = (2 + c.f + c.q)*f
  line -> m
  0 sw {{ active = c.e < 3 }}
  line -> sw -> l
  parameter free
"""
        graph, made = companion_of(body.replace("parameter free\n", "input free = 0\n"))
        over = "c over one step"
        assert set(bound(made.quantities["w"]).arguments) == {
            Reading(over, "", "e"),
            Reading("c", "", "q"),
            Reading("r", "", "f"),
        }
        assert set(made.integrals["i"].rate.arguments) == {Reading(over, "", "f"), Reading("c", "", "q")}
        assert made.integrals["i"].start == graph.integrals["i"].start
        (delay,) = made.delays.values()
        assert delay.value.arguments == (Reading(over, "", "f"),)
        assert set(element(made, "m").arguments) == {Reading(over, "", "f"), Reading("c", "", "q")}
        assert made.switches == ()  # its junctions stay as they are


def bound(named: Named) -> Bound:
    assert named.definition is not None
    return named.definition


def value(named: Named) -> float:
    return evaluate(bound(named).formula.expression, float)
