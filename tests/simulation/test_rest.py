"""`equilibrium` before `simulate`: the run starts where all rates vanish."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed
from tests.compiling import ROOT


def at_rest(body: str, *outputs: str) -> dict[str, float]:
    """The outputs at the start, which must be those at the end."""
    reported = ", ".join(f"y{i} = {o}" for i, o in enumerate(outputs))
    text = f"model A {{\n{body}\n  output {reported}\n  experiment e {{ equilibrium; simulate 0 .. 1 s }}\n}}\n"
    found = bondgraph.load(text).simulate(points=3)
    first, last = found.values[0], found.values[-1]
    assert last == pytest.approx(first, rel=1e-9, abs=1e-12)
    return dict(zip(outputs, map(float, first), strict=True))


def test_a_hardening_spring_under_load() -> None:
    """100 x + 2e4 x^3 = 300 N: the real root, and nothing moves."""
    body = "  Se push : F = 300 N\n  1 body\n  I mass : p = 1 kg*v { start v = 3 [m/s] }\n  C spring : F = 100 [N/m]*x + 2e4 [N/m^3]*x^3\n  R damper : F = 0.5 [N*s/m]*v\n  push -> body -> mass, spring, damper"
    found = at_rest(body, "spring.x", "mass.v")
    root = max(np.roots([2e4, 0, 100, -300]).real)
    assert found["spring.x"] == pytest.approx(root, rel=1e-12) and found["mass.v"] == pytest.approx(0, abs=1e-12)


def test_a_diode_behind_a_resistor_charges_a_capacitor() -> None:
    """In the end no current flows but the load's: through diode and resistors alike."""
    body = "  Se s : u = 5 V\n  R series : u = 10 ohm*i\n  R diode : i = 1 nA*(exp(u/26 mV) - 1)\n  C c : u = q/(100 uF)\n  R load : u = 1000 ohm*i\n  s -> 1(series, diode) -> 0(c, load)"
    found = at_rest(body, "c.u", "diode.i")
    i = found["diode.i"]
    assert i == pytest.approx(found["c.u"] / 1000, rel=1e-12)
    assert 5 - 10 * i - 26e-3 * np.log(1 + i / 1e-9) == pytest.approx(found["c.u"], rel=1e-12)


def test_what_nothing_brings_back_stays() -> None:
    """A mass that rolls out in oil: its speed is zero, its place is where the author put it."""
    body = "  1 body\n  I mass : p = 1 kg*v { start v = 3 [m/s] }\n  R oil : F = 2 [N*s/m]*v\n  body -> mass, oil\n  signal x = integral(body.v, 7 m)"
    found = at_rest(body, "x", "mass.v")
    assert found["mass.v"] == pytest.approx(0, abs=1e-12) and np.isfinite(found["x"])


def test_none_is_told() -> None:
    """A constant force without anything that holds it."""
    text = "model A {\n  Se push : F = 1 N\n  I mass : p = 1 kg*v\n  push -> mass\n  output v = mass.v\n  experiment e { equilibrium; simulate 0 .. 1 s }\n}\n"
    with pytest.raises(RunFailed, match=r"no equilibrium.*`mass.p`"):
        bondgraph.load(text).simulate()


def test_a_manipulator_under_load_sits_where_statics_say(tmp_path: Path) -> None:
    """30 uN in x move the platform by 9.67567 um: the hand-written statics of the reference."""
    text = (ROOT / "models/manipulator.bg").read_text(encoding="utf-8")
    rest = (
        "experiment rest { set fx = 30 uN; equilibrium; simulate 0 .. 0.1 ms; report x in um }\n  experiment push_x {"
    )
    shutil.copy(ROOT / "models/mems.bg", tmp_path)
    (tmp_path / "manipulator.bg").write_text(text.replace("experiment push_x {", rest), encoding="utf-8")
    found = bondgraph.load(tmp_path / "manipulator.bg").simulate("rest", points=2)
    assert found["x"] * 1e6 == pytest.approx([9.67567, 9.67567], rel=1e-6)
