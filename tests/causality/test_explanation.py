"""Reasons for storages in derivative form, and places of loops: chains, ends, advice; as text, as JSON and by the command."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest
from click.testing import CliRunner

from bondgraph.commands import commands
from bondgraph.presentation.text.causality import CausalityExplanation, explain
from compiler.causality import CausalGraph, StrokeReason, dependences
from compiler.graph.elements import Kind
from compiler.graph.network import Element, Junction
from tests.causality.small_graphs import graph_of, small_graphs
from tests.causality.test_optimality import strokes_of
from tests.compiling import compiled
from tests.conftest import Golden

HERE = Path(__file__).parent


def explained(text: str) -> CausalityExplanation:
    return explain(compiled(text))


# ---------------------------------------------------------------- chains


def turned(causal: CausalGraph, bonds: tuple[int, ...]) -> CausalGraph:
    """The same strokes, with those of a chain at the other end."""
    strokes = [1 - s if b in bonds else s for b, s in enumerate(causal.effort_from)]
    return CausalGraph(causal.graph, tuple(strokes), causal.reasons, causal.derivative)


def keeps_the_rules(causal: CausalGraph, but: int) -> bool:
    """Return True if all junctions and transducers keep the rules, and all sources and storages their form, except one node."""
    for number, node in enumerate(causal.graph.nodes):
        efforts = [causal.decides_effort(b, number) for b in causal.graph.incident[number]]
        if number == but:
            continue
        match node:
            case Junction():
                right = efforts.count(node.kind is Kind.ONE) == 1
            case Element(kind=Kind.TRANSFORMER):
                right = efforts[0] is not efforts[1]
            case Element(kind=Kind.GYRATOR):
                right = efforts[0] is efforts[1]
            case Element(kind=Kind.EFFORT_SOURCE | Kind.FLOW_SOURCE):
                right = efforts == [node.kind is Kind.EFFORT_SOURCE]
            case _:
                right = True
        if not right:
            return False
    return True


@pytest.mark.parametrize("size", [3, 4, 5])
def test_a_chain_is_what_would_have_to_turn(size: int) -> None:
    """With the strokes of the chain turned, the storage is in integral form, and only the node that forces it violates a rule."""
    counts: Counter[str] = Counter()
    for small in small_graphs(size):
        causal = strokes_of(graph_of(small))
        for item in dependences(causal) if causal is not None else ():
            assert causal is not None
            graph, port = causal.graph, item.port
            assert port.node in (graph.bonds[item.bonds[0]].tail.node, graph.bonds[item.bonds[0]].head.node)
            if item.forced_by is None:
                counts["rings"] += 1
                assert "GY" in {k for _, _, k in small.links} or len(small.links) >= len(small.types), small
                continue
            last = graph.bonds[item.bonds[-1]]
            assert item.forced_by in (last.tail.node, last.head.node)
            other = turned(causal, item.bonds)
            kind = graph.nodes[port.node].kind
            assert other.decides_effort(item.bonds[0], port.node) is (kind is Kind.CAPACITOR), small
            assert keeps_the_rules(other, item.forced_by), small
            counts[item.because.value] += 1
    assert counts[StrokeReason.SOURCE.value] and counts[StrokeReason.INTEGRAL.value]
    print(f"\nsize {size}: {dict(counts)}")


LEVER = "model A {\n  Se s : F = 6 N\n  1 a, b : translation\n  TF lever : v1 = 3*v2\n  I m, n : p = 4 kg*v\n  s -> a -> m, lever\n  lever -> b -> n\n}\n"


class TestStorages:
    def test_both_ends_and_the_bonds_between(self) -> None:
        (row,) = explained(LEVER).derivative
        assert (row.storage, row.forced_by) == ("n", "m")
        assert [bond for bond, _ in row.chain] == ["b |-> n", "lever.2 |-> b", "a |-> lever.1", "a ->| m"]
        assert [place for _, place in row.chain] == ["text.bg:7", "text.bg:7", "text.bg:6", "text.bg:6"]
        assert "`prefer = derivative` on `m`" in row.advice and "0-junction" in row.advice

    def test_what_the_advice_says_is_true(self) -> None:
        """With the wish on m it is n that is the state; with a spring between, both are."""
        wished = LEVER.replace("I m, n : p = 4 kg*v", "I m : p = 4 kg*v { prefer = derivative }\n  I n : p = 4 kg*v")
        assert [r.storage for r in explained(wished).derivative] == ["m"]
        parted = LEVER.replace("lever -> b -> n", "C k : F = 1 [N/m]*x\n  lever -> 0(k) -> b -> n")
        assert explained(parted).derivative == ()

    def test_a_source_at_the_end(self) -> None:
        text = "model A {\n  Se s : u = 6 V\n  0 a : electric\n  C c : u = q/1 mF\n  s -> a -> c\n  output i = c.i\n}\n"
        (row,) = explained(text).derivative
        assert (row.forced_by, row.forced_at) == ("s", "text.bg:2")
        assert "`s`" in row.why and "effort" in row.why and "1-junction" in row.advice
        parted = text.replace("s -> a -> c", "R r : u = 1 ohm*i\n  s -> 1(r) -> a -> c")
        assert explained(parted).derivative == ()

    def test_the_shortest_of_two_chains(self) -> None:
        """Three inertias on one shaft, the third reached over a gear: each names the near one."""
        text = "model A {\n  Se s : M = 6 [N*m]\n  1 a, b : rotation\n  TF gear : omega1 = 3*omega2\n  I j, k, l : L = 4 [kg*m^2]*omega\n  s -> a -> j, k, gear\n  gear -> b -> l\n}\n"
        rows = {r.storage: r for r in explained(text).derivative}
        assert {n: (r.forced_by, len(r.chain)) for n, r in rows.items()} == {"k": ("j", 2), "l": ("j", 4)}

    @pytest.mark.parametrize("word", ["prefer", "require"])
    def test_what_the_author_asked_for(self, word: str) -> None:
        text = "model A {\n  Se s : u = 6 V\n  1 a : electric\n  R r : u = 2 ohm*i\n  I k : lambda = 3 H*i\n  I l : lambda = 1 H*i { %s = derivative }\n  s -> a -> r, k, l\n}\n"
        (row,) = explained(text % word).derivative
        assert row.storage == "l"
        assert row.forced_by is None and "its author" in row.why and f"`{word}`" in row.advice

    def test_on_a_mechanism(self) -> None:
        text = "model A {\n  multibody m : planar {\n    body b { mass = 1 kg }\n    slide guide : ground to b { along = 0 }\n  }\n  I extra : p = 2 kg*v\n  m.guide -> extra\n  output x = m.guide.x\n}\n"
        (row,) = explained(text).derivative
        assert row.forced_by == "m" and "body of `m`" in row.advice


class TestLoops:
    def test_members_in_order(self) -> None:
        text = "model A {\n  Se s : u = 6 V\n  1 a\n  R r : u = 2 ohm*i\n  R t : u = 3 ohm*i\n  s -> a -> r, t\n  output i = r.i\n}\n"
        (loop,) = explained(text).loops
        assert [(v, o) for v, o, _ in loop.cycle] == [("t.u", "a"), ("t.i", "t"), ("r.u", "r")]
        assert "small I on the 1-junction `a`" in loop.advice
        broken = text.replace("s -> a -> r, t", "I l : lambda = 1 mH*i\n  s -> a -> r, t, l")
        assert explained(broken).loops == ()

    def test_each_step_is_computed_from_the_one_before(self) -> None:
        compilation = compiled(HERE / "explained.bg")
        names = [v.name for v in compilation.equations.variables]
        reads = {
            names[a.target]: {names[x] for x in a.arguments if isinstance(x, int)}
            for a in compilation.equations.assignments
        }
        loops = explain(compilation).loops
        assert loops
        for loop in loops:
            variables = [v for v, _, _ in loop.cycle]
            assert all(
                before in reads[v] for before, v in zip([variables[-1], *variables[:-1]], variables, strict=True)
            )

    def test_the_shortest_cycle_of_a_block(self) -> None:
        """A ladder of resistors is one block; a cycle goes through two of them."""
        rows = "".join(f"  R x{i} : u = 2 ohm*i\n  R y{i} : u = 3 ohm*i\n" for i in range(6))
        chain = " -> ".join(f"1(x{i}) -> 0(y{i})" for i in range(6))
        (loop,) = explained(f"model A {{\n  Se s : u = 6 V\n{rows}  s -> {chain}\n  output i = x0.i\n}}\n").loops
        assert loop.variables > 12 and len(loop.cycle) <= 5

    def test_nonlinear_loops_are_loops_too(self) -> None:
        text = "plain model A {\n  Se s : e = 6\n  1 a\n  R r : e = f + f^3\n  R t : e = f + exp(f)\n  s -> a -> r, t\n  output o = r.f\n}\n"
        (loop,) = explained(text).loops
        assert set(loop.members) == {"r", "t", "a"}

    def test_a_law_that_cannot_be_turned(self) -> None:
        """It gives its variable by iteration: a loop of its own."""
        text = "plain model A {\n  Se s : e = 6\n  R r : e = f + exp(f)\n  s -> 1(r)\n  output o = r.f\n}\n"
        (loop,) = explained(text).loops
        assert loop.members == ("r",) and "`prefer`" in loop.advice
        assert explained(text.replace("e = f + exp(f)", "f = e + exp(e)")).loops == ()


# ---------------------------------------------------------------- text, JSON, command


def test_text(golden: Golden) -> None:
    golden(HERE / "explained.txt", explain(compiled(HERE / "explained.bg")).text())


def run(*arguments: str) -> tuple[int, str, str]:
    found = CliRunner().invoke(commands, ["causality", *arguments])
    return found.exit_code, found.stdout, found.stderr


def test_command() -> None:
    code, text, errors = run(str(HERE / "explained.bg"))
    assert (code, errors) == (0, "")
    assert text.rstrip("\n") + "\n" == (HERE / "explained.txt").read_text(encoding="utf-8")


def test_json() -> None:
    code, text, _ = run("--json", str(HERE / "explained.bg"))
    told = json.loads(text)
    assert code == 0 and told["schema"] == "bondgraph-causality/1"
    assert all(("->|" in s["bond"]) is (s["bond"].split(" ")[0] == s["effort_from"]) for s in told["strokes"])
    assert [(d["storage"], d["forced_by"]) for d in told["derivative"]] == [("filter", "supply"), ("load", "rotor")]
    assert all(d["chain"] and d["advice"] for d in told["derivative"])
    assert all(
        c["variable"] and c["place"].startswith("explained.bg:") for loop in told["loops"] for c in loop["cycle"]
    )


def test_conflicts_are_told(tmp_path: Path) -> None:
    path = tmp_path / "wrong.bg"
    path.write_text("model A {\n  Se a, b : u = 1 V\n  0 k\n  R r : u = 1 ohm*i\n  a, b -> k -> r\n}\n")
    code, text, errors = run(str(path))
    assert (code, text) == (1, "") and "BG301" in errors and "`a` and `b`" in errors


def test_strokes_are_shown_even_if_the_equations_fail(tmp_path: Path) -> None:
    """A gain of exactly 1: the strokes are legal, the numbers are not."""
    path = tmp_path / "singular.bg"
    path.write_text(
        "plain model A {\n  Se s : e = 1\n  1 k\n  R x : e = 2*f\n  R y : e = -2*f\n  s -> k -> x, y\n  output o = x.f\n}\n"
    )
    code, text, errors = run(str(path))
    assert code == 1 and "s ->| k" in text and "algebraic loop" in text and "BG502" in errors
    code, text, _ = run("--json", str(path))
    assert code == 1 and [d["code"] for d in json.loads(text)["diagnostics"]] == ["BG502"]
