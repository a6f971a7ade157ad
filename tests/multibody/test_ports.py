"""Ports of bodies and frames, driven and locked joints, reactions: power, momentum and Newton's law at the joint."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bondgraph
from tests.compiling import Running, compiled
from tests.multibody.drawing import Drawing
from tests.multibody.newton_euler import of_quaternion
from tests.multibody.random_trees import RandomTree

SIX = ("x", "y", "z", "rx", "ry", "rz")


@pytest.mark.few(3)
@pytest.mark.parametrize("place", ["b3", "tip", "own"])
@pytest.mark.parametrize("seed", [1, 4])
def test_wrench_and_twist(place: str, seed: int) -> None:
    """Flows are J q'; efforts act as J^T e; flows of positions are the rates of the readings (except in body axes)."""
    tree = RandomTree(4, seed, ("hinge", "float", "universal", "cylinder"))
    drawn = tree.drawing()
    drawn.frame("tip", "b3", [0.3, -0.2, 0.5])
    drawn.frame("own", "b3", [0.3, -0.2, 0.5], axes="body")
    ports = [f"{place}.{c}" for c in SIX]
    running = Running(drawn.compiled([f"{p}:f" for p in ports], ports, everything=True))
    q, rates = tree.sample()

    def flows(v: Any) -> Any:
        found = running.outputs(tree.state(q, v))
        return np.array([found[f"{p}:f"] for p in ports])

    jacobian = np.array([flows(unit) for unit in np.eye(len(q))]).T
    place_jacobian, spin_jacobian = tree.oracle().jacobian(q)[3]
    turn = tree.poses(q)[3][1]
    point = np.array([0.3, -0.2, 0.5]) if place != "b3" else tree.centres[3]
    arm = turn @ (point - tree.centres[3])
    expected = np.concatenate([place_jacobian + np.cross(spin_jacobian.T, arm).T, spin_jacobian])
    if place == "own":
        expected = np.concatenate([turn.T @ expected[:3], turn.T @ expected[3:]])
    np.testing.assert_allclose(jacobian, expected, atol=1e-12)
    efforts = tree.random.uniform(-2, 2, 6)
    found = running.rates(tree.state(q, rates), inputs={f"to {p}": e for p, e in zip(ports, efforts, strict=True)})
    wanted = tree.oracle().accelerations(q, rates, jacobian.T @ efforts)
    got = np.array([found[name] for _, name in tree.names()])
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


@pytest.mark.parametrize("seed", [0, 1, 3, 5])
def test_efforts_on_a_ball(seed: int) -> None:
    """Dual to the rates of its rotation vector, whichever body it was drawn from."""
    tree = RandomTree(3, seed, ("ball", "hinge"))
    i = next(iter(tree.attitudes))
    ports = [f"j{i}.{c}" for c in SIX[3:]]
    running = Running(tree.drawing().compiled([f"{p}:f" for p in ports], ports, everything=True))
    q, rates = tree.sample()
    jacobian = np.array([[running.outputs(tree.state(q, unit))[f"{p}:f"] for p in ports] for unit in np.eye(len(q))]).T
    efforts = tree.random.uniform(-2, 2, 3)
    found = running.rates(tree.state(q, rates), inputs={f"to {p}": e for p, e in zip(ports, efforts, strict=True)})
    wanted = tree.oracle().accelerations(q, rates, jacobian.T @ efforts)
    got = np.array([found[name] for _, name in tree.names()])
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


