"""Joints that constrain nothing: their coordinates, the rates of these, and efforts dual to the rates, for all motions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.compiling import MODELS, Running, compiled
from tests.multibody.newton_euler import of_quaternion
from tests.multibody.random_trees import RandomTree, rotation

SIX = ("x", "y", "z", "rx", "ry", "rz")


class Measured:
    """A random tree with one more joint; outputs are its coordinates and flows."""

    def __init__(self, tree: RandomTree, kind: str, ends: tuple[str, str], axes: str, letters: tuple[str, ...]) -> None:
        self.tree, self.letters = tree, letters
        drawn = tree.drawing()
        drawn.frame("tip", ends[0], [0.3, -0.2, 0.5])
        drawn.frame("far", ends[1], [-0.4, 0.6, 0.1])
        names = ("tip", "far") if kind == "distance" else ends
        drawn.joint("chord", kind, *names, at=[0.2, -0.1, 0.4], turn=[0.3, -0.5, 0.2], axes=axes)
        outputs = [f"chord.{c}{v}" for c in letters for v in ("", ":f")]
        self.running = Running(drawn.compiled(outputs, [f"chord.{c}" for c in letters], everything=True))

    def values(self, state: dict[str, float], suffix: str) -> Any:
        found = self.running.outputs(state)
        return np.array([found[f"chord.{c}{suffix}"] for c in self.letters])

    def rates(self, state: dict[str, float], efforts: Any) -> dict[str, float]:
        return self.running.rates(
            state, inputs={f"to chord.{c}": e for c, e in zip(self.letters, efforts, strict=True)}
        )


CASES = [
    *(("free", ends, axes, SIX) for axes in ("from", "to", "middle", "world") for ends in (("b0", "b2"), ("ground", "b1"))),
    ("distance", ("b0", "b2"), "from", ("d",)),
]  # fmt: skip


@pytest.mark.few(9)
@pytest.mark.parametrize("case", CASES, ids=str)
@pytest.mark.parametrize("seed", [3, 5])
def test_power_and_rates(case: Any, seed: int) -> None:
    """Flows are linear in the rates: c' = J q'. Efforts e act as J^T e on the coordinates, and c' is the rate of the readings."""
    tree = RandomTree(4, seed, ("hinge", "float", "ball", "universal", "slide"))
    made = Measured(tree, *case)
    q, rates = tree.sample()
    jacobian = np.array([made.values(tree.state(q, unit), ":f") for unit in np.eye(len(q))]).T
    np.testing.assert_allclose(made.values(tree.state(q, rates), ":f"), jacobian @ rates, atol=1e-12)
    efforts = tree.random.uniform(-2, 2, len(made.letters))
    found = made.rates(tree.state(q, rates), efforts)
    expected = tree.oracle().accelerations(q, rates, jacobian.T @ efforts)
    got = np.array([found[name] for _, name in tree.names()])
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-10 * np.abs(expected).max())

    def moved(t: float) -> Any:
        """Readings a little later, along the rates."""
        old = tree.attitudes
        try:
            there = q + t * rates
            changed = {}
            for i, p in old.items():
                part = tree.parts[i]
                turn = slice(part.first + part.count - 3, part.first + part.count)
                changed[i] = times(p, small(there[turn]))
                there[turn] = 0
            tree.attitudes = changed
            return made.values(tree.state(there, rates), "")
        finally:
            tree.attitudes = old

    h = 1e-3
    slope = (45 * (moved(h) - moved(-h)) - 9 * (moved(2 * h) - moved(-2 * h)) + moved(3 * h) - moved(-3 * h)) / (60 * h)
    np.testing.assert_allclose(slope, jacobian @ rates, atol=1e-9)


def small(v: Any) -> Any:
    """The quaternion of a rotation vector."""
    a = np.linalg.norm(v)
    return np.array([np.cos(a / 2), *(np.sinc(a / 2 / np.pi) / 2 * v)])


def times(p: Any, q: Any) -> Any:
    """The product of quaternions."""
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.0199, 0.0201, 1.0, 3.1, 4.0, 6.2])
def test_rotation_vectors_from_zero_to_two_pi(angle: float) -> None:
    """The rotation vector of a body is angle times axis; smooth at zero, and distinct from the opposite rotation."""
    tree = RandomTree(1, 0, ("float",))
    tree.turned[0] = 0.0
    drawn = tree.drawing()
    drawn.joint("chord", "free", "ground", "b0", at=[0, 0, 0])
    letters = ("rx", "ry", "rz")
    outputs = [f"chord.{c}{v}" for c in letters for v in ("", ":f")]
    running = Running(
        drawn.compiled([*outputs, *(f"b0.{c}" for c in letters)], [f"chord.{c}" for c in letters], everything=True)
    )
    axis = np.array([2, -3, 6]) / 7
    tree.attitudes[0] = np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])
    spin = np.array([0.3, 0.4, -0.2])
    found = running.outputs(tree.state(np.zeros(6), [0, 0, 0, *spin]))
    r = np.array([found[f"chord.{c}"] for c in letters])
    np.testing.assert_allclose(r, angle * axis, rtol=1e-14, atol=1e-30)
    np.testing.assert_allclose([found[f"b0.{c}"] for c in letters], r)
    rates = np.array([found[f"chord.{c}:f"] for c in letters])
    whole = rotation(r).T @ np.array([rotation(r + 1e-30j * rates).imag / 1e-30])[0]  # skew of the spin in own axes
    np.testing.assert_allclose([whole[2, 1], whole[0, 2], whole[1, 0]], spin, atol=1e-11)
    np.testing.assert_allclose(of_quaternion(tree.attitudes[0]), rotation(r), atol=1e-13)


def test_series_at_zero_turn_are_no_events() -> None:
    """Rotation vectors are pieced together smoothly: a run steps over the seams, in machine code."""
    assert compiled(MODELS / "six_axes.bg").program.hybrid is None
