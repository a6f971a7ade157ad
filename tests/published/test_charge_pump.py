"""The charge pump of the test set for IVP solvers: charges of a transistor that follow voltages, index 2; many solvers fail at it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import bondgraph
from bondgraph.errors import RunFailed
from tests.compiling import MODELS, compiled

FILE = MODELS / "published" / "charge_pump.bg"
Y1, Y9 = 0.126280042987675933170893e-12, 0.152255686815577679043511e-3  # published for t = 1200 ns, the others are zero


def test_ten_periods() -> None:
    """All charge comes back; what is on the gate is what its capacitance holds without voltage."""
    assert compiled(FILE).state_space.index == 2
    found = bondgraph.load(FILE).simulate(rtol=1e-6)
    assert found.final("y1") == pytest.approx(Y1, rel=1e-13)
    for name, size in (("y2", 1e-11), ("y3", 1e-11), ("y4", 1e-11), ("y5", 1e-11), ("y6", 20), ("y7", 10), ("y8", 40)):
        assert found.final(name) == pytest.approx(0, abs=1e-4 * size)
    assert found["y2"] + found["y3"] == pytest.approx(0, abs=1e-4 * 1e-11)
    assert found.final("y9") == 0.0  # the voltage has stopped


def test_the_current_while_the_gate_still_falls() -> None:
    """Published for the instant at which the voltage stops; five of its digits hold: by hand C_ox gamma/2 (gamma^2/4 - V_FB)^(-1/2) 2 V/ns."""
    model, end = bondgraph.load(FILE), 120e-9  # periods are alike
    one, two = (model.simulate(to=end - before, points=2, rtol=1e-8).final("y9") for before in (1e-13, 2e-13))
    by_hand = 4e-12 * 0.035 / 2 / np.sqrt(0.035**2 / 4 - (0.2 - 0.035 * np.sqrt(1.01) - 1.01)) * 2e9
    assert 2 * one - two == pytest.approx(by_hand, rel=1e-7)
    assert 2 * one - two == pytest.approx(Y9, rel=1e-5)


def test_the_plateau() -> None:
    """At 20 V the drain is cut off: C_S u = C_ox/3 (20 V - u - V_TE(u)), with V_TE the threshold over a bulk at -u."""
    found = bondgraph.load(FILE).simulate(to=110e-9, points=12, rtol=1e-8)

    def rest(u: float) -> float:
        return 1.6 * u - 4 / 3 * (20 - u - 0.2 - 0.035 * (np.sqrt(1.01 + u) - np.sqrt(1.01)))

    u = brentq(rest, 0, 20, xtol=1e-14)
    assert found["y7"][6:] == pytest.approx(u, rel=1e-6)
    assert found["y8"][6:] == pytest.approx(4 * u, rel=1e-6)


def test_charges_that_no_voltage_gives_back_are_refused() -> None:
    """Below threshold the channel holds nothing, so its charge tells no voltage: as a state it is refused."""
    text = FILE.read_text(encoding="utf-8").replace(
        "max(s.u, d.u))\n  C cs", "max(s.u, d.u)) { prefer = integral }\n  C cs"
    )
    assert "prefer" in text
    with pytest.raises(RunFailed, match=r"`mos\.s\.u`"):
        bondgraph.load(text).simulate(to=110e-9)
