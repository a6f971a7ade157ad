"""Models with events that several tests run: thrown, switched, sampled, and events that follow from each other."""

from __future__ import annotations

import numpy as np

# The developers of FMI list this model: a ball that loses speed at each bounce, and rests when it is slow.
BALL = """model BouncingBall {
  parameter g = 9.81 [m/s^2], e = 0.7, v_min = 0.1 [m/s]
  mode falls = 1
  MSe weight : F = -1 kg*g*falls
  1 body : translation
  I mass : p = 1 kg*v
  weight -> body -> mass
  signal height = integral(mass.v, 1 m)
  when height <= 0 m and mass.v < 0 [m/s] {
    height = 0 m
    mass.v = (-e*mass.v if -e*mass.v >= v_min else 0 [m/s])
    falls = (1 if -e*mass.v >= v_min else 0)
  }
  output h = height, v = mass.v
  experiment drop { simulate 0 .. 3 s }
}
"""
HEATER = """model Heater {
  parameter T_0 = 290 K, high = 295 K
  mode heats = true, starts = 0
  signal T = integral((2 [K/s] if heats else 0 [K/s]) - (T - 285 K)/(10 s), T_0)
  when T > high or time > 40 s { heats = false }
  when T < 293 K and time < 40 s { heats = true, starts = starts + 1 }
  output temperature = T, n = starts
}
"""
_SERVO = """model Servo {
  parameter target = 3 rad, period = 10 ms
  mode volt = 0 V, error = 0 rad, sum = 0
  I rotor  : L = 0.002 [kg*m^2]*omega
  R drag   : M = 1 [mN*m*s]*omega
  GY motor : u1 = 0.1 [V*s]*omega2
  R coil   : u = 2 ohm*i
  MSe supply : u = volt
  supply -> 1(coil) -> motor -> 1(rotor, drag)
  signal angle = integral(rotor.omega, 0 rad)
  every period{timing} {
    error = angle - target
    sum   = sum - 0.01*error
    volt  = min(max(-10 V*error + 1 V*sum - 1 [V*s]*rotor.omega, -12 V), 12 V)
  }
  output phi = angle, u = volt, stairs = integral(floor(angle/1 rad) + floor(2*time/1 s), 0 s)
}
"""
# A start event that resets a state, and a chain of events that each other's settings cause.
CHAIN = """plain model Chain {
  mode a = 0, b = 0
  input u = 0
  signal x = integral(1, 0)
  when x < 0.5 { x = 2, a = a + 1 }
  when a > 0.5 { b = a + x }
  when b > 1.5 { a = 10*b }
  when u > 1 { b = -x }
  output y = x, p = a, q = b
}
"""


def servo(timing: str) -> str:
    """A motor whose controller is sampled, with an offset, a delay, a jitter."""
    return _SERVO.replace("{timing}", timing)


def bounces(e: float, v_min: float, stop: float) -> list[tuple[float, float]]:
    """Instants and speeds after them, of a ball that falls from 1 m."""
    speed = (2 * 9.81) ** 0.5
    time, found = speed / 9.81, []
    while time <= stop and speed > 0:
        speed = e * speed if e * speed >= v_min else 0.0
        found.append((time, speed))
        time += 2 * speed / 9.81
    return found


def height(times: np.ndarray, e: float, v_min: float) -> np.ndarray:
    h = np.maximum(1 - 0.5 * 9.81 * times**2, 0.0)
    for start, speed in bounces(e, v_min, float(times[-1])):
        since = times - start
        h = np.where(since >= 0, np.maximum(speed * since - 0.5 * 9.81 * since**2, 0.0), h)
    return h
