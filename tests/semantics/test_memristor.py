"""A memristor: a resistor whose law reads the charge or the flux that has passed through it (Chua 1971; Oster and Auslander 1972)."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from compiler.unparse import write_text
from tests.compiling import compiled, mistakes

CHARGE = """model Cell {
  parameter R_0 = 2 ohm, a = 3 [ohm/C]
  Se drive : u = 5 V
  Mem cell : u = (R_0 + a*q)*i { start q = 0.5 C }
  drive -> cell
  output q = cell.q, i = cell.i, heat = cell.u*cell.i
}"""
FLUX = """model Cell {
  Sf drive : i = 5 [A]
  Mem cell : i = (2 [1/ohm] + 3 [1/(ohm*V*s)]*p)*u
  drive -> cell
  output p = cell.p, u = cell.u
}"""
LOOP = """model Loop {
  Mem cell : u = (1 ohm + 2 [ohm/C^2]*q^2)*i
  C   store : u = q/0.5 [F] { start q = 1 C }
  I   coil : lambda = 0.3 [V*s/A]*i
  1 loop
  loop -> cell, store, coil
  output q = cell.q, i = coil.i, stored = store.q
}"""


def after(t: np.ndarray, q: float = 0.0) -> np.ndarray:
    """Solution of (2 + 3 x) x' = 5 from x = q: a parabola."""
    return (-2 + np.sqrt(4 + 6 * (5 * t + 2 * q + 1.5 * q * q))) / 3


def test_controlled_by_charge() -> None:
    found = bondgraph.load(CHARGE).simulate(to="2 s", rtol=1e-9, energy=True)
    q = after(found.time, 0.5)
    np.testing.assert_allclose(found["q"], q, rtol=1e-8)
    np.testing.assert_allclose(found["heat"], 25 / (2 + 3 * q), rtol=1e-8)
    assert found.energy is not None
    assert found.energy.dissipated == pytest.approx(5 * (q[-1] - 0.5), rel=1e-8)  # all that the source of 5 V supplies


def test_controlled_by_flux() -> None:
    found = bondgraph.load(FLUX).simulate(to="2 s", rtol=1e-9)
    np.testing.assert_allclose(found["p"], after(found.time), rtol=1e-8)
    np.testing.assert_allclose(found["u"], 5 / (2 + 3 * after(found.time)), rtol=1e-8)


def test_in_a_loop_against_scipy() -> None:
    from scipy.integrate import solve_ivp

    def rates(t: float, x: np.ndarray) -> list[float]:
        q, s, i = x
        return [i, i, (-s / 0.5 - (1 + 2 * q * q) * i) / 0.3]

    found = bondgraph.load(LOOP).simulate(to="3 s", rtol=1e-9)
    expected = solve_ivp(rates, (0, 3), [0.0, 1.0, 0.0], method="DOP853", t_eval=found.time, rtol=1e-12, atol=1e-14).y
    for name, values in zip(("q", "stored", "i"), expected, strict=True):
        np.testing.assert_allclose(found[name], values, atol=1e-7)


def test_written_and_read_again() -> None:
    """As a modulated resistor that reads an integral."""
    again = bondgraph.load(write_text(compiled(CHARGE).whole_graph))
    assert again.simulate(to="1 s", rtol=1e-9).final("q") == pytest.approx(float(after(np.array(1.0), 0.5)), rel=1e-8)


def test_an_experiment_starts_it() -> None:
    text = CHARGE.removesuffix("}") + "experiment charged { start cell.q = 0.2 C; simulate 0 .. 1 s }\n}"
    found = bondgraph.load(text).simulate("charged", rtol=1e-9)
    assert found.final("q") == pytest.approx(float(after(np.array(1.0), 0.2)), rel=1e-7)


def test_in_a_graph_built_in_python() -> None:
    graph = bondgraph.Graph("Cell")
    drive, cell = graph.Se("drive", "u = 5 V"), graph.element("Mem", "cell", "u = (2 ohm + 3 [ohm/C]*q)*i")
    graph.bond(drive, cell)
    graph.output("q", "cell.q")
    assert graph.model().simulate(to="1 s", rtol=1e-9).final("q") == pytest.approx(
        float(after(np.array(1.0))), rel=1e-8
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("(R_0 + a*q)", "R_0"), "neither its displacement nor its momentum"),
        (("+ a*q", "+ a*q*time/1 s"), "reads `time`"),
        (("cell.q", "cell.lambda"), "lambda"),
        (("a = 3 [ohm/C]", "a = 3 ohm"), "cannot be added"),
    ],
)
def test_refused(change: tuple[str, str], words: str) -> None:
    found = [str(d.sentence) if hasattr(d, "sentence") else str(d) for d in mistakes(CHARGE.replace(*change))]
    assert any(words in text for text in found), found
