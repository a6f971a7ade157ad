"""Test whether strokes can be completed: a perfect matching, updated with each choice.

Every junction is determined by exactly one of its bonds, and so is a transformer ("on one side it determines the effort"). A bond
between a 0 and a 1 determines both of its ends or neither: an edge of a matching. A bond between two equal junctions determines one of
its ends: two edges that meet in a vertex of the bond. A gyrator counts its two bonds oppositely. The bond of a one-port
determines its junction or does not: an edge to a vertex that may stay unmatched. So valid strokes are the matchings that leave no
other vertex unmatched.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..graph.elements import Kind
from ..graph.network import BondEnd, BondGraph, Element, Junction
from .strokes import TAIL, Strokes

Partner = tuple[int, int]  # a vertex, and the bond of the edge that leads to it


class Matching:
    """A perfect matching of the bonds that have no stroke yet. Vertices are nodes by number, then one for each bond.

    Found by augmenting paths: J. Edmonds, Paths, trees, and flowers, Canadian Journal of Mathematics 17 (1965).
    """

    def __init__(self, strokes: Strokes) -> None:
        self.strokes, self.graph = strokes, strokes.graph
        self.nodes = len(self.graph.nodes)
        self.signs = [(_sign(self.graph, b.tail), _sign(self.graph, b.head)) for b in self.graph.bonds]
        self.mate: dict[int, Partner] = {}
        self.journal: list[tuple[int, Partner | None]] = []
        self.tree: set[int] = set()  # the vertices that the last vain search met

    def remember(self, bonds: Iterable[int]) -> None:
        """Start from strokes that are going to be undone."""
        for bond in bonds:
            for node in self._ends(bond):
                if self.strokes.decides_effort(bond, node) is self.signs[bond][self.strokes.side(bond, node)]:
                    self._match(node, self._far(node, bond), bond)

    def complete(self) -> int | None:
        """Match every vertex that must be matched. Returns one that cannot be, or None."""
        needed = [n for n in range(self.nodes) if self._is_open(n)]
        needed += [
            self.nodes + b for b, s in enumerate(self.signs) if s[0] is s[1] is not None and not self._has_stroke(b)
        ]
        return next((v for v in needed if v not in self.mate and not self._augment(v)), None)

    def follow(self, bonds: Iterable[int]) -> bool:
        """Update the matching with strokes that were put on bonds. Returns False, with nothing changed, if they cannot be completed."""
        mark, lost = len(self.journal), []
        for bond in bonds:
            for vertex in (*self._ends(bond), self.nodes + bond):
                mate = self.mate.get(vertex)
                if mate is not None and mate[1] == bond:
                    self._leave(vertex)
                    self._leave(mate[0])
                    lost += [vertex, mate[0]]
        for vertex in lost:
            if vertex < self.nodes and self._is_open(vertex) and vertex not in self.mate and not self._augment(vertex):
                self._undo(mark)
                return False
        return True

    # ------------------------------------------------------------ the graph
    def _has_stroke(self, bond: int) -> bool:
        return self.strokes.effort_from[bond] is not None

    def _is_open(self, node: int) -> bool:
        """Return True if a node is a vertex that is not determined yet."""
        return self.strokes.open[node] > 0 and _sign(self.graph, BondEnd(node, 0)) is not None

    def _ends(self, bond: int) -> list[int]:
        """Nodes at the ends of a bond that are vertices."""
        ends = self.graph.bonds[bond]
        return [e.node for e, sign in zip((ends.tail, ends.head), self.signs[bond], strict=True) if sign is not None]

    def _far(self, vertex: int, bond: int) -> int:
        """Vertex at the other end of a bond's edge from a node."""
        tail, head = self.signs[bond]
        if tail is None or head is None or tail is head:
            return self.nodes + bond
        ends = self.graph.bonds[bond]
        return ends.head.node if self.strokes.side(bond, vertex) == TAIL else ends.tail.node

    def edges(self, vertex: int) -> Iterator[Partner]:
        """Neighbours of a vertex over bonds without stroke."""
        if vertex < self.nodes:
            for bond in self.graph.incident[vertex]:
                if not self._has_stroke(bond):
                    yield self._far(vertex, bond), bond
        else:
            yield from ((node, vertex - self.nodes) for node in self._ends(vertex - self.nodes))

    def may_stay_single(self, vertex: int) -> bool:
        """Return True if a vertex belongs to a one-port, which may determine its junction or not."""
        return vertex >= self.nodes and None in self.signs[vertex - self.nodes]

    # ------------------------------------------------------------ the matching
    def _match(self, one: int, other: int, bond: int) -> None:
        for vertex, partner in ((one, other), (other, one)):
            self.journal.append((vertex, self.mate.get(vertex)))
            self.mate[vertex] = partner, bond

    def _leave(self, vertex: int) -> None:
        self.journal.append((vertex, self.mate.pop(vertex, None)))

    def _undo(self, mark: int) -> None:
        while len(self.journal) > mark:
            vertex, mate = self.journal.pop()
            if mate is None:
                self.mate.pop(vertex, None)
            else:
                self.mate[vertex] = mate

    def _augment(self, root: int) -> bool:
        """Match a vertex along an augmenting path, whose edges are alternately outside and inside the matching."""
        search = _AlternatingTree(self, root)
        end = search.run()
        if end is None:
            self.tree = {*search.queue, *search.parent}
            return False
        vertex: int | None = end
        if self.may_stay_single(end) and end in self.mate:  # the path ends by letting a one-port go
            vertex = self.mate[end][0]
            self._leave(end)
        while vertex is not None:
            before, bond = search.parent[vertex]
            following = self.mate.get(before)
            self._match(vertex, before, bond)
            vertex = None if following is None else following[0]
        return True


