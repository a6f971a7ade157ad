"""A planar mechanism in absolute coordinates: each body has x, y and an angle, each joint its constraints with multipliers.

All coordinates are expressions of the poses; their slopes give velocities, and the directions of forces (virtual power).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from compiler.algebra.expression import ZERO, Expression, Number, Symbol, add, call, multiply, symbols
from compiler.graph.mechanism import GROUND, Joint
from compiler.graph.network import MechanismNode
from tests.second_opinion.writer import NotHeld, slope

if TYPE_CHECKING:
    from tests.second_opinion.assembly import Assembly

Point = tuple[Expression, Expression]


def _sin(x: Expression) -> Expression:
    return call("sin", x)


def _cos(x: Expression) -> Expression:
    return call("cos", x)


def turned(point: Point, angle: Expression) -> Point:
    c, s = _cos(angle), _sin(angle)
    return c * point[0] - s * point[1], s * point[0] + c * point[1]


class Linkage:
    """Bodies, joints and the forces on them."""

    def __init__(self, a: Assembly, node: MechanismNode) -> None:
        m = node.mechanism
        if not m.planar:
            raise NotHeld("a mechanism in space")
        self.a, self.mechanism = a, m
        self.pose: dict[str, tuple[Expression, Expression, Expression]] = {GROUND: (ZERO, ZERO, ZERO)}
        self.rate: dict[str, tuple[Symbol, ...]] = {}
        self.drawn: dict[str, tuple[float, float, float]] = {GROUND: (0.0, 0.0, 0.0)}
        self.velocity_of: dict[Symbol, Symbol] = {}
        self.acceleration_of: dict[Symbol, Symbol] = {}
        self.forces: dict[Symbol, list[Expression]] = {}
        self.constraints: list[Expression] = []
        self.multipliers: list[Symbol] = []
        self.reactions: dict[str, list[Expression]] = {}  # joint -> force x, y and torque on its second body
        self.places: list[tuple[int, int]] = []  # of each pose coordinate: in x, and of its rate
        for body in m.bodies:
            values = [*(self.value(c) for c in body.position[:2]), self.value(body.turn[2])]
            poses = [a.state(ZERO, v) for v in values]
            rates = [a.state(a.unknown(), 0.0) for _ in values]
            self.pose[body.name], self.rate[body.name] = (poses[0], poses[1], poses[2]), tuple(rates)
            self.drawn[body.name] = (values[0], values[1], values[2])
            for p, r in zip(poses, rates, strict=True):
                a.rates[p.key.number] = r
                self.velocity_of[p] = r
                acceleration = a.rates[r.key.number]
                assert isinstance(acceleration, Symbol)
                self.acceleration_of[p] = acceleration
                self.forces[p] = []
                self.places.append((p.key.number, r.key.number))
        for joint in m.joints:
            self._hold(joint)

    def value(self, bound: Any) -> float:
        """A number, now and for all runs of this system."""
        found = self.a.opened(bound)
        self.a.fixed |= {self.a.free[s.key.number] for s in symbols(found) if s.key.kind == "p"}  # type: ignore[attr-defined]
        return self.a.number(found)

    # ------------------------------------------------------------ points
    def fixed(self, place: str, at: tuple[float, float]) -> tuple[Point, Expression]:
        """Position of a point that is fixed to a body (or frame, or the ground) and was drawn at `at`, and the body's rotation since."""
        body = self.mechanism.body_of(place)
        x, y, phi = self.pose[body]
        x0, y0, phi0 = self.drawn[body]
        since = phi - phi0
        dx, dy = turned((Number(at[0] - x0), Number(at[1] - y0)), since)
        return (x + dx, y + dy), since

    def point(self, place: str) -> tuple[float, float]:
        p = self.mechanism.point_of(place)
        return self.value(p[0]), self.value(p[1])

    # ------------------------------------------------------------ joints
    def coordinates(self, joint: Joint) -> dict[str, Expression]:
        """Values of the joint's coordinates."""
        if joint.kind == "distance":
            (px, py), _ = self.fixed(joint.first, self.point(joint.first))
            (qx, qy), _ = self.fixed(joint.second, self.point(joint.second))
            return {"d": call("sqrt", (qx - px) * (qx - px) + (qy - py) * (qy - py))}
        at = (self.value(joint.position[0]), self.value(joint.position[1]))
        (px, py), turn_1 = self.fixed(joint.first, at)
        (qx, qy), turn_2 = self.fixed(joint.second, at)
        turn = turn_2 - turn_1
        if joint.kind == "hinge":
            found: dict[str, Expression] = {"phi": turn}
        elif joint.kind == "slide":
            found = {"x": self._along(joint, (px, py), (qx, qy), turn_1)[0]}
        elif joint.kind == "free":
            seen = {"from": turn_1, "to": turn_2, "world": ZERO, "middle": multiply(Number(0.5), turn_1 + turn_2)}
            angle = seen[joint.axes] + (self.value(joint.turn[2]) if joint.axes != "world" else ZERO)
            x, y = turned((qx - px, qy - py), -angle)
            found = {"x": x, "y": y, "phi": turn}
        else:
            found = {}
        return {n: c + (self.value(joint.rest[n]) if n in joint.rest else 0.0) for n, c in found.items()}

    def _along(self, joint: Joint, p: Point, q: Point, turn: Expression) -> Point:
        """The way along the axis, and beside it, in the axes of the first body."""
        ax, ay = (self.value(joint.axis[i]) for i in (0, 1))
        length = (ax * ax + ay * ay) ** 0.5
        back = turned((q[0] - p[0], q[1] - p[1]), -turn)
        ax, ay = ax / length, ay / length
        return add(multiply(Number(ax), back[0]), multiply(Number(ay), back[1])), add(
            multiply(Number(-ay), back[0]), multiply(Number(ax), back[1])
        )

    def _hold(self, joint: Joint) -> None:
        name = joint.name
        if joint.locked:
            raise NotHeld("a locked joint")
        if joint.kind in ("gear", "rack"):
            first, second = (next(j for j in self.mechanism.joints if j.name == n) for n in (joint.first, joint.second))
            values = []
            for other in (first, second):
                ((_, c),) = self.coordinates(other).items()
                values.append(c - sum(self.value(b) for b in other.rest.values()))
            self._tie(values[1] - multiply(Number(self.value(joint.ratio)), values[0]))
            return
        if joint.kind == "rod":
            (px, py), _ = self.fixed(joint.first, self.point(joint.first))
            (qx, qy), _ = self.fixed(joint.second, self.point(joint.second))
            x0, y0, x1, y1 = *self.point(joint.first), *self.point(joint.second)
            length = ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5
            d = call("sqrt", (qx - px) * (qx - px) + (qy - py) * (qy - py))
            force = self._tie(d - length)
            self.reactions[name] = [force * (qx - px) / d, force * (qy - py) / d]
            return
        if joint.kind in ("free", "distance"):
            return
        at = (self.value(joint.position[0]), self.value(joint.position[1]))
        p, turn_1 = self.fixed(joint.first, at)
        q, turn_2 = self.fixed(joint.second, at)
        if joint.kind in ("hinge", "weld"):
            self.reactions[name] = [self._tie(q[0] - p[0]), self._tie(q[1] - p[1]), ZERO]
        elif joint.kind == "slide":
            force = self._tie(self._along(joint, p, q, turn_1)[1])
            ax, ay = (self.value(joint.axis[i]) for i in (0, 1))
            length = (ax * ax + ay * ay) ** 0.5
            normal = turned((Number(-ay / length), Number(ax / length)), turn_1)
            self.reactions[name] = [force * normal[0], force * normal[1], ZERO]
        else:
            raise NotHeld(joint.kind)
        if joint.kind in ("slide", "weld"):
            self.reactions[name][2] = self._tie(turn_2 - turn_1)

    def _tie(self, gap: Expression) -> Symbol:
        multiplier = self.a.unknown()
        self.constraints.append(gap)
        self.multipliers.append(multiplier)
        return multiplier

    # ------------------------------------------------------------ what others read, and push
    def coordinate(self, path: str) -> Expression:
        """Value of a coordinate of a part: `pin.phi`, `rod.x`, `tip.y`."""
        part, freedom = path.rsplit(".", 1)
        for joint in self.mechanism.joints:
            if joint.name == part:
                return self.coordinates(joint)[freedom]
        body = self.mechanism.body_of(part)
        if freedom == "phi":
            return self.pose[body][2]
        for frame in self.mechanism.frames:
            if frame.name == part:
                if frame.axes != "world":
                    raise NotHeld("a frame in the axes of its body")
                here, _ = self.fixed(part, self.point(part))
                return here["xy".index(freedom)]
        return self.pose[body]["xy".index(freedom)]

    def velocity(self, c: Expression) -> Expression:
        """Rate of a coordinate."""
        terms = [slope(c, s) * self.velocity_of[s] for s in symbols(c) if s in self.velocity_of]
        return add(*terms) if terms else ZERO

    def reading(self, path: str, variable: str) -> Expression:
        if ".reaction." in path:
            part, _, component = path.split(".")
            if part not in self.reactions:
                raise NotHeld("the reaction of a gear or rack")
            return self.reactions[part][("x", "y", "phi").index(component)]
        c = self.coordinate(path)
        if variable == "q":
            return c
        if variable == "f":
            return self.velocity(c)
        raise NotHeld("the effort of a port of a mechanism")

    def push(self, path: str, effort: Expression) -> None:
        self._push(self.coordinate(path), effort)

    def _push(self, c: Expression, effort: Expression) -> None:
        for s in symbols(c):
            if s in self.forces:
                self.forces[s].append(slope(c, s) * effort)

    def close(self) -> None:
        """Newton and Euler for all bodies, once everything has pushed, and the constraints."""
        for gap, multiplier in zip(self.constraints, self.multipliers, strict=True):
            self._push(gap, multiplier)
            self.a.equal_zero(gap)
        gravity = [self.value(self.mechanism.gravity[i]) for i in (0, 1)]
        for body in self.mechanism.bodies:
            mass, inertia = self.a.opened(body.mass), self.a.opened(body.inertia.zz)
            for i, p in enumerate(self.pose[body.name]):
                assert isinstance(p, Symbol)
                own = multiply(mass if i < 2 else inertia, self.acceleration_of[p])
                weight = multiply(mass, Number(-gravity[i])) if i < 2 else ZERO
                self.a.equal_zero(add(own, weight, *(-f for f in self.forces[p])))

    # ------------------------------------------------------------ starts
    def said(self) -> list[tuple[Expression, float, bool]]:
        """Coordinates, their starts, and True if the start is of their rate."""
        found = []
        for part in (*self.mechanism.bodies, *self.mechanism.frames, *self.mechanism.joints):
            for name, bound in part.starts.items():
                freedom, _, rate = name.partition(".")
                found.append((self.coordinate(f"{part.name}.{freedom}"), self.value(bound), bool(rate)))
        return found

    def unsaid(self) -> list[Expression]:
        """The coordinates of joints of which nothing is said."""
        found = []
        for joint in self.mechanism.joints:
            told = {n.partition(".")[0] for n in joint.starts}
            found += [c for n, c in self.coordinates(joint).items() if n not in told and joint.kind != "distance"]
        return found
