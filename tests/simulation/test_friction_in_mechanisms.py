"""Joints that stick and slip, against equations of Lagrange that are integrated from event to event."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bondgraph
from bondgraph.compiled_scene import TARGETS

BOTH = [pytest.param(t, marks=pytest.mark.machine_code) if t == "native" else t for t in TARGETS]
COULOMB, BREAK, VISCOUS = 0.5, 0.9, 0.1  # N or N*m, and times seconds a metre or radian
Rates = Callable[[float, Any, float], Any]


def stick_and_slip(slide: Rates, stuck: Rates, speed: Any, held: Callable[[float, Any], float], y: Any, instants: Any) -> Any:  # fmt: skip
    """States at instants, shape (states, instants). `slide`, `stuck`: rates, for a direction of sliding; `held`: effort on what sticks."""
    now, y, direction = 0.0, np.array(y, dtype=float), 0.0
    found = np.zeros((len(y), len(instants)))
    while now < instants[-1]:
        if not direction and abs(held(now, y)) >= BREAK * (1 - 1e-9):
            direction = float(np.sign(held(now, y)))

        def end(t: float, y: Any, d: float = direction) -> float:
            return d * speed(y) if d else abs(held(t, y)) - BREAK

        end.terminal, end.direction = True, -1.0 if direction else 1.0  # type: ignore[attr-defined]
        part = solve_ivp(
            lambda t, y, d=direction: (slide if d else stuck)(t, y, d), (now, instants[-1]), y, "DOP853", rtol=1e-11, atol=1e-12, events=end,
            dense_output=True, max_step=0.05,
        )  # fmt: skip
        between = (instants >= now) & (instants <= part.t[-1])
        found[:, between] = part.sol(instants[between]) if between.any() else 0.0
        now, y, direction = part.t[-1], part.y[:, -1], 0.0
    return found


def friction(joint: str, letter: str = "F") -> str:
    turning = letter == "M"
    rate, unit = ("omega", "N*m") if turning else ("v", "N")
    domain = "rotation" if turning else "translation"
    return f"""
  mode way = 0
  0 end : {domain}
  1 contact : {domain} {{ active = way != 0 }}
  MR surface : {letter} = way*{COULOMB} [{unit}] + {VISCOUS} [{unit}*s{"" if turning else "/m"}]*{rate}
  m.{joint} -> end -> contact -> surface
  when way == 0 and abs(end.{letter}) > {BREAK} [{unit}] {{ way = 1 if end.{letter} > 0 [{unit}] else -1 }}
  when way*contact.{rate} < 0 [{"rad/s" if turning else "m/s"}] {{ way = 0 }}"""


CART = """model Cart {
  multibody m : planar {
    gravity = (0, GRAVITY [m/s^2])
    body cart { mass = 2 kg, inertia = 0.1 [kg*m^2] }
    body bob { mass = 1 kg, inertia = 0.05 [kg*m^2], at = (0, -0.5 m) }
    slide a : ground to cart { along = 0 }
    hinge h : cart to bob { at = (0, 0), start phi.omega = 2 [rad/s] }
  }
  Se push : F = 3 N*sin(2 [rad/s]*time)
  push -> m.a FRICTION
  output x = m.a.x, phi = m.h.phi, v = m.a.x.v, omega = m.h.phi.omega
}"""


@pytest.mark.few(4)
@pytest.mark.parametrize("target", BOTH)
@pytest.mark.parametrize("gravity", [0.0, -9.81])
@pytest.mark.parametrize("solver", ["automatic", "explicit", "radau"])
def test_a_cart_that_sticks_below_a_pendulum(solver: str, gravity: float, target: str) -> None:
    mass, bob, length, inertia = 2.0, 1.0, 0.5, 0.05

    def load(t: float) -> float:
        return float(3 * np.sin(2 * t))

    def slide(t: float, y: Any, direction: float) -> Any:
        _, phi, v, omega = y
        c, s = np.cos(phi), np.sin(phi)
        matrix = [[mass + bob, bob * length * c], [bob * length * c, inertia + bob * length**2]]
        right = [load(t) - direction * COULOMB - VISCOUS * v + bob * length * s * omega**2, bob * gravity * length * s]
        return [v, omega, *np.linalg.solve(matrix, right)]

    def turning(phi: float) -> float:
        return float(bob * gravity * length * np.sin(phi) / (inertia + bob * length**2))

    def stuck(t: float, y: Any, direction: float) -> Any:
        return [0.0, y[3], 0.0, turning(y[1])]

    def held(t: float, y: Any) -> float:
        _, phi, _, omega = y
        return float(load(t) - bob * length * (turning(phi) * np.cos(phi) - omega**2 * np.sin(phi)))

    instants = np.linspace(0, 6, 31)
    exact = stick_and_slip(slide, stuck, lambda y: y[2], held, [0, 0, 0, 2.0], instants)
    model = bondgraph.load(CART.replace("GRAVITY", str(gravity)).replace("FRICTION", friction("a")))
    found = model.simulate(to=6, points=31, rtol=1e-9, solver=solver, target=target)
    assert len(found.events) >= 6
    for name, row in zip(("x", "phi", "v", "omega"), exact, strict=True):
        np.testing.assert_allclose(found[name], row, atol=2e-6, err_msg=name)


CRANK = """model Crank {
  multibody m : planar {
    gravity = (0, 0)
    body crank { inertia = 0.2 [kg*m^2] }
    body rod { mass = 1 kg, inertia = 0.1 [kg*m^2], at = (0.65 m, 0.15 m) }
    body piston { mass = 3 kg, at = (1 m, 0) }
    hinge main : ground to crank { at = (0, 0) }
    hinge pin : crank to rod { at = (0.3 m, 0.3 m) }
    hinge wrist : rod to piston { at = (1 m, 0) }
    slide bore : ground to piston { along = 0 }
  }
  Se motor : M = 1.3 [N*m]*sin(1 [rad/s]*time)
  C spring : M = 4 [N*m]*phi
  motor -> m.main -> spring FRICTION
  output phi = m.main.phi, omega = m.main.phi.omega, x = m.bore.x
}"""


def crank(angle: Any) -> tuple[Any, Any, Any]:
    """Way of the piston from its drawing and its slope, and the inertia seen at the crank."""
    r, rod = np.hypot(0.3, 0.3), np.hypot(0.7, 0.3)
    a = angle + np.pi / 4
    y, dy = r * np.sin(a), r * np.cos(a)
    along = np.sqrt(rod**2 - y**2)
    slope = -y - y * dy / along
    swing = -dy / along  # rate of the rod's angle, asin(-y/rod)
    middle = ((-y + slope) / 2, dy / 2)
    inertia = 0.2 + 3 * slope**2 + (middle[0] ** 2 + middle[1] ** 2) + 0.1 * swing**2
    return r * np.cos(a) + along - 1, slope, inertia


@pytest.mark.few(2)
@pytest.mark.parametrize("target", BOTH)
@pytest.mark.parametrize("joint", ["main", "bore"])
def test_a_slider_crank_that_sticks(joint: str, target: str) -> None:
    """A closed loop, with friction at the crank or at the piston."""

    def arm(phi: float) -> float:
        return 1.0 if joint == "main" else float(crank(phi)[1])

    def free(t: float, phi: float) -> float:
        return float(1.3 * np.sin(t) - 4 * phi)

    def slide(t: float, y: Any, direction: float) -> Any:
        phi, omega = y
        inertia, change = crank(phi)[2], crank(phi + 1e-30j)[2].imag / 1e-30
        return [
            omega,
            (free(t, phi) - (direction * COULOMB + VISCOUS * arm(phi) * omega) * arm(phi) - 0.5 * change * omega**2)
            / inertia,
        ]

    def held(t: float, y: Any) -> float:
        return free(t, y[0]) / arm(y[0])

    instants = np.linspace(0, 8, 33)
    exact = stick_and_slip(slide, lambda *_: [0.0, 0.0], lambda y: y[1] * arm(y[0]), held, [0.0, 0.0], instants)
    letter = "M" if joint == "main" else "F"
    model = bondgraph.load(CRANK.replace("FRICTION", friction(joint, letter)))
    found = model.simulate(to=8, points=33, rtol=1e-9, target=target)
    assert len(found.events) >= 6
    np.testing.assert_allclose(found["phi"], exact[0], atol=1e-6)
    np.testing.assert_allclose(found["x"], [crank(phi)[0] for phi in exact[0]], atol=1e-6)
