"""Conserved quantities of a mechanism without losses, in runs: energy, momentum, angular momentum, the lengths of quaternions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph
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


@pytest.mark.few(2)
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
    """Of a free body with other bodies on joints, without connection to the ground."""
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


RING = """
model Ring {{
  multibody m : spatial {{
    {bodies}
    {joints}
  }}
  output {outputs}
}}
"""
AROUND = ("ball", "universal", "cylinder", "hinge", "ball")


def ring(seed: int) -> tuple[str, int]:
    """A ring of five bodies that floats, with any masses, tensors and places; each joint of another kind, ten freedoms among them."""
    random = np.random.default_rng(seed)
    count = len(AROUND)
    turns = 2 * np.pi * (np.arange(count) + 0.3 * random.uniform(size=count)) / count
    places = np.stack([np.cos(turns), np.sin(turns), 0.4 * random.normal(size=count)], axis=1)
    start = random.permutation(count)

    def place(v: Any) -> str:
        return "(" + ", ".join(f"{x!r} m" for x in v.tolist()) + ")"

    def number(x: float) -> str:
        return f"{x!r} [kg*m^2]"

    bodies, joints, outputs = [], [], []
    for i in range(count):
        middle = (places[i] + places[(i + 1) % count]) / 2 + 0.1 * random.normal(size=3)
        inertia = ", ".join(number(x) for x in random.uniform(0.1, 0.19, 3).tolist())
        mass = float(random.uniform(0.5, 2.0))
        spin = (
            f", start x.v = {3 * random.normal()!r} [m/s], start rz.omega = {3 * random.normal()!r} [1/s]"
            if i == 0
            else ""
        )
        bodies.append(f"body b{i} {{ mass = {mass!r} kg, inertia = ({inertia}), at = {place(middle)}{spin} }}")
        outputs += [f"v{c}{i} = {mass!r} [kg]*m.b{i}.{c}.v" for c in "xyz"]
    for i in start.tolist():
        kind, axis = AROUND[i], place(random.normal(size=3)).replace(" m", "")
        other = f", about = {axis}" if kind == "hinge" else f", along = {axis}" if kind == "cylinder" else ""
        if kind == "universal":
            other = ", about = (1, 0.2, 0), then = (0, 0.1, 1)"
        joints.append(f"{kind} j{i} : b{(i - 1) % count} to b{i} {{ at = {place(places[i])}{other} }}")
    return RING.format(bodies="\n    ".join(bodies), joints="\n    ".join(joints), outputs=", ".join(outputs)), count


@pytest.mark.few(1)
@pytest.mark.machine_code
@pytest.mark.parametrize("seed", range(2))
def test_rings_that_float_keep_energy_and_momentum(seed: int, tmp_path: Path) -> None:
    """Whichever joint closes them; nothing acts from outside, so each momentum of the whole stays."""
    text, count = ring(seed)
    path = tmp_path / "ring.bg"
    path.write_text(text, encoding="utf-8")
    found = bondgraph.load(path).simulate(to=1.0, rtol=1e-10, points=5, energy=True)
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-8
    parts = {c: np.array([found[f"v{c}{i}"] for i in range(count)]) for c in "xyz"}
    assert max(np.ptp(p, axis=1).max() for p in parts.values()) > 0.1, "each by itself changes"
    for part in parts.values():
        total = part.sum(axis=0)
        assert np.abs(total - total[0]).max() < 1e-8
