"""A mechanism as text: bodies, frames and joints as they are drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from ..algebra.formula import Bound
from ..graph.domains import DOMAINS
from ..graph.mechanism import Body, Joint, Mechanism, Vector
from ..graph.units import KILOGRAM, METRE, ONE, SECOND, Dimension
from .literals import braces, former_name
from .names import Names

BoundText = Callable[[Bound, Dimension], str]


def mechanism_lines(mechanism: Mechanism, names: Names, text: BoundText) -> Iterator[str]:
    """The lines of its block. `text` writes a value in the SI unit of a dimension."""
    mapped = {own: name for (owner, own), name in names.parts.items() if owner == mechanism.name}

    def part(kind: str, own: str, definition: str, attributes: Iterable[str]) -> str:
        return f"  {kind} {mapped[own]}{definition}{braces(attributes)}{former_name(own, mapped[own])}"

    name = names.nodes[mechanism.name]
    yield f"multibody {name} : planar {{{former_name(mechanism.name, name)}"
    gravity = _point(mechanism.gravity, METRE / SECOND**2, text)
    if gravity != NOWHERE:
        yield f"  gravity = {gravity}"
    for body in mechanism.bodies:
        yield part("body", body.name, "", _body(body, text))
    for frame in mechanism.frames:
        attributes = (*_at(frame.position, text), *_starts(frame.starts, text))
        yield part("frame", frame.name, f" : {mapped.get(frame.body, frame.body)}", attributes)
    for joint in mechanism.joints:
        first, second = (mapped.get(b, b) for b in (joint.first, joint.second))  # `ground` is none of its parts
        yield part(joint.kind, joint.name, f" : {first} to {second}", _joint(joint, text))
    yield "}"


NOWHERE = "(0, 0)"  # the default of a point


def _body(body: Body, text: BoundText) -> Iterator[str]:
    for word, bound, dimension in (("mass", body.mass, KILOGRAM), ("inertia", body.inertia.zz, KILOGRAM * METRE**2)):
        value = text(bound, dimension)
        if value != "0":
            yield f"{word} = {value}"
    yield from _at(body.position, text)
    angle = text(body.turn[2], ONE)
    if angle != "0":
        yield f"angle = {angle}"
    yield from _starts(body.starts, text)


def _joint(joint: Joint, text: BoundText) -> Iterator[str]:
    yield from _at(joint.position, text)
    angle = text(joint.turn[2], ONE)
    if joint.kind == "slide" or angle != "0":
        yield f"{'along' if joint.kind == 'slide' else 'angle'} = {angle}"
    if joint.axes != "from":
        yield f"axes = {joint.axes}"
    yield from _starts(joint.starts, text)


def _at(point: Vector, text: BoundText) -> Iterator[str]:
    where = _point(point, METRE, text)
    if where != NOWHERE:
        yield f"at = {where}"


def _point(point: Vector, dimension: Dimension, text: BoundText) -> str:
    return f"({', '.join(text(b, dimension) for b in point[:2])})"


def _starts(starts: Mapping[str, Bound], text: BoundText) -> Iterator[str]:
    for key, bound in starts.items():
        freedom, _, rate = key.partition(".")
        domain = DOMAINS["rotation" if freedom == "phi" else "translation"]
        target = f"{freedom}.{domain.letter('f')}" if rate else freedom
        yield f"start {target} = {text(bound, domain.dimension('f' if rate else 'q'))}"
