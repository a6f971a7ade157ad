"""Coordinates without inertia: idle rotations, which nothing drives, and a check that every coordinate moves some inertia.

Idle are a point mass on rods or on a hinge through its centre, a thin bar hung at its ends. A link that is symmetric about a point (or line), with
all bodies it carries and all joints and loads on it, feels no torque there and has no inertia there. As the limit of a body with less and less
inertia it keeps its angular velocity. So an inertia about that point or line, of any size, is added to its matrix: the angular acceleration along
it is zero, and so is the effect of the addition. Loads and energies are written without it.

Symmetry is checked numerically, with the parameters of this scene and with others: a property of these values alone is no symmetry, as a run may
change them.

The check is numerical, in one pose, with the values of this scene. It compares the articulated inertia along a coordinate (with all joints further
outwards free) to the inertia with these joints fixed. If the first is only rounding, other coordinates make the same motion: two hinges in line with
nothing between, a body without inertia about its axis of rotation. Zeros that fold are found earlier (`recursion.py`). Within a closed loop this is
no error: such a coordinate moves inertia through the closing joint. It then gets a fictitious inertia, which an unknown effort cancels
(`fictitious_inertia.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from math import cos, hypot, sin

from ..algebra.expression import ZERO, Expression, Number, add, multiply
from ..fast_dataclass import dataclass
from ..graph.mechanism import COUPLINGS, GROUND, SPANS, Body, Joint
from .assignment_emitter import AssignmentEmitter
from .axes import to_own
from .coordinates import is_turning
from .fictitious_inertia import FictitiousInertia, measured
from .inertia import tensor_entries
from .kinematics import Kinematics
from .link_state import LinkState
from .recursion import PLACES, Recursion
from .rotations import unit
from .tree import bonded_joints
from .values import Elsewhere, SampleValues
from .vectors import UNIT, Matrix, Vector, matrix_of, minus

Numbers = tuple[float, float, float]
SAME = 1e-11  # of the sizes: places and directions that are one
HINGED = frozenset({"hinge", "cylinder"})
NOTHING = 1e-13  # relative to the inertia with the joints outwards fixed: rounding of some hundred products
Square = list[list[float]]
Place = tuple[int, int]  # a link, and the number of one of its coordinates


@dataclass(frozen=True, slots=True)
class LinkGeometry:
    """Geometry of the joints, forces and masses of a link: points, and lines through points; in the drawing, world axes."""

    points: tuple[Vector, ...]
    lines: tuple[tuple[Vector, Vector], ...]

    @property
    def places(self) -> tuple[Vector, ...]:
        """All points, with those of the lines."""
        return (*self.points, *(p for p, _ in self.lines))


def idle_turns(kinematics: Kinematics, recursion: Recursion, driving: Set[str]) -> Mapping[int, Matrix]:
    """For each link with an idle rotation, the added inertia: 3 x 3, link axes. `driving`: ports with efforts or flows."""
    values = tuple(kind(kinematics.script, kinematics.length) for kind in (SampleValues, Elsewhere))
    driven = bonded_joints(driving) | {
        end for j in kinematics.tree.closing if j.kind in COUPLINGS for end in (j.first, j.second)
    }
    whole = measured(kinematics, recursion, values[0], set(range(len(kinematics.moving))))
    size = 1.0 if whole is None else whole.of(True)
    result: dict[int, Matrix] = {}
    for moving in kinematics.moving:
        weighs = recursion.inertias[moving.index].mass != ZERO and not moving.link.fixed
        thin = weighs and all(_is_singular(kinematics, b, values[0]) for b in moving.link.bodies)
        held = _held(kinematics, moving, driving, driven) if thin else None
        way = None if held is None else _way(kinematics, moving, held, values)
        if way is not None:
            result[moving.index] = _about(way, size, values[0])
    return result


def _about(way: Sequence[Vector], size: float, values: SampleValues) -> Matrix:
    """Inertia about directions: a weighted sum of their dyadic squares."""
    shares = [Number(size / sum(values.of(x) ** 2 for x in v)) for v in way]
    return matrix_of(
        [
            [add(*(multiply(s, v[row], v[k]) for s, v in zip(shares, way, strict=True))) for k in range(3)]
            for row in range(3)
        ]
    )


# ---------------------------------------------------------------- what holds a link
def _held(kinematics: Kinematics, moving: LinkState, driving: Set[str], driven: Set[str]) -> LinkGeometry | None:
    """Geometry of the joints, forces and masses of a link; None if it is more than points and lines."""
    on, place, index = kinematics.on, kinematics.tree.place, moving.index
    points: list[Vector] = []
    lines: list[tuple[Vector, Vector]] = []
    steps = [m for m in kinematics.moving if m is moving or m.parent == index]
    for step in steps:
        link = step.link
        if link.step.kind == "float" or (isinstance(link.part, Body) and link.step.kind == "hinge" and step is moving):
            continue
        if link.fixed or link.part.name in driven or link.step.kind not in ("hinge", "ball"):
            return None
        if link.step.kind == "ball":
            points.append(kinematics.pin(link))
        else:
            lines.append((kinematics.pin(link), step.direction))
    for joint in (*kinematics.tree.closing, *kinematics.tree.chords):
        ends = (
            [] if joint.kind in COUPLINGS else [e for e in (joint.first, joint.second) if _is_on(on, place, e, index)]
        )
        for end in ends:
            if joint.kind in SPANS:
                points.append(_place(kinematics, end))
            elif joint.kind == "free" and joint.name not in driven:
                continue
            elif joint.kind == "free" and end == joint.second and _pushes_at_point(joint, driving):
                points.append(kinematics.script.place(joint.position, f"{joint.name} at"))
            elif joint.name in driven or joint.locked or joint.kind not in (*HINGED, "ball"):
                return None
            elif joint.kind == "ball":
                points.append(kinematics.script.place(joint.position, f"{joint.name} at"))
            else:
                axis = unit(kinematics.script.place(joint.axis, f"{joint.name}.axis", "1"))
                lines.append((kinematics.script.place(joint.position, f"{joint.name} at"), axis))
    pushed = _pushed(kinematics, index, driving)
    if pushed is None:
        return None
    return LinkGeometry((*points, *pushed, *_weighed(kinematics, moving)), tuple(lines))


def _is_on(on: Mapping[str, str], place: Mapping[str, int | None], end: str, index: int) -> bool:
    return on[end] != GROUND and place[on[end]] == index


def _place(kinematics: Kinematics, end: str) -> Vector:
    """Position of an end of a rod or distance in the drawing."""
    return kinematics.script.place(kinematics.mechanism.point_of(end), f"{end} at")


def _pushes_at_point(joint: Joint, driving: Set[str]) -> bool:
    """Return True if a free joint exerts a force on its second body, at its point there, and no torque."""
    turning = {f"{joint.name}.{letter}" for letter in joint.freedoms if is_turning(letter)}
    return joint.axes == "from" and not turning & driving


def _pushed(kinematics: Kinematics, index: int, driving: Set[str]) -> list[Vector] | None:
    """Points of a link at which ports exert forces; None if a port exerts a torque."""
    mechanism, place = kinematics.mechanism, kinematics.tree.place
    own = {b.name: "world" for b in mechanism.bodies if place[b.name] == index}
    own |= {f.name: f.axes for f in mechanism.frames if _is_on(kinematics.on, place, f.name, index)}
    points = []
    for port in sorted(driving):
        name, _, letter = port.partition(".")
        if name in own:
            if own[name] != "world" or is_turning(letter):
                return None
            points.append(_place(kinematics, name))
    return points


def _weighed(kinematics: Kinematics, moving: LinkState) -> list[Vector]:
    """Centres of bodies with mass."""
    script = kinematics.script
    return [
        kinematics.centres[b.name]
        for b in moving.link.bodies
        if script.constant(b.mass, f"{b.name} mass", "kg") != ZERO
    ]


# ---------------------------------------------------------------- symmetry
def _way(
    kinematics: Kinematics, moving: LinkState, held: LinkGeometry, values: Sequence[SampleValues]
) -> Sequence[Vector] | None:
    """Directions, link axes, of a link's idle rotations: three for a point, one for a line; None if there is none."""
    places = held.places
    apart = [minus(p, places[0]) for p in places[1:]]
    apart = [v for v in apart if not _is_nothing(v, places, values)]
    if not apart and not held.lines:
        entries = (x for b in moving.link.bodies for x in tensor_entries(kinematics.script, b))
        return UNIT if all(x == ZERO for x in entries) else None  # the bodies are points
    ways = [*(d for _, d in held.lines), *apart]
    if not all(_is_along(ways[0], v, values) for v in ways):
        return None
    if not all(_is_thin(kinematics, b, ways[0], values) for b in moving.link.bodies):
        return None
    return (to_own(moving.basis, ways[0]),)


