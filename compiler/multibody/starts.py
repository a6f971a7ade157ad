"""Starts of what is computed from the coordinates: chords, bodies that hang on others, frames.

The tree is the compiler's own affair, so an author may start any part: each such start is a claim, and the coordinates of
which nothing was said move, as little as it takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from ..graph.mechanism import Body, Frame, Joint, Mechanism

if TYPE_CHECKING:
    from .dynamics import Motion, Writer
    from .tree import Link


def claimed_parts(mechanism: Mechanism, links: tuple[Link, ...]) -> Mapping[str, Body | Frame | Joint]:
    """The parts with a start that have no coordinates of their own."""
    own = {link.body.name if link.joint is None else link.joint.name for link in links}
    return {part.name: part for part in _parts(mechanism) if part.starts and part.name not in own}


def _parts(mechanism: Mechanism) -> Iterator[Body | Frame | Joint]:
    yield from mechanism.joints
    yield from mechanism.bodies
    yield from mechanism.frames


def claim_starts(
    mechanism: Mechanism, claimed: Mapping[str, Body | Frame | Joint], motions: Mapping[str, Motion], builder: Writer
) -> None:
    """Each of their starts as a claim."""
    for part in claimed.values():
        for key, bound in part.starts.items():
            freedom, _, rate = key.partition(".")
            motion = motions[f"{part.name}.{freedom}"]
            value = motion.flow if rate else motion.pose
            builder.claim(value, builder.folded(bound), f"{mechanism.name}.{part.name}.{freedom}", part.span)
