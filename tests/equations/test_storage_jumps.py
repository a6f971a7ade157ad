"""Energies that jump, by their formulas: where and how high is known in closed form."""

from __future__ import annotations

import math

import pytest

import bondgraph
from compiler.equations.errors import EnergyJumps

ONE = "plain model M {{ C x : energy = {}; Sf t : f = 1; t -> x }}"
TWO = "plain model M {{ C x(q, r) : energy = {}; Sf s : f = 1; s -> x.q; Sf t : f = 1; t -> x.r }}"


def jump(energy: str, ports: int) -> tuple[str, float, float] | None:
    """Stored quantity, its value at the jump and the height, as the message says them; None without an error."""
    text = (ONE if ports == 1 else TWO).format(energy)
    told = bondgraph.check(text)
    if not told:
        return None
    (error,) = told
    assert isinstance(error, EnergyJumps), error
    name, _, place = error.place.partition(" = ")
    return name, float(place), float(error.height)


@pytest.mark.parametrize(
    ("energy", "expected"),
    [
        ("atan2(q, -1)", (0.0, 2 * math.pi)), ("atan2(q, 1)", None), ("atan2(q, -1)^2", None), ("atan2(-1, q)", None),
        ("0 if (q - 1)^2 < 0.01 else 1", (0.9, 1.0)), ("0 if (q - 1)^2 < 1e-10 else 1", (1.0, 1.0)), ("0 if (q - 1)^2 + 1 < 0.01 else 1", None),
        ("q^2 if q > 1 else q", None), ("q^2 if q > 3 else 3*q", None), ("q^2 if q > 3 else 2*q", (3.0, 3.0)), ("sign(q)", (0.0, 2.0)), ("abs(q)", None), ("mod(q, 3)*(3 - mod(q, 3))", None), ("7*stairs(q, 3)", (0.0, 21.0)),
        ("2 if q^3 - 6*q^2 + 11*q > 6.1 else 0", (1.054, 2.0)),
    ],
)  # fmt: skip
def test_of_one_port(energy: str, expected: tuple[float, float] | None) -> None:
    found = jump(energy, 1)
    assert (found is None) == (expected is None), found
    if found is not None and expected is not None:
        assert found[1:] == pytest.approx(expected, rel=1e-3, abs=1e-12)


@pytest.mark.parametrize(
    ("energy", "size"),
    [
        ("atan2(r, q)", 2 * math.pi), ("atan2(1 + q^2, r)", None), ("1 if q > 5 and r > 3 else 0", 1.0), ("1 if q > 5 and r < -30 else 0", 1.0),
        ("(norm((q, r)) - 1)^2", None), ("3 if q^2 + r^2 > 1e4 else 0", 3.0), ("q^2 + r^2 if q*r > 7 else q^2 + r^2 + q*r - 7", None),
    ],
)  # fmt: skip
def test_of_two_ports(energy: str, size: float | None) -> None:
    found = jump(energy, 2)
    assert (None if found is None else found[2]) == (None if size is None else pytest.approx(size, rel=1e-3))
