"""The number of storages in integral form is the largest there is: against all strokes of every small connected graph.

BONDGRAPH_EXHAUSTIVE=8 in the environment asks for all graphs up to that size (junctions, links and one-ports together).
"""

from __future__ import annotations

import os
import random
from collections import Counter

import networkx
import pytest

from compiler.causality import CausalGraph, assign_causality
from compiler.errors import CompilationFailed
from compiler.graph.elements import Kind
from compiler.graph.network import Bond, BondEnd, BondGraph, Element, Junction
from tests.causality.small_graphs import Best, Small, best_of, graph_of, small_graphs

SIZE = int(os.environ.get("BONDGRAPH_EXHAUSTIVE", "6"))


def strokes_of(graph: BondGraph) -> CausalGraph | None:
    try:
        return assign_causality(graph)
    except CompilationFailed as failed:
        assert {d.code for d in failed.diagnostics} == {"BG301"}
        return None


def value_of(causal: CausalGraph) -> Best:
    """Wishes fulfilled and storages in integral form; the rules are checked on the way."""
    graph = causal.graph
    fulfilled = integral = others = 0
    for number, node in enumerate(graph.nodes):
        efforts = [causal.decides_effort(b, number) for b in graph.incident[number]]
        if isinstance(node, Junction):
            assert efforts.count(node.kind is Kind.ONE) == 1, f"{node.name} is decided by one bond"
            continue
        assert isinstance(node, Element)
        match node.kind:
            case Kind.TRANSFORMER:
                assert efforts[0] is not efforts[1]
            case Kind.GYRATOR:
                assert efforts[0] is efforts[1]
            case Kind.EFFORT_SOURCE | Kind.FLOW_SOURCE:
                assert efforts == [node.kind is Kind.EFFORT_SOURCE]
            case Kind.CAPACITOR | Kind.INERTIA:
                integral += efforts == [node.kind is Kind.CAPACITOR]
        if node.prefer in ("effort", "flow"):  # only resistors say it so here
            others += efforts == [node.prefer == "effort"]
        elif node.prefer is not None:
            fulfilled += efforts == [(node.prefer == "integral") is (node.kind is Kind.CAPACITOR)]
    return Best(fulfilled, integral, others)


@pytest.mark.parametrize("size", range(2, SIZE + 1))
def test_every_small_graph(size: int) -> None:
    counts: Counter[str] = Counter()
    for small in small_graphs(size):
        causal, expected = strokes_of(graph_of(small)), best_of(small)
        counts["graphs"] += 1
        counts["without strokes"] += expected is None
        assert (causal is None) is (expected is None), small
        if causal is not None and expected is not None:
            assert value_of(causal) == expected, small
            counts["with storage in derivative form"] += bool(causal.derivative)
        counts["agree"] += 1
    print(f"\nsize {size}: " + ", ".join(f"{n} {what}" for what, n in counts.items()))
    assert counts["graphs"] == counts["agree"]


def a_graph(rng: random.Random, junctions: int) -> Small:
    """A random graph with many rings: grids of resistors and gyrators are where a choice leads nowhere unseen."""
    links = {(rng.randrange(n), n, rng.choice(["bond", "TF", "GY"])) for n in range(1, junctions)}
    for _ in range(rng.randrange(1, 4)):
        a, b = sorted(rng.sample(range(junctions), 2))
        links.add((a, b, rng.choice(["bond", "bond", "TF", "GY"])))
    leaves = tuple(
        tuple(rng.choices(["Se", "Sf", "C", "I", "R"], [1, 1, 6, 6, 5], k=rng.randrange(3))) for _ in range(junctions)
    )
    return Small(tuple(rng.choice("01") for _ in range(junctions)), tuple(sorted(links)), leaves)


def test_larger_graphs_with_wishes() -> None:
    """Wishes for storages count before storages, those before wishes for resistors, each class by its number."""
    rng, counts = random.Random(5), Counter[str]()
    for _ in range(300):
        small = a_graph(rng, rng.randrange(3, 8))
        words = {"C": ["integral", "derivative"], "I": ["integral", "derivative"], "R": ["effort", "flow"]}
        wishes = {
            (n, p): rng.choice(words[kind])
            for n, leaves in enumerate(small.leaves)
            for p, kind in enumerate(leaves)
            if kind in words and rng.random() < 0.4
        }
        causal, expected = strokes_of(graph_of(small, wishes)), best_of(small, wishes)
        assert (causal is None) is (expected is None), small
        if causal is not None:
            assert value_of(causal) == expected, (small, wishes)
            counts["compared"] += 1
    assert counts["compared"] > 40


