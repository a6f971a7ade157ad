"""2. Lossless systems for a long time: where the energy goes; damped ones: none comes from nowhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import bondgraph
from bondgraph.errors import RunFailed, UsageError
from tests.stress.report import Section
from tests.stress.trial import TooLong, shortened, within
from tests.stress.ways import Way, loaded, ways

RTOL = 1e-6
TREND = 1e-10  # relative, of a solver that conserves energy
CONSERVING = "energy"  # how such a solver is called
LONGEST = 400.0  # s for one run

# name -> text, period in s, output of the energy
LOSSLESS: dict[str, tuple[str, float]] = {
    "linear oscillator": (
        """model Swing {
  I mass : p = 1 kg*v     { start v = 1 [m/s] }
  C spring : F = 1 [N/m]*x
  1(mass) -> spring
  output energy = 1 kg*mass.v^2/2 + 1 [N/m]*spring.x^2/2
}
""",
        2 * np.pi,
    ),
    "hardening spring": (
        """model Swing {
  I mass : p = 1 kg*v     { start v = 1 [m/s] }
  C spring : F = 1 [N/m]*x + 1 [N/m^3]*x^3
  1(mass) -> spring
  output energy = 1 kg*mass.v^2/2 + 1 [N/m]*spring.x^2/2 + 1 [N/m^3]*spring.x^4/4
}
""",
        4.9,
    ),
    "pendulum": (
        """model Swing {
  multibody arm : planar {
    gravity = (0, -1 [m/s^2])
    body  bob { mass = 1 kg, at = (0, -1 m) }
    hinge pin : ground to bob { at = (0, 0), start phi = 2 }
  }
  output energy = 1 [kg*m^2]*arm.pin.phi.omega^2/2 + 1 [N*m]*(1 - cos(arm.pin.phi))
}
""",
        8.35,
    ),
    "prey and predators": (
        """plain model Animals {
  signal prey = integral(prey*(1 - hunters), 1.5)
  signal hunters = integral(hunters*(prey - 1), 1)
  output energy = prey - ln(prey) + hunters - ln(hunters)
}
""",
        6.5,
    ),
}
DAMPED = """model Damped {{
  "Two masses, two hardening springs, two dampers: from random starts, energy only falls."
  I one : p = 1 kg*v       {{ start v = {0:.6g} [m/s] }}
  I two : p = {4:.3g} kg*v {{ start v = {1:.6g} [m/s] }}
  C a : F = 10 [N/m]*x + 5 [N/m^3]*x^3  {{ start x = {2:.6g} m }}
  C b : F = {5:.3g} [N/m]*x + 1 [N/m^3]*x^3 {{ start x = {3:.6g} m }}
  R r : F = {6:.3g} [N*s/m]*v
  R s : F = {7:.3g} [N*s^2/m^2]*v*abs(v)
  1 first, second : translation
  first -> one
  first -> a
  first -> 0(1(b, r)) -> second
  second -> two, s
  output energy = one.p^2/(2 kg) + two.p^2/({8:.6g} kg) + 5 [N/m]*a.x^2 + 1.25 [N/m^3]*a.x^4 + {9:.6g} [N/m]*b.x^2 + 0.25 [N/m^3]*b.x^4
}}
"""


def damped(number: int) -> str:
    """A damped system with random numbers."""
    rng = np.random.default_rng(number)
    v1, v2, x1, x2 = rng.uniform(-1, 1, 4)
    m2, k2, r, s = (float(f"{v:.3g}") for v in 10 ** rng.uniform(-2, 2, 4))
    return DAMPED.format(v1, v2, x1, x2, m2, k2, r, s, 2 * m2, k2 / 2)


def section(short: bool, folder: Path) -> Section:
    """Drift over many periods with a picture, and passivity."""
    found = Section("2. Energy over a long time")
    periods = 300 if short else 100_000
    found.say(
        f"Relative change of the energy at rtol = {RTOL:g}, over {periods} periods with machine code (a hundredth of that where every step is made "
        "by Python): at the end, the largest on the way, and the trend: the slope of a straight line through it, times the run."
    )
    rows, curves = [], []
    chosen = ways()
    for way in chosen[:1] if short else chosen:
        for name, (text, period) in LOSSLESS.items():
            count = periods if way.target == "native" or short else periods // 100
            if short and way.target == "numpy":
                count = 20
            row, curve = _one(found, name, text, period * count, way)
            rows.append([name, way.name, count, *row])
            if curve is not None:
                curves.append((name, way, period, curve))
    found.table(("system", "way", "periods", "steps", "at the end", "largest", "trend", "s"), rows)
    if not short:
        picture = _picture(curves, folder)
        if picture is not None:
            found.picture(picture, "energy over periods")
    _passive(found, 3 if short else 200, chosen[0])
    return found


def _one(found: Section, name: str, text: str, stop: float, way: Way) -> tuple[list[Any], Any]:
    """A row of the table and the curve: times and relative changes."""
    found.tried += 1
    try:
        with within(LONGEST):
            result = loaded(text).simulate(None, to=stop, points=2001, rtol=RTOL, **way.arguments)
    except UsageError as failed:
        found.unsuited[shortened(str(failed))] += 1
        return ["-", "", "", "", ""], None
    except RunFailed as failed:
        found.refuse(f"{name} ({way.name})", str(failed))
        return ["refused", "", "", "", ""], None
    except TooLong:
        found.fail(f"{name} ({way.name})", f"no end within {LONGEST:g} s")
        return ["no end", "", "", "", ""], None
    change = result["energy"] / result["energy"][0] - 1
    trend = float(np.polyfit(result.time / result.time[-1], change, 1)[0])
    exact = result.solver == "matrix exponential" or way.solver == CONSERVING
    if exact and abs(trend) > TREND:
        found.fail(f"{name} ({way.name})", f"a trend of {trend:.3g} of the energy, with a solver that conserves it")
    if not exact and not np.abs(change).max() < 1e-2:
        found.fail(f"{name} ({way.name})", f"the energy changes by {np.abs(change).max():.3g} of it")
    row = [result.steps, float(change[-1]), float(np.abs(change).max()), trend, result.wall_time]
    return row, (result.time, change)


def _picture(curves: list[Any], folder: Path) -> Path | None:
    """Energy over periods, both logarithmic."""
    try:
        import matplotlib
    except ImportError:
        return None
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 4.5))
    for name, way, period, (time, change) in curves:
        late = time > 0
        axes.loglog(
            time[late] / period, np.maximum(np.abs(change[late]), 1e-17), label=f"{name}, {way.name}", linewidth=1
        )
    axes.set_xlabel("periods")
    axes.set_ylabel("relative change of the energy")
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(fontsize=7)
    figure.tight_layout()
    path = folder / "drift.png"
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


def _passive(found: Section, count: int, way: Way) -> None:
    """Damped systems with random numbers: the energy never rises by more than the tolerance, and the balance closes."""
    worst, unbalanced = 0.0, 0.0
    for number in range(count):
        found.tried += 1
        result = bondgraph.load(damped(number)).simulate(
            None, to=20.0, points=2001, rtol=RTOL, energy=number % 4 == 0, **way.arguments
        )
        energy = result["energy"]
        rise = float(np.diff(energy).max() / energy[0])
        worst = max(worst, rise)
        if rise > RTOL:
            found.fail(f"damped system {number}", f"the energy rises by {rise:.3g} of it between two instants")
        if result.energy is not None:
            left = abs(result.energy.residual) / energy[0]
            unbalanced = max(unbalanced, left)
            if left > 10 * RTOL:
                found.fail(f"damped system {number}", f"{left:.3g} of the energy is not accounted for")
    found.say(
        f"{count} damped systems of two masses from random starts, with random stiffness, mass and friction over four decades: the energy "
        f"rises nowhere by more than {worst:.2g} of what there was; what the balance leaves is at most {unbalanced:.2g}."
    )
