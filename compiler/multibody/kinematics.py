"""Poses and velocities of links, in link axes and in world axes. The latter are written only if they are needed.

In link axes these are axes and point of reference of each link, its motion, and its velocity-dependent acceleration.
In turning axes the point is on the axis of rotation, so that arms between such points are constant. In still axes it is the centre of
mass, so that the inertia is constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

from ..algebra.expression import ONE, ZERO, Expression, Number, multiply, negate
from ..graph.mechanism import GROUND, NOTHING, ORIGIN, Body, Inertia, Joint, Mechanism
from .assignment_emitter import AssignmentEmitter
from .axes import ANYWHERE, WORLD, AxisBranch, Basis, branches, numbers, snapped, to_own, to_world, turned_to
from .coordinates import Coordinate, Coordinates
from .link_state import Carried, LinkState, Marker
from .rotations import NO_TURN, TWO, AnyTurn, AxialTurn, Turn, about, composed, of_quaternion, of_rotation_vector, unit
from .tree import Link, Step, Tree, ends_of
from .values import length_of
from .vectors import NULL, UNIT, Vector, applied, cross, is_null, minus, negated, plus, scaled


class Links:
    """All links of a mechanism, each in its own axes."""

    def __init__(self, mechanism: Mechanism, tree: Tree, script: AssignmentEmitter, flows: Mapping[str, Expression], whole: bool = False) -> None:  # fmt: skip
        """`whole`: include forces and torques out of the plane of a planar motion, which reactions need."""
        self.mechanism, self.tree, self.script = mechanism, tree, script
        self.states = Coordinates(script, flows)
        self.on = ends_of(mechanism)
        self.drawn: dict[str, Turn] = {}
        directions = [self._direction(link) for link in tree.links]
        self.moving: list[LinkState] = []
        self._grounds: dict[Basis, LinkState] = {}
        self.centres = {b.name: script.place(b.position, f"{b.name} at") for b in mechanism.bodies}
        for link, branch, direction in zip(tree.links, branches(tree.links, directions), directions, strict=True):
            if whole:
                branch = replace(branch, active=ANYWHERE.active)
            self.moving.append(self._moved(link, branch, direction))

    # ------------------------------------------------------------ the drawing
    def _direction(self, link: Link) -> Vector:
        """Unit vector of a link's freedom in the drawing; reversed if the joint was drawn from the link."""
        way, part = link.step.direction, link.part
        if not way:
            return NULL
        if way in "xyz":
            v = UNIT["xyz".index(way)]
            if isinstance(part, Joint):
                v = self.joint_turn(part).apply(self.script, v, f"{part.name}.{way} axis")
        else:
            assert isinstance(part, Joint)
            given = part.axis if way == "axis" else part.other_axis
            v = unit(self.script.place(given, f"{part.name}.{way}", "1"))
        v = self.script.vector(f"{part.name}.{way} direction", snapped(v))
        return negated(v) if link.reverse else v

    def joint_turn(self, joint: Joint) -> Turn:
        """Rotation of a joint's axes in the drawing."""
        if joint.name not in self.drawn:
            v = self.script.place(joint.turn, f"{joint.name} turn", "1")
            self.drawn[joint.name] = of_rotation_vector(self.script, v, f"{joint.name} axes")
        return self.drawn[joint.name]

    def pin(self, link: Link) -> Vector:
        """Point of a link's joint in the drawing; the centre of mass for a floating body."""
        if isinstance(link.part, Joint):
            return self.script.place(link.part.position, f"{link.part.name} at")
        return self.centres[link.part.name]

    # ------------------------------------------------------------ link by link
    def parent_of(self, moving: LinkState) -> LinkState:
        """Parent of a link, or the ground in the axes of the branch."""
        if moving.parent is not None:
            return self.moving[moving.parent]
        return self.ground(moving.branch)

    def ground(self, branch: AxisBranch = ANYWHERE) -> LinkState:
        """The ground in the axes of a branch."""
        basis = branch.basis
        if basis not in self._grounds:
            world = Body(GROUND, NOTHING, Inertia(), ORIGIN, ORIGIN, {}, self.mechanism.span)
            link = Link(Step("ground", "", ()), world, None, False, ())
            self._grounds[basis] = LinkState(link, -1, None, branch, basis, NULL)
        return self._grounds[basis]

    def _moved(self, link: Link, branch: AxisBranch, direction: Vector) -> LinkState:
        basis = branch.basis if link.parent is None else self.moving[link.parent].basis
        moving = LinkState(link, len(self.moving), link.parent, branch, basis, NULL, direction=direction)
        if link.step.kind == "float":
            self._float(moving)
        elif link.step.kind == "ball":
            self._ball(moving)
        elif link.step.kind == "weld":
            self._weld(moving)
        elif branch.still:
            self._still(moving)
        else:
            self._turning(moving)
        return moving

    def _scalar(self, moving: LinkState) -> Coordinate:
        coordinate = self.states.scalar(moving.link, moving.link.coordinates[0])
        moving.coordinates = [coordinate]
        return coordinate

    def _still(self, moving: LinkState) -> None:
        """A hinge about the third axis or a slide, in axes that do not turn."""
        script, link = self.script, moving.link
        name = link.part.name if not link.bodies else link.bodies[0].name
        parent, q = self.parent_of(moving), self._scalar(moving)
        pin, basis = self.pin(link), moving.basis
        way = to_own(basis, moving.direction)
        moving.origin = self.centres[link.bodies[0].name] if link.bodies else pin
        moving.angle, moving.spin, moving.carried = parent.angle, parent.spin, parent.spin
        if link.step.kind == "slide":
            from_parent = to_own(basis, minus(moving.origin, parent.origin))
            near = NULL if moving.parent is None else parent.inner(script, from_parent, f"{name}.near")
            way = parent.inner(script, way, f"{q.name}.way")
            moving.shift = script.vector(f"{name}.arm", plus(near, scaled(q.moved, way)), "m")
            linear = way
            slipping = scaled(multiply(TWO, q.rate), cross(parent.spin, way))
            bias = plus(self.centripetal(parent, moving.shift), slipping)
        else:
            way = snapped(way)
            moving.angle = script.let(f"{name}.turn", parent.angle + way[2] * q.moved, "1")
            moving.spin = (ZERO, ZERO, script.let(f"{name}.spin", parent.spin[2] + way[2] * q.rate, "1/s"))
            near = NULL if moving.parent is None else minus(pin, parent.origin)
            near = parent.inner(script, to_own(basis, near), f"{name}.near")
            far = moving.inner(script, to_own(basis, minus(moving.origin, pin)), f"{name}.far")
            moving.shift = script.vector(f"{name}.arm", plus(near, far), "m")
            linear = cross(way, far)
            bias = plus(self.centripetal(parent, near), self.centripetal(moving, far))
        moving.columns = [(NULL if link.step.kind == "slide" else way, linear)]
        moving.bias = (NULL, script.vector(f"{name}.bias", bias, "m/s^2"))

    def _weld(self, moving: LinkState) -> None:
        """The bodies that a parent carries, as a link of its own."""
        script, link, parent = self.script, moving.link, self.parent_of(moving)
        own_point = moving.branch.still or moving.parent is None
        moving.origin = self.centres[link.bodies[0].name] if own_point else parent.origin
        moving.angle, moving.spin, moving.carried = parent.angle, parent.spin, parent.spin
        near = NULL if moving.parent is None else to_own(moving.basis, minus(moving.origin, parent.origin))
        moving.shift = parent.inner(script, near, f"{link.name}.near")
        bias = self.centripetal(parent, moving.shift)
        moving.bias = (NULL, script.vector(f"{link.name}.bias", bias, "m/s^2"))

    def _turning(self, moving: LinkState) -> None:
        """A hinge, screw or slide, in axes that turn with the link."""
        script, link = self.script, moving.link
        name = link.part.name if not link.bodies else link.bodies[0].name
        parent, q = self.parent_of(moving), self._scalar(moving)
        way = snapped(to_own(moving.basis, moving.direction))
        if link.step.kind == "slide":
            at_rest = self.centres[link.bodies[0].name] if link.bodies and moving.parent is None else parent.origin
            moving.origin = at_rest
            along: Expression = ONE
        else:
            moving.origin = self.pin(link)
            along = self._lead(link)
        near = NULL if moving.parent is None else to_own(moving.basis, minus(moving.origin, parent.origin))
        near = script.vector(f"{name}.near", near, "m")
        slip = scaled(multiply(along, q.moved), way)
        moving.shift = script.vector(f"{name}.arm", plus(near, slip), "m")
        turning = link.step.kind in TURNING
        if turning:
            way = self._hinge_axes(moving, way, q)
        moving.carried = moving.back(script, parent.spin, f"{name}.carried")
        rate = scaled(q.rate, way)
        moving.spin = script.vector(f"{name}.spin", plus(moving.carried, rate), "1/s") if turning else moving.carried
        angular = cross(moving.carried, rate) if turning else NULL
        linear = self.centripetal(parent, moving.shift)
        linear = moving.back(script, script.vector(f"{name}.centripetal", linear, "m/s^2"), f"{name}.centripetal own")
        if along != ZERO:
            linear = plus(linear, scaled(multiply(TWO, along), cross(moving.carried, rate)))
        moving.columns = [(way if turning else NULL, scaled(along, way))]
        moving.bias = (script.vector(f"{name}.bias turn", angular), script.vector(f"{name}.bias", linear, "m/s^2"))

    def _hinge_axes(self, moving: LinkState, way: Vector, q: Coordinate) -> Vector:
        """Choose axes of a link with one parallel to its hinge, if its direction is known. Returns the direction in these axes."""
        known = numbers(way)
        if known is None:
            moving.passage = (about(self.script, way, q.moved, f"{q.name} turned"),)
            return way
        along = [k for k in range(3) if way[(k + 1) % 3] == ZERO and way[(k + 2) % 3] == ZERO]
        constant: tuple[AxialTurn, ...] = ()
        sign: Expression = ONE
        if along:
            (k,) = along
            sign = way[k]
        else:
            constant, k, moving.basis = turned_to(known, moving.basis)
        angle = self.script.let(f"{q.name} angle", multiply(sign, q.moved), "1")
        moving.passage = (*constant, AxialTurn(k, angle))
        return scaled(sign, UNIT[k])

    def _lead(self, link: Link) -> Expression:
        """Displacement of a screw per radian."""
        if link.step.kind != "screw":
            return ZERO
        assert isinstance(link.part, Joint)
        per_turn = self.script.constant(link.part.ratio, f"{link.part.name} lead", "m")
        return self.script.let(f"{link.part.name} lead per radian", multiply(Number(0.15915494309189535), per_turn))

    def _ball(self, moving: LinkState) -> None:
        """A rotation in space about a point of the parent."""
        script, link = self.script, moving.link
        name, parent = link.part.name, self.parent_of(moving)
        moving.origin = self.pin(link)
        near = NULL if moving.parent is None else to_own(moving.basis, minus(moving.origin, parent.origin))
        moving.shift = script.vector(f"{name}.near", near, "m")
        self._free_turn(moving, name)
        linear = script.vector(f"{name}.centripetal", self.centripetal(parent, moving.shift), "m/s^2")
        moving.bias = (moving.bias[0], moving.back(script, linear, f"{name}.centripetal own"))
        moving.columns = [(axis, NULL) for axis in UNIT] if not link.fixed else []

    def _float(self, moving: LinkState) -> None:
        """A body with its own pose: its position in world axes, its angular velocity in body axes."""
        link = moving.link
        moving.origin = self.pin(link)
        moving.coordinates = [self.states.scalar(link, name) for name in link.coordinates[:3]]
        self._free_turn(moving, link.part.name)
        moving.columns = [*((NULL, axis) for axis in UNIT), *((axis, NULL) for axis in UNIT)]

    def _free_turn(self, moving: LinkState, name: str) -> None:
        script, link, parent = self.script, moving.link, self.parent_of(moving)
        attitude = moving.attitude = self.states.attitude(link)
        turn = of_quaternion(script, attitude.parts, f"{name}.own")
        from_drawing = () if moving.basis is WORLD else (_constant(moving.basis),)
        moving.passage, moving.basis = (*from_drawing, turn), WORLD
        moving.carried = moving.back(script, parent.spin, f"{name}.carried")
        moving.spin = script.vector(f"{name}.whole spin", plus(moving.carried, attitude.spin), "1/s")
        moving.bias = (script.vector(f"{name}.bias turn", cross(moving.carried, attitude.spin)), NULL)

    # ------------------------------------------------------------ accelerations that rates cause
    def squares(self, moving: LinkState) -> tuple[Expression, ...]:
        """Products of the components of the angular velocity: xx, yy, zz, xy, xz, yz."""
        name = moving.link.name
        if not moving.squares:
            x, y, z = moving.spin
            pairs = (("xx", x, x), ("yy", y, y), ("zz", z, z), ("xy", x, y), ("xz", x, z), ("yz", y, z))
            moving.squares = tuple(self.script.let(f"{name} spin {c}", multiply(a, b)) for c, a, b in pairs)
        return moving.squares

    def centripetal(self, moving: LinkState, arm: Vector) -> Vector:
        """w x (w x arm), with w the angular velocity."""
        if moving.index < 0 or is_null(moving.spin) or is_null(arm):
            return NULL
        xx, yy, zz, xy, xz, yz = self.squares(moving)
        name = moving.link.name
        across = [self.script.let(f"{name} spin across {c}", negate(a + b)) for c, a, b in (("x", yy, zz), ("y", xx, zz), ("z", xx, yy))]  # fmt: skip
        return applied(((across[0], xy, xz), (xy, across[1], yz), (xz, yz, across[2])), arm)


