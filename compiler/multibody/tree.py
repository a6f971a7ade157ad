"""A mechanism as a tree: each body hangs on ground or on another body; `free` joints stay outside of it as chords.

A joint that leaves all three planar freedoms constrains nothing, so its coordinates are explicit functions of the poses that
it joins. Bodies that no other joint ties to the ground get their pose as coordinates.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import networkx

from ..errors import Diagnostic
from ..graph.mechanism import GROUND, Body, Joint, Mechanism
from .errors import ClosedLoop


@dataclass(frozen=True, slots=True)
class Link:
    """A body in the tree. `joint` is None for a body whose pose is its coordinates; `reversed` if the joint was drawn from it."""

    body: Body
    parent: int | None  # position in the tree; None: ground
    joint: Joint | None
    reversed: bool

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The names of its coordinates: of its joint, or of its own pose."""
        if self.joint is None:
            return tuple(f"{self.body.name}.{c}" for c in ("x", "y", "phi"))
        return tuple(f"{self.joint.name}.{c}" for c in self.joint.freedoms)


@dataclass(frozen=True, slots=True)
class Tree:
    """Bodies so that parents come first, and the chords."""

    links: tuple[Link, ...]
    chords: tuple[Joint, ...]
    diagnostics: tuple[Diagnostic, ...]


def spanning_tree(mechanism: Mechanism) -> Tree:
    """Grow the tree from the ground over all joints but `free` ones; what remains starts from a body with its own pose."""
    bodies = {b.name: b for b in mechanism.bodies}
    network = networkx.MultiGraph()
    network.add_nodes_from([GROUND, *bodies])
    for joint in mechanism.joints:
        if joint.kind != "free":
            network.add_edge(joint.first, joint.second, key=joint.name, joint=joint)
    links: list[Link] = []
    place: dict[str, int | None] = {GROUND: None}
    used: set[str] = set()
    for root in [GROUND, *bodies]:
        if root not in place:
            place[root] = len(links)
            links.append(Link(bodies[root], None, None, False))
        elif root != GROUND:
            continue
        for near, far, key in _breadth_first(network, root):
            if far in place:
                continue
            joint = network.edges[near, far, key]["joint"]
            place[far] = len(links)
            links.append(Link(bodies[far], place[near], joint, joint.second == near))
            used.add(joint.name)
    diagnostics: list[Diagnostic] = []
    for joint in mechanism.joints:
        if joint.kind != "free" and joint.name not in used:
            diagnostics.append(ClosedLoop(joint.span, joint.kind, joint.name, _loop(network, joint)))
    return Tree(tuple(links), tuple(j for j in mechanism.joints if j.kind == "free"), tuple(diagnostics))


def _breadth_first(network: networkx.MultiGraph, root: str) -> Iterable[tuple[str, str, str]]:
    """Edges from the root outwards, in the order of declaration."""
    seen = {root}
    queue = [root]
    for near in queue:
        for far in network.adj[near]:
            if far not in seen:
                seen.add(far)
                queue.append(far)
                yield near, far, next(iter(network.adj[near][far]))


def _loop(network: networkx.MultiGraph, joint: Joint) -> str:
    others = network.copy()
    others.remove_edge(joint.first, joint.second, key=joint.name)
    path = networkx.shortest_path(others, joint.first, joint.second)
    return " - ".join([*path, joint.first])
