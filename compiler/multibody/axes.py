"""Choice of the axes in which each link is computed.

A branch (the links on one joint of the ground) that only turns about one axis and slides across it, or only slides, is
computed in axes that do not turn: there inertia about the axis is a constant and angles add up. So planar mechanisms are
recognised in any plane of the drawing; the axis of the turn is always the third. All other branches are computed in axes that turn
with each link: constant inertia tensors, constant arms, one hinge to rotate vectors by. These axes are parallel to the world's in the
drawing. If a hinge is parallel to none of them, those of its link are turned by constant angles until one is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..algebra.expression import ZERO, Expression, Number, add, multiply
from ..fast_dataclass import dataclass
from .rotations import AxialTurn
from .tree import Link
from .vectors import Vector, dot

Basis = tuple[tuple[float, float, float], ...]  # rows; world = basis * own, in the drawing
WORLD: Basis = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NEARLY = 1e-14
ROUNDING = 2e-15  # of a vector's length, after it was turned


@dataclass(frozen=True, slots=True)
class AxisBranch:
    """Axes of the links of one branch. `still`: they do not turn; `basis`: constant rotation from the world's axes.

    `active`: the components (of six: torques or angular velocities, then forces or velocities) that can be non-zero.
    """

    still: bool
    basis: Basis
    active: tuple[int, ...]


ANYWHERE = AxisBranch(False, WORLD, (0, 1, 2, 3, 4, 5))
SLIDING = (3, 4, 5)
IN_PLANE = (2, 3, 4)


def to_own(basis: Basis, v: Vector) -> Vector:
    """Components in other axes of a vector given in world axes. Components that are zero up to rounding become zero."""
    if basis is WORLD:
        return v
    turned = _product(tuple(zip(*basis, strict=True)), v)
    known = numbers(turned)
    if known is None:
        return turned
    least = ROUNDING * math.sqrt(sum(c * c for c in known))
    x, y, z = (Number(c) if abs(c) > least else ZERO for c in known)
    return x, y, z


def to_world(basis: Basis, v: Vector) -> Vector:
    """World components of a vector given in other axes."""
    return v if basis is WORLD else _product(basis, v)


def _product(rows: Sequence[Sequence[float]], v: Vector) -> Vector:
    x, y, z = (add(*(multiply(Number(a), b) for a, b in zip(row, v, strict=True))) for row in rows)
    return x, y, z


def numbers(v: Vector) -> tuple[float, float, float] | None:
    """The components, if all are numbers; else None."""
    if isinstance(v[0], Number) and isinstance(v[1], Number) and isinstance(v[2], Number):
        return v[0].value, v[1].value, v[2].value
    return None


def branches(links: Sequence[Link], directions: Sequence[Vector]) -> list[AxisBranch]:
    """Branch of each link. `directions` are unit vectors in the drawing."""
    roots: list[int] = []
    for number, link in enumerate(links):
        roots.append(number if link.parent is None else roots[link.parent])
    members: dict[int, list[int]] = {}
    for number, root in enumerate(roots):
        members.setdefault(root, []).append(number)
    kinds = {root: _branch([(links[i].step.kind, directions[i]) for i in inside]) for root, inside in members.items()}
    return [kinds[root] for root in roots]


def _branch(moves: Sequence[tuple[str, Vector]]) -> AxisBranch:
    kinds = {kind for kind, _ in moves}
    if not kinds <= {"slide", "hinge", "weld"}:
        return ANYWHERE
    if "hinge" not in kinds:
        return AxisBranch(True, WORLD, SLIDING)
    hinges = [numbers(d) for kind, d in moves if kind == "hinge"]
    axis = hinges[0]
    if axis is None or any(h is None or not _is_along(h, axis) for h in hinges):
        return ANYWHERE
    across = [dot(d, _vector(axis)) for kind, d in moves if kind == "slide"]
    if not all(isinstance(x, Number) and abs(x.value) < NEARLY for x in across):
        return ANYWHERE
    return AxisBranch(True, _with_third(axis), IN_PLANE)


def _vector(v: tuple[float, float, float]) -> Vector:
    return Number(v[0]), Number(v[1]), Number(v[2])


def _is_along(a: tuple[float, float, float], b: tuple[float, float, float]) -> bool:
    return abs(abs(sum(x * y for x, y in zip(a, b, strict=True))) - 1.0) < NEARLY


def _with_third(axis: tuple[float, float, float]) -> Basis:
    """Axes with the third parallel or antiparallel to a given direction: the world's axes if possible."""
    for k in range(3):
        if abs(abs(axis[k]) - 1.0) < NEARLY:
            if k == 2:
                return WORLD
            columns = [[float(row == (k + 1 + c) % 3) for row in range(3)] for c in range(3)]
            return _columns(columns)
    _, own, basis = turned_to(axis, WORLD)
    return _columns([[row[(own + 1 + c) % 3] for row in basis] for c in range(3)])


def _columns(columns: Sequence[Sequence[float]]) -> Basis:
    return tuple((columns[0][r], columns[1][r], columns[2][r]) for r in range(3))


def turned_to(axis: tuple[float, float, float], basis: Basis) -> tuple[tuple[AxialTurn, ...], int, Basis]:
    """Constant rotations that make one axis of the basis parallel to a given direction (in the axes of the basis).

    Returns the rotations, the number of that axis, and the rotated basis.
    """
    zero = [k for k in range(3) if abs(axis[k]) < NEARLY]
    if zero:
        about = zero[0]
        own = (about + 1) % 3
        plan = [(about, math.atan2(axis[(about + 2) % 3], axis[own]))]
    else:
        own = 0
        plan = [(2, math.atan2(axis[1], axis[0])), (1, -math.atan2(axis[2], math.hypot(axis[0], axis[1])))]
    for k, angle in plan:
        basis = _times_turn(basis, k, angle)
    return tuple(AxialTurn(k, Number(angle)) for k, angle in plan), own, basis


def _times_turn(basis: Basis, about: int, angle: float) -> Basis:
    c, s = math.cos(angle), math.sin(angle)
    i, j = (about + 1) % 3, (about + 2) % 3
    rows = []
    for row in basis:
        new = list(row)
        new[i], new[j] = c * row[i] + s * row[j], c * row[j] - s * row[i]
        rows.append((new[0], new[1], new[2]))
    return tuple(rows)


def snapped(v: Vector) -> Vector:
    """The vector with components rounded to zero or one if they differ only by rounding."""
    x, y, z = (_snapped(c) for c in v)
    return x, y, z


def _snapped(x: Expression) -> Expression:
    if isinstance(x, Number):
        for exact in (-1.0, 0.0, 1.0):
            if abs(x.value - exact) < NEARLY:
                return Number(exact) if exact else ZERO
    return x
