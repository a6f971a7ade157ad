"""Eigenvalues that rounding splits: Jordan blocks in many units, and what analyses say of eigenvalues that coincide."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import bondgraph
from bondgraph.analysis.eigenvalues import bounded_eigenvalues
from bondgraph.analysis.spectrum import spectrum
from bondgraph.errors import RunFailed
from compiler.api import Source, scene_of
from tests.compiling import LIBRARY, MODELS
from tests.second_opinion.scales import POWERS, in_other_units

RING = """model Ring {
  parameter k1 = 100 [N/m], k2 = 100 [N/m], k3 = 100 [N/m], m = 1 kg
  I a, b, c : p = m*v
  1 A, B, C : translation
  0 g1, g2, g3 : translation
  C s1 : F = k1*x
  C s2 : F = k2*x
  C s3 : F = k3*x
  A -> a
  B -> b
  C -> c
  A -> g1 -> B
  B -> g2 -> C
  C -> g3 -> A
  g1 -> s1
  g2 -> s2
  g3 -> s3
}"""


def block(value: complex, size: int, random: np.random.Generator, others: tuple[float, ...]) -> np.ndarray:
    """A Jordan block (of a pair, where the value is not real) beside other eigenvalues, in random directions and units over sixteen decades."""
    cell = np.array([[value.real, value.imag], [-value.imag, value.real]]) if value.imag else np.array([[value.real]])
    inner = np.kron(np.eye(size), cell) + np.kron(np.eye(size, k=1), np.eye(len(cell)))
    n = len(inner) + len(others)
    whole = np.zeros((n, n))
    whole[: len(inner), : len(inner)] = inner
    whole[len(inner) :, len(inner) :] = np.diag(others)
    turned, units = random.standard_normal((n, n)), 10.0 ** random.uniform(-8, 8, n)
    return turned @ whole @ np.linalg.inv(turned) * units / units[:, None]


@pytest.mark.few(12)
@pytest.mark.parametrize("size", [2, 3, 4, 5])
@pytest.mark.parametrize("value", [-1 + 0j, -0.001 + 1j, 0j])
@pytest.mark.parametrize("others", [(), (-3.0, -70.0), (-1.0,)])
def test_a_jordan_block_is_its_mean(size: int, value: complex, others: tuple[float, ...]) -> None:
    """LAPACK has it on a circle of the radius eps^(1/size); the mean is exact to 1e-9 in ten scalings, and the bound holds."""
    for seed in range(10):
        A = block(value, size, np.random.default_rng([seed, size]), others)
        found = bounded_eigenvalues(A)
        exact = np.array([value, value.conjugate(), *others])
        away = np.abs(found.values[:, None] - exact)
        assert (away.min(axis=1) <= found.bounds).all()
        members = np.argsort(away[:, 0])[:size]
        assert away[members, 0].max() < 1e-9 and len(set(found.values[members])) <= 1 + (-1.0 in others)
        assert len(spectrum(A).values) == len(A)
        shape = spectrum(A).shapes[:, members[0]]  # an eigenvector of each row, to the size of its terms
        assert (np.abs(A @ shape - value * shape) <= 1e-5 * (np.abs(A) @ np.abs(shape) + abs(value * shape))).all()


def test_two_eigenvalues_apart_are_not_one() -> None:
    """-1 and -1 - 1e-6 with vectors that nearly coincide keep apart; the bound of each is a small part of that."""
    A = np.array([[-1.0, 1.0], [0.0, -1.0 - 1e-6]])
    turned = np.array([[2.0, 1.0], [1.0, 1.0]])
    found = bounded_eigenvalues(turned @ A @ np.linalg.inv(turned))
    assert sorted(found.values.real) == pytest.approx([-1.0 - 1e-6, -1.0], abs=1e-8) and found.bounds.max() < 1e-7


@pytest.mark.parametrize("powers", [POWERS[0], POWERS[7]])
def test_a_controller_that_cancels_a_pole_has_one_verdict_in_all_units(powers: dict[str, int]) -> None:
    """The pole R/L_d of a winding is cancelled by a controller with the time constant T = L_d/R: -1/T is a defective pair, and one more of the other axis."""
    path = MODELS / "field_oriented.bg"
    scene = scene_of(Source("model", path.read_text("utf-8"), path), LIBRARY, ("FieldOriented", None), None, {})
    text, own = in_other_units(scene.text, powers)
    model = bondgraph.load(text, model=scene.model)
    rates = np.array([m.eigenvalue for m in model.modes()]) / own.of_unit("1/s")
    assert rates == pytest.approx([-5, -1000 / 3, -500, -500, -500], rel=1e-12)
    assert model.equilibrium().stable is True
    with pytest.raises(RunFailed, match="coincides with another"):
        model.sensitivity(("R",), "modes")


@pytest.mark.parametrize("powers", [POWERS[3], POWERS[7]])
def test_a_mechanism_without_losses_is_undamped_in_all_units(powers: dict[str, int]) -> None:
    """Andrews' mechanism: no speed acts on another through joints, so that no rounding is taken for damping or growth."""
    path = MODELS / "published" / "andrews.bg"
    scene = scene_of(Source("model", path.read_text("utf-8"), path), LIBRARY, ("Squeezer", None), None, {})
    text, own = in_other_units(scene.text, powers)
    found = bondgraph.load(text, model=scene.model).equilibrium()
    assert found.stable and found.verdict.undamped == (pytest.approx(424.5617707j * own.of_unit("1/s"), rel=1e-8),)


