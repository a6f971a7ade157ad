"""Impulses within mechanisms where junctions tie or hold joints at speed, against masses of poses by complex steps, closed forms, and stiff dampers.

The witness of trees: with the mass matrix M of the pose and the ties C v = 0, the rates after satisfy M (v - v_0) = C^T impulse.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from compiler.algebra.expression import Apply, Number, Symbol
from compiler.algebra.formula import Bound, Formula
from compiler.graph.network import TIME, Switch
from tests.compiling import Running
from tests.multibody.drawing import SPAN
from tests.multibody.random_trees import RandomTree

TARGETS = ("native", "numpy")
pytestmark = pytest.mark.machine_code
AT, JUST_AFTER = 1.0, 1 + 1e-10
SWITCH = "mode on = false\n  when time > at { on = true }"
CLOSE = {"rtol": 1e-7, "atol": 1e-7}


@cache
def model(text: str) -> bondgraph.Model:
    return bondgraph.load(text)


def around(text: str, target: str, **options: Any) -> tuple[dict[str, float], dict[str, float]]:
    """Outputs before and just after the junctions switch at 1 s. The text has a parameter `at`."""
    found = []
    for at, to in ((5, AT), (AT, JUST_AFTER)):
        result = model(text).simulate(settings={"at": at}, to=to, points=2, rtol=1e-10, target=target, **options)
        found.append({n: float(result[n][-1]) for n in result.names})
    return found[0], found[1]


@pytest.mark.few(5)
# ------------------------------------------------------------ momenta of coordinates
@pytest.mark.parametrize("seed", range(12))
def test_momenta_of_random_trees_in_space(seed: int) -> None:
    """All kinds of joints: the mass matrix of the poses times the rates."""
    tree = RandomTree(5, 700 + seed)
    compilation = tree.drawing().compiled(everything=True)
    built = compilation.__dict__["_built"]
    later = Bound(Formula(1, Apply("less", (Symbol(0), Number(1.0)))), (TIME,))
    switching = replace(built.graph, switches=(Switch("none", later, SPAN),))
    compilation.__dict__["_built"] = replace(built, graph=switching)
    running = Running(compilation)
    q, rates = tree.sample()
    values = running.program.dependent(*running.arguments(0.0, tree.state(q, rates), None))
    found = dict(zip(running.program.dependents.names, np.ravel(values).tolist(), strict=True))
    mass = np.zeros((len(q), len(q)))
    for i, ((place, spin), (_, r)) in enumerate(zip(tree.oracle().jacobian(q), tree.poses(q), strict=True)):
        mass += tree.masses[i] * place.T @ place + spin.T @ (r @ tree.tensors[i] @ r.T) @ spin
    momenta = [found[f"{rate if '.spin.' in rate else name} momentum"] for name, rate in tree.names()]
    np.testing.assert_allclose(momenta, mass @ rates, rtol=1e-11, atol=1e-11)


# ------------------------------------------------------------ random trees in the plane
def about(angle: Any) -> Any:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@dataclass
class PlanarTree:
    """Bodies on hinges and slides, with clamps, flywheels behind clutches, or two joints tied to each other."""

    seed: int
    wheels: dict[int, float] = field(default_factory=dict)  # joint -> inertia
    ties: list[Any] = field(default_factory=list)  # rows over the rates of the joints, then of the wheels

    def __post_init__(self) -> None:
        self.random = random = np.random.default_rng(self.seed)
        self.count = n = 2 + self.seed % 3
        self.at, self.pin = random.uniform(-1, 1, (n, 2)), random.uniform(-1, 1, (n, 2))
        self.parent = [int(random.integers(-1, i)) if i else -1 for i in range(n)]
        self.hinged = [bool(random.integers(2)) for _ in range(n)]
        self.way = [about(a)[0] for a in random.uniform(0, 6, n)]
        self.mass, self.inertia = random.uniform(0.5, 2, n), random.uniform(0.05, 0.3, n)

    def text(self) -> str:
        lines = ["model Tree {", "  parameter at = 1 s", "  multibody m : planar {", "    gravity = (0, -3 [m/s^2])"]
        starts = self.random.uniform(-1, 1, (self.count, 2)).tolist()
        for i in range(self.count):
            (x, y), (a, b), (u, v), (q, rate) = self.at[i], self.pin[i], self.way[i], starts[i]
            lines.append(f"    body b{i} {{ mass = {self.mass[i]} kg, inertia = {self.inertia[i]} [kg*m^2], at = ({x} m, {y} m) }}")  # fmt: skip
            ends = f"{'ground' if self.parent[i] < 0 else f'b{self.parent[i]}'} to b{i}"
            if self.hinged[i]:
                lines.append(f"    hinge j{i} : {ends} {{ at = ({a} m, {b} m), start phi = {q}, start phi.omega = {rate} [rad/s] }}")  # fmt: skip
            else:
                lines.append(f"    slide j{i} : {ends} {{ along = ({u}, {v}), start x = {q} m, start x.v = {rate} [m/s] }}")  # fmt: skip
        lines += ["  }", f"  {SWITCH}", *self._network()]
        outputs = [f"q{i} = m.j{i}.{'phi' if h else 'x'}, v{i} = m.j{i}.{'phi.omega' if h else 'x.v'}" for i, h in enumerate(self.hinged)]  # fmt: skip
        outputs += [f"v{self.count + k} = w{j}.{'omega' if self.hinged[j] else 'v'}" for k, j in enumerate(self.wheels)]
        return "\n".join([*lines, "  output " + ", ".join(outputs), "}"])

    def _network(self) -> list[str]:
        """Lines of the ties, which are entered in `ties`."""
        first, second = (int(j) for j in self.random.permutation(self.count)[:2])
        kind = self.random.integers(4)
        if kind == 0:
            return self._tied(first, second)
        lines = self._clamped(first) if kind == 1 else self._wheel(first)
        return (
            lines if kind == 2 else lines + (self._clamped(second) if self.random.integers(2) else self._wheel(second))
        )

    def _row(self, joint: int, value: float = 1.0) -> Any:
        row = np.zeros(2 * self.count)  # room for all wheels
        row[joint] = value
        self.ties.append(row)
        return row

    def _clamped(self, j: int) -> list[str]:
        self._row(j)
        law = "M = 1e-9 [N*m*s/rad]*omega" if self.hinged[j] else "F = 1e-9 [N*s/m]*v"
        return [f"  1 c{j} {{ active = not on }}", f"  R r{j} : {law}", f"  m.j{j} -> c{j} -> r{j}"]

    def _wheel(self, j: int) -> list[str]:
        inertia, rate = self.random.uniform(0.1, 1), self.random.uniform(-2, 2)
        self._row(j)[self.count + len(self.wheels)] = -1
        self.wheels[j] = inertia
        domain = "rotation" if self.hinged[j] else "translation"
        law = f"L = {inertia} [kg*m^2]*omega {{ start omega = {rate} [rad/s] }}"
        if not self.hinged[j]:
            law = f"p = {inertia} kg*v {{ start v = {rate} [m/s] }}"
        return [f"  I w{j} : {law}", f"  1 s{j} : {domain}", f"  0 c{j} : {domain} {{ active = on }}", f"  m.j{j} -> c{j} -> s{j} -> w{j}"]  # fmt: skip

    def _tied(self, a: int, b: int) -> list[str]:
        if self.hinged[a] == self.hinged[b]:
            self._row(a)[b] = -1
            domain = "rotation" if self.hinged[a] else "translation"
            return [f"  0 c : {domain} {{ active = on }}", f"  m.j{a} -> c -> m.j{b}"]
        slide, hinge = (b, a) if self.hinged[a] else (a, b)
        self._row(slide)[hinge] = -0.7
        return [
            "  TF t(a: translation, b: rotation) : a.v = 0.7 m*b.omega", "  0 c : translation { active = on }",
            f"  m.j{slide} -> c -> t.a", f"  t.b -> m.j{hinge}",
        ]  # fmt: skip

    def poses(self, q: Any) -> Any:
        """Centres and angles, one row per body."""
        placed: list[tuple[Any, Any]] = []
        for i, parent in enumerate(self.parent):
            d, angle = placed[parent] if parent >= 0 else (np.zeros(2), 0.0)
            if self.hinged[i]:
                d, angle = d + about(angle) @ self.pin[i] - about(angle + q[i]) @ self.pin[i], angle + q[i]
            else:
                d = d + about(angle) @ self.way[i] * q[i]
            placed.append((d, angle))
        return np.array([[*(d + about(a) @ self.at[i]), a] for i, (d, a) in enumerate(placed)])

    def masses(self, q: Any) -> Any:
        """Mass matrix of the joints, then of the wheels."""
        slopes = np.stack([self.poses(q + 1e-30j * way).imag / 1e-30 for way in np.eye(self.count)], axis=-1)
        weights = np.stack([self.mass, self.mass, self.inertia], axis=1)
        whole = np.diag([0.0] * self.count + list(self.wheels.values()))
        whole[: self.count, : self.count] = np.einsum("bcj,bc,bck->jk", slopes, weights, slopes)
        return whole


@pytest.mark.few(6)
@pytest.mark.parametrize("seed", range(24))
def test_random_trees_in_the_plane(seed: int) -> None:
    """Clamps, clutches and ties of joints: momenta balance, and no energy comes in."""
    tree = PlanarTree(seed)
    before, after = around(tree.text(), TARGETS[seed % 2])
    size = tree.count + len(tree.wheels)
    v_0, v = (np.array([found[f"v{i}"] for i in range(size)]) for found in (before, after))
    mass = tree.masses(np.array([before[f"q{i}"] for i in range(tree.count)]))
    ties = np.array(tree.ties)[:, :size]
    whole = np.block([[mass, ties.T], [ties, np.zeros((len(ties), len(ties)))]])
    wanted = np.linalg.solve(whole, np.concatenate([mass @ v_0, np.zeros(len(ties))]))[:size]
    np.testing.assert_allclose(v, wanted, **CLOSE)
    assert v @ mass @ v <= v_0 @ mass @ v_0 * (1 + 1e-8)


# ------------------------------------------------------------ closed forms
CART = """model Cart {
  parameter at = 1 s
  multibody m : planar {
    gravity = (0, 0)
    body cart { mass = 2 kg }
    body bob { mass = 1 kg, inertia = 0.05 [kg*m^2], at = (0.3 m, -0.4 m) }
    slide a : ground to cart { along = (1, 0), start x.v = 1 [m/s] }
    hinge h : cart to bob { at = (0, 0), start phi.omega = 0.5 [rad/s] }
  }
  mode on = true
  when time > at { on = false }
  when time > at + 0.5 s { on = true }
  1 clamp { active = on }
  R r : F = 0.001 [N*s/m]*v
  m.a -> clamp -> r
  EXTRA
  output v = m.a.x.v, phi = m.h.phi, w = m.h.phi.omegaMORE
}"""


@pytest.mark.parametrize("target", TARGETS)
def test_a_cart_with_a_pendulum_is_caught_and_released(target: str) -> None:
    """Momentum about the pivot stays when the cart is caught; released it goes on with the same rates."""
    text = CART.replace("EXTRA", "").replace("MORE", "")
    before, after = around(text, target)
    height = 0.3 * np.sin(before["phi"]) - 0.4 * np.cos(before["phi"])
    assert after["v"] == 0
    assert after["w"] == pytest.approx(before["w"] - height * before["v"] / (0.05 + 0.25), rel=1e-8)
    caught = model(text).simulate(to=1.5, points=2, rtol=1e-10, target=target)
    released = model(text).simulate(to=1.5 + 1e-10, points=2, rtol=1e-10, target=target)
    assert caught["w"][-1] == pytest.approx(after["w"], rel=1e-9)
    np.testing.assert_allclose([released["v"][-1], released["w"][-1]], [0, after["w"]], rtol=1e-8, atol=1e-8)


def test_a_mass_in_derivative_form_on_a_body() -> None:
    """A mass that only moves along x with the pendulum's body counts in the momentum about the pivot."""
    before, after = around(
        CART.replace("EXTRA", "I more : p = 0.7 kg*v\n  m.bob.x -> more").replace("MORE", ""), "native"
    )
    height = 0.3 * np.sin(before["phi"]) - 0.4 * np.cos(before["phi"])

    def momentum(v: float, w: float) -> float:
        return 0.3 * w - height * v - 0.7 * height * (v - height * w)

    assert momentum(0.0, after["w"]) == pytest.approx(momentum(before["v"], before["w"]), rel=1e-8)


