"""Pictures of runs and branches: their content, and their refusals; energies over time against closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.analysis.energies import energies
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from bondgraph.presentation.plots.families import plot_surface
from tests.compiling import MODELS

RINGING = """
model Ringing {
  Se push : F = 2 N
  I mass : p = 1 kg*v
  C spring : F = 100 [N/m]*x
  R air : F = 1 [N*s/m]*v
  Sf belt : v = 0.5 [m/s]
  C band : F = 10 [N/m]*x
  push -> 1(mass, spring, air)
  belt -> band
  output x = spring.x, v = mass.v
  experiment ring { simulate 0 .. 2 s { points = 201 } }
}
"""


def test_energy_over_time() -> None:
    """The oscillator by its exponential; a belt that stretches a spring gives 1/2 k (v t)^2."""
    found = energies(bondgraph.load(RINGING))
    t = found.time
    decay, omega = 0.5, np.sqrt(100 - 0.25)
    x = 0.02 * (1 - np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t)))
    v = 0.02 * np.exp(-decay * t) * (decay**2 + omega**2) / omega * np.sin(omega * t)
    assert found.elements["push"] == pytest.approx(2 * x, abs=1e-9)
    assert found.elements["spring"] == pytest.approx(50 * x**2, abs=1e-9)
    assert found.elements["mass"] == pytest.approx(v**2 / 2, abs=1e-9)
    assert found.elements["belt"] == pytest.approx(5 * (0.5 * t) ** 2, abs=1e-8)
    assert found.stored + found.dissipated == pytest.approx(found.supplied, abs=1e-8) and not found.motion.any()


def test_energy_of_the_manipulator() -> None:
    """At 20 ms, by two integrators of hand-written equations."""
    found = energies(bondgraph.load(MODELS / "manipulator.bg"), "push_x", points=11)
    assert found.supplied[-1] == pytest.approx(1.461642194e-10, rel=1e-7)
    assert found.dissipated[-1] == pytest.approx(1.023968566e-12, rel=1e-6)
    assert (found.stored + found.motion)[-1] == pytest.approx(1.451402509e-10, rel=1e-7)


def test_pictures(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    model = tmp_path / "ring.bg"
    model.write_text(RINGING, encoding="utf-8")
    run = [
        "run",
        str(model),
        "--plot",
        str(tmp_path / "p.svg"),
        "--over",
        "x",
        "--plot-energy",
        str(tmp_path / "e.svg"),
    ]
    assert CliRunner().invoke(commands, run).exit_code == 0
    for name in ("p.svg", "e.svg"):
        assert (tmp_path / name).read_text(encoding="utf-8").startswith("<?xml")
    result = bondgraph.load(model).simulate()
    with pytest.raises(UsageError, match="the run shows no `z`; it shows x, v"):
        result.plot(tmp_path / "q.png", "z")
    wrong = CliRunner().invoke(commands, ["run", str(model), "--over", "x"])
    assert wrong.exit_code == 2 and "name a file with --plot" in wrong.output


def test_a_relief_and_what_is_none(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    text = RINGING
    text = (
        text.replace("100 [N/m]", "k")
        .replace("F = 2 N", "F = f")
        .replace("  Se", "  parameter k = 100 [N/m], f = 2 N\n  Se")
    )
    text = (
        text.replace("  Sf belt : v = 0.5 [m/s]\n", "")
        .replace("  C band : F = 10 [N/m]*x\n", "")
        .replace("  belt -> band\n", "")
    )
    model = bondgraph.load(text)
    found = model.sweep({"k": "50 N/m .. 150 N/m : 3", "f": "1 N .. 3 N : 3"}, of="equilibrium")
    plot_surface(found, tmp_path / "s.svg", "x")
    assert (tmp_path / "s.svg").exists()
    with pytest.raises(UsageError, match="there is no `z` to draw; there is x, v"):
        plot_surface(found, tmp_path / "t.svg", "z")
    with pytest.raises(UsageError, match="of two quantities"):
        plot_surface(model.sweep({"k": [50.0, 60.0]}, of="equilibrium"), tmp_path / "t.svg", "x")
