"""`equilibrium` before `simulate`: the run starts where all rates vanish."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import bondgraph
from bondgraph.analysis.operating_point import OperatingPoint
from bondgraph.errors import RunFailed
from bondgraph.simulation.equilibrium import search
from bondgraph.simulation.equilibrium.sparse import SparseSearch
from tests.compiling import ROOT

EULER = SparseSearch.euler


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


def test_rates_that_are_no_numbers_are_told_by_name() -> None:
    """At the start of the search a law divides by zero: numpy's own error was not caught."""
    text = "model A {\n  parameter m = 1 kg\n  I mass : p = m*v\n  I load : p = 1 kg*v\n  R drag : F = 2 [N*s/m]*(1 kg/m)*v\n  C rope : F = 5 [N/m]*x\n  1 a, b\n  0 ab\n  a -> mass, drag\n  a -> ab -> b\n  ab -> rope\n  b -> load\n  output v = mass.p*rope.x/m\n}\n"
    with pytest.raises((RunFailed, bondgraph.CompilationFailed), match=r"`drag\.v` has no finite slope"):
        bondgraph.load(text).modes(settings={"m": 0})


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
    assert found.steps < 10  # nothing moves: rounding is no magnitude


class TestLargeModels:
    """More than a hundred states: the same search by sparse factors, with conserved quantities and states without a restoring effect."""

    @staticmethod
    def by_both(text: str, monkeypatch: pytest.MonkeyPatch) -> tuple[OperatingPoint, OperatingPoint]:
        """By sparse factors and by dense ones, at least one of them as named."""
        ways: list[str] = []
        monkeypatch.setattr(SparseSearch, "euler", lambda self, *x: ways.append("sparse") or EULER(self, *x))
        sparse = bondgraph.load(text).operating_point()
        assert ways
        monkeypatch.setattr(search, "is_large", lambda states, entries: False)
        ways.clear()
        dense = bondgraph.load(text).operating_point()
        assert not ways
        return sparse, dense

    def test_charges_that_have_no_way_out(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """n capacitors of j uF at j V, joined by lines: all come to sum(j^2)/sum(j) V, and no current is left."""
        text = """
        model Charges {
          parameter n = 60
          for j in 1..n {
            0 node[j] : electric
            C cap[j] : u = q/(1 [uF]*j) { start u = 1 V*j }
            node[j] -> cap[j]
          }
          for j in 2..n {
            1 line[j] : electric
            R res[j] : u = 10 [ohm]*i
            I coil[j] : lambda = 1 [mH]*i
            node[j-1] -> line[j] -> node[j]
            line[j] -> res[j], coil[j]
          }
        }"""
        sparse, dense = self.by_both(text, monkeypatch)
        n = 60
        wanted = (2 * n + 1) / 3 * 1e-6 * np.arange(1, n + 1)
        for point in (sparse, dense):
            values = dict(zip(point.program.states.names, point.state, strict=False))
            charges = np.array([values[f"cap[{j}].q"] for j in range(1, n + 1)])
            assert charges == pytest.approx(wanted, rel=1e-9)
            assert max(abs(values[f"coil[{j}].lambda"]) for j in range(2, n + 1)) < 1e-12

    def test_a_train_that_nothing_holds(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Carriages with hardening couplings, pressed together: it settles where it is, its momentum of zero kept."""
        text = """
        model Train {
          parameter n = 60
          for i in 1..n { 1 body[i];  I mass[i] : p = 1 kg*v;  body[i] -> mass[i] }
          for i in 2..n {
            C spring[i] : F = 100 [N/m]*x + 1e5 [N/m^3]*x^3 { start x = 1 mm*i }
            R damper[i] : F = 30 [N*s/m]*v
            0 gap[i] : translation
            1 link[i]
            body[i-1] -> gap[i] -> body[i]
            gap[i] -> link[i] -> spring[i], damper[i]
          }
        }"""
        sparse, dense = self.by_both(text, monkeypatch)
        for point in (sparse, dense):
            assert point.state == pytest.approx(np.zeros(point.count), abs=1e-9)

    def test_what_is_driven_for_ever_has_no_rest(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """At any distance: the force of its springs is not rounding of that."""
        monkeypatch.setattr(search, "STEPS", 80)
        text = """
        model Pushed {
          parameter n = 51
          Se push : F = 1 N
          push -> body[1]
          for i in 1..n { 1 body[i];  I mass[i] : p = 1 kg*v;  body[i] -> mass[i] }
          for i in 2..n { C spring[i] : F = 100 [N/m]*x;  0 gap[i] : translation;  body[i-1] -> gap[i] -> body[i];  gap[i] -> spring[i] }
        }"""
        with pytest.raises(RunFailed, match="no equilibrium was found"):
            bondgraph.load(text).operating_point()

    @pytest.mark.machine_code
    def test_unknowns_of_loops_follow(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Capacitors behind a resistor and a diode in line, each with a load: in the end all current goes through the load."""
        text = """
        model Loads {
          parameter n = 3, m = 35
          Se source : u = 5 V
          for j in 1..n {
            R across[j] : u = 1 [kohm]*i
            R diode[j]  : i = 1 [uA]*(exp(u/0.2 [V]) - 1)
            R load[j]   : u = 2 [kohm]*i
            0 node[j, 0] : electric
            1 way[j]
            source[j] -> way[j] -> node[j, 0]
            way[j] -> across[j], diode[j]
            node[j, 0] -> load[j]
          }
        }"""
        text = text.replace("Se source : u = 5 V", "").replace(
            "R across[j]", "Se source[j] : u = 5 V\n            R across[j]"
        )
        inner = """
          for j in 1..n { for k in 0..m {
            C cap[j, k] : u = q/(1 [uF])
          } }
          for j in 1..n { node[j, 0] -> cap[j, 0] }
          for j in 1..n { for k in 1..m {
            0 node[j, k] : electric
            1 line[j, k] : electric
            R wire[j, k] : u = 10 [ohm]*i
            node[j, k-1] -> line[j, k] -> node[j, k] -> cap[j, k]
            line[j, k] -> wire[j, k]
          } }
        }"""
        text = text.rstrip().removesuffix("}") + inner
        sparse, dense = self.by_both(text, monkeypatch)
        assert sparse.all > sparse.count > 100
        for point in (sparse, dense):
            u = point.state[: point.count] / 1e-6
            i = u / 2e3
            assert 5 - 1e3 * i - 0.2 * np.log(1 + i / 1e-6) == pytest.approx(u, rel=1e-9)
