"""What a mechanism without losses keeps, in runs: energy, momentum, angular momentum, the lengths of quaternions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.compiling import Running
from tests.multibody.random_trees import RandomTree


def run(running: Running, state: dict[str, float], to: float) -> list[dict[str, float]]:
    """States by name at some instants; at 1e-11."""
    names = running.program.states.names
    start = np.array([state[n] for n in names])

    def rates(t: float, x: Any) -> Any:
        return running.program.derivative(
            t, x, running.inputs, running.constants, running.program.switches(t, running.constants)
        )

    found = solve_ivp(rates, (0, to), start, method="DOP853", rtol=1e-11, atol=1e-12, t_eval=np.linspace(0, to, 5))
    assert found.success
    return [dict(zip(names, x.tolist(), strict=True)) for x in found.y.T]


def moved(tree: RandomTree, values: dict[str, float]) -> tuple[Any, Any]:
    """Coordinates and rates of the oracle from states."""
    for i in tree.attitudes:
        owner = f"m.b{i}" if tree.parts[i].kind == "float" else f"m.j{i}"
        p = np.array([values[f"{owner}.attitude.{c}"] for c in "wxyz"])
        assert abs(p @ p - 1) < 1e-9
        tree.attitudes[i] = p
    q = [0.0 if name.endswith(".attitude") else values[name] for name, _ in tree.names()]
    return np.array(q), np.array([values[rate] for _, rate in tree.names()])


@pytest.mark.parametrize("seed", range(4))
def test_energy(seed: int) -> None:
    """Of random trees in a field of gravity, counted by the oracle."""
    tree = RandomTree(5, 40 + seed)
    running = Running(tree.drawing().compiled(everything=True))
    q, rates = tree.sample()
    energies = []
    for values in run(running, tree.state(q, 0.3 * rates), 0.5):
        q, rates = moved(tree, values)
        total = 0.0
        for i, ((place, spin), (x, r)) in enumerate(zip(tree.oracle().jacobian(q), tree.poses(q), strict=True)):
            v, w = place @ rates, r.T @ spin @ rates
            total += tree.masses[i] * (v @ v / 2 - tree.gravity @ x) + w @ tree.tensors[i] @ w / 2
        energies.append(total)
    np.testing.assert_allclose(energies, energies[0], rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_momentum_and_angular_momentum(seed: int) -> None:
    """Of what floats freely with bodies on joints that nothing holds to the ground."""
    tree = next(
        t
        for t in (RandomTree(4, 1000 * seed + s, ("float", "hinge", "ball", "universal", "slide")) for s in range(500))
        if [p.kind == "float" for p in t.parts] == [True, False, False, False]
        and all(p.parent >= 0 for p in t.parts[1:])
    )
    tree.gravity = np.zeros(3)
    running = Running(tree.drawing().compiled(everything=True))
    q, rates = tree.sample()
    kept = []
    for values in run(running, tree.state(q, 0.5 * rates), 1.0):
        q, rates = moved(tree, values)
        momentum, angular = np.zeros(3), np.zeros(3)
        for i, ((place, spin), (x, r)) in enumerate(zip(tree.oracle().jacobian(q), tree.poses(q), strict=True)):
            p = tree.masses[i] * place @ rates
            momentum += p
            angular += np.cross(x, p) + r @ tree.tensors[i] @ r.T @ spin @ rates
        kept.append(np.concatenate([momentum, angular]))
    np.testing.assert_allclose(kept, np.tile(kept[0], (len(kept), 1)), atol=1e-8)


def test_a_free_asymmetric_top() -> None:
    """About its middle axis it turns over; energy and angular momentum in the world stay, by the program's own readings."""
    tree = RandomTree(1, 0, ("float",))
    tree.tensors, tree.turned[0], tree.gravity = [np.diag([1.0, 2.0, 3.0])], 0.0, np.zeros(3)
    running = Running(tree.drawing().compiled([f"b0.{c}:f" for c in ("rx", "ry", "rz")], everything=True))
    state = tree.state(np.zeros(6), [0.1, 0.2, 0.3, 1e-3, 4.0, 1e-3])
    spins, kept = [], []
    for values in run(running, state, 12.0):
        w = np.array([values[f"m.b0.spin.{c}"] for c in "xyz"])
        read = running.outputs(values)
        world = np.array([read[f"b0.{c}:f"] for c in ("rx", "ry", "rz")])
        moved(tree, values)
        turn = tree.poses(np.zeros(6))[0][1]
        np.testing.assert_allclose(world, turn @ w, atol=1e-9)
        kept.append([*(turn @ tree.tensors[0] @ w), w @ tree.tensors[0] @ w])
        spins.append(w[1])
    np.testing.assert_allclose(kept, np.tile(kept[0], (len(kept), 1)), rtol=1e-8, atol=1e-8)
    assert min(spins) < -3.0 < 3.0 < max(spins)