def _constant(basis: Basis) -> AnyTurn:
    """Rotation from the world's axes to those of a basis."""
    rows = tuple(zip(*basis, strict=True))
    less = tuple(tuple(Number(rows[r][c] - float(r == c)) for c in range(3)) for r in range(3))
    return AnyTurn(less, (ONE, ZERO, ZERO, ZERO))  # type: ignore[arg-type]


TURNING = frozenset({"hinge", "screw"})


class Kinematics(Links):
    """Poses and rates of all links."""

    def __init__(self, mechanism: Mechanism, tree: Tree, script: AssignmentEmitter, flows: Mapping[str, Expression], whole: bool = False) -> None:  # fmt: skip
        super().__init__(mechanism, tree, script, flows, whole)
        self.turns: dict[int, Turn] = {}
        self.displacements: dict[int, Vector] = {}
        self.velocities: dict[int, Vector] = {}
        self.carried: dict[str, Carried] = {}  # bodies between the joints of a chord

    @cached_property
    def length(self) -> float:
        """Size of the mechanism in the drawing."""
        return length_of(self.script, (x for m in self.moving for x in m.shift))

    def turn(self, index: int) -> Turn:
        """Rotation of a link relative to the drawing, in world axes."""
        found = self.turns.get(index)
        if found is None:
            found = self.turns[index] = self._turn(self.moving[index], index)
        return found

    def _turn(self, moving: LinkState, index: int) -> Turn:
        script, link = self.script, moving.link
        name = f"{link.name} world"
        if moving.branch.still:
            third = tuple(row[2] for row in moving.basis)
            return about(script, (Number(third[0]), Number(third[1]), Number(third[2])), moving.angle, name)
        parent = NO_TURN if moving.parent is None else self.turn(moving.parent)
        if moving.attitude is not None:
            own = moving.passage[-1]
        elif link.step.kind in ("slide", "weld"):
            own = NO_TURN
        else:
            own = about(script, moving.direction, moving.coordinates[0].moved, f"{name} own")
        return composed(script, parent, own, name)

    def displacement(self, index: int) -> Vector:
        """Displacement of a link's point of reference from the drawing, world axes."""
        found = self.displacements.get(index)
        if found is None:
            name = f"{self.tree.links[index].name} displaced"
            found = self.script.vector(name, self._displacement(self.moving[index], index), "m")
            self.displacements[index] = found
        return found

    def _displacement(self, moving: LinkState, index: int) -> Vector:
        script, link = self.script, moving.link
        name = link.name
        if link.step.kind == "float":
            x, y, z = (c.moved for c in moving.coordinates)
            return x, y, z
        if link.step.kind == "weld":
            return self.moved(moving.parent, moving.origin, f"{name} seat")
        if link.step.kind == "slide":
            q = moving.coordinates[0]
            parent = NO_TURN if moving.parent is None else self.turn(moving.parent)
            way = parent.apply(script, moving.direction, f"{name} way")
            return plus(self.moved(moving.parent, moving.origin, f"{name} seat"), scaled(q.moved, way))
        pin = self.pin(link)
        there = self.moved(moving.parent, pin, f"{name} pin")
        if link.step.kind == "screw":
            way = self.turn(index).apply(script, moving.direction, f"{name} way")
            there = plus(there, scaled(multiply(self._lead(link), moving.coordinates[0].moved), way))
        return plus(there, self.turn(index).swing(script, minus(moving.origin, pin), f"{name} swing"))

    def moved(self, index: int | None, point: Vector, name: str) -> Vector:
        """Displacement from the drawing of a point that is fixed to a link, world axes."""
        if index is None:
            return NULL
        arm = minus(point, self.moving[index].origin)
        if is_null(arm):
            return self.displacement(index)
        return plus(self.displacement(index), self.turn(index).swing(self.script, arm, name))

    def velocity(self, index: int) -> Vector:
        """Velocity of a link's point of reference, in link axes."""
        found = self.velocities.get(index)
        if found is not None:
            return found
        moving = self.moving[index]
        script, link = self.script, moving.link
        name = f"{link.bodies[0].name if link.bodies else link.name}.velocity"
        if link.step.kind == "float":
            found = moving.back(script, self._rates(moving), name)
        else:
            parent = self.parent_of(moving)
            found = NULL
            if moving.parent is not None:
                swept = plus(self.velocity(moving.parent), cross(parent.spin, moving.shift))
                found = moving.back(script, script.vector(f"{name} carried", swept, "m/s"), name)
            own = [scaled(c.rate, column[1]) for c, column in zip(moving.coordinates, moving.columns, strict=False)]
            found = script.vector(name, plus(found, *own), "m/s")
        self.velocities[index] = found
        return found

    @staticmethod
    def _rates(moving: LinkState) -> Vector:
        x, y, z = (c.rate for c in moving.coordinates)
        return x, y, z

    def world(self, index: int, v: Vector, name: str) -> Vector:
        """Transform a vector from link axes to world axes."""
        moving = self.moving[index]
        there = to_world(moving.basis, v)
        return there if moving.branch.still else self.turn(index).apply(self.script, there, name)

    def own(self, index: int, v: Vector, name: str) -> Vector:
        """Transform a vector from world axes to link axes."""
        moving = self.moving[index]
        there = v if moving.branch.still else self.turn(index).back(self.script, v, name)
        return to_own(moving.basis, there)

    def placed(self, body: str, point: Vector, name: str) -> Marker:
        """Marker: a point of a body with its motion. In the drawing it is at `point`."""
        if body in self.carried:
            return self._carried(body, point, name)
        index = None if body == GROUND else self.tree.place[body]
        if index is None:
            return Marker(body, point, NULL, NO_TURN, NULL, NULL, NULL)
        moving, script = self.moving[index], self.script
        arm = moving.inner(script, to_own(moving.basis, minus(point, moving.origin)), f"{name}.arm")
        arm = script.vector(f"{name}.arm", arm, "m")
        shift = script.vector(f"{name}.moved", self.moved(index, point, name), "m")
        swept = cross(moving.spin, arm)
        if moving.link.step.kind == "float":
            velocity = self._rates(moving)
            if not is_null(swept):
                velocity = plus(velocity, self.world(index, script.vector(f"{name}.swept", swept), f"{name}.sweep"))
        else:
            velocity = script.vector(f"{name}.own", plus(self.velocity(index), swept), "m/s")
            velocity = self.world(index, velocity, f"{name}.v")
        velocity = script.vector(f"{name}.v", velocity, "m/s")
        spin = script.vector(f"{name}.omega", self.world(index, moving.spin, f"{name}.omega"), "1/s")
        return Marker(body, point, shift, self.turn(index), velocity, spin, arm)

    def _carried(self, body: str, point: Vector, name: str) -> Marker:
        script, carried = self.script, self.carried[body]
        carrier = self.placed(carried.by, point, f"{name}.carrier")
        shift = script.vector(f"{name}.shift", carrier.turn.apply(script, carried.shift, f"{name}.shift"), "m")
        drift = carrier.turn.apply(script, carried.drift, f"{name}.drift")
        velocity = plus(carrier.velocity, cross(carrier.spin, shift), drift)
        return replace(
            carrier,
            displacement=script.vector(f"{name}.moved", plus(carrier.displacement, shift), "m"),
            velocity=script.vector(f"{name}.v", velocity, "m/s"),
        )

    def push(self, placed: Marker, force: Vector, torque: Vector, name: str) -> None:
        """Apply a force at a marker and a torque on its body, world axes. Only before the recursion."""
        index = None if placed.body == GROUND else self.tree.place[placed.body]
        if index is None or (is_null(force) and is_null(torque)):
            return
        moving, script = self.moving[index], self.script
        force = script.vector(f"{name}.push", force, "N")
        torque = script.vector(f"{name}.twist", torque, "N*m")
        floats = moving.link.step.kind == "float"
        if floats:
            moving.world_force = plus(moving.world_force, force)
        if not floats or not is_null(placed.arm):
            force = self.own(index, force, f"{name}.push own")
        if not floats:
            moving.force = plus(moving.force, force)
        moment = NULL if is_null(placed.arm) else cross(placed.arm, force)
        moving.torque = plus(moving.torque, moment, self.own(index, torque, f"{name}.twist own"))
