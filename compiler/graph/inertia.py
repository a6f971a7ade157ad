"""Checks of inertia tensors: principal moments, and the moments that a rigid body can have."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ..algebra.expression import evaluate
from ..algebra.formula import Bound
from .mechanism import Body
from .network import BondGraph, MechanismNode, Quantity

ROUNDING = 1e-6  # of the largest moment: drawings give few digits


def principal_moments(moments: Sequence[float]) -> tuple[float, float, float]:
    """Eigenvalues of a symmetric matrix (xx, yy, zz, xy, xz, yz), in rising order.

    In closed form: O. K. Smith, Eigenvalues of a symmetric 3 x 3 matrix, Comm. ACM 4 (1961) 168.
    """
    xx, yy, zz, xy, xz, yz = moments
    middle = (xx + yy + zz) / 3
    xx, yy, zz = xx - middle, yy - middle, zz - middle
    spread = math.sqrt((xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    if spread == 0.0:
        return middle, middle, middle
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    angle = math.acos(max(-1.0, min(1.0, determinant / (2 * spread**3)))) / 3
    largest = middle + 2 * spread * math.cos(angle)
    smallest = middle + 2 * spread * math.cos(angle + 2 * math.pi / 3)
    return smallest, 3 * middle - largest - smallest, largest


def is_impossible(principal: tuple[float, float, float]) -> bool:
    """Return True if a rotation about some axis would have negative energy."""
    return principal[0] < -ROUNDING * max(map(abs, principal))


def is_no_body_s(principal: tuple[float, float, float]) -> bool:
    """Return True if no rigid body has these moments: one principal moment is at most the sum of the other two."""
    first, second, third = principal
    return third > (first + second) * (1 + ROUNDING)


def inertia_notes(graph: BondGraph) -> Iterator[str]:
    """Notes on tensors that can be computed, but that no single body has. A moment about one axis alone (a rotor) is accepted."""
    for node in graph.nodes:
        if isinstance(node, MechanismNode) and not node.mechanism.planar:
            for body in node.mechanism.bodies:
                values = [_value(b, graph) for b in inertia_entries(body)]
                known = [v for v in values if v is not None]
                if len(known) == len(values):
                    principal = principal_moments(known)
                    if principal[1] > ROUNDING * principal[2] and is_no_body_s(principal):
                        shown = ", ".join(f"{p:.4g}" for p in principal)
                        yield (
                            f"`{node.name}.{body.name}` has principal moments that no rigid body has: {shown} kg*m^2; "
                            "the largest is more than the sum of the other two"
                        )


def inertia_entries(body: Body) -> tuple[Bound, ...]:
    """Entries xx, yy, zz, xy, xz, yz."""
    i = body.inertia
    return i.xx, i.yy, i.zz, i.xy, i.xz, i.yz


def _value(bound: Bound, graph: BondGraph) -> float | None:
    values = [graph.quantities[a.name].value if isinstance(a, Quantity) else a for a in bound.arguments]
    known = [v for v in values if v is not None]
    try:
        return None if len(known) < len(values) else evaluate(bound.formula.expression, known.__getitem__)
    except (ArithmeticError, ValueError):
        return None