@pytest.mark.parametrize("planar", [False, True])
def test_reactions(planar: bool) -> None:
    """Reactions of every joint, against the momenta of all bodies beyond it: force and torque at the joint's point."""
    drawn = Drawing(planar, (1.0, -9.0, 0.0 if planar else 2.0))
    random = np.random.default_rng(3)
    space = np.array([1, 1, 0.0 if planar else 1])
    masses, centres, ats = (
        random.uniform(1, 2, 4),
        random.uniform(-1, 1, (4, 3)) * space,
        random.uniform(-1, 1, (4, 3)) * space,
    )
    axis = (0, 0, 1) if planar else (1, 2, -1)
    for i in range(4):
        tensor = (0, 0, 0.5, 0, 0, 0) if planar else (0.6, 0.5, 0.4, 0.1, -0.1, 0.2)
        drawn.body(f"b{i}", masses[i], tensor, centres[i].tolist())
    drawn.joint("h0", "hinge", "ground", "b0", ats[0].tolist(), axis)
    drawn.joint("s1", "slide", "b1", "b0", ats[1].tolist(), (1, 1, 0))
    drawn.joint("w2", "weld", "b1", "b2", ats[2].tolist())
    drawn.joint("h3", "hinge", "b2", "b3", ats[3].tolist(), axis if planar else (0, 1, 0))
    letters = ("x", "y", "phi") if planar else SIX
    outside = {"h0": (0, 1, 2, 3), "s1": (1, 2, 3), "w2": (2, 3), "h3": (3,)}
    for number, (joint, bodies) in enumerate(outside.items()):
        drawn.frame(f"at {joint}", f"b{bodies[0] if joint != 's1' else 0}", ats[number].tolist())
    names = [f"{j}.reaction.{c}" for j in outside for c in letters]
    read = [f"b{i}.{c}{v}" for i in range(4) for c in letters for v in ("", ":f")]
    read += [f"b{i}.attitude.{c}" for i in range(4) for c in "wxyz" if not planar]
    read += [f"at {j}.{c}" for j in outside for c in letters[: 2 if planar else 3]]
    running = Running(drawn.compiled([*names, *read], everything=True))
    state = {
        "m.h0.phi": 0.4,
        "m.h0.phi.omega": 0.7,
        "m.s1.x": 0.3,
        "m.s1.x.v": -0.8,
        "m.h3.phi": -1.0,
        "m.h3.phi.omega": 1.9,
    }
    rates = running.rates(state)

    def momenta(t: float) -> list[tuple[Any, Any, Any]]:
        """Of each body where it is, its momentum and its angular momentum about its centre, a little later."""
        there = {
            n: x + t * rates[n] + t * t / 2 * rates.get(f"{n}.omega", rates.get(f"{n}.v", 0.0))
            for n, x in state.items()
        }
        found = running.outputs(there)
        result = []
        for i in range(4):
            v, w = (np.array([found.get(f"b{i}.{c}:f", 0.0) for c in part]) for part in (SIX[:3], SIX[3:]))
            x = np.array([found.get(f"b{i}.{c}", 0.0) for c in SIX[:3]])
            spin = np.array([0, 0, 0.5 * found[f"b{i}.phi:f"]]) if planar else None
            if spin is None:
                turn = of_quaternion([found[f"b{i}.attitude.{c}"] for c in "wxyz"])
                tensor = np.array([[0.6, 0.1, -0.1], [0.1, 0.5, 0.2], [-0.1, 0.2, 0.4]])
                spin = turn @ tensor @ turn.T @ w
            result.append((x, masses[i] * v, spin))
        return result

    h = 1e-4
    later, before, now, found = momenta(h), momenta(-h), momenta(0.0), running.outputs(state)
    gravity = np.array([1.0, -9.0, 0.0 if planar else 2.0])
    for joint, bodies in outside.items():
        point = np.array([found.get(f"at {joint}.{c}", 0.0) for c in SIX[:3]])
        force, torque = np.zeros(3), np.zeros(3)
        for i in bodies:
            one = (later[i][1] - before[i][1]) / (2 * h) - masses[i] * gravity
            force += one
            torque += np.cross(now[i][0] - point, one) + (later[i][2] - before[i][2]) / (2 * h)
        sign = (
            -1.0 if joint == "s1" else 1.0
        )  # drawn from the outer body: the reaction is that on its second, the inner
        got = np.array([found.get(f"{joint}.reaction.{c}", 0.0) for c in SIX])
        got[5] += found.get(f"{joint}.reaction.phi", 0.0)
        np.testing.assert_allclose(got, sign * np.concatenate([force, torque]), atol=1e-6)


