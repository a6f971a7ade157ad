"""Modes drawn on a mechanism: the poses of the bodies agree with closed forms of the modes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import bondgraph
from bondgraph.commands import commands
from bondgraph.errors import UsageError
from bondgraph.presentation.diagram import svg_text
from tests.compiling import MODELS

PENDULA = """
model Pendula {
  "Two equal ones, held to each other: they swing together, then against each other."
  multibody pair : planar {
    gravity = (0, -9.81 [m/s^2])
    body  left  { mass = 1 kg, at = (0, -1 m) }
    body  right { mass = 1 kg, at = (1 m, -1 m) }
    hinge first  : ground to left  { at = (0, 0) }
    hinge second : ground to right { at = (1 m, 0) }
    distance gap : bob to other
    frame bob   : left  { at = (0, -0.5 m) }
    frame other : right { at = (1 m, -0.5 m) }
  }
  C tie : F = 5 [N/m]*(x - 1 m)
  pair.gap -> tie
  output phi = pair.first.phi
}
"""


def test_two_pendula() -> None:
    """Together at sqrt(g/l), against each other at sqrt(g/l + 2 k (l/2)^2/(m l^2)); bodies turn by equal angles, alike or opposite."""
    figure = bondgraph.load(PENDULA).draw_mechanism(modes=2)
    text = svg_text(figure)
    slow, fast = math.sqrt(9.81) / (2 * math.pi), math.sqrt(9.81 + 2.5) / (2 * math.pi)
    assert f"{slow:.6g} Hz" in text and f"{fast:.6g} Hz" in text
    aside = [far(g) - far(h) for g, h in zip(of_kind(figure, "limb"), of_kind(figure, "shadow"), strict=True)]
    assert aside[0] == pytest.approx(aside[1], rel=1e-3) and aside[2] == pytest.approx(-aside[3], rel=1e-3)
    assert min(map(abs, aside)) > 5  # px


def of_kind(figure: Any, kind: str) -> list[Any]:
    return sorted((g for g in figure.groups if g.kind == kind), key=lambda g: figure.groups.index(g))


def far(group: Any) -> float:
    """The mean x of the outline of a body."""
    points = group.shapes[0].points
    return float(sum(p[0] for p in points) / len(points))


def test_the_manipulator(tmp_path: Path) -> None:
    """Six modes, slowest first; in the first the platform goes along x, in the second along y: nothing turns much."""
    file = tmp_path / "m.svg"
    done = CliRunner().invoke(commands, ["modes", str(MODELS / "manipulator.bg"), "--plot", str(file), "--shapes", "3"])
    assert done.exit_code == 0 and file.read_text(encoding="utf-8").count(" Hz, damping") == 3
    assert "1119.49 Hz" in file.read_text(encoding="utf-8")
    with pytest.raises(UsageError, match="which mechanism is to be drawn"):
        bondgraph.load(MODELS / "oscillator.bg").draw_mechanism(modes=1)
