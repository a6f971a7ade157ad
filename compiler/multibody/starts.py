"""Starts of parts that are computed from the coordinates: chords, bodies that are carried by others, frames.

The author does not choose the tree, so any part may have a start. Each such start is a claim, and the coordinates
without a start of their own move as little as necessary to satisfy it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ..graph.mechanism import Body, Frame, Joint, Mechanism
from .assignment_emitter import AssignmentEmitter
from .motion import MechanismEquations
from .tree import Tree


def claimed_parts(mechanism: Mechanism, tree: Tree) -> Mapping[str, Body | Frame | Joint]:
    """Parts with a start that have no coordinates of their own."""
    own = {link.part.name for link in tree.links}
    return {part.name: part for part in _parts(mechanism) if part.starts and part.name not in own}


def _parts(mechanism: Mechanism) -> Iterator[Body | Frame | Joint]:
    yield from mechanism.joints
    yield from mechanism.bodies
    yield from mechanism.frames


def claim_starts(
    script: AssignmentEmitter, claimed: Mapping[str, Body | Frame | Joint], result: MechanismEquations
) -> None:
    """Add each of their starts as a claim."""
    for part in claimed.values():
        for key, bound in part.starts.items():
            freedom, is_rate = (key[:-2], True) if key.endswith(".f") else (key, False)
            port = f"{part.name}.{freedom}"
            if port in result.motions:
                motion = result.motions[port]
                value = motion.flow if is_rate else motion.pose
            else:
                value = result.readings[port]
            script.builder.claim(value, script.builder.folded(bound), script.named(port), part.span)
