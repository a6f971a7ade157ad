"""Vectors, rotations and the tree of a mechanism: functions by themselves, against numpy, scipy and drawings by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from compiler.algebra.expression import Expression, Number, evaluate
from compiler.graph.mechanism import Mechanism
from compiler.graph.network import MechanismNode
from compiler.multibody.assignment_emitter import AssignmentEmitter
from compiler.multibody.coordinates import _unit
from compiler.multibody.rotations import turned_by_rates
from compiler.multibody.tree import loop_of, spanning_tree, steps_of
from compiler.multibody.vectors import Vector, skew
from tests.compiling import compiled

Array = Any


class Plain:
    """A script that names nothing."""

    def let(self, name: str, expression: Expression, unit: str = "") -> Expression:
        return expression

    def vector(self, name: str, v: Vector, unit: str = "") -> Vector:
        return v


SCRIPT = cast(AssignmentEmitter, Plain())


def numbers(*values: float) -> Any:
    return tuple(Number(float(v)) for v in values)


def values(vector: tuple[Expression, ...]) -> Array:
    return np.array([evaluate(x, float) for x in vector])


def test_skew_is_the_matrix_of_a_cross_product() -> None:
    a, b = np.array([0.3, -1.1, 2.3]), np.array([1.7, 0.4, -0.9])
    matrix = np.array([values(row) for row in skew(numbers(*a))])
    np.testing.assert_allclose(matrix @ b, np.cross(a, b), rtol=1e-15)


def test_a_unit_quaternion() -> None:
    p = np.array([0.7, -1.1, 0.4, 2.2])
    np.testing.assert_allclose(values(_unit(numbers(*p))), p / np.linalg.norm(p), rtol=1e-15)


@pytest.mark.parametrize("size", [1e-7, 1e-3, 0.4, 1.0, 2.5, 3.5, 5.0])
def test_the_angular_velocity_of_a_rotation_vector(size: float) -> None:
    """In the axes of B: the series of the right Jacobian, sum of (-1)^k [r]^k r'/(k + 1)!, and turns of scipy a short time apart."""
    r, rates = size * np.array([2.0, -1.0, 2.0]) / 3, np.array([0.3, -0.7, 1.9])
    found = values(turned_by_rates(SCRIPT, numbers(*r), numbers(*rates), "w"))
    term, total = rates.copy(), rates.copy()
    for k in range(1, 60):
        term = -np.cross(r, term) / (k + 1)
        total = total + term
    np.testing.assert_allclose(found, total, rtol=0, atol=1e-13 if size > 0.1 else 1e-8)
    h = 1e-6
    turn = Rotation.from_rotvec(r - h * rates).inv() * Rotation.from_rotvec(r + h * rates)
    np.testing.assert_allclose(found, turn.as_rotvec() / (2 * h), atol=1e-8)


def test_rates_along_the_vector_are_the_angular_velocity() -> None:
    r, rates = numbers(0.3, 0, 0), numbers(1.5, 0, 0)
    assert turned_by_rates(SCRIPT, r, rates, "w") is rates


CHAIN = """
  multibody m : planar {
    body a { mass = 1 kg, inertia = 1 [kg*m^2], at = (1 m, 0) }
    body b { mass = 1 kg, inertia = 1 [kg*m^2], at = (2 m, 1 m) }
    body c { mass = 1 kg, inertia = 1 [kg*m^2], at = (2 m, -1 m) }
    body d { mass = 1 kg, inertia = 1 [kg*m^2], at = (3 m, 0) }
    body e { mass = 1 kg, inertia = 1 [kg*m^2], at = (9 m, 0) }
    hinge one : ground to a { at = (0, 0) }
    hinge two : a to b { at = (1 m, 1 m) }
    hinge three : a to c { at = (1 m, -1 m) }
    hinge four : b to d { at = (3 m, 1 m) }
    hinge five : c to d { at = (3 m, -1 m) }
    free six : ground to e
  }
"""


def mechanism(text: str) -> Mechanism:
    (node,) = (n for n in compiled(f"model A {{{text}}}").whole_graph.nodes if isinstance(n, MechanismNode))
    return node.mechanism


class TestTree:
    def test_paths_go_to_the_ground(self) -> None:
        tree = spanning_tree(mechanism(CHAIN))
        assert tree.path("ground") == ["ground"]
        assert tree.path("a") == ["a", "ground"]
        assert tree.path("b") == ["b", "a", "ground"] and tree.path("c") == ["c", "a", "ground"]
        assert tree.path("d") in (["d", "b", "a", "ground"], ["d", "c", "a", "ground"])

    def test_a_loop_goes_from_the_first_body_over_the_meeting_one_to_the_second(self) -> None:
        """The bodies of the ring a, b, d, c, which no choice of the closing joint changes; the ground is not in it."""
        drawn = mechanism(CHAIN)
        tree = spanning_tree(drawn)
        (closing,) = tree.closing
        loop = loop_of(tree, closing, drawn)
        assert loop[0] == loop[-1] == closing.first and loop[-2] == closing.second and len(loop) == 5
        ring = [*"abdc"]
        one_way = [ring[(ring.index(loop[0]) + k) % 4] for k in range(4)]
        assert loop[:-1] in (one_way, [one_way[0], *reversed(one_way[1:])])
        assert loop_of(tree, replace(closing, first="one", second="two"), drawn) == ["one", "two"]  # as a gear

    def test_a_free_joint_has_the_freedoms_of_its_space(self) -> None:
        joints = {j.name: j for j in mechanism(CHAIN).joints}
        assert [s.letters for s in steps_of(joints["six"])] == [("x",), ("y",), ("phi",)]
        assert [(s.kind, s.direction) for s in steps_of(joints["six"])] == [
            ("slide", "x"),
            ("slide", "y"),
            ("hinge", "z"),
        ]
        assert [s.letters for s in steps_of(joints["one"])] == [("phi",)]
        space = mechanism(
            "multibody m : spatial { body e { mass = 1 kg, inertia = (1 [kg*m^2], 1 [kg*m^2], 1 [kg*m^2]), at = (0, 0, 0) }\n free six : ground to e }"
        )
        assert [s.letters for s in steps_of(space.joints[0])] == [("x",), ("y",), ("z",), ("rx", "ry", "rz")]