DRIVEN = """model Crank {{
  parameter m = 2 kg, g = 9.81 [m/s^2]
  multibody stage : planar {{
    gravity = (0, -g)
    body crank {{ mass = m, inertia = 0.3 [kg*m^2], at = (0.5 m, 0) }}
    body rod   {{ mass = m, inertia = 0.1 [kg*m^2], at = (1.2 m, 0.3 m) }}
    hinge top  : ground to crank {{ at = (0, 0) }}
    hinge pin  : {ends} {{ at = (1 m, 0) }}
  }}
  {drive}
  output M = {effort}, phi = stage.top.phi, psi = stage.pin.phi, omega = stage.top.phi.omega
}}
"""


@pytest.mark.parametrize("ends", ["crank to rod", "rod to crank"])
def test_a_driven_hinge(ends: str) -> None:
    """Its rate is what the network says, its acceleration the derivative of that; with the torque that this takes put on instead,
    everything moves the same."""
    rate = "3 [1/s] + 2 [1/s]*sin(time*5 [1/s])"
    driven = compiled(
        DRIVEN.format(ends=ends, drive=f"Sf drive : omega = {rate}\n  drive -> stage.top", effort="drive.M"),
        everything=True,
    )
    running = Running(driven)
    assert sorted(running.program.states.names) == ["stage.pin.phi", "stage.pin.phi.omega", "stage.top.phi"]
    state, time = {"stage.top.phi": 0.4, "stage.pin.phi": -0.7, "stage.pin.phi.omega": 1.3}, 0.37
    rates, outputs = running.rates(state, time), running.outputs(state, time)
    assert outputs["omega"] == rates["stage.top.phi"] == pytest.approx(3 + 2 * np.sin(5 * time), rel=1e-14)
    push = "input torque = 0 [N*m]\n  MSe drive : M = torque\n  drive -> stage.top"
    text = DRIVEN.format(ends=ends, drive=push, effort="drive.M")
    pushed = Running(compiled(text, free=("torque",), everything=True))
    again = pushed.rates({**state, "stage.top.phi.omega": outputs["omega"]}, inputs={"torque": outputs["M"]})
    assert again["stage.top.phi.omega"] == pytest.approx(10 * np.cos(5 * time), rel=1e-12)
    assert again["stage.pin.phi.omega"] == pytest.approx(rates["stage.pin.phi.omega"], rel=1e-12)


