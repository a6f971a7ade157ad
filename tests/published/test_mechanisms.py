"""Published test problems of mechanics, with digits computed again in quadruple precision (the top) or exact ones (the pendulum)."""

from __future__ import annotations

import os

import numpy as np
import pytest

import bondgraph
from bondgraph.compiled_scene import HIDDEN
from tests.compiling import MODELS

TOP = {  # Euler parameters, centre of mass and spins at 0.2 s; by extrapolation in quadruple precision, 26 digits agree
    "e0": "-7.08279152974531312562108796855e-01", "e1": "4.38781088126581897370189638e-01",
    "e2": "5.45728396145417673414642772e-01", "e3": "8.93997528240050104623756681e-02",
    "x": "6.05550561377119770136150239e-01", "y": "5.98957681794919157684825780e-01", "z": "-5.23983027430003184780596595e-01",
    "omega_x": "-2.69159091214340862135129869e+00", "omega_y": "1.5e+02", "omega_z": "4.91726098989399441714576226e+00",
}  # fmt: skip
PENDULUM = {  # by Jacobi's elliptic functions
    5: ("0.9423054350437573354968575", "-0.3347543384140005807887011"),
    10: ("0.2750874625761168600543914", "-0.9614192050991250642651351"),
    100: ("0.1815133514270313845423859", "-0.9833884803340575046827545"),
    2000: ("-0.8146030685890321521217578", "-0.580018827836935461591945"),
}


@pytest.mark.parametrize(("rtol", "bound"), [(1e-11, 1e-11), (1e-8, 1e-7)])
def test_heavy_top(rtol: float, bound: float) -> None:
    """Measured: 3e-12 (of the smallest component) at rtol 1e-11, in some 2900 steps."""
    found = bondgraph.load(MODELS / "published" / "heavy_top_terze.bg").simulate(rtol=rtol)
    errors = [abs(found.final(name) / float(digits) - 1) for name, digits in TOP.items()]
    assert max(errors) <= bound


def test_heavy_top_keeps_what_it_must() -> None:
    """Energy, the angular momentum about the vertical and about its own axis, and the length of the quaternion."""
    found = bondgraph.load(MODELS / "published" / "heavy_top_terze.bg").simulate(rtol=1e-10, energy=True)
    assert found.energy is not None
    assert abs(found.energy.residual) < 1e-8 * 5000
    length = sum(found[f"e{i}"] ** 2 for i in range(4))
    np.testing.assert_allclose(length, 1.0, atol=1e-9)


def test_pendulum() -> None:
    """To 1e-8 after 845 periods; the error is one of time, 1e-13 of each period."""
    # Without machine code the reference gets as far as 10 s in reasonable time.
    end, points = (10, 11) if os.environ.get(HIDDEN) else (2000, 4001)
    model = bondgraph.load(MODELS / "published" / "iftomm_A01_pendulum.bg")
    found = model.simulate(to=end, points=points, rtol=1e-13, atol=3e-14)
    for time, digits in ((t, d) for t, d in PENDULUM.items() if t <= end):
        row = int(np.flatnonzero(found.time == time)[0])
        for name, exact in zip("xy", digits, strict=True):
            assert found[name][row] == pytest.approx(float(exact), rel=1e-8)