def test_energy_of_an_impulse() -> None:
    """The balance of the run has the loss of the impulse: kinetic energy before less after."""
    text = CART.replace("EXTRA", "").replace("MORE", "")
    before, after = around(text, "native")
    height = 0.3 * np.sin(before["phi"]) - 0.4 * np.cos(before["phi"])

    def kinetic(v: float, w: float) -> float:
        return 1.5 * v**2 + 0.15 * w**2 - v * w * height

    loss = kinetic(before["v"], before["w"]) - kinetic(after["v"], after["w"])
    found = model(text).simulate(to=1.4, points=2, rtol=1e-10, energy=True)
    assert found.energy is not None
    (dissipated,) = [e.dissipated for e in found.energy.elements if e.name == "active"]
    assert dissipated == pytest.approx(loss, rel=1e-8)
    assert abs(found.energy.residual) < 1e-8


ARM = """model Arm {
  multibody m : planar {
    gravity = (0, 0)
    body upper { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.5 m, 0 m) }
    body lower { mass = 2 kg, inertia = 0.2 [kg*m^2], at = (1.4 m, 0.2 m) }
    hinge a : ground to upper { at = (0, 0), start phi.omega = 1 [rad/s] }
    hinge b : upper to lower { at = (1 m, 0 m), start phi.omega = 2 [rad/s] }
  }
  mode locked = false
  when m.b.phi > 0.2 { locked = true }
  1 lock { active = not locked }
  R r : M = 1e-12 [N*m*s/rad]*omega
  m.b -> lock -> r
  output phi = m.a.phi, w = m.a.phi.omega, psi = m.b.phi, u = m.b.phi.omega
}"""


