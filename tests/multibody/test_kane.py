"""Two bodies in a row against Kane's method of sympy, which knows nothing of recursions: to 1e-10 at random states."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy
from sympy.physics import mechanics

from tests.compiling import Running
from tests.multibody.random_trees import LETTERS, Part, RandomTree, rotation


class Kane:
    """The equations of motion of a random tree, joint by joint."""

    def __init__(self, tree: RandomTree) -> None:
        self.tree = tree
        self.world = mechanics.ReferenceFrame("N")
        self.origin = mechanics.Point("O")
        self.origin.set_vel(self.world, 0)
        self.coordinates: list[Any] = []
        self.speeds: list[Any] = []
        self.kinematic: list[Any] = []
        self.values: dict[Any, float] = {}
        frames, points, bodies, loads = [], [], [], []
        for i, part in enumerate(tree.parts):
            first = part.parent < 0
            parent = (self.world, self.origin, np.zeros(3)) if first else (frames[part.parent], *points[part.parent])
            frame, pin = self._joint(i, part, *parent)
            centre = pin.locatenew(f"C{i}", self._vector(frame, tree.centres[i] - part.at))
            centre.v2pt_theory(pin, self.world, frame)
            t = tree.tensors[i]
            tensor = mechanics.inertia(frame, t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[1, 2], t[0, 2])
            bodies.append(mechanics.RigidBody(f"B{i}", centre, frame, tree.masses[i], (tensor, centre)))
            loads.append((centre, tree.masses[i] * self._vector(self.world, tree.gravity)))
            frames.append(frame)
            points.append((pin, part.at))
        method = mechanics.KanesMethod(self.world, self.coordinates, self.speeds, self.kinematic)
        method.kanes_equations(bodies, loads)
        self.method = method

    @staticmethod
    def _vector(frame: Any, v: Any) -> Any:
        return sum((float(c) * e for c, e in zip(v, (frame.x, frame.y, frame.z), strict=True)), mechanics.Vector(0))

    def _coordinate(self, name: str) -> tuple[Any, Any]:
        q, u = mechanics.dynamicsymbols(f"q_{name} u_{name}")
        self.coordinates.append(q)
        self.speeds.append(u)
        self.kinematic.append(q.diff() - u)
        return q, u

    def _joint(self, i: int, part: Part, parent: Any, point: Any, at: Any) -> tuple[Any, Any]:
        """The frame of a body and its pin, from those of its parent."""
        place = point.locatenew(f"A{i}", self._vector(parent, part.at - at))
        place.v2pt_theory(point, self.world, parent)
        frame, way = parent, part.axis / np.linalg.norm(part.axis)
        slip: list[tuple[Any, tuple[Any, Any]]] = []
        turns: list[tuple[Any, Any, Any]] = []
        own = rotation(part.turned)
        match part.kind:
            case "ball":
                return self._ball(i, parent, place)
            case "slide":
                slip = [(way, self._coordinate(f"{i}x"))]
            case "cylinder":
                slip = [(way, self._coordinate(f"{i}x"))]
                turns = [(way, *self._coordinate(f"{i}phi"))]
            case "planar":
                slip = [(own[:, 0], self._coordinate(f"{i}x")), (own[:, 1], self._coordinate(f"{i}y"))]
                turns = [(own[:, 2], *self._coordinate(f"{i}phi"))]
            case "universal":
                turns = [(way, *self._coordinate(f"{i}a")), (part.other, *self._coordinate(f"{i}b"))]
            case "hinge" | "screw":
                turns = [(way, *self._coordinate(f"{i}phi"))]
                if part.kind == "screw":
                    q, u = turns[0][1:]
                    slip = [(way * part.lead / (2 * np.pi), (q, u))]
        shift = velocity = mechanics.Vector(0)
        for direction, (q, u) in slip:
            shift, velocity = (
                shift + q * self._vector(parent, direction),
                velocity + u * self._vector(parent, direction),
            )
        pin = place.locatenew(f"P{i}", shift)
        swept = mechanics.cross(parent.ang_vel_in(self.world), shift) if shift != 0 else mechanics.Vector(0)
        pin.set_vel(self.world, place.vel(self.world) + swept + velocity)
        for number, (axis, q, u) in enumerate(turns):
            after = mechanics.ReferenceFrame(f"F{i}{number}")
            after.orient_axis(frame, self._vector(frame, axis), q)
            after.set_ang_vel(frame, u * self._vector(frame, axis / np.linalg.norm(axis)))
            frame = after
        if frame is parent:
            frame = mechanics.ReferenceFrame(f"F{i}")
            frame.orient_axis(parent, parent.x, 0)
        return frame, pin

    def _ball(self, i: int, parent: Any, place: Any) -> tuple[Any, Any]:
        p = mechanics.dynamicsymbols(f"p_{i}w p_{i}x p_{i}y p_{i}z")
        w = mechanics.dynamicsymbols(f"w_{i}x w_{i}y w_{i}z")
        frame = mechanics.ReferenceFrame(f"F{i}")
        frame.orient_quaternion(parent, p)
        frame.set_ang_vel(parent, w[0] * frame.x + w[1] * frame.y + w[2] * frame.z)
        self.coordinates += list(p)
        self.speeds += list(w)
        a, v = p[0], sympy.Matrix(p[1:])
        rates = [-v.dot(sympy.Matrix(w)) / 2, *((a * sympy.Matrix(w) + v.cross(sympy.Matrix(w))) / 2)]
        self.kinematic += [x.diff() - rate for x, rate in zip(p, rates, strict=True)]
        self.values |= dict(zip(p, self.tree.attitudes[i], strict=True))
        return frame, place

    def accelerations(self, q: Any, rates: Any) -> Any:
        values = dict(self.values)
        scalars = [x for x in self.coordinates if x not in values]
        numbers = [x for part in self.tree.parts for x in q[part.first : part.first + len(LETTERS[part.kind])]]
        values |= dict(zip(scalars, numbers, strict=True)) | dict(zip(self.speeds, rates, strict=True))
        mass, forcing = (
            np.array(m.subs(values).evalf(), dtype=float) for m in (self.method.mass_matrix, self.method.forcing)
        )
        return np.linalg.solve(mass, forcing)[:, 0]


KINDS = [
    ("hinge", "slide"), ("universal", "hinge"), ("cylinder", "hinge"), ("planar", "hinge"), ("screw", "universal"),
    ("ball", "hinge"), ("slide", "ball"),
]  # fmt: skip


@pytest.mark.few(2)
@pytest.mark.parametrize("kinds", KINDS)
def test_two_bodies(kinds: tuple[str, ...]) -> None:
    """Axes anywhere for the first, along the world's for the others: sympy takes its time."""
    straight = kinds not in KINDS[:1]
    trees = (RandomTree(2, seed, kinds, straight) for seed in range(500))
    tree = next(
        t
        for t in trees
        if tuple(p.kind for p in t.parts) == kinds and t.parts[1].parent == 0 and not any(p.reverse for p in t.parts)
    )
    q, rates = tree.sample()
    found = Running(tree.drawing().compiled(everything=True)).rates(tree.state(q, rates))
    expected = Kane(tree).accelerations(q, rates)
    got = np.array([found[rate] for _, rate in tree.names()])
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
