"""Joints without a place between two bodies: they stand at the origin of the drawing, which is seldom meant where neither body is drawn."""

from __future__ import annotations

from collections.abc import Iterator

from ..algebra.expression import evaluate
from .mechanism import ORIGIN, Body
from .network import BondGraph, MechanismNode, Quantity

TURNING = ("hinge", "ball", "universal", "cylinder", "screw")  # where they stand decides how the bodies move


def placement_notes(graph: BondGraph) -> Iterator[str]:
    """Notes on joints that turn two bodies about the origin for want of an `at`, where neither body is drawn there."""
    for node in graph.nodes:
        if isinstance(node, MechanismNode):
            bodies = {b.name: b for b in node.mechanism.bodies}
            for joint in node.mechanism.joints:
                ends = [bodies[n] for n in (joint.first, joint.second) if n in bodies]
                if (
                    joint.kind in TURNING
                    and joint.position is ORIGIN
                    and len(ends) == 2
                    and all(_is_away(b, graph) for b in ends)
                ):
                    yield (
                        f"`{node.name}.{joint.name}` says no `at`, so it stands at the origin of the drawing, where neither `{joint.first}` nor "
                        f"`{joint.second}` is drawn"
                    )


def _is_away(body: Body, graph: BondGraph) -> bool:
    """Return True if a body is drawn at another place than the origin."""

    def value(argument: object) -> float:
        number = graph.quantities[argument.name].value if isinstance(argument, Quantity) else argument
        return number if isinstance(number, float) else 1.0

    return any(evaluate(b.formula.expression, lambda slot, b=b: value(b.arguments[slot])) != 0.0 for b in body.position)  # type: ignore[misc]