def test_equal_frequencies_have_a_derivative_only_if_they_share_it() -> None:
    """Three masses in a ring: 3 k/m twice. Both go with 1/m alike; with one spring one goes and one stays, and none is "the second"."""
    model = bondgraph.load(RING)
    eigenvalues = [m.eigenvalue for m in model.modes()]
    assert eigenvalues == [0, 0, pytest.approx(1j * math.sqrt(300)), pytest.approx(1j * math.sqrt(300))]
    found = model.sensitivity(["m"], "modes")
    for name in ("frequency 1", "frequency 2"):
        assert found.of(name, "m") == pytest.approx(-math.sqrt(300) / (4 * math.pi), rel=1e-12)
    with pytest.raises(RunFailed, match="coincides with another"):
        model.sensitivity(["m", "k1"], "modes")


@pytest.mark.parametrize("ratio", [1e3, 1e10, 1e17])
def test_a_slow_oscillator_behind_a_stiff_one_without_losses(ratio: float) -> None:
    """x1' = p1, p1' = x2 - r^2 x1, x2' = p2 - p1, p2' = -x2: w^4 - (r^2 + 2) w^2 + r^2 = 0, and the slow one is 1 1/s but for 1/r^2."""
    A = np.array([[0, 1, 0, 0], [-(ratio**2), 0, 1, 0], [0, -1, 0, 1], [0, 0, -1, 0]], dtype=float)
    rates = np.sort(np.abs(spectrum(A).values))
    product, half = ratio**2, ratio**2 / 2 + 1
    fast = math.sqrt(half + math.sqrt(half**2 - product))
    assert rates == pytest.approx([ratio / fast, ratio / fast, fast, fast], rel=1e-9)


def test_modes_say_what_rounding_hides() -> None:
    """A Jordan block of eight, whose numbers of seventeen digits tell its eigenvalues to some percent: shown by their mean, with a note."""
    A = block(-1 + 0j, 8, np.random.default_rng(3), ())
    rows = ["+".join(f"({x!r})*x{j}" for j, x in enumerate(row.tolist())) for row in A]
    signals = "\n".join(f"signal x{i} = integral({row}, 0)" for i, row in enumerate(rows))
    found = bondgraph.load(f"plain model A {{\n{signals}\noutput y = x0\n}}").modes()
    assert [m.eigenvalue for m in found] == [pytest.approx(-1.0, abs=1e-6)] * 8
    assert re.fullmatch(r"8 eigenvalues are uncertain by rounding: -1\+0j 1/s by 0\.0\d+ 1/s", found.note)
