"""Currents through loops of closed switches, and voltages of parts behind open ones, against the limit of equal small resistances and leakages."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import networkx as nx
import numpy as np
import pytest
import sympy

from compiler.compilation import Compilation
from compiler.errors import CompilationFailed
from compiler.graph.elements import Kind
from compiler.graph.sharing import Row, _eliminated, groups
from compiler.graph.switch import switch_off
from compiler.scene import Scene
from compiler.source import Source
from tests.compiling import LIBRARY, Running


@dataclass(frozen=True)
class Branch:
    """A line from one node to another: `kind` is R, Se, Sf, on or off (valves), or their plain forms On and Off."""

    a: int
    b: int
    kind: str
    value: float = 0.0
    number: int = 1  # of switches in the line


def named(k: int, x: Branch) -> list[tuple[str, str]]:
    """Names of the switches of a line and of their modes."""
    return [(f"x{k}", f"d{k}"), *((f"x{k}_{i}", f"d{k}_{i}") for i in range(1, x.number))]


def compilation(branches: list[Branch]) -> Compilation:
    lines = ["Se earth : e = 0", "earth -> n0"]
    lines += [f"0 n{k}" for k in sorted({0, *(n for x in branches for n in (x.a, x.b))})]
    for k, x in enumerate(branches):
        lines += [f"1 b{k}", f"n{x.a} -> b{k} -> n{x.b}", f"output f{k} = b{k}.f"]
        match x.kind:
            case "R":
                lines += [f"R x{k} : e = {x.value}*f", f"b{k} -> x{k}"]
            case "Se" | "Sf":
                lines += [f"{x.kind} x{k} : {x.kind[1]} = {x.value}", f"x{k} -> b{k}"]
            case "on" | "off":
                lines += [f"mode {v} = false\n0 {n} {{ active = not {v} }}\nb{k} -> {n}" for n, v in named(k, x)]
                lines += [f"when not {v} and {n}.e > 0 {{ {v} = true }}" for n, v in named(k, x)]
                lines += [f"when {v} and b{k}.f < 0 {{ {v} = false }}" for _, v in named(k, x)]
            case _:
                lines += [f"0 {n} {{ active = time < 1 }}\nb{k} -> {n}" for n, _ in named(k, x)]
        lines += [f"output e{k} = x{k}.e"] if x.kind in ("off", "Off") else []
    text = "plain model A {\n" + "\n".join(lines) + "\n}"
    closed = tuple(n for k, x in enumerate(branches) if x.kind in ("on", "On") for n, _ in named(k, x))
    return Compilation(Source("text.bg", text), Scene(off=closed), LIBRARY)


def solution(branches: list[Branch]) -> dict[str, float] | None:
    """Flows of all branches and efforts of the open ones: of all solutions the one with the least squares of what the switches carry.

    None if there is none, or if the valves among them do not decide it.
    """
    nodes, count = 1 + max(n for x in branches for n in (x.a, x.b)), len(branches)
    drop = np.zeros((count, nodes + count))
    matrix, right = np.zeros((nodes + count, nodes + count)), np.zeros(nodes + count)
    matrix[0, 0] = 1.0  # the earth
    for k, x in enumerate(branches):
        drop[k, x.a] += 1
        drop[k, x.b] -= 1
        for node, sign in ((x.a, -1), (x.b, 1)):
            if node:
                matrix[node, nodes + k] += sign
        row = nodes + k
        if x.kind in ("Sf", "off", "Off"):
            matrix[row, nodes + k], right[row] = 1.0, x.value
        else:
            matrix[row] = drop[k]
            matrix[row, nodes + k] = -x.value if x.kind == "R" else 0.0
            right[row] = -x.value if x.kind == "Se" else 0.0
    found = np.linalg.lstsq(matrix, right, rcond=None)[0]
    if np.abs(matrix @ found - right).max() > 1e-9:
        return None
    _, sizes, basis = np.linalg.svd(matrix)
    free = basis[sizes < 1e-9].T
    # Equal resistances add up in a line, and leakages get less.
    switches = [(k, x.kind, x.number**0.5) for k, x in enumerate(branches) if x.kind.lower() in ("on", "off")]
    carried = [np.eye(nodes + count)[nodes + k] * w if kind in ("on", "On") else drop[k] / w for k, kind, w in switches]
    valves = [i for i, (_, kind, _) in enumerate(switches) if kind.islower()]
    if free.size:
        moved = np.array(carried) @ free if carried else np.zeros((0, free.shape[1]))
        if np.linalg.matrix_rank(moved[valves], 1e-9) < free.shape[1]:
            return None
        found = found - free @ np.linalg.lstsq(moved, np.array(carried) @ found, rcond=None)[0]
    expected = {f"f{k}": found[nodes + k] for k in range(count)}
    return expected | {f"e{k}": drop[k] @ found / x.number for k, x in enumerate(branches) if x.kind in ("off", "Off")}


def agree(branches: list[Branch]) -> None:
    expected = solution(branches)
    assert expected is not None
    assert Running(compilation(branches)).outputs() == pytest.approx(expected, rel=1e-9, abs=1e-9)


class TestLoopsOfClosedSwitches:
    def test_two_beside_each_other_share_a_current(self) -> None:
        agree([Branch(0, 1, "Sf", 6.0), Branch(1, 0, "on"), Branch(1, 0, "on")])

    def test_three_of_which_two_are_in_line(self) -> None:
        """6 divides 4 : 2, as the resistances are 1 : 2."""
        branches = [Branch(0, 1, "Sf", 6.0), Branch(1, 0, "on"), Branch(1, 2, "on"), Branch(0, 2, "on")]
        expected = solution(branches)
        assert expected == pytest.approx({"f0": 6.0, "f1": 4.0, "f2": 2.0, "f3": -2.0})
        agree(branches)

    def test_switches_beside_valves(self) -> None:
        agree([Branch(0, 1, "Sf", 6.0), Branch(1, 0, "on"), Branch(1, 0, "On"), Branch(1, 0, "on")])

    @pytest.mark.parametrize(("first", "second"), [(2, 1), (1, 2), (2, 2), (3, 2)])
    def test_several_in_one_line(self, first: int, second: int) -> None:
        """Their resistances add up."""
        branches = [Branch(0, 1, "Sf", 6.0), Branch(1, 0, "on", 0.0, first), Branch(1, 0, "on", 0.0, second)]
        expected = solution(branches)
        assert expected is not None and expected["f1"] == pytest.approx(6 * second / (first + second))
        agree(branches)

    def test_a_valve_and_a_switch_in_one_line(self) -> None:
        """A loop of a plain switch and a line with both."""
        text = """plain model A {
  Se earth : e = 0
  Sf i : f = 6
  0 n
  1 a, b
  i -> n -> a -> x
  n -> b -> w
  a -> y
  a -> z
  b -> z
  0 z
  z -> earth
  mode d = false
  0 x { active = not d }
  0 y, w { active = time < 1 }
  when not d and x.e > 0 { d = true }
  when d and a.f < 0 { d = false }
  output f = a.f, g = b.f
}"""
        made = Compilation(Source("text.bg", text), Scene(off=("x", "y", "w")), LIBRARY)
        assert Running(made).outputs() == pytest.approx({"f": 2.0, "g": 4.0}, rel=1e-12)

    def test_switches_alone_are_not_shared(self) -> None:
        """The text decides them, and the loop is refused as any other one."""
        branches = [
            Branch(0, 1, "Sf", 6.0),
            Branch(1, 0, "On"),
            Branch(1, 0, "On"),
            Branch(0, 2, "Sf", 1.0),
            Branch(2, 0, "on"),
        ]
        with pytest.raises(CompilationFailed):
            _ = compilation(branches).program

    def test_a_bridge_of_valves(self) -> None:
        ring = [Branch(1, 2, "on"), Branch(1, 3, "on"), Branch(2, 0, "on"), Branch(3, 0, "on"), Branch(2, 3, "on")]
        agree([Branch(0, 1, "Sf", 5.0), *ring])
        agree([Branch(0, 2, "Sf", 5.0), Branch(0, 3, "Sf", -2.0), *ring])

    def test_a_loop_with_a_resistor_is_determined(self) -> None:
        agree([Branch(0, 1, "Sf", 6.0), Branch(1, 0, "on"), Branch(1, 2, "on"), Branch(2, 0, "R", 3.0)])


class TestPartsBehindOpenSwitches:
    def test_a_voltage_over_two_in_line(self) -> None:
        agree([Branch(0, 1, "Se", 6.0), Branch(1, 2, "off"), Branch(2, 0, "off")])

    def test_several_in_one_line(self) -> None:
        agree([Branch(0, 1, "Se", 6.0), Branch(1, 2, "off", 0.0, 2), Branch(2, 0, "off")])
        agree([Branch(0, 1, "Se", 6.0), Branch(1, 0, "off", 0.0, 3)])

    def test_a_voltage_over_several(self) -> None:
        """Node 2 hangs between 6 V and 0 on one and two leakages: 2 V."""
        branches = [Branch(0, 1, "Se", 6.0), Branch(1, 2, "off"), Branch(2, 0, "off"), Branch(0, 2, "off")]
        expected = solution(branches)
        assert expected is not None
        assert [expected[f"e{k}"] for k in (1, 2, 3)] == pytest.approx([4.0, 2.0, -2.0])
        agree(branches)

    def test_switches_beside_valves(self) -> None:
        agree([Branch(0, 1, "Se", 6.0), Branch(1, 2, "off"), Branch(2, 0, "Off")])

    def test_a_part_with_a_resistor_and_a_source_floats(self) -> None:
        part = [Branch(2, 3, "R", 2.0), Branch(3, 4, "Se", 1.5)]
        agree([Branch(0, 1, "Se", 6.0), *part, Branch(1, 2, "off"), Branch(4, 0, "off"), Branch(3, 0, "off")])

    def test_closed_and_open_ones(self) -> None:
        agree([
            Branch(0, 1, "Se", 6.0), Branch(1, 2, "on"), Branch(2, 3, "off"), Branch(3, 0, "off"), Branch(2, 4, "on"), Branch(4, 0, "R", 2.0),
            Branch(2, 4, "on"), Branch(1, 4, "on"),
        ])  # fmt: skip


def random_branches(seed: int) -> list[Branch]:
    numbers = np.random.default_rng(seed)
    nodes = int(numbers.integers(3, 6))
    kinds = ["on", "on", "off", "off", "On", "Off", "R"]
    found = []
    for _ in range(int(numbers.integers(4, 9))):
        a, b = (int(n) for n in numbers.choice(nodes, 2, replace=False))
        kind = str(numbers.choice(kinds))
        number = 1 + int(kind in ("on", "off") and numbers.integers(3) == 0)
        found.append(Branch(a, b, kind, float(numbers.integers(1, 5)) if kind == "R" else 0.0, number))
    for kind in ("Se", "Sf"):
        a, b = (int(n) for n in numbers.choice(nodes, 2, replace=False))
        found.append(Branch(a, b, kind, float(numbers.integers(1, 9))))
    return found


SEEDS = [s for s in range(400) if solution(random_branches(s)) is not None][:24]


@pytest.mark.parametrize("seed", SEEDS)
def test_random_circuits(seed: int) -> None:
    agree(random_branches(seed))


class TestLinesThatAreOff:
    """Each bond of a 1-junction that is off ends at a source of no flow."""

    BODY = """plain model A {
  Se s : e = 6
  Se t : e = 4
  R r : e = 2*f
  1 l1, l2, l3 { active = time < 1 }
  1 m
  0 n, o
  s -> l1 -> m -> n -> l2 -> r
  t -> m
  m -> o -> l3
  l3 -> r3
  R r3 : e = f
  output at_n = n.e, at_o = o.e
}"""

    def outputs(self, off: tuple[str, ...], body: str = BODY) -> dict[str, float]:
        return Running(Compilation(Source("text.bg", body), Scene(off=off), LIBRARY)).outputs()

    def test_those_that_hold_one_flow_at_zero_share_its_effort(self) -> None:
        """e_1 + 4 = n + o, in three equal parts."""
        assert self.outputs(("l1", "l2", "l3")) == pytest.approx({"at_n": 4 / 3, "at_o": 4 / 3}, rel=1e-14)

    def test_one_leaves_nothing_open(self) -> None:
        """All of 6 + 4 is over the line that is off."""
        body = self.BODY.replace("m -> o -> l3\n  l3 -> r3\n  R r3 : e = f", "").replace("0 n, o", "0 n")
        body = body.replace(", at_o = o.e", "").replace("l1, l2, l3 {", "l2 {").replace("1 m", "1 m, l1")
        assert self.outputs(("l2",), body) == pytest.approx({"at_n": 10.0}, rel=1e-14)


class TestGroupsAndRows:
    @pytest.mark.parametrize("seed", range(40))
    def test_elimination_is_that_of_sympy(self, seed: int) -> None:
        """Columns in another order, rows as sets of what is not zero."""
        numbers = np.random.default_rng(seed)
        matrix = numbers.integers(-1, 2, (int(numbers.integers(1, 6)), int(numbers.integers(2, 7))))
        order = [int(c) for c in numbers.permutation(matrix.shape[1])]
        rows: list[Row] = [{c: Fraction(int(v)) for c, v in enumerate(row) if v} for row in matrix]
        reduced, pivots = sympy.Matrix(matrix[:, order].tolist()).rref()
        expected = {
            order[p]: {order[c]: Fraction(int(v.p), int(v.q)) for c, v in enumerate(reduced.row(i)) if v}
            for i, p in enumerate(pivots)
        }
        assert _eliminated([row for row in rows if row], order) == expected

    @pytest.mark.parametrize("seed", range(10))
    @pytest.mark.parametrize("kind", [Kind.ZERO, Kind.ONE])
    def test_groups_are_connected_through_junctions_of_a_kind(self, seed: int, kind: Kind) -> None:
        graph = switch_off(compilation(random_branches(SEEDS[seed])).whole_graph, ())
        skipped = frozenset(i for i, n in enumerate(graph.nodes) if i % 5 == 0)
        group = groups(graph, kind, skipped)
        lines = nx.Graph()
        lines.add_nodes_from(range(len(graph.bonds)))
        for i, bonds in enumerate(graph.incident):
            if graph.nodes[i].kind is kind and i not in skipped:
                lines.add_edges_from((bonds[0], b) for b in bonds)
        for part in nx.connected_components(lines):
            assert len({group[b] for b in part}) == 1 and group[min(part)] in part
        assert len({*group}) == nx.number_connected_components(lines)
