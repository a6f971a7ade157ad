"""Equations for people: of nonlinear loops and implicit laws, against the program that a run computes with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sympy

import bondgraph

RECTIFIER = Path(__file__).parent.parent / "golden" / "rectifier.bg"


def test_state_and_algebraic_equations_are_those_of_the_program() -> None:
    """x' and the residuals, at points that are no solution: both sides are functions of states and unknowns."""
    model = bondgraph.load(RECTIFIER)
    rates, rests = model.state_equations(), model.algebraic_equations()
    assert (list(rates), set(rests)) == (["store.q"], {"store.u", "series.u"})
    program = model.compilation(everything=True).program
    constants, inputs = program.constants(np.array(program.defaults)), np.array(program.input_defaults)
    names = (*program.states.names, *program.unknowns.names)
    assert names[0] == "store.q" and set(names[1:]) == set(rests)
    for time, values in ((0.001, (1e-4, 0.9, 0.1)), (0.013, (-2e-4, -1.5, 0.02))):
        x = np.array([dict(zip(("store.q", "store.u", "series.u"), values, strict=True))[n] for n in names])
        expected = program.derivative(time, x, inputs, constants, program.mode_at(time, x, inputs, constants))
        known = dict(zip(names, x, strict=True)) | {"time": time} | {n: p.value for n, p in model.parameters.items()}
        put = {s: known[s.name] for e in (*rates.values(), *rests.values()) for s in e.free_symbols}
        found = [float((rates | rests)[n].subs(put)) for n in names]
        assert found == pytest.approx(expected.tolist(), rel=1e-12)


def test_a_model_without_nonlinear_loops_has_no_algebraic_equations() -> None:
    text = "model A {\n  Se s : u = 6 V\n  R r : u = 2 ohm*i\n  R t : u = 3 ohm*i\n  C c : u = q/4 F\n  R w : u = 5 ohm*i\n  0 k\n  s -> 1(r) -> k -> t\n  k -> 1(w, c)\n}\n"
    model = bondgraph.load(text)
    assert model.algebraic_equations() == {}
    q = sympy.Symbol("c.q", real=True)
    # The node's voltage divides 6 V over 2, 3 and 5 ohm: k (1/2 + 1/3 + 1/5) = 6/2 + (q/4)/5.
    for charge in (0.0, 1.0, -7.0):
        k = (3 + charge / 20) / (31 / 30)
        found = float(model.state_equations()["c.q"].subs({q: charge}))
        assert found == pytest.approx((k - charge / 4) / 5, rel=1e-14)


def test_texts_say_what_vanishes_and_for_what_it_is_solved() -> None:
    model = bondgraph.load(RECTIFIER)
    lines = model.equations().splitlines()
    residuals = [line for line in lines if line.startswith("0 = ")]
    assert len(residuals) == 2 and not any("residual" in line for line in lines)
    assert any("solved for series.u, loop of" in r and "diode" in r for r in residuals)
    assert any("solved for store.u, loop of store" in r and "store.u**3" in r for r in residuals)
    latex = model.equations(latex=True)
    assert latex.count("0 &= ") == 2 and r"\text{solved for } \mathrm{store.u}" in latex
    assert "0 = store.q" in model.show("equations") and "store, solved for store.u" in model.show("equations")
