"""Stops and impacts against closed forms: a geometric series of flights, a damped half swing, a mass between two walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.library.bench import near, run

G = 9.81

BOUNCING = """
    StoppedMass ball { m = 0.1 kg, low = 0 m, high = 100 m, x_0 = 1 m, bounce = 0.8, v_rest = 1 [mm/s] }
    Se weight : F = -0.1 kg*9.81 [m/s^2]
    Se lift   : F = 0 N if time < 5 s else 2*0.1 kg*9.81 [m/s^2]
    1 hand
    weight -> hand
    lift -> hand -> ball.ends
    output x = ball.way, v = ball.v, F = ball.force, rests = ball.rests
"""


def flights() -> tuple[list[float], float]:
    """Times at which a ball that falls from 1 m touches the ground, and its speed after the last of them."""
    speed, times = math.sqrt(2 * G), [math.sqrt(2 / G)]
    while 0.8 * speed >= 1e-3:
        speed *= 0.8
        times.append(times[-1] + 2 * speed / G)
    return times, speed


def test_a_ball_bounces_comes_to_rest_and_is_lifted_again() -> None:
    found = run("mechanics", "StoppedMass", BOUNCING, 6, points=61, energy=True)
    times, last = flights()
    series = math.sqrt(2 / G) * (
        1 + 2 * 0.8 / (1 - 0.8)
    )  # of endless bounces; what is left after the last is a tail of it
    assert series - times[-1] == pytest.approx(2 * 0.8 * last / G / (1 - 0.8), rel=1e-6)
    np.testing.assert_allclose([e.time for e in found.events], [*times, 5], rtol=1e-9)
    resting = (found.time > times[-1]) & (found.time < 5)
    assert (found["v"][resting] == 0).all() and (found["rests"][resting] == 1).all()
    near(found["F"][resting], -0.1 * G)  # what the ground carries
    after = np.maximum(found.time - 5, 0)
    near(found["x"][found.time >= 5], (0.5 * G * after**2)[found.time >= 5])
    assert found.energy is not None
    lost = sum(e.dissipated for e in found.energy.elements if e.kind == "event")
    assert lost == pytest.approx(0.1 * G * 1, rel=1e-9)  # all that it had
    near(found.energy.residual, 0, scale=1)


def test_a_mass_between_two_walls() -> None:
    """Without force: from wall to wall, each impact takes 10 % of the speed."""
    body = """
        StoppedMass slider { m = 2 kg, low = -3 mm, high = 7 mm, v_0 = 0.1 [m/s], bounce = 0.9 }
        Se nothing : F = 0 N*time/1 s
        nothing -> slider.ends
        output x = slider.way, v = slider.v
    """
    found = run("mechanics", "StoppedMass", body, 1, points=11)
    speed, time, expected = 0.1, 0.07, []
    while time < 1:
        expected.append(time)
        speed *= 0.9
        time += 0.01 / speed
    np.testing.assert_allclose([e.time for e in found.events], expected, rtol=1e-9)
    assert found.final("v") == pytest.approx((-0.9) ** len(expected) * 0.1, rel=1e-9)


def swing(k: float, r: float, m: float, v: float) -> tuple[float, float]:
    """Contact time of a mass with a spring and a damper that do not pull, and its speed afterwards."""
    delta = r / (2 * m)
    w = math.sqrt(k / m - delta**2)

    def x(t: float) -> float:
        return v / w * math.exp(-delta * t) * math.sin(w * t)

    def dx(t: float) -> float:
        return v * math.exp(-delta * t) * (math.cos(w * t) - delta / w * math.sin(w * t))

    end = brentq(lambda t: k * x(t) + r * dx(t), 1e-3 / w, math.pi / w, xtol=1e-18, rtol=1e-14)
    return end, -dx(end)


STOPPED = {
    "Stops": """
        I m : p = 0.5 kg*v { start v = 1 [m/s] }
        Stops stop { low = -3 mm, high = 5 mm, k = 2e5 [N/m], r = 200 [N*s/m] }
    """,
    "RotaryStops": """
        I m : L = 0.5 [kg*m^2]*omega { start omega = 1 [1/s] }
        RotaryStops stop { low = -0.003 rad, high = 0.005 rad, k = 2e5 [N*m], r = 200 [N*m*s] }
    """,
}


@pytest.mark.parametrize("kind", STOPPED)
def test_a_spring_and_a_damper_that_do_not_pull(kind: str) -> None:
    """To the high stop and back to the low one; the spring is let go before it has its length again."""
    found = run(
        "mechanics", kind, f"1 body\n{STOPPED[kind]}\nbody -> m, stop.ends\noutput v = body.f", 40e-3, points=2001
    )
    touch, speed = swing(2e5, 200, 0.5, 1)
    flying = (found.time > 5e-3 + touch + 1e-5) & (found.time < 5e-3 + touch + 7e-3 / speed)
    near(found["v"][found.time < 5e-3], 1)
    near(found["v"][flying], -speed)
    assert found.final("v") == pytest.approx(speed**2, rel=1e-7)  # linear: each impact leaves the same share


def test_stops_at_the_limits_of_a_joint() -> None:
    """A rail with limits, and stops at fixed places: the spring reads the joint's coordinate, for any start."""
    body = """
        parameter low = -2 mm, high = 4 mm
        multibody drive : planar {
          body table { mass = 0.5 kg }
          slide rail : ground to table { along = 0, limits = (low, high), start x = 1 mm, start x.v = 1 [m/s] }
        }
        Stops stop { low = low, high = high, k = 2e5 [N/m], r = 200 [N*s/m] }
        drive.rail -> stop.ends
        output x = drive.rail.x, v = drive.rail.x.v, way = stop.way
    """
    found = run("mechanics", "Stops", body, 8e-3, points=801)
    touch, speed = swing(2e5, 200, 0.5, 1)
    near(found["v"][found.time < 3e-3], 1)
    after = found.time > 3e-3 + touch
    assert after.any()
    near(found["v"][after], -speed)
    near(found["way"], found["x"], rtol=1e-12)
    assert any(
        "limits of the slide" in w.condition or "limits" in str(w) for w in found.warnings
    )  # the stop gives way a little


def test_check_valve_opens_late_and_shuts_at_zero() -> None:
    body = """
        Se pump : P = 1 bar*sin(2*pi*1 Hz*time)
        Se tank : P = 0 Pa
        CheckValve valve { P_open = 0.5 bar }
        0 a, b
        pump -> a -> valve.a
        valve.b -> b
        tank -> b
        R leak : Q = P*1e-12 [m^3/(s*Pa)]
        b -> leak
        output Q = valve.flow, P = valve.drop
    """
    found = run("hydraulic", "CheckValve", body, 2, points=401)
    phase = found.time % 1
    passes = (phase > 1 / 12) & (phase < 0.5)
    pressure = 1e5 * np.sin(2 * np.pi * found.time)
    near(found["P"], pressure)
    root = np.sign(pressure) * (np.sqrt(pressure**2 + 0) - 0) ** 0.5
    expected = np.where(passes, 0.62 * 1e-5 * math.sqrt(2 / 850) * root, 0)
    edge = np.abs(phase - 0.5) < 0.01
    near(found["Q"][~edge], expected[~edge], rtol=2e-3, margin=1)
    assert (found["Q"][~passes & ~edge] == 0).all()
