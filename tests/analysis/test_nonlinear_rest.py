"""Sources that hold a plate, a magnet or a membrane where it is wanted: forces that are squares of what acts, against closed forms."""

from __future__ import annotations

import json
from math import sqrt
from pathlib import Path

import pytest
from click.testing import CliRunner

from bondgraph.commands import commands

EPS0 = 8.8541878128e-12  # F/m
GAP = """model Gap {{
  parameter k: N/m = {k}, k3: N/m^3 = {k3}, g0: m = {gap}, A: m^2 = {area}, m = 20 ug, r = 2e-4 [N*s/m], R = {resistance}
  constant eps0 = 8.8541878128e-12 [F/m]
  input volt = 1 V
  MSe src : u = volt
  R lead : u = R*i
  C plates(q: electric, x: translation) : energy = q^2*(g0 - x)/(2*eps0*A)
  C spring : F = k*x + k3*x^3
  I mass : p = m*v
  R air : F = r*v
  src -> 1(lead) -> plates.q
  1(spring, mass, air) -> plates.x
  output x = spring.x, q = plates.q
}}
"""
# stiffness, cubic stiffness, gap, area, wanted fraction of the gap
PLATES = [
    (8.0, 0.0, 3e-6, 1e-6, 0.3),
    (8.0, 0.0, 3e-6, 1e-6, 0.01),
    (8.0, 0.0, 3e-6, 1e-6, 1e-4),
    (0.5, 0.0, 2e-6, 1e-8, 0.25),
    (200.0, 0.0, 1e-6, 4e-6, 0.2),
    (1e3, 0.0, 1e-5, 1e-4, 0.15),
    (40.0, 0.0, 1e-4, 1e-4, 0.32),
    (8.0, 1e13, 3e-6, 1e-6, 0.3),
    (1.0, 1e12, 3e-6, 1e-6, 0.1),
    (300.0, 1e13, 2e-6, 1e-7, 0.33),
    (2.0, 1e11, 5e-6, 2e-6, 0.2),
    (15.0, 0.0, 4e-6, 3e-6, 0.05),
]


@pytest.mark.parametrize(("k", "k3", "gap", "area", "fraction"), PLATES)
def test_a_plate_is_held_where_it_is_wanted(
    k: float, k3: float, gap: float, area: float, fraction: float, tmp_path: Path
) -> None:
    """A closed form: eps0 A V^2/(2 (g0 - x)^2) = k x + k3 x^3, before pull-in, whatever the resistance is."""
    x = fraction * gap
    truth = (gap - x) * sqrt(2 * (k * x + k3 * x**3) / (EPS0 * area))
    file = tmp_path / "gap.bg"
    file.write_text(GAP.format(k=k, k3=k3, gap=gap, area=area, resistance="1 kohm"), encoding="utf-8")
    done = CliRunner().invoke(commands, ["invert", str(file), "--want", f"x={x!r} m", "--by", "volt", "--json"])
    assert done.exit_code == 0, done.output
    assert abs(json.loads(done.stdout)["inputs"]["volt"]["value"]) == pytest.approx(truth, rel=1e-6)