def test_a_locked_joint_is_welded_where_it_starts() -> None:
    for start in (None, {"phi": 0.6}):
        drawn = Drawing(False, (0, 0, -9.81))
        drawn.body("a", 1.0, (0.1, 0.2, 0.3, 0, 0, 0), (1, 0, 0))
        drawn.body("b", 2.0, (0.3, 0.2, 0.1, 0, 0, 0), (2, 0, 0.5))
        drawn.joint("one", "hinge", "ground", "a", (0, 0, 0), (0, 1, 0))
        drawn.joint("two", "hinge", "a", "b", (1.5, 0, 0), (0, 1, 0), start=start, locked=True)
        running = Running(drawn.compiled(["two.phi", "two.phi:f"], everything=True))
        asked = Running(drawn.compiled(["two.phi", "two.reaction.ry"], everything=True))
        assert [n for n in running.program.states.names if "two" in n] == []
        angle = (start or {}).get("phi", 0.0)
        assert running.outputs({}) == {"two.phi": angle, "two.phi:f": 0.0}
        assert asked.outputs({})["two.phi"] == angle
        arm = np.array([1.5, 0, 0]) + np.array(
            [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        ) @ [0.5, 0, 0.5]
        inertia = 0.2 + 0.2 + 1.0 + 2.0 * arm @ arm
        torque = 9.81 * (1.0 * 1.0 + 2.0 * arm[0])  # about y: z x F
        for made in (running, asked):
            assert made.rates({})["m.one.phi.omega"] == pytest.approx(torque / inertia, rel=1e-13)


def test_rest_is_what_a_coordinate_reads_in_the_drawing() -> None:
    drawn = Drawing(True)
    drawn.body("a", 1.0, at=(3, 0, 0))
    drawn.joint("one", "slide", "ground", "a", axis=(1, 0, 0), rest={"x": 0.2})
    running = Running(drawn.compiled(["one.x", "a.x"], everything=True))
    assert running.outputs({}) == {"one.x": 0.2, "a.x": 3.0}
    assert running.outputs({"m.one.x": 0.5})["a.x"] == pytest.approx(3.3)


FOUR_BARS = """model Bars {{
  multibody bars : planar {{
    gravity = (0, -9.81 [m/s^2])
    body a {{ mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0, 0.5 m) }}
    body b {{ mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.6 m, 1.1 m) }}
    body c {{ mass = 1 kg, inertia = 0.1 [kg*m^2], at = (1.2 m, 0.6 m) }}
    hinge h1 : ground to a {{ at = (0, 0) }}
    hinge h2 : a to b      {{ at = (0, 1 m) }}
    hinge h3 : b to c      {{ at = (1.2 m, 1.2 m) }}
    hinge h4 : ground to c {{ at = (1.2 m, 0) }}
  }}
  Sf drive : omega = 0.6 [1/s]*sin(2 [1/s]*time)
  drive -> bars.{hinge}
  output angle = bars.{hinge}.phi, M = drive.M, omega = drive.omega
  output x = bars.b.x, y = bars.b.y, turn = bars.b.phi
  output u = bars.a.x.v^2 + bars.a.y.v^2 + bars.b.x.v^2 + bars.b.y.v^2 + bars.c.x.v^2 + bars.c.y.v^2
  output w = bars.a.phi.omega^2 + bars.b.phi.omega^2 + bars.c.phi.omega^2, h = bars.a.y + bars.b.y + bars.c.y
}}
"""


@pytest.mark.parametrize("hinge", ["h1", "h2", "h3", "h4"])
def test_any_joint_of_a_loop_may_be_driven(hinge: str) -> None:
    """The loop is cut elsewhere. The power of the drive is what the bars take up: their energy, by their own readings."""
    found = bondgraph.load(FOUR_BARS.format(hinge=hinge)).simulate(to=0.5, rtol=1e-10, points=501)
    np.testing.assert_allclose(found["angle"], 0.3 * (1 - np.cos(2 * found.time)), atol=1e-10)
    energy = found["u"] / 2 + 0.1 * found["w"] / 2 + 9.81 * found["h"]
    power = found["M"] * found["omega"]
    work = np.cumsum((power[1:] + power[:-1]) / 2) * found.time[1]
    np.testing.assert_allclose(energy[1:] - energy[0], work, atol=2e-6)


@pytest.mark.parametrize("hinge", ["h1", "h3"])
def test_the_work_of_a_drive_in_a_loop_is_balanced(hinge: str) -> None:
    """Its torque holds the multipliers, which are solved for at every place of the quadrature."""
    found = bondgraph.load(FOUR_BARS.format(hinge=hinge)).simulate(to=0.5, rtol=1e-8, points=11, energy=True).energy
    assert found is not None and found.supplied > 0.03
    assert abs(found.residual) < 1e-9 * found.supplied


def test_a_ball_at_rest() -> None:
    """Values of its coordinates in the drawing."""
    drawn = Drawing()
    drawn.body("b", 1.0, (0.1, 0.2, 0.3, 0, 0, 0), (0.5, 0, 0))
    drawn.joint("pin", "ball", "ground", "b", rest={"rx": 0.2, "rz": -0.1}, start={"rx": 0.5})
    running = Running(drawn.compiled(["pin.rx", "pin.ry", "pin.rz"], everything=True))
    assert running.outputs() == pytest.approx({"pin.rx": 0.5, "pin.ry": 0.0, "pin.rz": -0.1}, abs=1e-15)
    assert running.starts()["m.pin.attitude.x"] == pytest.approx(np.sin(0.15))
