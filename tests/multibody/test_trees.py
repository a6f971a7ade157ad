"""Accelerations of random trees against Newton and Euler by numbers: all joints, all axes, either way round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bondgraph
from tests.compiling import Running
from tests.multibody.drawing import vector
from tests.multibody.random_trees import KINDS, RandomTree


def check(tree: RandomTree, samples: int = 2, length: float = 1.0) -> None:
    """Second rates at random states and efforts, to 1e-10 of the largest."""
    ports = tree.ports()
    names = tree.names()
    compilation = tree.drawing().compiled((), ports, everything=True)
    running = Running(compilation)
    assert not running.program.unknowns.names
    for _ in range(samples):
        q, rates = tree.sample()
        efforts = tree.random.uniform(-5, 5, len(ports))
        found = running.rates(
            tree.state(q, rates, length), inputs={f"to {p}": e for p, e in zip(ports, efforts, strict=True)}
        )
        by_port = dict(zip([f"m.{p}" for p in ports], efforts.tolist(), strict=True))
        forces = [by_port.get(name, 0.0) for name, _ in names]
        expected = tree.oracle().accelerations(q, rates, forces)
        got = np.array([found[rate] for _, rate in names])
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-10 * max(1.0, np.abs(expected).max()))


@pytest.mark.few(12)
@pytest.mark.parametrize("kind", [k for k in KINDS if k != "weld"])
@pytest.mark.parametrize("seed", range(3))
def test_chains_of_one_kind(kind: str, seed: int) -> None:
    check(RandomTree(2, seed, (kind,)))


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", range(12))
def test_mixed_trees(seed: int) -> None:
    check(RandomTree(7, 100 + seed), samples=1)


@pytest.mark.parametrize("kind", ["ball", "float"])
def test_the_length_of_a_quaternion_changes_nothing(kind: str) -> None:
    """Stages of a step leave the unit sphere a little: rotations and accelerations stay exact."""
    check(RandomTree(3, 7, (kind, "hinge")), length=1.01)


@pytest.mark.parametrize("seed", range(3))
def test_directions_that_a_run_may_change(seed: int) -> None:
    """An axis by parameters: no turn of it is known when the model is compiled."""
    tree = RandomTree(3, seed, ("hinge", "screw", "slide", "universal"))
    drawn = tree.drawing()
    for number, joint in enumerate(drawn.joints):
        names = [f"a{number}{c}" for c in "xyz"]
        values = [float(b.formula.expression.value) for b in joint.axis]  # type: ignore[attr-defined]
        drawn.parameters |= dict(zip(names, values, strict=True))
        drawn.joints[number] = replace(joint, axis=vector(names))
    running = Running(drawn.compiled((), tree.ports(), everything=True))
    q, rates = tree.sample()
    found = running.rates(tree.state(q, rates))
    expected = tree.oracle().accelerations(q, rates, np.zeros(len(q)))
    got = np.array([found[rate] for _, rate in tree.names()])
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("length", [1e-300, 1e-170, 1.0, 1e200])
def test_the_length_of_a_direction_changes_nothing(length: float) -> None:
    """Its square may vanish or overflow: a torque of 1 N*m on 2 kg*m^2 turns by 1/4 rad in 1 s."""
    text = f"""model Turning {{
  multibody arm : spatial {{
    body rod {{ mass = 1 kg, inertia = (1 [kg*m^2], 1 [kg*m^2], 2 [kg*m^2]) }}
    hinge pin : ground to rod {{ at = (0, 0, 0), about = (0, 0, {length!r}) }}
  }}
  Se twist : M = 1 [N*m]
  twist -> arm.pin
  output phi = arm.pin.phi
}}
"""
    assert bondgraph.load(text).simulate(to=1.0, points=2).final("phi") == pytest.approx(0.25, rel=1e-12)