def _is_singular(kinematics: Kinematics, body: Body, values: SampleValues) -> bool:
    """Return True if a body has no inertia about some direction that it may turn about."""
    xx, yy, zz, xy, xz, yz = (values.of(x) for x in tensor_entries(kinematics.script, body))
    if kinematics.mechanism.planar:
        return zz == 0.0
    whole = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    return abs(whole) <= SAME * max(abs(xx), abs(yy), abs(zz)) ** 3


def _is_thin(kinematics: Kinematics, body: Body, way: Vector, values: Sequence[SampleValues]) -> bool:
    """Return True if a body has no inertia about a direction through its centre."""
    turn = kinematics.script.place(body.turn, f"{body.name} turn", "1")
    for each in values:
        xx, yy, zz, xy, xz, yz = (each.of(x) for x in tensor_entries(kinematics.script, body))
        x, y, z = _turned_back(_of(each, way), _of(each, turn))
        left = (xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z)
        if hypot(*left) > SAME * max(abs(xx), abs(yy), abs(zz)) * hypot(x, y, z):
            return False
    return True


def _turned_back(v: Numbers, turn: Numbers) -> Numbers:
    """World vector in axes that are rotated by a rotation vector (Rodrigues)."""
    angle = hypot(*turn)
    if angle == 0.0:
        return v
    axis = (-turn[0] / angle, -turn[1] / angle, -turn[2] / angle)
    swept, along = _cross(axis, v), sum(a * b for a, b in zip(axis, v, strict=True)) * (1 - cos(angle))
    x, y, z = (cos(angle) * v[k] + sin(angle) * swept[k] + along * axis[k] for k in range(3))
    return x, y, z


