"""Layout: each connected part separately as a tree, the bonds that close its rings routed afterwards, the parts in rows.

Long chains are in rows of a page's width: back and forth, each row below the one before, all bonds still straight.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, pairwise

import networkx as nx

from .blocks import DOWN, LEFT, RIGHT, Block, Boxed, TreeBranch
from .diagram_model import DiagramModel, DiagramNode
from .glyphs import letter_rectangle, text_rectangle
from .overlap import MARGIN, NOTHING, Point, Rectangles, Vector, bounds, joined, lane, moved, rectangles
from .route import HARD, Ground, Rectangle, all_routed, between, routed
from .tree import SIDES, Parts, grow_tree

APART = 46.0  # between two parts
WIDEST = 1000.0  # largest width of a row, of one part or of several
TURNED = 160  # nodes of the layouts of a tree in which the ends of its routed bonds are turned
ROUTES = 40  # most ways searched, over all attempts
ROUNDS = 3  # of turning, and searches of each way of the best tree
HUB = 3  # bonds of a box around which all others are placed
SIGNAL = 0.4  # price of a signal beside that of a bond
ROOMIER = (24.0, 60.0, 120.0)
NARROW = 4.0  # free space of a signal at each side
LATEST = 1.25  # of a row's length: a row ends between two instances if it can

Branches = Mapping[int, Sequence[TreeBranch]]


@dataclass(frozen=True, slots=True)
class DiagramLayout:
    """Positions of all parts; y grows downwards."""

    places: Mapping[int, Point]
    labels: Mapping[int, tuple[str, float, float, str]]
    boxes: Mapping[int, Boxed]
    bonds: Mapping[int, tuple[Point, ...]]  # line -> the corners of its way, from tail to head
    signals: Mapping[int, tuple[Point, ...]]
    texts: Mapping[int, Point]  # signal from outside -> the middle of its name
    taken: Rectangles


@dataclass(frozen=True, slots=True)
class _Web:
    """Nodes, with those that a layout adds: the ends of bent bonds, the names of signals from outside."""

    nodes: list[DiagramNode]
    stubs: dict[tuple[int, int], int]  # closing line, its end -> stub
    names: dict[int, int]  # signal -> node of its name
    parts: Parts | None  # those of trees of these nodes, unless they take too much memory


@dataclass(frozen=True, slots=True)
class _Tree:
    """A part grown from one root, its rings still open; a smaller `worth` is better."""

    root: int
    closing: list[int]
    web: _Web
    branches: Mapping[int, Sequence[TreeBranch]]
    block: Block
    worth: float


def place(model: DiagramModel) -> DiagramLayout:
    """Return the layout of a diagram: no two parts overlap, bonds are straight unless they close a ring."""
    parts = nx.connected_components(_network(model, range(len(model.nodes))))
    return _in_rows([_part(model, sorted(part)) for part in parts])


def _network(model: DiagramModel, nodes: Iterable[int]) -> nx.MultiGraph:
    """Return some nodes with the lines between them, whose keys are their numbers; the order is that of the diagram."""
    network = nx.MultiGraph()
    network.add_nodes_from(nodes)
    lines = [(x.tail, x.head, n) for n, x in enumerate(model.lines) if x.tail in network and x.head in network]
    network.add_edges_from(lines)
    return network


# ---------------------------------------------------------------- one part


def _part(model: DiagramModel, part: Sequence[int]) -> DiagramLayout:
    network = _network(model, part)
    trees = sorted((_rooted(model, network, root) for root in _roots(model, network)), key=lambda t: t.worth)
    if closing := trees[0].closing:
        rounds = TURNED // len(part)
        for tree in trees[: max(2, rounds // ROUNDS)]:
            for _ in range(max(2, min(2 * ROUNDS, rounds))):
                before, tree = tree.branches, _turned(model, tree)
                if tree.branches == before:
                    break
                trees.append(tree)
    lines = len(closing) + sum(x.source in network and x.target in network for x in model.signals)
    if lines:
        different = {tree.worth: tree for tree in trees}
        chosen = sorted(different)[: max(2, ROUTES // lines)]
        trees = [min((different[worth] for worth in chosen), key=lambda tree: _finished(model, tree, 1)[0])]
    longest = max(trees, key=lambda tree: sum(bounds(tree.block.taken)[::2]))  # one that goes to the right
    layouts = [_finished(model, tree, ROUNDS)[1] for tree in (trees[0], *_rows(model, longest))]
    return min(layouts, key=lambda layout: max(WIDEST, bounds(layout.taken)[2] - bounds(layout.taken)[0]))


def _rows(model: DiagramModel, tree: _Tree) -> Iterator[_Tree]:
    """Yield the tree in rows of a page's width, if it is one long row and closes no ring."""
    left, _, right, _ = bounds(tree.block.taken)
    rows = math.ceil((right - left) / WIDEST)
    for count in range(rows, rows + 3) if rows > 1 and not tree.closing else ():
        branches = wrapped(tree.web.nodes, tree.branches, tree.block, tree.root, count)
        yield replace(tree, branches=branches, block=_block(model, tree.web, branches, tree.root))


