"""A mechanism as text: bodies, frames and joints as they are drawn."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from ..algebra.expression import call
from ..algebra.formula import Bound
from ..graph.domains import DOMAINS, Domain
from ..graph.inertia import inertia_entries
from ..graph.mechanism import (
    ATTITUDE,
    CONTACTS,
    COUPLINGS,
    NOTHING,
    ORIGIN,
    SPANS,
    UNITY,
    UPRIGHT,
    Body,
    Frame,
    Joint,
    Mechanism,
    Vector,
    domain_of,
)
from ..graph.units import KILOGRAM, METRE, ONE, SECOND, Dimension
from .literals import braces, former_name
from .reference_names import ReferenceNames, Words

MOMENT = KILOGRAM * METRE**2
ALONG = frozenset({"slide", "cylinder", "screw", "skate"})
ABOUT = frozenset({"hinge", "universal", "wheel"})  # in space; in the plane there is one axis
UPWARDS = (NOTHING, UNITY, NOTHING)  # in the plane


def mechanism_lines(mechanism: Mechanism, names: ReferenceNames, words: Words) -> Iterator[str]:
    """Lines of its block."""
    mapped = {own: name for (owner, own), name in names.parts.items() if owner == mechanism.name}
    frames = {f.name for f in mechanism.frames}
    writer = _Parts(words, mechanism.planar)

    def part(kind: str, own: str, definition: str, attributes: Iterable[str]) -> str:
        return f"  {kind} {mapped[own]}{definition}{braces(attributes)}{former_name(own, mapped[own])}"

    name = names.nodes[mechanism.name]
    space = "planar" if mechanism.planar else "spatial"
    yield f"multibody {name} : {space} {{{former_name(mechanism.name, name)}"
    gravity = writer.vector(mechanism.gravity, METRE / SECOND**2)
    if gravity:
        yield f"  gravity = {gravity}"
    for body in mechanism.bodies:
        yield part("body", body.name, "", writer.body(body))
    for frame in mechanism.frames:
        yield part("frame", frame.name, f" : {mapped.get(frame.body, frame.body)}", writer.frame(frame))
    for joint in mechanism.joints:
        first, second = (mapped.get(b, b) for b in (joint.first, joint.second))  # `ground` is no part
        attributes = writer.joint(joint, bool({joint.first, joint.second} & frames))
        yield part(joint.kind, joint.name, f" : {first} to {second}", attributes)
    yield "}"


class _Parts:
    """Attributes of the parts of a planar or spatial mechanism."""

    def __init__(self, words: Words, planar: bool) -> None:
        self.text, self.words, self.planar = words.bound, words, planar

    def vector(self, vector: Vector, dimension: Dimension, needed: bool = False) -> str:
        """Two components or three; empty for zero, unless it is needed."""
        texts = [self.text(b, dimension) for b in vector[: 2 if self.planar else 3]]
        return f"({', '.join(texts)})" if needed or set(texts) != {"0"} else ""

    def body(self, body: Body) -> Iterator[str]:
        mass = self.text(body.mass, KILOGRAM)
        if mass != "0":
            yield f"mass = {mass}"
        yield from self._inertia(body)
        yield from self._at(body.position)
        yield from self._turn(body.turn)
        yield from self._starts(body.starts)
        look = body.appearance
        if look.shape:
            sizes = [self.text(size, METRE) for size in look.sizes]
            if look.shape == "cylinder":
                sizes = [sizes[0], f"({', '.join(sizes[1:])})"]
            yield f"shape = {look.shape}({', '.join(sizes)})"
        if look.colour:
            yield f"colour = {look.colour}"

    def _inertia(self, body: Body) -> Iterator[str]:
        entries = [self.text(b, MOMENT) for b in inertia_entries(body)]
        if set(entries) != {"0"}:
            shown = entries if set(entries[3:]) != {"0"} else entries[:3]
            yield f"inertia = {entries[2]}" if self.planar else f"inertia = ({', '.join(shown)})"

    def frame(self, frame: Frame) -> Iterator[str]:
        yield from self._at(frame.position)
        if frame.axes != "world":
            yield f"axes = {frame.axes}"
        yield from self._starts(frame.starts)

    def joint(self, joint: Joint, on_frame: bool) -> Iterator[str]:
        """A joint. `on_frame`: without a position it would be at the frame."""
        if joint.kind in COUPLINGS:
            rack = joint.kind == "rack"
            yield f"{'radius' if rack else 'ratio'} = {self.text(joint.ratio, METRE if rack else ONE)}"
            return
        if joint.kind not in SPANS:
            yield from self._at(joint.position, on_frame)
        yield from self._directions(joint)
        if joint.axes != "from":
            yield f"axes = {joint.axes}"
        for coordinate, bound in joint.rest.items():
            which = f" {coordinate}" if len(joint.freedoms) > 1 else ""
            yield f"rest{which} = {self.text(bound, _domain(coordinate).dimension('q'))}"
        if joint.locked:
            yield "locked = true"
        yield from self._starts(joint.starts)

    def _directions(self, joint: Joint) -> Iterator[str]:
        if self.planar and joint.kind in ("slide", "skate"):
            yield f"along = {self._along(joint)}"
        elif joint.kind in ALONG:
            yield f"along = {self._direction(joint.axis)}"
        elif joint.kind in ABOUT and not self.planar and joint.axis != ORIGIN:
            yield f"about = {self._direction(joint.axis)}"
        elif joint.kind in ("free", "planar"):
            yield from self._turn(joint.turn)
        if joint.kind == "universal":
            yield f"then = {self._direction(joint.other_axis)}"
        if joint.kind in CONTACTS and joint.other_axis != (UPWARDS if self.planar else UPRIGHT):
            yield f"normal = {self._direction(joint.other_axis)}"
        if joint.kind == "wheel":
            yield f"radius = {self.text(joint.ratio, METRE)}"
        if joint.kind == "screw":
            yield f"lead = {self.text(joint.ratio, METRE)}"

    def _along(self, joint: Joint) -> str:
        """Direction of a slide in the plane, as an angle if it was drawn so."""
        angle = joint.turn[2].expression
        by_angle = all(b.expression == call(f, angle) for b, f in zip(joint.axis[:2], ("cos", "sin"), strict=True))
        return self.text(joint.turn[2], ONE) if by_angle else self._direction(joint.axis)

    def _direction(self, axis: Vector) -> str:
        """Direction as bare numbers, or lengths."""
        lengths = METRE in [self.words.usual(b) for b in axis]
        return self.vector(axis, METRE if lengths else ONE, needed=True)

    def _at(self, point: Vector, needed: bool = False) -> Iterator[str]:
        where = self.vector(point, METRE, needed)
        if where:
            yield f"at = {where}"

    def _turn(self, turn: Vector) -> Iterator[str]:
        if self.planar:
            angle = self.text(turn[2], ONE)
            if angle != "0":
                yield f"angle = {angle}"
        elif found := self.vector(turn, ONE):
            yield f"turn = {found}"

    def _starts(self, starts: Mapping[str, Bound]) -> Iterator[str]:
        if "attitude.w" in starts:
            yield f"start attitude = ({', '.join(self.text(starts[f'attitude.{c}'], ONE) for c in ATTITUDE)})"
        for key, bound in starts.items():
            freedom, _, rate = key.partition(".")
            if freedom != "attitude":
                domain = _domain(freedom)
                target = f"{freedom}.{domain.letter('f')}" if rate else freedom
                yield f"start {target} = {self.text(bound, domain.dimension('f' if rate else 'q'))}"


def _domain(freedom: str) -> Domain:
    return DOMAINS[domain_of(f"part.{freedom}")]
