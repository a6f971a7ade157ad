"""Forward kinematics in link axes: axes and point of reference of each link, its motion, and its velocity-dependent acceleration.

In turning axes the point is on the axis of rotation, so that arms between such points are constant. In still axes it is the centre of
mass, so that the inertia is constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..algebra.expression import ONE, ZERO, Expression, Number, multiply, negate
from ..graph.mechanism import GROUND, NOTHING, ORIGIN, Body, Inertia, Joint, Mechanism
from .assignment_emitter import AssignmentEmitter
from .axes import ANYWHERE, WORLD, AxisBranch, Basis, branches, numbers, snapped, to_own, turned_to
from .coordinates import Coordinate, Coordinates
from .link_state import LinkState
from .rotations import TWO, AnyTurn, AxialTurn, Turn, about, of_quaternion, of_rotation_vector, unit
from .tree import Link, Step, Tree, ends_of
from .vectors import NULL, UNIT, Vector, applied, cross, is_null, minus, negated, plus, scaled

TURNING = frozenset({"hinge", "screw"})


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
