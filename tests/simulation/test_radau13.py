"""Radau IIA of orders 5, 9 and 13: published coefficients, order conditions, convergence, loops, events, both back-ends, and its refusal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import UsageError
from bondgraph.simulation.integrators import radau
from bondgraph.simulation.integrators.steps import radau_coefficients
from bondgraph.simulation.integrators.steps import radau_step as source
from tests.compiling import MODELS
from tests.published.test_stiff_problems import PUBLISHED

NAME = "Radau IIA 5 to 13"


def coefficients(stages: int) -> Sequence[Any]:
    """Return nodes, T, its inverse, eigenvalues (the real one, then pairs), weights of the estimate, and the matrix from stages to dense rows."""
    legendre = np.polynomial.legendre
    radau = np.zeros(stages + 1)
    radau[-2:] = -1.0, 1.0  # P_s - P_(s-1)
    places = np.sort(legendre.legroots(radau))
    for _ in range(3):
        places -= legendre.legval(places, radau) / legendre.legval(places, legendre.legder(radau))
    places[-1] = 1.0
    c = (places + 1) / 2
    basis = legendre.legvander(places, stages - 1)
    whole = np.stack([legendre.legval(places, legendre.legint(row, lbnd=-1)) / 2 for row in np.eye(stages)], axis=1)
    inverse = basis @ np.linalg.inv(whole)
    values, vectors = np.linalg.eig(inverse.T)  # rows of the transformation are left eigenvectors
    order = sorted((k for k in range(stages) if values[k].imag <= 1e-9), key=lambda k: abs(values[k].imag))
    rows = [vectors[:, order[0]].real, *(part for k in order[1:] for part in (vectors[:, k].real, vectors[:, k].imag))]
    forth = np.stack([row / np.abs(row).max() for row in rows[:1]] + rows[1:])
    # An eigenvector has either sign, as it comes from LAPACK; a pair of them shares its: that of the table.
    first = sum(n * n for n in (3, 5, 7) if n < stages)
    table = np.reshape(radau_coefficients.TI[first : first + stages**2], (stages, stages))
    signs = [1.0 if table[k] @ forth[k] > 0 else -1.0 for k in (0, *range(1, stages, 2))]
    forth *= np.array([signs[0], *np.repeat(signs[1:], 2)])[:, None]
    if stages == 3:  # as in the program RADAU5: the end of the step is 1, 1, 0
        real, a, b = np.linalg.inv(forth)[-1]
        forth = np.array([[real, 0, 0], [0, a, b], [0, -b, a]]) @ forth
    start = np.linalg.solve(
        basis.T, legendre.legvander(np.array([-1.0]), stages - 1)[0]
    )  # Lagrange polynomials at the start
    powers = np.stack([c ** (r // 2 + 1) * (1 - c) ** ((r + 1) // 2) for r in range(stages)], axis=1)
    eigenvalues = [values[order[0]].real, *(part for k in order[1:] for part in (values[k].real, values[k].imag))]
    return c, np.linalg.inv(forth), forth, np.array(eigenvalues), -start @ inverse, np.linalg.inv(powers)


@pytest.mark.parametrize(("place", "name"), [*enumerate(("C", "T", "TI", "MU", "E", "WITHIN"))])
def test_the_table_is_what_is_computed(place: int, name: str) -> None:
    computed = np.concatenate([np.ravel(coefficients(stages)[place]) for stages in (3, 5, 7)])
    assert getattr(radau_coefficients, name) == pytest.approx(computed.tolist(), rel=1e-11, abs=1e-12)


@pytest.mark.parametrize(
    ("stages", "published"),
    [
        (5, (6.286704751729276645173, 3.655694325463572258243, 6.543736899360077294021, 5.700953298671789419170, 3.210265600308549888425)),
        (7, (8.936832788405216337302, 4.378693561506806002523, 10.16969328379501162732, 7.141055219187640105775, 6.623045922639275970621,
             8.511834825102945723051, 3.281013624325058830036)),
    ],
)  # fmt: skip
def test_eigenvalues_are_published(stages: int, published: tuple[float, ...]) -> None:
    """Digits of the program RADAU of Hairer and Wanner: the real eigenvalue, then real and imaginary parts of the pairs."""
    mu = np.array(coefficients(stages)[3])
    pairs = sorted((abs(im), re) for re, im in zip(mu[1::2], mu[2::2], strict=True))
    expected = sorted((im, re) for re, im in zip(published[1::2], published[2::2], strict=True))
    assert mu[0] == pytest.approx(published[0], rel=1e-13)
    assert np.array(pairs) == pytest.approx(np.array(expected), rel=1e-12)


def test_three_stages_are_those_of_radau() -> None:
    """Formulas of Hairer and Wanner, and digits of their program RADAU5."""
    c, forth, _, mu, estimate, within = coefficients(3)
    root = 6**0.5
    assert c == pytest.approx(radau.C, rel=1e-15)
    assert estimate == pytest.approx(np.array([-13 - 7 * root, -13 + 7 * root, -1]) / 3, rel=1e-13)
    assert (mu[0], abs(mu[2])) == pytest.approx((radau.MU_REAL, (3 ** (5 / 6) + 3 ** (7 / 6)) / 2), rel=1e-14)
    assert forth[0] == pytest.approx([0.09443876248897524, -0.14125529502095421, 0.03002919410514742], rel=1e-12)
    assert forth[1] == pytest.approx([0.25021312296533332, 0.20412935229379994, -0.38294211275726192], rel=1e-12)
    at = 0.3
    rows = np.array([at, at * (1 - at), at**2 * (1 - at)])
    assert rows @ within == pytest.approx(radau.P @ [at, at**2, at**3], rel=1e-13)


@pytest.mark.parametrize("stages", [3, 5, 7])
def test_conditions_of_order(stages: int) -> None:
    """Stages are exact for polynomials of their number, the end for those of degree 2 s - 2; the transformation gives that matrix."""
    c, forth, back, mu, *_ = coefficients(stages)
    blocks = np.zeros((stages, stages))
    blocks[0, 0] = mu[0]
    for k in range(1, stages, 2):
        blocks[k : k + 2, k : k + 2] = [[mu[k], -mu[k + 1]], [mu[k + 1], mu[k]]]
    matrix = np.linalg.inv(forth @ blocks @ back)
    for power in range(1, stages + 1):
        assert matrix @ c ** (power - 1) == pytest.approx(c**power / power, abs=2e-13)
    for power in range(1, 2 * stages):
        assert matrix[-1] @ c ** (power - 1) == pytest.approx(1 / power, abs=1e-13)


@pytest.mark.parametrize("name", ["van_der_pol", pytest.param("slider_crank", marks=pytest.mark.machine_code)])
def test_tight_tolerances_with_few_evaluations(name: str) -> None:
    """Stiff relaxation, and a closed mechanism: at 1e-10 a third of the evaluations of order 5 or fewer, within 30 tolerances of a tighter run."""
    model = bondgraph.load(MODELS / f"{name}.bg")
    exact = model.simulate(solver="radau", rtol=1e-12)
    fifth, found = (model.simulate(solver=solver, rtol=1e-10) for solver in ("radau", "radau13"))
    assert found.solver.startswith(NAME) and found.evaluations["derivative"] < fifth.evaluations["derivative"] / 3
    for column in found.columns:
        assert np.abs(found[column.name] - exact[column.name]).max() < 3e-9 * np.abs(exact[column.name]).max()


def test_the_order_rises_and_falls(monkeypatch: pytest.MonkeyPatch) -> None:
    """With three stages alone, many times the steps."""
    model = bondgraph.load(MODELS / "van_der_pol.bg")
    steps = model.simulate(solver="radau13", rtol=1e-10, target="numpy").steps
    monkeypatch.setattr(source, "STAGES", (3,) * len(source.STAGES))
    assert model.simulate(solver="radau13", rtol=1e-10, target="numpy").steps > 8 * steps


@pytest.mark.machine_code
def test_both_back_ends() -> None:
    model = bondgraph.load(MODELS / "van_der_pol.bg")
    native, numpy = (model.simulate(solver="radau13", target=target) for target in ("native", "numpy"))
    assert (native.solver, numpy.solver) == (f"{NAME}, native", f"{NAME}, numpy")
    assert abs(native.steps - numpy.steps) <= 2
    for column in native.columns:
        largest = np.abs(native[column.name]).max()
        assert np.abs(native[column.name] - numpy[column.name]).max() < 1e-5 * largest


@pytest.mark.few(4)
@pytest.mark.parametrize("rtol", [1e-6, 1e-10])
@pytest.mark.parametrize("name", ["vdpol_mu1000", "robertson", "hires", "transistor_amplifier"])
def test_published_digits(name: str, rtol: float) -> None:
    """The amplifier has the unknowns of an algebraic loop."""
    exact = np.array([float(x) for x in PUBLISHED[name]])
    found = bondgraph.load(MODELS / "published" / f"{name}.bg").simulate(rtol=rtol, solver="radau13")
    values = np.array([found.final(f"y{i + 1}") for i in range(len(exact))])
    assert found.solver.startswith(NAME)
    assert np.abs(values / exact - 1).max() < 30 * max(rtol, 1e-11)


def test_events_are_located_within_long_steps() -> None:
    """A motion whose velocity is reversed each time it comes back to the ground: closed form of the bounces."""
    text = (
        "plain model Ball { signal v = integral(-1, 1), x = integral(v, 0); when x < 0 { v = 0.5*1.0 }; output y = x }"
    )
    found = bondgraph.load(text).simulate(to=2.5, points=6, solver="radau13", rtol=1e-10)
    assert [event.time for event in found.events][:1] == pytest.approx([2.0], rel=1e-10)
    assert found["y"][-1] == pytest.approx(0.5 * 0.5 - 0.5 * 0.25, rel=1e-9)


def test_a_model_whose_factors_are_sparse_is_refused() -> None:
    cells = "plain model Cells { parameter n = 120; Se source : e = sin(time); 0 node[0]; source -> node[0]\n for i in 1..n { 0 node[i]; R r[i] : e = 0.1*f; C c[i] : q = 0.1*e; R l[i] : f = e + e^3; node[i-1] -> 1(r[i]) -> node[i] -> c[i], l[i] }\n output u = c[1].e }"  # fmt: skip
    with pytest.raises(UsageError, match=r"up to about 100 states.*name `radau`"):
        bondgraph.load(cells).simulate(to=0.5, solver="radau13")