class _AlternatingTree:
    """One search tree. An odd cycle is shrunk into its base."""

    def __init__(self, matching: Matching, root: int) -> None:
        self.matching, self.mate, self.root = matching, matching.mate, root
        self.parent: dict[int, Partner] = {}
        self.shrunk: dict[int, int] = {}  # vertex -> the base of the cycle that it lies in
        self.queue = [root]  # vertices that an even number of edges leads to
        self.entered = {root}

    def run(self) -> int | None:
        """Return the end of an augmenting path, which `parent` leads back to the root."""
        for vertex in self.queue:  # it grows
            for other, bond in self.matching.edges(vertex):
                partner = self.mate.get(other)
                if self._base(vertex) == self._base(other) or self.mate.get(vertex, (None,))[0] == other:
                    continue
                if other == self.root or (partner is not None and partner[0] in self.parent):
                    self._shrink(vertex, other, bond)
                elif other not in self.parent:
                    self.parent[other] = vertex, bond
                    if partner is None:
                        return other
                    if self.matching.may_stay_single(partner[0]):
                        return partner[0]
                    self._enter(partner[0])
        return None

    def _enter(self, vertex: int) -> None:
        if vertex not in self.entered:
            self.entered.add(vertex)
            self.queue.append(vertex)

    def _base(self, vertex: int) -> int:
        return self.shrunk.get(vertex, vertex)

    def _shrink(self, one: int, other: int, bond: int) -> None:
        base = self._meeting(one, other)
        cycle: set[int] = set()
        self._mark(one, base, other, bond, cycle)
        self._mark(other, base, one, bond, cycle)
        for vertex in (*self.queue, *self.parent):
            if self._base(vertex) in cycle:
                self.shrunk[vertex] = base
                self._enter(vertex)

    def _meeting(self, one: int, other: int) -> int:
        """First common vertex on the paths of two vertices to the root."""
        passed = set()
        vertex = self._base(one)
        passed.add(vertex)
        while vertex in self.mate and vertex != self.root:
            vertex = self._base(self.parent[self.mate[vertex][0]][0])
            passed.add(vertex)
        vertex = self._base(other)
        while vertex not in passed:
            vertex = self._base(self.parent[self.mate[vertex][0]][0])
        return vertex

    def _mark(self, vertex: int, base: int, child: int, bond: int, cycle: set[int]) -> None:
        """Mark one side of an odd cycle: its vertices can now be reached in the other direction too."""
        while self._base(vertex) != base:
            partner = self.mate[vertex][0]
            cycle |= {self._base(vertex), self._base(partner)}
            self.parent[vertex] = child, bond
            child = partner
            vertex, bond = self.parent[partner]


def _sign(graph: BondGraph, end: BondEnd) -> bool | None:
    """Sign of a bond at a vertex: True if it determines the node when the node determines its effort; None at one-ports."""
    node = graph.nodes[end.node]
    if isinstance(node, Junction):
        return node.kind is Kind.ONE
    if isinstance(node, Element) and node.kind in (Kind.TRANSFORMER, Kind.GYRATOR):
        return node.kind is Kind.TRANSFORMER or end.port == 0
    return None
