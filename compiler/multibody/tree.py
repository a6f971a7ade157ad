"""A mechanism as a tree of links: each has one elementary motion relative to the ground or another link, and carries bodies.

Bodies that are welded together (or locked as drawn) are one link. A joint with several coordinates is a chain of elementary
ones with empty links between: a cylinder is a slide and a hinge. A `free` joint or a `distance` constrains nothing and is
left outside as a chord. Bodies without connection to the ground have their pose as coordinates. The remaining joints close
loops.

Ranks of joints by their kinds and bodies, not by their names or the order of declarations: they decide where loops are cut.
Colour refinement of B. Weisfeiler and A. Leman (1968): groups of bodies differ if their own data or their joints differ, or the
groups behind these. If all are equal, as the legs of a symmetrical mechanism, the order of declarations decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import replace
from typing import Any

from ..algebra.formula import Bound
from ..fast_dataclass import dataclass
from ..graph.groups import Groups
from ..graph.mechanism import GROUND, POSE, Body, Frame, Joint, Mechanism

CLOSING = frozenset({"rod", "gear", "rack", "wheel", "skate"})  # they tie what moves anyhow
ROUNDS = 12  # of refinement: joints that far away still tell two groups apart
Ranks = Mapping[str, int]


@dataclass(frozen=True, slots=True)
class Step:
    """One elementary freedom in a direction of its joint, with its coordinates: hinge, slide, screw, ball or float.

    Or none: a weld whose reaction is read.
    """

    kind: str
    direction: str  # axis, other_axis, or an axis x, y, z of the joint's own; a ball has none
    letters: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Link:
    """Link with one elementary freedom. `reverse` if the joint was drawn from it; fixed ones keep their start."""

    step: Step
    part: Joint | Body  # owner of the coordinates: a floating body has its own
    parent: int | None  # a link; None: ground
    reverse: bool
    bodies: tuple[Body, ...]  # the first of them has its point of reference in its centre of mass
    fixed: bool = False

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(f"{self.part.name}.{letter}" for letter in self.step.letters)

    @property
    def name(self) -> str:
        """Name of the link in equations."""
        return self.coordinates[-1] if self.step.letters else self.part.name


@dataclass(frozen=True, slots=True)
class Tree:
    """Links with parents first, the link of each body, chords, and closing joints."""

    links: tuple[Link, ...]
    place: Mapping[str, int | None]  # body -> its link; None: at rest on the ground
    chords: tuple[Joint, ...]
    closing: tuple[Joint, ...]

    def path(self, body: str) -> list[str]:
        """Return the chain of bodies from a given body to the ground, for messages."""
        names = [] if body == GROUND else [body]
        link = None if body == GROUND else self.place[body]
        while link is not None:
            link = self.links[link].parent
            names += [b.name for b in self.links[link].bodies[:1]] if link is not None else []
        return [*names, GROUND]


STEPS: Mapping[str, tuple[Step, ...]] = {
    "slide": (Step("slide", "axis", ("x",)),),
    "hinge": (Step("hinge", "axis", ("phi",)),),
    "screw": (Step("screw", "axis", ("phi",)),),
    "cylinder": (Step("slide", "axis", ("x",)), Step("hinge", "axis", ("phi",))),
    "planar": (Step("slide", "x", ("x",)), Step("slide", "y", ("y",)), Step("hinge", "z", ("phi",))),
    "universal": (Step("hinge", "axis", ("phi1",)), Step("hinge", "other_axis", ("phi2",))),
    "ball": (Step("ball", "", ("rx", "ry", "rz")),),
}
IN_SPACE = (*(Step("slide", c, (c,)) for c in "xyz"), *STEPS["ball"])
FLOATING = (Step("float", "", POSE),)
WELDED = (Step("weld", "", ()),)


def steps_of(joint: Joint) -> tuple[Step, ...]:
    """Elementary freedoms of a joint, from its first body to its second."""
    if joint.kind == "free":
        return STEPS["planar"] if joint.planar else IN_SPACE
    return STEPS[joint.kind]


def _without_open_turn(part: Joint | Body) -> Joint | Body:
    """Return the owner of coordinates without the starts of a turn in space that are not all of it: its pose follows, and its rates with that."""
    pose, rates = ([axis + kind for axis in ("rx", "ry", "rz") if axis + kind in part.starts] for kind in ("", ".f"))
    whole = len(pose) == 3 or "attitude.w" in part.starts
    opened = {*(() if whole else pose), *(() if whole and len(rates) == 3 else rates)}
    return replace(part, starts={k: v for k, v in part.starts.items() if k not in opened}) if opened else part


def is_weld(joint: Joint) -> bool:
    """Return True if a joint leaves no freedom and is at its position in the drawing."""
    return joint.kind == "weld" or (joint.locked and joint.kind not in CLOSING | {"distance"} and not joint.starts)


def is_chord(joint: Joint) -> bool:
    """Return True for a joint that constrains nothing."""
    return joint.kind == "distance" or (joint.kind == "free" and not joint.locked)


def ends_of(mechanism: Mechanism) -> Mapping[str, str]:
    """Map from each name that a joint may use to the body (or ground) that it is on."""
    bodies = {b.name: b.name for b in mechanism.bodies}
    return {GROUND: GROUND, **bodies, **{f.name: f.body for f in mechanism.frames}}


def spanning_tree(
    mechanism: Mechanism, bonded: Set[str] = frozenset(), apart: Set[str] = frozenset(), read: Set[str] = frozenset()
) -> Tree:
    """Grow the tree from the ground; the rest starts from a body with its own pose.

    If possible, loops are not cut at `bonded` joints, as a coordinate takes efforts and flows at no cost; then not at those that are
    `read`, as a coordinate costs nothing to read. `apart`: welds that are links of their own.
    """
    return _Growth(mechanism, bonded, apart, read).tree()


class _Growth:
    def __init__(self, mechanism: Mechanism, bonded: Set[str], apart: Set[str], read: Set[str]) -> None:
        self.mechanism, self.on = mechanism, ends_of(mechanism)
        moved = {j.name for j in mechanism.joints if j.locked and j.starts}  # these cannot close a loop
        self.kept_in = (moved, bonded, read)
        self.welds = [j for j in mechanism.joints if is_weld(j) and j.name not in apart]
        # what floats has the coordinates of a body with starts, wherever that is declared: then only these move at the start
        self.bodies = sorted(mechanism.bodies, key=lambda body: not body.starts)
        self.group = Groups((name, name) for name in [GROUND, *(b.name for b in self.bodies)])
        self.links: list[Link] = []
        self.start: dict[str, int | None] = {}  # group -> its link
        self.used: set[str] = set()

    def tree(self) -> Tree:
        merged = {j.name for j in self.welds}
        for joint in self.welds:
            self._weld(joint)
        members: dict[str, list[Body]] = {}
        for body in self.bodies:
            members.setdefault(self.group.of(body.name), []).append(body)
        free = [j for j in self.mechanism.joints if j.kind not in CLOSING and not is_chord(j) and j.name not in merged]
        neighbours = self._neighbours(free)
        names = list(dict.fromkeys(j.name for near in neighbours.values() for _, j in near))
        if len(self._forest(free, names)) < len(names):
            order = self._order(neighbours, *joint_ranks(free, members, self._group_of, self.kept_in))
            neighbours = self._neighbours(self._forest(free, order))
        self._grow(GROUND, None, members, neighbours)
        # what floats, in any order of declaration: a joint from A to B moves B at the start
        moved = {self._group_of(j.second) for j in free}
        for group in sorted(members, key=lambda g: (not any(b.starts for b in members[g]), g in moved)):
            if group not in self.start:
                self._grow(group, self._float(members[group]), members, neighbours)
        place = {name: self.start[self.group.of(name)] for name in self.group if name != GROUND}
        closing = [j for j in self.mechanism.joints if not is_chord(j) and j.name not in self.used]
        chords = [j for j in self.mechanism.joints if is_chord(j)]
        own = {link.part.name for link in self.links}
        parts: tuple[Joint | Body | Frame, ...] = (*self.mechanism.joints, *self.bodies, *self.mechanism.frames)
        links = self.links
        if closing or any(part.starts and part.name not in own for part in parts):  # what decides other coordinates
            links = [link if link.fixed else replace(link, part=_without_open_turn(link.part)) for link in links]
        return Tree(tuple(links), place, tuple(chords), tuple(closing))

    def _neighbours(self, joints: Sequence[Joint]) -> dict[str, list[tuple[str, Joint]]]:
        found: dict[str, list[tuple[str, Joint]]] = {}
        for joint in joints:
            first, second = self._group_of(joint.first), self._group_of(joint.second)
            if first != second:
                found.setdefault(first, []).append((second, joint))
                found.setdefault(second, []).append((first, joint))
        return found

    def _order(self, neighbours: Mapping[str, Sequence[tuple[str, Joint]]], ranks: Ranks, groups: Ranks) -> list[str]:
        """Joints in the order in which a tree reaches them that grows breadth first from the ground, then from the remaining bodies.

        Among joints at the same distance the ranks decide, so that loops are cut at the joint with the most coordinates.
        """
        seen: set[str] = set()
        names: dict[str, None] = {}
        for root in self.group:
            level = [] if root in seen or self.group.of(root) != root else [root]
            while level:
                seen.update(level)
                found = [
                    (ranks[j.name], groups[far], far, j.name) for near in level for far, j in neighbours.get(near, ())
                ]
                found.sort(key=lambda each: each[:2])
                names.update(dict.fromkeys(name for *_, far, name in found))
                level = list(dict.fromkeys(far for *_, far, _ in found if far not in seen))
        return [*names]

    def _forest(self, joints: Sequence[Joint], order: Sequence[str]) -> list[Joint]:
        """Joints without a loop (J. Kruskal, 1956): first those that should not close one, then in the given order."""
        by_name, joined = {j.name: j for j in joints}, Groups(self.group)

        def weight(name: str) -> tuple[bool, ...]:
            return tuple(name not in kept for kept in self.kept_in)

        kept: set[str] = set()
        for name in sorted(order, key=weight):
            one, other = (joined.of(self.on[end]) for end in (by_name[name].first, by_name[name].second))
            if one != other:
                joined.join(one, other)
                kept.add(name)
        return [j for j in joints if j.name in kept]

    def _group_of(self, end: str) -> str:
        return self.group.of(self.on[end])

    def _weld(self, joint: Joint) -> None:
        """Merge two groups. The group takes the name of the ground, or of its first body."""
        first, second = self._group_of(joint.first), self._group_of(joint.second)
        if first == second:
            return
        order = list(self.group)
        name, other = sorted((first, second), key=order.index)
        self.group.join(other, name)
        self.used.add(joint.name)

    def _float(self, bodies: list[Body]) -> int:
        body = bodies[0]
        if not self.mechanism.planar:
            self.links.append(Link(FLOATING[0], body, None, False, tuple(bodies)))
            return len(self.links) - 1
        return self._row(STEPS["planar"], body, None, False, tuple(bodies), False)

    def _row(
        self, steps: tuple[Step, ...], part: Joint | Body, parent: int | None, reverse: bool, bodies: tuple[Body, ...],
        fixed: bool,
    ) -> int:  # fmt: skip
        steps = steps[::-1] if reverse else steps
        for number, step in enumerate(steps):
            carried = bodies if number == len(steps) - 1 else ()
            self.links.append(Link(step, part, parent, reverse, carried, fixed))
            parent = len(self.links) - 1
        assert parent is not None
        return parent

    def _grow(
        self, root: str, link: int | None, members: Mapping[str, list[Body]],
        neighbours: Mapping[str, list[tuple[str, Joint]]],
    ) -> None:  # fmt: skip
        """Grow breadth first, in the order of declaration."""
        self.start[root] = link
        queue = [root]
        for near in queue:
            for far, joint in neighbours.get(near, ()):
                if far in self.start:
                    continue
                reverse = self._group_of(joint.second) == near
                bodies = tuple(members[far])
                self.start[far] = self._row(
                    WELDED if is_weld(joint) else steps_of(joint),
                    joint,
                    self.start[near],
                    reverse,
                    bodies,
                    joint.locked,
                )
                self.used.add(joint.name)
                queue.append(far)


def drivable(mechanism: Mechanism, ports: Iterable[str]) -> frozenset[str]:
    """Ports whose flow the network may determine: coordinates of tree joints, one by one (not those of a ball).

    `ports` are all that have bonds.
    """
    links = spanning_tree(mechanism, bonded_joints(ports)).links
    return frozenset(
        c
        for link in links
        for c in link.coordinates
        if isinstance(link.part, Joint) and not link.fixed and len(link.coordinates) == 1
    )


def bonded_joints(ports: Iterable[str]) -> frozenset[str]:
    """Parts that the ports belong to."""
    return frozenset(port.partition(".")[0] for port in ports)


def loop_of(tree: Tree, joint: Joint, mechanism: Mechanism) -> list[str]:
    """Bodies around the loop that a joint closes, for messages."""
    on = ends_of(mechanism)
    if joint.first not in on:  # a gear or rack joins joints
        return [joint.first, joint.second]
    first, second = (tree.path(on[end]) for end in (joint.first, joint.second))
    shared = [n for n in first if n in second]
    meeting = shared[0]
    return [*first[: first.index(meeting)], meeting, *reversed(second[: second.index(meeting)]), on[joint.first]]


def joint_ranks(
    joints: Sequence[Joint],
    members: Mapping[str, Sequence[Body]],
    group_of: Callable[[str], str],
    kept_in: Sequence[Set[str]],
) -> tuple[Ranks, Ranks]:
    """Rank of each joint by its name, and of each group of bodies; equal ones share it.

    `kept_in`: sets of joints that should not close a loop, the most important first.
    """
    kinds = {
        j.name: (*(j.name not in kept for kept in kept_in), len(j.freedoms), j.kind, *map(_words, _vectors(j)))
        for j in joints
    }
    joint_rank = _ranked(kinds)
    ends = {j.name: (group_of(j.first), group_of(j.second)) for j in joints}
    groups = dict.fromkeys([*members, *(g for pair in ends.values() for g in pair)])
    rank = _ranked({g: (g != GROUND, *sorted(map(_data, members.get(g, ())))) for g in groups})
    for _ in range(ROUNDS):
        around: dict[str, list[tuple[int, int]]] = {g: [] for g in groups}
        for name, pair in ends.items():
            for near, far in (pair, pair[::-1]):
                around[near].append((joint_rank[name], rank[far]))
        finer = _ranked({g: (rank[g], sorted(around[g])) for g in groups})
        if finer == rank:
            break
        rank = finer
    return _ranked({n: (joint_rank[n], sorted(rank[g] for g in ends[n])) for n in joint_rank}), rank


def _ranked(keys: Mapping[str, Any]) -> dict[str, int]:
    """Position of each key among the distinct ones, in sorted order."""
    distinct = sorted({repr(key): key for key in keys.values()}.values())
    places = {repr(key): place for place, key in enumerate(distinct)}
    return {name: places[repr(key)] for name, key in keys.items()}


def _vectors(joint: Joint) -> tuple[Bound, ...]:
    return (*joint.position, *joint.axis, *joint.other_axis, joint.ratio)


def _data(body: Body) -> tuple[str, ...]:
    """Mass, position and inertia zz of a body."""
    return tuple(map(_words, (body.mass, *body.position, body.inertia.zz)))


def _words(bound: Bound) -> str:
    """Form of an expression with its numbers, without the names of its symbols."""
    return repr(bound.formula.expression)
