"""Needed nodes, their order, and loops: against networkx on random digraphs."""

from __future__ import annotations

import networkx
from hypothesis import given
from hypothesis import strategies as st

from compiler.reduction.order import blocks, needed, tear

Digraph = list[list[int]]


@st.composite
def digraphs(draw: st.DrawFn) -> Digraph:
    """For each node the nodes that it depends on."""
    count = draw(st.integers(1, 12))
    return [sorted(draw(st.sets(st.integers(0, count - 1), max_size=3))) for _ in range(count)]


def network(inputs: Digraph) -> networkx.DiGraph:
    """The same, with an edge from each node to those that it depends on."""
    graph = networkx.DiGraph()
    graph.add_nodes_from(range(len(inputs)))
    graph.add_edges_from((node, source) for node, sources in enumerate(inputs) for source in sources)
    return graph


@given(digraphs(), st.data())
def test_needed_is_all_that_the_targets_depend_on(inputs: Digraph, data: st.DataObject) -> None:
    targets = data.draw(st.sets(st.integers(0, len(inputs) - 1), max_size=3))
    graph = network(inputs)
    assert needed(targets, inputs) == set(targets).union(*(networkx.descendants(graph, t) for t in targets))


@given(digraphs())
def test_blocks_are_the_strongly_connected_components(inputs: Digraph) -> None:
    found = blocks(range(len(inputs)), inputs)
    assert {frozenset(b) for b in found} == {
        frozenset(c) for c in networkx.strongly_connected_components(network(inputs))
    }
    assert sorted(n for b in found for n in b) == list(range(len(inputs)))


@given(digraphs())
def test_each_block_comes_after_all_that_it_depends_on(inputs: Digraph) -> None:
    done: set[int] = set()
    for block in blocks(range(len(inputs)), inputs):
        done.update(block)
        assert all(source in done for node in block for source in inputs[node])


@given(digraphs())
def test_the_order_is_the_same_in_every_run(inputs: Digraph) -> None:
    assert blocks(range(len(inputs)), inputs) == blocks(range(len(inputs)), [list(i) for i in inputs])


@given(digraphs(), st.data())
def test_only_the_asked_nodes_and_what_they_reach(inputs: Digraph, data: st.DataObject) -> None:
    roots = data.draw(st.lists(st.integers(0, len(inputs) - 1), unique=True, min_size=1, max_size=3))
    found = {n for b in blocks(roots, inputs) for n in b}
    assert found == needed(roots, inputs)


@given(digraphs())
def test_tearing_leaves_an_order(inputs: Digraph) -> None:
    """Without the cut members the rest of a block is computed one after the other; nothing is lost, nothing is cut in vain."""
    for block in blocks(range(len(inputs)), inputs):
        cut, order = tear(block, inputs)
        assert sorted([*cut, *order]) == sorted(block)
        known = set(cut)
        for node in order:
            assert all(source in known for source in inputs[node] if source in set(block))
            known.add(node)
        inside = network(inputs).subgraph(block)
        if networkx.is_directed_acyclic_graph(inside):
            assert not cut
        else:
            assert cut and networkx.is_directed_acyclic_graph(inside.subgraph(order))


def test_a_simple_loop_is_cut_once() -> None:
    for length in (1, 2, 5, 50):
        ring = [[(i + 1) % length] for i in range(length)]
        cut, order = tear(range(length), ring)
        assert (len(cut), len(order)) == (1, length - 1)


def test_a_hub_is_cut_first() -> None:
    """All members depend on one and it on all: one cut opens every loop."""
    inputs = [[*range(1, 8)], *([0] for _ in range(7))]
    cut, order = tear(range(8), inputs)
    assert cut == [0] and len(order) == 7


def test_long_chains_need_no_recursion() -> None:
    chain = [[], *([i] for i in range(30_000))]
    assert len(blocks([30_000], chain)) == 30_001
    assert len(needed([30_000], chain)) == 30_001
    ring = [[(i + 1) % 20_000] for i in range(20_000)]
    (block,) = blocks([0], ring)
    assert len(block) == 20_000