@pytest.mark.parametrize("target", TARGETS)
def test_an_elbow_locks_at_an_angle(target: str) -> None:
    """Angular momentum about the shoulder is what it was at the start."""
    elbow = np.array([0.4, 0.2])

    def momentum(psi: float, w: float, u: float) -> float:
        arm = np.array([1.0, 0.0]) + about(psi) @ elbow
        across = about(psi) @ elbow
        return float((0.1 + 0.25) * w + 0.2 * (w + u) + 2 * (arm @ arm * w + arm @ across * u))

    found = model(ARM).simulate(to=2, points=3, rtol=1e-10, target=target)
    assert found["psi"][-1] == pytest.approx(0.2, abs=1e-9)
    assert found["u"][-1] == 0
    assert momentum(0.2, found["w"][-1], 0.0) == pytest.approx(momentum(0.0, 1.0, 2.0), rel=1e-8)


@pytest.mark.parametrize("damping", [1e3, 1e4])
def test_limit_of_a_stiff_damper(damping: float) -> None:
    """A damper in the place of the clamp: the rate of the pendulum tends to that after the impulse, as one over its coefficient."""
    stiff = (
        CART.replace("1 clamp { active = on }", "1 clamp")
        .replace("R r", "MR r")
        .replace("EXTRA", "parameter R = 1 [N*s/m]")
    )
    stiff = stiff.replace("0.001 [N*s/m]*v", "(0.001 [N*s/m] if on else R)*v").replace("MORE", "")
    to = AT + 30 / damping
    soft = model(stiff).simulate(settings={"R": damping}, to=to, points=2, rtol=1e-10)["w"][-1]
    firm = model(CART.replace("EXTRA", "").replace("MORE", "")).simulate(to=to, points=2, rtol=1e-10)["w"][-1]
    assert 4 < abs(soft - firm) * damping < 4.5


