"""Starts of parts that are computed from the coordinates: chords, bodies that are carried by others, frames.

The author does not choose the tree, so any part may have a start. Each such start is a claim, and the coordinates
without a start of their own move as little as necessary to satisfy it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..graph.mechanism import Body, Frame, Joint, Mechanism
from .assignment_emitter import AssignmentEmitter
from .motion import MechanismEquations
from .tree import Tree


def claimed_parts(mechanism: Mechanism, tree: Tree) -> Mapping[str, Body | Frame | Joint]:
    """Parts with the starts of what are no coordinates of their own, if there are any."""
    own = {link.part.name: link.part.starts for link in tree.links}
    every: tuple[Body | Frame | Joint, ...] = (*mechanism.joints, *mechanism.bodies, *mechanism.frames)
    parts = {part.name: part for part in every if part.starts != own.get(part.name, {})}
    left = {n: {k: v for k, v in part.starts.items() if k not in own.get(n, {})} for n, part in parts.items()}
    return {name: replace(part, starts=left[name]) for name, part in parts.items()}


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
