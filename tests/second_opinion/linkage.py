"""A planar mechanism in absolute coordinates: each body has x, y and an angle, each joint its constraints with multipliers.

All coordinates are expressions of the poses; their slopes give velocities, and the directions of forces (virtual power).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from compiler.algebra.expression import ZERO, Expression, Number, Symbol, add, call, multiply, substitute, symbols
from compiler.graph.mechanism import COUPLINGS, HOLDING_NOTHING, PLANAR_POSE, Body, Joint
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

    pose_names = PLANAR_POSE

    def __init__(self, a: Assembly, node: MechanismNode) -> None:
        self.a, self.mechanism = a, node.mechanism
        self.pose: dict[str, Any] = {}
        self.rate: dict[str, Any] = {}
        self.drawn: dict[str, Any] = {}
        self.places: list[int] = []  # in x: of poses
        self.speeds: list[int] = []  # and of their rates
        self.forces: dict[Symbol, list[Expression]] = {}  # on each rate
        self.constraints: list[Expression | None] = []  # None: of rates alone
        self.rates: list[Expression] = []  # of constraints
        self.multipliers: list[Symbol] = []
        self.acting: dict[str, list[tuple[Expression, Expression]]] = {}  # joint -> rates and the efforts on them
        self.awaited: list[tuple[Symbol, str, str]] = []  # reactions that laws read
        self.complete = False
        self.turns: dict[
            Expression, Expression
        ] = {}  # states that count turns -> the same of poses, without whole turns
        for body in self.mechanism.bodies:
            self._place(body)
        for joint in self.mechanism.joints:
            self.acting[joint.name] = []
            self._hold(joint)

    def _place(self, body: Body) -> None:
        values = [*(self.value(c) for c in body.position[:2]), self.value(body.turn[2])]
        self.drawn[body.name] = values
        rates = self._moving(3)
        self.rate[body.name], self.pose[body.name] = rates, self._posed(values, rates)

    def _moving(self, count: int) -> tuple[Symbol, ...]:
        """New rates, zero at the start."""
        rates = [self.a.state(self.a.unknown(), 0.0) for _ in range(count)]
        self.speeds += [r.key.number for r in rates]
        self.forces |= {r: [] for r in rates}
        return tuple(rates)

    def _posed(self, starts: Sequence[float], rates: Sequence[Expression]) -> tuple[Symbol, ...]:
        """New coordinates of a pose."""
        poses = [self.a.state(r, v) for r, v in zip(rates, starts, strict=True)]
        self.places += [p.key.number for p in poses]
        return tuple(poses)

    def value(self, bound: Any) -> float:
        """A number, now and for all runs of this system."""
        found = self.a.opened(bound)
        self.a.fixed |= {self.a.free[s.key.number] for s in symbols(found) if s.key.kind == "p"}  # type: ignore[attr-defined]
        return self.a.number(found)

    # ------------------------------------------------------------ points
    def fixed(self, place: str, at: tuple[float, float]) -> tuple[Point, Expression]:
        """Position of a point that is fixed to a body (or frame, or the ground) and was drawn at `at`, and the body's rotation since."""
        body = self.mechanism.body_of(place)
        x, y, phi = self.pose.get(body, (ZERO, ZERO, ZERO))
        x0, y0, phi0 = self.drawn.get(body, (0.0, 0.0, 0.0))
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
        if joint.locked:
            raise NotHeld("a locked joint")
        if joint.kind in COUPLINGS:
            first, second = (self.from_drawing(n) for n in (joint.first, joint.second))
            self._tie(second - multiply(Number(self.value(joint.ratio)), first))
            return
        if joint.kind == "rod":
            (px, py), _ = self.fixed(joint.first, self.point(joint.first))
            (qx, qy), _ = self.fixed(joint.second, self.point(joint.second))
            x0, y0, x1, y1 = *self.point(joint.first), *self.point(joint.second)
            length = ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5
            self._tie(call("sqrt", (qx - px) * (qx - px) + (qy - py) * (qy - py)) - length)
            return
        if joint.kind in HOLDING_NOTHING:
            return
        at = (self.value(joint.position[0]), self.value(joint.position[1]))
        p, turn_1 = self.fixed(joint.first, at)
        q, turn_2 = self.fixed(joint.second, at)
        if joint.kind in ("hinge", "weld"):
            self._tie(q[0] - p[0])
            self._tie(q[1] - p[1])
        elif joint.kind == "slide":
            self._tie(self._along(joint, p, q, turn_1)[1])
        else:
            raise NotHeld(joint.kind)
        if joint.kind in ("slide", "weld"):
            self._tie(turn_2 - turn_1)

    def from_drawing(self, name: str) -> Expression:
        """The one coordinate of a joint, zero in the drawing."""
        joint = next(j for j in self.mechanism.joints if j.name == name)
        ((_, c),) = self.coordinates(joint).items()
        return c - sum(self.value(b) for b in joint.rest.values())

    def _tie(self, gap: Expression | None, rate: Expression | None = None) -> None:
        """Let a gap vanish, or without one a rate."""
        self.constraints.append(gap)
        self.rates.append(self.velocity(gap) if gap is not None else rate)  # type: ignore[arg-type]
        self.multipliers.append(self.a.unknown())
        self.acting[next(reversed(self.acting))].append((self.rates[-1], self.multipliers[-1]))

    def reaction(self, name: str, component: str) -> Expression:
        """Component of the whole wrench through a joint on its second body, at the joint's point in world axes."""
        joint = next(j for j in self.mechanism.joints if j.name == name)
        if joint.kind in COUPLINGS:
            raise NotHeld("the reaction of a gear or rack")
        end, sign = (joint.second, 1.0) if self.mechanism.body_of(joint.second) in self.rate else (joint.first, -1.0)
        body = self.mechanism.body_of(end)
        wrench = [
            add(*(multiply(Number(sign), slope(flow, r), e) for flow, e in self.acting[name])) for r in self.rate[body]
        ]
        return self.at_joint(joint, body, wrench)[self.pose_names.index(component)]

    def at_joint(self, joint: Joint, body: str, wrench: Sequence[Expression]) -> Sequence[Expression]:
        """The wrench at the centre of a body, as it is at a joint's point."""
        (qx, qy), _ = self.fixed(joint.second, (self.value(joint.position[0]), self.value(joint.position[1])))
        x, y, _ = self.pose[body]
        fx, fy, torque = wrench
        return fx, fy, torque - ((qx - x) * fy - (qy - y) * fx)

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
        terms = [multiply(slope(c, s), self.a.rates[s.key.number]) for s in symbols(c) if s.key.kind == "x"]  # type: ignore[attr-defined]
        return add(*terms) if terms else ZERO

    def flow(self, path: str) -> Expression:
        """Rate of a coordinate of a part: what effort on it multiplies to power."""
        return self.velocity(self.coordinate(path))

    def reading(self, path: str, variable: str) -> Expression:
        if ".reaction." in path:
            part, component = path.split(".reaction.")
            if self.complete:
                return self.reaction(part, component)
            self.awaited.append((self.a.unknown(), part, component))
            return self.awaited[-1][0]
        if variable in "qf":
            return self.coordinate(path) if variable == "q" else self.flow(path)
        raise NotHeld("the effort of a port of a mechanism")

    def push(self, path: str, effort: Expression) -> None:
        flow = self.flow(path)
        self._push(flow, effort)
        if (joint := path.rpartition(".")[0]) in self.acting:
            self.acting[joint].append((flow, effort))

    def _push(self, flow: Expression, effort: Expression) -> None:
        for r in symbols(flow):
            if r in self.forces:
                self.forces[r].append(slope(flow, r) * effort)

    def close(self) -> None:
        """Newton and Euler for all bodies, once everything has pushed, and the constraints."""
        for gap, rate, multiplier in zip(self.constraints, self.rates, self.multipliers, strict=True):
            self._push(rate, multiplier)
            self.a.equal_zero(rate if gap is None else gap)
        for body in self.mechanism.bodies:
            for r, own in zip(self.rate[body.name], self.inertial(body), strict=True):
                self.a.equal_zero(add(own, *(-f for f in self.forces[r])))
        self.complete = True
        for symbol, part, component in self.awaited:
            self.a.equal_zero(self.reaction(part, component) - symbol)

    def accelerations(self, body: Body) -> list[Expression]:
        """Of the rates, less gravity."""
        gravity = [*(self.value(g) for g in self.mechanism.gravity), 0.0, 0.0, 0.0]
        return [self.a.rates[r.key.number] - g for r, g in zip(self.rate[body.name], gravity, strict=False)]

    def inertial(self, body: Body) -> list[Expression]:
        """Mass and inertia times accelerations."""
        mass, inertia = self.a.opened(body.mass), self.a.opened(body.inertia.zz)
        x, y, phi = self.accelerations(body)
        return [multiply(mass, x), multiply(mass, y), multiply(inertia, phi)]

    # ------------------------------------------------------------ starts
    def posed(self, c: Expression) -> Expression:
        """A coordinate of poses alone, which count no whole turns."""
        return substitute(c, lambda s: self.turns.get(s, s))

    def closed(self) -> list[Expression]:
        """What vanishes of poses."""
        return [self.posed(gap) for gap in self.constraints if gap is not None]

    def said(self) -> list[tuple[str, float, bool]]:
        """Paths of coordinates, their starts, and True if the start is of their rate."""
        found = []
        for part in (*self.mechanism.bodies, *self.mechanism.frames, *self.mechanism.joints):
            for name, bound in part.starts.items():
                path = name.removesuffix(".f")
                found.append((f"{part.name}.{path}", self.value(bound), path != name))
        return found

    def unsaid(self, rate: bool) -> list[str]:
        """The coordinates of joints of which nothing is said, or nothing of the rate."""
        joints = [j for j in self.mechanism.joints if j.kind not in COUPLINGS | {"distance"}]
        return [f"{j.name}.{n}" for j in joints for n in self.coordinates(j) if n + ".f" * rate not in j.starts]