# ------------------------------------------------------------ closed loops
CRANK = """model Crank {
  parameter at = 1 s
  multibody m : planar {
    gravity = (0, 0)
    body crank { mass = 1 kg, inertia = 0.02 [kg*m^2], at = (0.1 m, 0.05 m) }
    body rod { ROD at = (0.4 m, 0.05 m) }
    body slider { mass = 2 kg, at = (0.6 m, 0 m) }
    hinge a : ground to crank { at = (0, 0), start phi.omega = 3 [rad/s] }
    hinge b : crank to rod { at = (0.2 m, 0.1 m) }
    hinge c : rod to slider { at = (0.6 m, 0 m) }
    slide s : ground to slider { along = (1, 0) }
  }
  SWITCH
  BONDS
  output q = m.a.phi, w = m.a.phi.omega, v = m.s.x.v
}""".replace("SWITCH", SWITCH)
RODS = {"mass = 1 kg, inertia = 0.05 [kg*m^2],": 1.0, "": 0.0}
CAUGHT = "1 c { active = not on }\n  R r : F = 1e-12 [N*s/m]*v\n  m.s -> c -> r"
COUPLED = "I k : p = 3 kg*v { start v = -0.5 [m/s] }\n  1 n : translation\n  0 c : translation { active = on }\n  m.s -> c -> n -> k"
FLYWHEEL = "I k : L = 0.3 [kg*m^2]*omega { start omega = -1 [rad/s] }\n  1 n : rotation\n  0 c : rotation { active = on }\n  m.a -> c -> n -> k"


