"""Poses and velocities of links in world axes: rotations, displacements, velocities. Each is written only if it is needed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

from ..algebra.expression import Expression, Number, multiply
from ..graph.mechanism import GROUND, Mechanism
from .assignment_emitter import AssignmentEmitter
from .axes import to_own, to_world
from .joints import Links
from .link_state import LinkState
from .marker import Carried, Marker
from .rotations import NO_TURN, Turn, about, composed
from .tree import Tree
from .values import length_of
from .vectors import NULL, Vector, cross, is_null, minus, plus, scaled


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
