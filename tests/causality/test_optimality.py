"""The number of storages in integral form is the largest there is: against all strokes of every small connected graph.

BONDGRAPH_EXHAUSTIVE=8 in the environment asks for all graphs up to that size (junctions, links and one-ports together).
"""

from __future__ import annotations

import os
import random
from collections import Counter

import pytest

from compiler.causality import CausalGraph, assign_causality
from compiler.errors import CompilationFailed
from compiler.graph.network import BondGraph, Element, Junction, Kind
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
    fulfilled = integral = 0
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
        if node.prefer in ("effort", "flow"):
            fulfilled += efforts == [node.prefer == "effort"]
        elif node.prefer is not None:
            fulfilled += efforts == [(node.prefer == "integral") is (node.kind is Kind.CAPACITOR)]
    return Best(fulfilled, integral)


@pytest.mark.parametrize("size", range(1, SIZE + 1))
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
    """Wishes count before storages, each class by its number."""
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