def _roots(model: DiagramModel, network: nx.MultiGraph) -> list[int]:
    """Return the box with many bonds; if there is none, both ends and the middle of a longest path through inner nodes."""
    hub = max((n for n in network if model.nodes[n].shape == "box"), key=network.degree, default=None)
    if hub is not None and network.degree(hub) > HUB:
        return [hub]
    inner = [n for n in network if len(network[n]) > 1] or list(network)[:1]
    core = _network(model, inner)
    *_, first = (inner[0], *(n for _, n in nx.bfs_edges(core, inner[0])))
    before = {node: previous for previous, node in nx.bfs_edges(core, first)}
    *_, last = (first, *before)
    way = [last]
    while way[-1] != first:
        way.append(before[way[-1]])
    ringed = network.number_of_edges() >= len(network)
    spaced = way[:: max(1, len(way) // 4)] if len(inner) <= 40 and ringed else []
    return list(dict.fromkeys([way[0], way[-1], way[len(way) // 2], *spaced]))


def _rooted(model: DiagramModel, network: nx.MultiGraph, root: int) -> _Tree:
    """Return the part as a tree from that root: the line that carries each node and its parent, breadth first; the other lines close rings."""
    carried = {n: (min(network[parent][n]), parent) for parent, n in nx.bfs_edges(network, root)}
    closing = sorted({line for *_, line in network.edges(keys=True)} - {line for line, _ in carried.values()})
    web = _web(model, closing)
    branches = _branches(model, web, network, carried)
    block = _block(model, web, branches, root)
    return _Tree(root, closing, web, branches, block, _worth(model, web, closing, block))


def _turned(model: DiagramModel, tree: _Tree) -> _Tree:
    """Return the tree grown again, with the ends of routed bonds turned towards their other ends."""
    other = {tree.web.stubs[n, e]: tree.web.stubs[n, sum(model.lines[n].ends) - e] for n, e in tree.web.stubs}
    places = tree.block.places
    branches = {
        node: [
            replace(b, likes=_towards(places[node], places[other[b.child]])) if b.child in other else b for b in around
        ]
        for node, around in tree.branches.items()
    }
    block = _block(model, tree.web, branches, tree.root)
    return replace(tree, branches=branches, block=block, worth=_worth(model, tree.web, tree.closing, block))


def _block(
    model: DiagramModel, web: _Web, branches: Mapping[int, Sequence[TreeBranch]], root: int, roomy: float = 0.0
) -> Block:
    return grow_tree(web.nodes, model.lines, branches, root, roomy, web.parts)


def _towards(start: Point, end: Point) -> tuple[Vector, ...]:
    """Return the sides of a node, the one nearest to another node first."""
    x, y = end[0] - start[0], end[1] - start[1]
    return tuple(sorted(SIDES, key=lambda s: -(s[0] * x + s[1] * y)))


def _worth(model: DiagramModel, web: _Web, closing: Sequence[int], block: Block) -> float:
    far = sum(math.dist(*(block.places[web.stubs[n, e]] for e in model.lines[n].ends)) for n in closing)
    read = [[block.places.get(n) for n in (x.source, x.target) if n is not None] for x in model.signals]
    apart = sum(math.dist(a, b) for a, b in (ends for ends in read if len(ends) == 2) if a and b)
    return round(block.worth + far + SIGNAL * apart, 3)


def _finished(model: DiagramModel, tree: _Tree, rounds: int) -> tuple[float, DiagramLayout]:
    """Return the cost and the layout of a tree with its rings closed, with more space if no way is found otherwise."""
    layout = _with_ways(model, tree, tree.block, rounds)
    for roomy in ROOMIER:
        if layout is None:
            block = _block(model, tree.web, tree.branches, tree.root, roomy)
            layout = _with_ways(model, tree, block, rounds, last=roomy == ROOMIER[-1])
    assert layout is not None
    bonds, signals = list(layout.bonds.values()), list(layout.signals.values())
    routed = [layout.bonds[n] for n in tree.closing]
    prices = _price(routed) + SIGNAL * _price(signals) + 150 * (_crossings([*bonds, *signals]))
    return round(tree.block.worth + prices, 3), layout


def _price(ways: Sequence[Sequence[Point]]) -> float:
    """Return the length of some ways, with the price of their bends."""
    return sum(30 * (len(way) - 2) + sum(math.dist(a, b) for a, b in pairwise(way)) for way in ways)


def _crossings(ways: Sequence[Sequence[Point]]) -> int:
    """Return the number of crossings of bonds."""
    parts = [(n, a, b) for n, way in enumerate(ways) for a, b in pairwise(way)]
    return sum(n != m and _cross(a, b, c, d) for i, (n, a, b) in enumerate(parts) for m, c, d in parts[i + 1 :])


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    def side(p: Point, q: Point, r: Point) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def _web(model: DiagramModel, closing: Sequence[int]) -> _Web:
    nodes = list(model.nodes)
    stubs, names = {}, {}
    for number in closing:
        for end in model.lines[number].ends:
            stubs[number, end] = len(nodes)
            nodes.append(DiagramNode("", "", "", "stub", (), "", ""))
    for number, signal in enumerate(model.signals):
        if signal.source is None:
            names[number] = len(nodes)
            nodes.append(DiagramNode("", "", signal.label, "signal", (), "", ""))
    return _Web(nodes, stubs, names, {} if len(nodes) <= TURNED else None)


def _branches(
    model: DiagramModel, web: _Web, network: nx.MultiGraph, carried: Mapping[int, tuple[int, int]]
) -> dict[int, list[TreeBranch]]:
    carrying = {parent for _, parent in carried.values()} | {end for _, end in web.stubs}
    branches: dict[int, list[TreeBranch]] = {n: [] for n in range(len(web.nodes))}
    for child, (number, parent) in sorted(carried.items(), key=lambda item: item[1][0]):
        branches[parent].append(TreeBranch(number, child, model.lines[number].tail == parent, child in carrying))
    for (number, end), stub in web.stubs.items():
        branches[end].append(TreeBranch(number, stub, model.lines[number].tail == end, False))
    for number, name in web.names.items():
        if (target := model.signals[number].target) in network:
            branches[target].append(TreeBranch(len(model.lines) + number, name, False, False))
    return branches


def _with_ways(model: DiagramModel, tree: _Tree, block: Block, rounds: int, last: bool = False) -> DiagramLayout | None:
    """Return the layout with the ways of ring-closing bonds and of signals; None if such a bond finds no way.

    In the `last` attempt such a bond goes straight across.
    """
    web, closing = tree.web, tree.closing
    ground = Ground(block.taken)
    parts = [node_rectangles(web.nodes[n], n, block) for n in block.places if web.nodes[n].shape != "stub"]
    ground.block(rectangles(chain.from_iterable(parts)), HARD)
    bonds: dict[int, tuple[Point, ...]] = {}
    for (number, end), point in block.ends.items():
        if number < len(model.lines) and number not in closing and model.lines[number].tail == end:
            bonds[number] = (point, block.ends[number, model.lines[number].head])
            ground.take(bonds[number])
    for number, end in web.stubs:
        ground.block(lane(block.ends[number, end], block.ends[number, web.stubs[number, end]]), HARD)
    feet = {n: [(block.ends[n, e], block.ends[n, web.stubs[n, e]]) for e in model.lines[n].ends] for n in closing}
    near = sorted(closing, key=lambda n: math.dist(feet[n][0][1], feet[n][1][1]))
    found = all_routed(ground, {n: partial(routed, ground, *feet[n][0], *reversed(feet[n][1])) for n in near}, rounds)
    if len(found) < len(closing) and not last:
        return None
    bonds |= {n: found.get(n, (feet[n][0][0], feet[n][1][0])) for n in closing}
    texts, signals = dict[int, Point](), dict[int, tuple[Point, ...]]()
    for number, name in web.names.items():
        if name in block.places:
            line = len(model.lines) + number
            texts[number] = block.places[name]
            signals[number] = (block.ends[line, name], block.ends[line, model.signals[number].target])
            ground.take(signals[number], NARROW)
    inner = {
        number: [_outline(web.nodes[n], block, n) for n in (signal.source, signal.target)]
        for number, signal in enumerate(model.signals)
        if signal.source in block.places and signal.source is not None and signal.target in block.places
    }
    near = sorted(inner, key=lambda n: math.dist(inner[n][0][:2], inner[n][1][:2]))
    signals |= all_routed(ground, {n: partial(between, ground, *inner[n]) for n in near}, rounds, NARROW)
    places = {n: p for n, p in block.places.items() if n < len(model.nodes)}
    labels = {n: t for n, t in block.labels.items() if n < len(model.nodes) and n not in block.boxes}
    taken = joined(block.taken, *(lane(a, b) for n in closing for a, b in pairwise(bonds[n])))
    return DiagramLayout(places, labels, block.boxes, bonds, signals, texts, taken)


def _outline(node: DiagramNode, block: Block, number: int) -> Rectangle:
    """Return the border of a letter or a box."""
    left, top, right, bottom = node_rectangles(node, number, block)[0]
    return (left, top, right, bottom) if number in block.boxes else (left - 3, top - 3, right + 3, bottom + 3)


def node_rectangles(node: DiagramNode, number: int, placed: Block | DiagramLayout) -> list[Rectangle]:
    """Return a box; or a letter, and its label if it has one."""
    if number in placed.boxes:
        box = placed.boxes[number]
        return [(box.left, box.top, box.right, box.bottom)]
    x, y = placed.places[number]
    left, top, right, bottom = letter_rectangle(node)
    labels = [text_rectangle(*placed.labels[number])] if node.label and node.shape != "signal" else []
    return [(x + left, y + top, x + right, y + bottom), *labels]


# ---------------------------------------------------------------- all parts


def _in_rows(parts: Sequence[DiagramLayout]) -> DiagramLayout:
    """Arrange the parts side by side, as many as a row holds, then in the next row."""
    places, texts = dict[int, Point](), dict[int, Point]()
    labels, boxes = dict[int, tuple[str, float, float, str]](), dict[int, Boxed]()
    bonds, signals = dict[int, tuple[Point, ...]](), dict[int, tuple[Point, ...]]()
    taken = []
    x = y = depth = 0.0
    for part in parts:
        left, top, right, bottom = bounds(part.taken)
        if x and x + right - left > WIDEST:
            x, y, depth = 0.0, y + depth + APART, 0.0
        dx, dy = round(x - left), round(y - top)
        places |= {n: (a + dx, b + dy) for n, (a, b) in part.places.items()}
        labels |= {n: (t, a + dx, b + dy, s) for n, (t, a, b, s) in part.labels.items()}
        boxes |= {n: b.at(dx, dy) for n, b in part.boxes.items()}
        bonds |= {n: tuple((a + dx, b + dy) for a, b in way) for n, way in part.bonds.items()}
        signals |= {n: tuple((a + dx, b + dy) for a, b in way) for n, way in part.signals.items()}
        texts |= {n: (a + dx, b + dy) for n, (a, b) in part.texts.items()}
        taken.append(moved(part.taken, dx, dy))
        x, depth = x + right - left + APART, max(depth, bottom - top)
    return DiagramLayout(places, labels, boxes, bonds, signals, texts, joined(NOTHING, *taken))


def wrapped(
    nodes: Sequence[DiagramNode], branches: Branches, block: Block, root: int, rows: int
) -> dict[int, list[TreeBranch]]:
    """Return the branches of a tree, those on its longest way with the sides at which it goes on in its row or to the next."""
    left, top, right, bottom = bounds(block.taken)
    parents = {b.child: (parent, b) for parent, around in branches.items() for b in around if b.heavy}
    spine = [max([root, *parents], key=lambda n: abs(block.places[n][0] - block.places[root][0]))]
    while spine[-1] in parents:
        spine.append(parents[spine[-1]][0])
    steps = {
        n: max(abs(a - b) for a, b in zip(block.places[n], block.places[parents[n][0]], strict=True))
        for n in spine[:-1]
    }
    first, last = sorted(block.places[n][0] for n in (root, spine[0]))
    length = (sum(steps.values()) + first - left + right - last) / rows
    sides, drops, way, done = dict[int, Vector](), dict[int, float](), RIGHT, first - left
    for child, step in reversed(steps.items()):
        within = nodes[child].inside and nodes[child].inside == nodes[parents[child][0]].inside
        done += step
        sides[child] = way
        if done > length * (LATEST if within else 1.0):
            sides[child], drops[child], done, way = DOWN, bottom - top + MARGIN, 0.0, LEFT if way == RIGHT else RIGHT
    return {
        n: [replace(b, side=sides.get(b.child), least=drops.get(b.child, 0.0)) for b in around]
        for n, around in branches.items()
    }