def crank_slopes(q: float) -> Any:
    """Slopes by the crank's angle: of its centre and angle, of the rod's, of the slider's place."""

    def places(q: complex) -> Any:
        pin, centre = about(q) @ np.array([0.2, 0.1]), about(q) @ np.array([0.1, 0.05])
        end = pin[0] + np.sqrt(0.17 - pin[1] ** 2)
        return np.array([*centre, q, (pin[0] + end) / 2, pin[1] / 2, np.arcsin(-pin[1] / np.sqrt(0.17)), end])

    return places(q + 1e-30j).imag / 1e-30


@pytest.mark.few(4)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("rod", RODS)
@pytest.mark.parametrize("bonds", [CAUGHT, COUPLED, FLYWHEEL], ids=["caught", "coupled", "flywheel"])
def test_slider_crank(bonds: str, rod: str, target: str) -> None:
    """The inertia of the whole reduced to the crank at this pose; a rod without mass adds none."""
    before, after = around(CRANK.replace("ROD", rod).replace("BONDS", bonds), target)
    slopes, of_rod = crank_slopes(before["q"]), RODS[rod]
    inertia = float(np.array([1, 1, 0.02, of_rod, of_rod, 0.05 * of_rod, 2]) @ slopes**2)
    arm = slopes[-1]
    wanted = {
        CAUGHT: 0.0, COUPLED: (inertia * before["w"] - 1.5 * arm) / (inertia + 3 * arm**2),
        FLYWHEEL: (inertia * before["w"] - 0.3) / (inertia + 0.3),
    }[bonds]  # fmt: skip
    np.testing.assert_allclose([after["w"], after["v"]], [wanted, arm * wanted], rtol=1e-8, atol=1e-8)


# ------------------------------------------------------------ in space
BALL = """model Hung {
  parameter at = 1 s
  multibody m : spatial {
    gravity = (0, 0, 0)
    body cart { mass = 2 kg }
    body bob { mass = 1 kg, inertia = (0.05 [kg*m^2], 0.05 [kg*m^2], 0.05 [kg*m^2]), at = (0.3 m, 0.2 m, -0.4 m) }
    slide a : ground to cart { along = (1, 0, 0), start x.v = 1 [m/s] }
    ball b : cart to bob { at = (0, 0, 0), start rx.omega = 0.5 [rad/s], start ry.omega = 1 [rad/s] }
  }
  SWITCH
  1 c { active = not on }
  R r : F = 1e-12 [N*s/m]*v
  m.a -> c -> r
  output v = m.a.x.v, x = m.a.x, px = m.bob.x, py = m.bob.y, pz = m.bob.z, wx = m.bob.rx.omega, wy = m.bob.ry.omega, wz = m.bob.rz.omega
}""".replace("SWITCH", SWITCH)


@pytest.mark.parametrize("target", TARGETS)
def test_a_cart_with_a_sphere_on_a_ball_joint(target: str) -> None:
    """The angular momentum of the sphere about the ball joint stays, with all three components."""
    before, after = around(BALL, target)
    w_0, w = (np.array([found[c] for c in ("wx", "wy", "wz")]) for found in (before, after))
    arm = np.array([before["px"] - before["x"], before["py"], before["pz"]])

    def momentum(w: Any, v: float) -> Any:
        return 0.05 * w + np.cross(arm, np.array([v, 0, 0]) + np.cross(w, arm))

    np.testing.assert_allclose(momentum(w, 0.0), momentum(w_0, before["v"]), **CLOSE)
    assert after["v"] == 0
    assert np.abs(w - w_0).max() > 0.1


SPATIAL = """model Spatial {
  parameter at = 1 s
  multibody m : spatial {
    gravity = (0, 0, 0)
    body crank { inertia = (2e-3 [kg*m^2], 0, 0), at = (0, 0, 0) }
    body rod { mass = 0.3 kg, inertia = (1e-3 [kg*m^2], 1e-3 [kg*m^2], 1e-3 [kg*m^2]), at = (0.15 m, 0.1 m, 0 m) }
    body slider { mass = 0.6 kg, at = (0.3 m, 0.1 m, 0 m) }
    hinge a : ground to crank { at = (0, 0, 0), about = (1, 0, 0), start phi.omega = RATE [rad/s] }
    ball b : crank to rod { at = (0 m, 0.1 m, 0 m) }
    ball c : rod to slider { at = (0.3 m, 0.1 m, 0 m) }
    slide s : ground to slider { along = (1, 0, 0) }
  }
  SWITCH
  I k : L = 3e-3 [kg*m^2]*omega { start omega = -1 [rad/s] }
  1 n : rotation
  0 c : rotation { active = on }
  m.a -> c -> n -> k
  output q = m.a.phi, w = m.a.phi.omega, v = m.s.x.v
}""".replace("SWITCH", SWITCH)