def by_networkx(small: Small) -> int | None:
    """Maximum number of storages in integral form, as a maximum weight matching of networkx; None if there is none.

    Junctions are vertices. A bond that determines both of its ends or neither is an edge; one that determines one of its ends goes over a
    vertex of its own. A one-port is a vertex of its own, with a weight if its storage is in integral form.
    """
    graph = networkx.Graph()
    required = {f"j{n}" for n in range(len(small.types))}
    base, big = 0, 1000
    for number, (a, b, kind) in enumerate(small.links):
        both = (small.types[a] != small.types[b]) is (kind != "GY")
        middle = [f"m{number}"] if not both else [f"m{number}", f"n{number}"]  # two in a row: parallel edges stay apart
        required |= set(middle)
        networkx.add_path(graph, [f"j{a}", *middle, f"j{b}"])
    for junction, leaves in enumerate(small.leaves):
        for place, kind in enumerate(leaves):
            leaf, decides = f"x{junction}{place}", (kind in ("Se", "C")) is (small.types[junction] == "0")
            if kind in ("Se", "Sf") and not decides:
                continue  # its bond never decides
            graph.add_edge(f"j{junction}", leaf)
            if kind in ("Se", "Sf"):
                required.add(leaf)
            elif kind in "CI":
                base += not decides
                graph.edges[f"j{junction}", leaf]["worth"] = 1 if decides else -1
    graph.add_nodes_from(required)
    for u, v, data in graph.edges(data=True):
        data["weight"] = big * ((u in required) + (v in required)) + data.get("worth", 0)
    matching = networkx.max_weight_matching(graph)
    if len(required & {v for edge in matching for v in edge}) < len(required):
        return None
    return base + sum(graph.edges[edge].get("worth", 0) for edge in matching)


def shuffled(graph: BondGraph, rng: random.Random) -> BondGraph:
    """The same graph, declared in another order."""
    order = rng.sample(range(len(graph.nodes)), len(graph.nodes))
    place = {old: new for new, old in enumerate(order)}
    bonds = [
        Bond(BondEnd(place[b.tail.node], b.tail.port), BondEnd(place[b.head.node], b.head.port), b.domain, b.span)
        for b in rng.sample(graph.bonds, len(graph.bonds))
    ]
    return BondGraph(graph.name, tuple(graph.nodes[o] for o in order), tuple(bonds), {}, {}, {}, graph.span)


def test_large_graphs_in_any_order_against_networkx() -> None:
    rng, counts = random.Random(11), Counter[str]()
    while counts["compared"] < 60:
        small = a_graph(rng, rng.randrange(10, 30))
        expected = by_networkx(small)
        counts["tried"] += 1
        for graph in (graph_of(small), shuffled(graph_of(small), rng)):
            causal = strokes_of(graph)
            assert (causal is None) is (expected is None), small
            assert causal is None or value_of(causal).integral == expected, small
        counts["compared"] += expected is not None
    print(f"\n{counts['tried']} large graphs tried, {counts['compared']} have strokes and agree")


def test_networkx_agrees_with_trying_everything() -> None:
    """The oracle of the large graphs is one on small graphs too."""
    for small in small_graphs(4):
        best = best_of(small)
        assert by_networkx(small) == (None if best is None else best.integral), small


def grid(n: int) -> Small:
    """A net of resistors without a storage: every choice of a resistor is a choice of which tree the others form."""
    links: list[tuple[int, int, str]] = []
    leaves: list[tuple[str, ...]] = [() for _ in range(n * n)]
    for i in range(n):
        for j in range(n):
            for a, b in ((i + 1, j), (i, j + 1)):
                if a < n and b < n:
                    links += [(i * n + j, len(leaves), "bond"), (a * n + b, len(leaves), "bond")]
                    leaves.append(("R",))
    links.append((0, len(leaves), "bond"))
    leaves.append(("Se", "R"))
    types = ["0"] * (n * n) + ["1"] * (len(leaves) - n * n)
    return Small(tuple(types), tuple(links), tuple(leaves))


def test_a_net_of_resistors_has_strokes() -> None:
    """Propagation alone ends in a contradiction that no single earlier choice caused."""
    causal = strokes_of(graph_of(grid(12)))
    assert causal is not None
    value_of(causal)
    decided = [
        n
        for n, node in enumerate(causal.graph.nodes)
        if node.kind is Kind.RESISTOR and not causal.decides_effort(causal.graph.incident[n][0], n)
    ]
    assert len(decided) == 2 * 12 * 11 + 1 - 12 * 12, "as many as there are meshes"