def _is_nothing(v: Vector, places: Sequence[Vector], values: Sequence[SampleValues]) -> bool:
    """Return True if a difference of positions is only rounding."""
    return all(hypot(*_of(each, v)) <= SAME * max(hypot(*_of(each, p)) for p in places) for each in values)


def _is_along(a: Vector, b: Vector, values: Sequence[SampleValues]) -> bool:
    """Return True if two directions are parallel or antiparallel."""
    pairs = [(_of(each, a), _of(each, b)) for each in values]
    return all(hypot(*_cross(x, y)) <= SAME * hypot(*x) * hypot(*y) for x, y in pairs)


def _of(values: SampleValues, v: Vector) -> Numbers:
    return values.of(v[0]), values.of(v[1]), values.of(v[2])


def _cross(a: Numbers, b: Numbers) -> Numbers:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@dataclass(frozen=True, slots=True)
class Survey:
    """Coordinates with a fictitious inertia, its value, and the first coordinate that moves no inertia."""

    lent: Mapping[Place, float]
    lost: tuple[LinkState, int] | None


def survey(kinematics: Kinematics, recursion: Recursion, around: Mapping[int, FictitiousInertia]) -> Survey:
    """Check the inertia along all coordinates. `around`: for each link within a closed loop, its fictitious inertias."""
    values = SampleValues(kinematics.script, kinematics.length)
    count = len(kinematics.moving)
    free = [[[values.of(x) for x in row] for row in recursion.own_matrix(m)] for m in kinematics.moving]  # fmt: skip
    held = [[list(row) for row in rows] for rows in free]
    own = [[list(row) for row in rows] for rows in free]
    lent: dict[Place, float] = {}
    for index in reversed(range(count)):
        moving = kinematics.moving[index]
        matrix, whole = free[index], held[index]
        for number, pair in enumerate(moving.columns):
            coordinate = moving.coordinates[number] if number < len(moving.coordinates) else None
            if coordinate is not None and (coordinate.driven or coordinate.target is None):
                continue
            column = [values.of(x) for x in (*pair[0], *pair[1])]
            push = _times(matrix, column)
            inertia, scale = _along(column, push), _along(column, _times(whole, column))
            if index in around:
                itself = _along(column, _times(own[index], column)) if moving.link.bodies else scale
                if min(itself, inertia) <= NOTHING * scale:
                    lent[index, number] = around[index].of(any(column[:3]))
                    inertia += lent[index, number]
            if inertia <= NOTHING * scale:
                return Survey(lent, (moving, number))
            for r in PLACES:
                for c in PLACES:
                    matrix[r][c] -= push[r] * push[c] / inertia
        if moving.parent is not None:
            carried = _carried(values, moving)
            for rows, to in ((matrix, free[moving.parent]), (whole, held[moving.parent])):
                _add(to, rows, carried)
    return Survey(lent, None)


def _along(column: Sequence[float], push: Sequence[float]) -> float:
    return sum(a * b for a, b in zip(column, push, strict=True))


def _times(rows: Square, v: Sequence[float]) -> list[float]:
    return [sum(a * b for a, b in zip(row, v, strict=True)) for row in rows]


def _carried(values: SampleValues, moving: LinkState) -> Square:
    """Motion of a link for each of the six motions of its parent; columns."""
    script = _Unwritten(values.script)
    arm = [values.of(x) for x in moving.shift]
    back = [[values.of(x) for x in moving.back(script, axis, "")] for axis in UNIT]  # the parent's axes, in own ones
    columns: Square = []
    for k in range(3):
        swept = [0.0, 0.0, 0.0]  # axis x arm
        swept[(k + 1) % 3], swept[(k + 2) % 3] = -arm[(k + 2) % 3], arm[(k + 1) % 3]
        columns.append([*back[k], *(sum(swept[j] * back[j][i] for j in range(3)) for i in range(3))])
    return [*columns, *([0.0, 0.0, 0.0, *back[k]] for k in range(3))]


def _add(to: Square, rows: Square, columns: Square) -> None:
    half = [_times(rows, column) for column in columns]
    for r in PLACES:
        for c in PLACES:
            to[r][c] += sum(a * b for a, b in zip(columns[r], half[c], strict=True))


class _Unwritten(AssignmentEmitter):
    """Expressions without names: they are not part of the equations."""

    def __init__(self, script: AssignmentEmitter) -> None:
        self.builder, self.owner, self.span = script.builder, script.owner, script.span

    def let(self, name: str, expression: Expression, unit: str = "") -> Expression:
        return expression
