"""Scenes of the benchmarks: a model of ours, the same equations by hand, end of the run, compared quantities, and their reference values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import bondgraph

ROOT = Path(__file__).resolve().parents[2]
POINTS = 201
DUFFING = """
model Lossless {
  "A mass on a hardening spring, nothing else: its energy is what it began with, for ever."
  1 body : translation
  I mass   : p = 1 kg*v
  C spring : F = 1 [N/m]*x + 1 [N/m^3]*x^3 { start x = 1 m }
  body -> mass, spring
  output x = spring.x, v = body.v
  experiment e { simulate 0 .. 1 s }
}
"""
LINEAR = DUFFING.replace(" + 1 [N/m^3]*x^3", "")


@dataclass(frozen=True)
class Scene:
    """`states`: outputs of ours in the order of the hand-written equations' states; `outputs`: those that count (all, if there are no others)."""

    name: str
    title: str
    model: str | Path
    stop: float
    start: tuple[float, ...]
    states: tuple[str, ...]
    hand: str  # the name of the equations, "" where there are none
    tolerances: tuple[float, ...] = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
    stops: tuple[float, ...] = ()  # where the right side bends
    outputs: tuple[int, ...] = ()  # which states are outputs
    absolute: tuple[
        float, ...
    ] = ()  # absolute tolerances that the problem gives; else rtol times the largest magnitude
    apart: bool = False  # each output is measured by its own largest magnitude
    mass: Any = None  # M of M y' = f, where it is not the unit matrix
    exact: Callable[[Any], Any] | None = None  # outputs at instants
    slow: tuple[str, ...] = ()  # peers for which it is too much
    goals: tuple[float, ...] = (1e-4, 1e-5, 1e-6, 1e-8)
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def instants(self) -> Any:
        return np.linspace(0.0, self.stop, POINTS)

    def load(self) -> bondgraph.Model:
        return bondgraph.load(self.model)

    @property
    def counted(self) -> list[int]:
        return list(self.outputs) or list(range(len(self.states)))


def _amplifier_mass() -> Any:
    mass = np.zeros((8, 8))
    for (i, j), c in {(0, 1): 1e-6, (3, 4): 3e-6, (6, 7): 5e-6}.items():
        mass[i, i] = mass[j, j] = -c
        mass[i, j] = mass[j, i] = c
    mass[2, 2], mass[5, 5] = -2e-6, -4e-6
    return mass


def _duffing(t: Any) -> Any:
    """x'' = -(x + x^3) from x = 1 at rest: x = cn(w t, k^2) with w^2 = 2, k^2 = 1/4."""
    from scipy.special import ellipj

    sn, cn, dn, _ = ellipj(np.sqrt(2.0) * t, 0.25)
    return np.stack([cn, -np.sqrt(2.0) * sn * dn], axis=-1)


def _linear(t: Any) -> Any:
    return np.stack([np.cos(t), -np.sin(t)], axis=-1)


DUFFING_PERIOD = 4 * 1.685750354812596 / 2**0.5  # 4 K(1/4)/w
PERIODS = 100_037  # no multiple of 200: instants fall on all phases
MANIPULATOR = ROOT / "models" / "manipulator.bg"
AT_REST = (0.0,) * 12
POSES = ("c1", "c2", "c3", "x", "y", "phi")
PUBLISHED = ROOT / "models" / "published"

SCENES = (
    Scene("manipulator_20", "Manipulator, 20 ms", MANIPULATOR, 20e-3, AT_REST, POSES, "manipulator", stops=(5e-3,), outputs=tuple(range(6))),
    Scene("manipulator_100", "Manipulator, 100 ms", MANIPULATOR, 100e-3, AT_REST, POSES, "manipulator", stops=(5e-3,), outputs=tuple(range(6))),
    Scene(
        "amplifier", "Transistor amplifier, 0.2 s", PUBLISHED / "transistor_amplifier.bg", 0.2, (0.0, 3.0, 3.0, 6.0, 3.0, 3.0, 6.0, 0.0),
        tuple(f"y{i}" for i in range(1, 9)), "amplifier", mass=_amplifier_mass(), slow=("scipy Radau + lambdify",),
    ),
    Scene(
        "robertson", "Robertson, 40 s, each concentration by itself", PUBLISHED / "robertson.bg", 40.0, (1.0, 0.0, 0.0), ("y1", "y2", "y3"), "robertson",
        absolute=(1e-20, 1e-25, 1e-20), apart=True,
    ),
    Scene("vdpol", "Van der Pol, mu = 1000, 2000 s", PUBLISHED / "vdpol_mu1000.bg", 2000.0, (2.0, 0.0), ("y1", "y2"), "vdpol", absolute=(1e-11, 1e-13)),
    Scene(
        "duffing", "Lossless oscillator with a hardening spring, 1e5 periods", DUFFING, PERIODS * DUFFING_PERIOD, (1.0, 0.0), ("x", "v"), "duffing",
        tolerances=(1e-4, 1e-5, 1e-6, 1e-7), exact=_duffing, slow=("scipy Radau + lambdify", "casadi", "diffsol BDF", "diffsol TR-BDF2", "diffsol ESDIRK34"), goals=(1.0, 1e-1, 1e-2),
    ),
    Scene(
        "linear", "Linear lossless oscillator, 1e5 periods", LINEAR, PERIODS * 2 * np.pi, (1.0, 0.0), ("x", "v"), "", tolerances=(1e-6,), exact=_linear, goals=(1e-6, 1e-9),
    ),
)  # fmt: skip
