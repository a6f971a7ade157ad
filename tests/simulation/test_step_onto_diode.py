"""A step of many volts onto a diode: at its full voltage it would take 1e80 A, by which nothing is measured. Right by the closed form, or refused."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph import RunFailed

pytestmark = pytest.mark.machine_code
TEXT = """model A {
  parameter C = 1 nF, I_s = 1e-12 A, U_t = 25 mV, U = 5 V, t_0 = 0 s
  Se supply  : u = U*step(time - t_0)
  C store    : u = q/C
  R diode    : i = I_s*(exp(u/U_t) - 1)
  supply -> 1(store) -> diode
  output u = store.u
}
"""


def charged(t: np.ndarray, volts: float, I_s: float, C: float, U_t: float) -> np.ndarray:
    """Voltage of the capacitor: exp(-v/U_t) - 1 of the diode decays with U_t C/I_s."""
    decayed = np.exp(-I_s * t / (C * U_t))
    return np.asarray(volts + U_t * np.log(-np.expm1(-I_s * t / (C * U_t)) + np.exp(-volts / U_t) * decayed))


@pytest.mark.parametrize("solver", [None, "radau13", "rodas"])
@pytest.mark.parametrize("start", [0.0, 1e-6, 1e-3])
@pytest.mark.parametrize("volts", [0.8, 1.5, 3.0, 5.0, 15.0])
def test_right_or_refused(volts: float, start: float, solver: str | None) -> None:
    """120 V, and 1e23 V, were the results of 5 V and 15 V, with a warning that the magnitude is not known."""
    end, options = (20e-6 if start < 1e-4 else 1.0), ({} if solver is None else {"solver": solver})
    try:
        found = bondgraph.load(TEXT).simulate(settings={"U": volts, "t_0": start}, to=end, points=21, **options)  # type: ignore[arg-type]
    except RunFailed as failure:
        assert volts > 1
        assert "could not be solved" in str(failure) or "hold rtol" in str(failure)
        return
    after = found.time > start * (1 + 1e-6)
    assert found["u"][after] == pytest.approx(
        charged(found.time[after] - start, volts, 1e-12, 1e-9, 0.025), abs=1e-4 * volts
    )


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1e6])
def test_in_other_units(size: float) -> None:
    settings = {"U": 5 * size, "U_t": 0.025 * size, "C": 1e-9 / size**2, "I_s": 1e-12 / size}
    found = bondgraph.load(TEXT).simulate(settings=settings, to=20e-6, points=21)
    wanted = charged(found.time[1:], 5 * size, 1e-12 / size, 1e-9 / size**2, 0.025 * size)
    assert found["u"][1:] == pytest.approx(wanted, rel=1e-5)