def spatial_slopes(q: float) -> tuple[float, float]:
    """Inertia of the whole reduced to the crank, the rod's angular velocity along its axis left out, and the slider's slope."""
    pin, turned = np.array([0, 0.1 * np.cos(q), 0.1 * np.sin(q)]), np.array([0, -0.1 * np.sin(q), 0.1 * np.cos(q)])
    reach = np.sqrt(0.09 - (pin[1] - 0.1) ** 2 - pin[2] ** 2)
    slope = -((pin[1] - 0.1) * turned[1] + pin[2] * turned[2]) / reach
    end = np.array([slope, 0, 0])
    centre, along = (turned + end) / 2, end - turned
    return float(2e-3 + 0.6 * slope**2 + 0.3 * centre @ centre + 1e-3 * along @ along / 0.09), float(slope)


@pytest.mark.few(2)
@pytest.mark.parametrize("rate", [0, 3])
@pytest.mark.parametrize("target", TARGETS)
def test_spatial_slider_crank_takes_a_flywheel(target: str, rate: float) -> None:
    """Also from rest, where the mechanism has no magnitudes; then no note speaks of growth."""
    text = SPATIAL.replace("RATE", str(rate))
    before, after = around(text, target)
    inertia, slope = spatial_slopes(before["q"])
    wanted = (inertia * before["w"] - 3e-3) / (inertia + 3e-3)
    np.testing.assert_allclose([after["w"], after["v"]], [wanted, slope * wanted], rtol=1e-8, atol=1e-8)
    found = model(text).simulate(to=2, points=2, target=target)
    assert not [note for note in found.notes if "impulse" not in note]


def test_two_mechanisms_and_a_curved_storage() -> None:
    """Hinges of two mechanisms are tied, and a flywheel with the law omega = L + 2 L^3 to both."""
    hinged = """multibody NAME : planar {
    gravity = (0, 0)
    body b { mass = 1 kg, inertia = 0.2 [kg*m^2], at = (0.3 m, 0 m) }
    hinge h : ground to b { at = (0, 0), start phi.omega = RATE [rad/s] }
  }"""
    both = [hinged.replace("NAME", n).replace("RATE", r) for n, r in (("m", "3"), ("n", "-1"))]
    text = "\n  ".join([
        "model Two {", "parameter at = 1 s", *both, SWITCH, "0 c, d : rotation { active = on }", "1 shaft : rotation",
        "I k : omega = 1 [1/(kg*m^2)]*L + 2 [1/(kg*m^2)/(N*m*s)^2]*L^3", "1 own : rotation",
        "m.h -> c -> shaft", "shaft -> n.h", "shaft -> d -> own -> k", "output a = m.h.phi.omega, b = n.h.phi.omega, L = k.L", "}",
    ])  # fmt: skip
    _, after = around(text, "native")
    root = np.roots([2 * 0.58, 0, 0.58 + 1, -0.29 * 2])
    momentum = float(root[np.abs(root.imag) < 1e-12].real[0])
    wanted = momentum + 2 * momentum**3
    np.testing.assert_allclose([after["a"], after["b"], after["L"]], [wanted, wanted, momentum], **CLOSE)


# ------------------------------------------------------------ refused
@pytest.mark.parametrize("target", TARGETS)
def test_an_impulse_beside_an_ideal_valve_is_refused(target: str) -> None:
    valve = "Se u : u = 3 V*sin(2*pi*time/0.3 s)\n  IdealDiode d\n  R load : u = 1 ohm*i\n  1 line : electric\n  u -> line -> d.pins\n  line -> load"
    text = "import IdealDiode from electric\n" + CART.replace("EXTRA", valve).replace("MORE", "")
    with pytest.raises(RunFailed, match="beside ideal valves"):
        model(text).simulate(to=1.2, points=2, target=target)


def test_an_integral_of_its_force_is_refused() -> None:
    with pytest.raises(RunFailed, match="is not known"):
        model(CART.replace("EXTRA", "").replace("MORE", ", i = integral(m.a.x.F, 0)")).simulate(to=1.2, points=2)
    assert model(CART.replace("EXTRA", "").replace("MORE", ", i = integral(m.a.x.v, 0)")).simulate(to=1.2, points=2)
