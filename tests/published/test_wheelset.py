"""The wheelset of the test set for IVP solvers: contacts by implicit equations, closed by loads, and creep; published digits after 10 s of hunting.

Mazzia and Magherini, Test Set for IVP Solvers (Bari, 2008), after Simeon, Führer and Rentrop, Surv. Math. Ind. 1 (1991) 1-37: an index-2 problem of
17 equations, solved by DASSL with tolerances of 1e-9.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bondgraph

FILE = Path(__file__).parent / "wheelset.bg"
PUBLISHED = {
    "x": 0.86355386965811e-02, "z": -0.93635784016818e-04, "theta": -0.13642299804033e-01, "phi": 0.15292895005422e-02,
    "mass_x.v": -0.76985374142666e-01, "mass_y.v": -0.25151106429207e-03, "mass_z.v": 0.20541188079539e-02,
    "w_yaw": -0.23904837703692, "w_roll": -0.13633468454173e-01, "beta": -0.24421377661131,
    "psi[1]": -0.33666751972196e-03, "xi[1]": -0.15949425684022, "psi[2]": 0.37839614386969e-03, "xi[2]": 0.14173214964613,
    "load[1]": -56.285630573753, "load[2]": -101.24044903201,
}  # fmt: skip


@pytest.mark.machine_code
def test_published_digits() -> None:
    """Six digits of what each number reaches in the run."""
    run = bondgraph.load(FILE).simulate(rtol=1e-8, outputs=tuple(PUBLISHED))
    for name, value in PUBLISHED.items():
        assert abs(run.final(name) - value) < 1e-6 * np.abs(run[name]).max(), name


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
def test_contacts_stay_closed(target: str) -> None:
    """The loads make the rate of each gap zero; the gap itself, which no equation of the model has, stays what it is at the start."""
    names = ("x", "y", "theta", "phi", "psi[1]", "xi[1]", "psi[2]", "xi[2]", "r[1]", "r[2]", "t[1]", "t[2]")
    run = bondgraph.load(FILE).simulate(to="10 ms", points=6, rtol=1e-9, outputs=names, target=target)
    for i in (1, 2):
        below = run[f"t[{i}]"] - 0.1 - 0.06 * np.cos(0.0262)
        gap = (
            below
            - run["y"]
            - run[f"xi[{i}]"] * np.sin(run["phi"])
            + run[f"r[{i}]"] * np.cos(run["phi"]) * np.cos(run[f"psi[{i}]"])
        )
        assert np.ptp(gap) < 1e-12 and np.ptp(run["theta"]) > 1e-4
