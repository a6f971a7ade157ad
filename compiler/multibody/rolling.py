"""Wheels and skates: contacts of a body with a plane of another, without slip.

The point of contact neither leaves the plane nor slides. The first is a constraint on positions, as of any closing joint. The second is one on
velocities alone, which follows from no constraint on positions (it is nonholonomic): a disc that has rolled around a loop comes back with another
angle. Only in the plane can it be integrated: there a wheel is a rack and pinion.

The point of contact is fixed to neither body. On a wheel with centre c and unit axle a, on a plane with unit normal n, it is

    x = c - (r/s) u,    u = n - (n.a) a,    s = |u| = sqrt(1 - (n.a)^2),

and without an axle, on a sphere or in the plane, x = c - r n. The velocity that vanishes is that of the wheel's material there against the plane's.
Its component along n is the rate of the height n.c - r s, as the rim is level at its lowest point.
"""

from __future__ import annotations

from ..algebra.expression import ONE, ZERO, Expression, add, call, divide, multiply, negate
from ..fast_dataclass import dataclass
from ..graph.mechanism import ORIGIN
from .loop_frames import Row, Sides
from .vectors import NULL, Vector, cross, dot, is_null, minus, negated, plus, scaled


@dataclass(frozen=True, slots=True)
class ContactPoint:
    """The point of contact from the second body's marker (m), its rate (m/s), and its height over the plane less that in the drawing."""

    arm: Vector
    drift: Vector
    height: Expression


@dataclass(frozen=True, slots=True)
class ContactDirection:
    """A unit direction along which the contact does not slide, and its rate (1/s)."""

    along: Vector
    turning: Vector


def contact_rows(sides: Sides) -> list[Row]:
    """Constraints of a wheel or skate."""
    joint = sides.joint
    drawn = sides.direction(joint.other_axis, "normal")
    plane: list[Vector] = [drawn, (drawn[1], negate(drawn[0]), ZERO)] if joint.planar else [*sides.axes_along(drawn)]
    normal, *level = (_with_first(sides, v, f"plane.{i}") for i, v in enumerate(plane))
    if joint.kind == "skate":
        return _skate_rows(sides, normal)
    touching = _touching(sides, normal, drawn)
    heights = [_row(sides, touching, normal, "contact", touching.height)]
    if joint.planar:
        return [*heights, _row(sides, touching, level[0], "rolls", _rolled(sides, level[0]))]
    return [*heights, *(_row(sides, touching, d, f"rolls.{i}") for i, d in enumerate(level, 1))]


def _skate_rows(sides: Sides, normal: ContactDirection) -> list[Row]:
    """A blade touches the plane at one point, and does not move across itself there. In the plane of a planar mechanism it touches anyway."""
    name, script, point = sides.joint.name, sides.script, ContactPoint(NULL, NULL, dot(normal.along, sides.gap))
    edge = sides.on(sides.second, sides.direction(sides.joint.axis, "along"), "edge")
    swept = cross(sides.second.spin, edge)
    if sides.joint.planar:
        return [_row(sides, point, ContactDirection(_left_of(edge), _left_of(swept)), "across")]
    beside = script.vector(f"{name}.beside", cross(normal.along, edge))
    share = script.let(f"{name}.share", divide(ONE, call("sqrt", dot(beside, beside))))
    across = script.vector(f"{name}.across", scaled(share, beside))
    changes = plus(cross(normal.turning, edge), cross(normal.along, swept))
    turning = scaled(share, minus(changes, scaled(dot(across, changes), across)))
    sideways = ContactDirection(across, script.vector(f"{name}.across rate", turning, "1/s"))
    return [_row(sides, point, normal, "contact", point.height), _row(sides, point, sideways, "across")]


def _left_of(v: Vector) -> Vector:
    return negate(v[1]), v[0], ZERO


# ---------------------------------------------------------------- geometry
def _with_first(sides: Sides, drawn: Vector, word: str) -> ContactDirection:
    """A direction that turns with the first body."""
    along = sides.on(sides.first, drawn, word)
    turning = sides.script.vector(f"{sides.joint.name}.{word} rate", cross(sides.first.spin, along), "1/s")
    return ContactDirection(along, turning)


def _touching(sides: Sides, normal: ContactDirection, upright: Vector) -> ContactPoint:
    """Point of contact of a wheel; `upright`: the normal in the drawing."""
    joint, script, name = sides.joint, sides.script, sides.joint.name
    radius = script.constant(joint.ratio, f"{name} radius", "m")
    n, height = normal.along, dot(normal.along, sides.gap)
    if joint.planar or joint.axis == ORIGIN:
        return ContactPoint(scaled(negate(radius), n), scaled(negate(radius), normal.turning), height)
    axle = sides.direction(joint.axis, "about")
    a = sides.on(sides.second, axle, "about")
    lean, leant = script.let(f"{name}.lean", dot(n, a)), dot(upright, axle)
    share, shown = (call("sqrt", ONE - x * x) for x in (lean, leant))
    share = script.let(f"{name}.upright", share)
    leaning = script.let(f"{name}.leaning", dot(sides.spin, cross(a, n)), "1/s")
    u = script.vector(f"{name}.down", minus(n, scaled(lean, a)))
    falling = scaled(divide(multiply(lean, leaning), share * share), u)
    changes = minus(plus(normal.turning, falling), plus(scaled(leaning, a), scaled(lean, cross(sides.second.spin, a))))
    size = script.let(f"{name}.size", negate(divide(radius, share)), "m")
    rim = divide(multiply(radius, add(lean, negate(leant)), add(lean, leant)), add(share, shown))
    arm = script.vector(f"{name}.arm", scaled(size, u), "m")
    return ContactPoint(arm, script.vector(f"{name}.arm rate", scaled(size, changes), "m/s"), add(height, rim))


def _rolled(sides: Sides, level: ContactDirection) -> Expression:
    """In the plane: the way along the line, and that of the rim."""
    radius = sides.script.constant(sides.joint.ratio, f"{sides.joint.name} radius", "m")
    return add(dot(level.along, sides.gap), multiply(radius, sides.plane_angle()))


# ---------------------------------------------------------------- rows
def _row(
    sides: Sides, touching: ContactPoint, direction: ContactDirection, word: str, gap: Expression | None = None
) -> Row:
    """Row: the material of both bodies at the point of contact has one velocity along a direction. `gap`: its integral, if it has one."""
    script, name = sides.script, f"{sides.joint.name}.{word}"
    d, near, far = direction.along, sides.first.spin, sides.second.spin
    reach = script.vector(f"{name}.reach", plus(sides.gap, touching.arm), "m")
    slip = script.vector(f"{name}.slip", minus(plus(sides.slip, cross(far, touching.arm)), cross(near, reach)), "m/s")

    def acceleration() -> Expression:
        (first, first_turning), (second, second_turning) = sides.accelerations()
        a = plus(second, cross(second_turning, touching.arm), cross(far, touching.drift))
        a = minus(minus(a, first), plus(cross(first_turning, reach), cross(near, plus(sides.slip, touching.drift))))
        return add(dot(d, a), dot(direction.turning, slip))

    def push(force: Expression) -> None:
        f = scaled(force, d)
        arm = NULL if is_null(touching.arm) else cross(touching.arm, f)
        sides.push(f, arm, negated(cross(reach, f)))
        sides.reacts(f, NULL)

    return Row(name, "m", ZERO if gap is None else gap, dot(d, slip), acceleration, push, gap is None)
