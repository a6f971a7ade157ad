"""Sizes of states and unknowns at a point, with no size of SI in them: those of one unit share the largest value.

Where all of a unit are zero, or rounding of zero, the smallest parameter of that unit gives their size, else what moves them: how far the others lead within
the time of the fastest mode. So a charge of 0 C beside volts has a size, the same in all units.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from compiler.api import Array, IntArray, Program

from ..numerics.scales import group_numbers, largest_of_group

ROUNDING = 1e-13  # relative to the size that a state would have without a value: less is rounding of zero
RESTING = 1e-8  # relative to the terms in a rate: less is rounding of zero
SPANNED = 1e-9  # of the exponents of a dimension: what others leave of it
ROUNDS = 64  # products with the matrix, whose growth gives its largest eigenvalue, whatever the units


def sizes(program: Program, parameters: Array, state: Array, rates: Array, jacobian: Array) -> Any:
    """Return the sizes (n + m,) of states and unknowns; natural units where nothing tells. `jacobian` (n + m, n + m): of rates (n,) and residuals."""
    units, count = group_numbers(program.variables.units), len(program.states.names)
    values, typical = largest_of_group(np.abs(state), units), of_parameters(program, parameters)
    certain = np.where(typical > 0, np.where(values > ROUNDING * typical, values, typical), 0.0)
    expected = reach(jacobian, certain, count, units)
    sure = np.where(values > ROUNDING * expected, values, expected)
    values = expected if (sure == certain).all() else reach(jacobian, sure, count, units)
    if not (values > 0).all():  # before anything has moved, rates tell how far it will
        slopes = np.abs(jacobian[:count])
        driven = np.where(np.abs(rates) > RESTING * (slopes @ values), np.abs(rates), 0.0) / (
            _fastest(slopes[:, :count]) or math.inf
        )
        started = largest_of_group(np.append(np.nan_to_num(driven), np.zeros(len(values) - count)), units)
        values = reach(jacobian, np.where(values > 0, values, started), count, units)
    return np.where(values > 0, values, natural(program, parameters, program.variables.units))


def natural(program: Program, parameters: Array, units: Sequence[str]) -> Any:
    """Return the natural sizes of a model for some units: powers of base units in which its parameters are, on the whole, numbers about 1. So a flux linkage
    has a size where there are henries and amperes."""
    numbers = [
        (unit, value)
        for unit, value in zip(program.parameters.units, np.abs(parameters).tolist(), strict=True)
        if value > 0
    ]
    if not numbers:
        return np.ones(len(units))
    powers = np.array([_exponents(unit) for unit, _ in numbers])
    exponents = np.array([_exponents(unit) for unit in units]).reshape(-1, powers.shape[1])
    bases, *_ = np.linalg.lstsq(powers, np.log([value for _, value in numbers]), rcond=None)
    # a dimension that parameters do not span has no unit
    spanned = np.linalg.norm(exponents - exponents @ np.linalg.pinv(powers) @ powers, axis=1) < SPANNED
    return np.where(spanned, np.exp(exponents @ bases), 1.0)


@lru_cache(maxsize=1024)
def _exponents(unit: str) -> tuple[float, ...]:
    from compiler.api import Source, read_unit

    return tuple(map(float, read_unit(Source("unit", unit)).dimension.exponents))


def of_parameters(program: Program, parameters: Array) -> Any:
    """Return the smallest parameter of the unit of each state and unknown, (n + m,): 1 for angles, 0 for units without any."""
    least = {"1": 1.0}
    for unit, value in zip(program.parameters.units, np.abs(parameters).tolist(), strict=True):
        if value > 0 and unit != "1":
            least[unit] = min(least.get(unit, math.inf), value)
    return np.array([least.get(unit, 0.0) for unit in program.variables.units])


def reach(jacobian: Array, values: Array, count: int, units: IntArray) -> Any:
    """Return sizes (n + m,) with those that are zero from the others: what these do to a rate within the time of the fastest mode, or to the residual of an
    unknown. The first `count` rows are those of states."""
    if (values > 0).all() or not values.any():
        return values
    slopes = np.abs(np.nan_to_num(jacobian, nan=0.0, posinf=0.0, neginf=0.0))
    own = np.where(np.arange(len(slopes)) < count, _fastest(slopes[:count, :count]), np.diag(slopes))
    for _ in values:
        with np.errstate(all="ignore"):
            further = slopes @ values / own
        further = largest_of_group(np.where((values > 0) | ~np.isfinite(further), values, further), units)
        if (further == values).all():
            break
        values = further
    return values


def _fastest(slopes: Array) -> float:
    """Return the largest eigenvalue of a matrix that is not negative, roughly, in 1/s; 0 if its powers vanish."""
    vector, growth = np.ones(len(slopes)), 0.0
    for _ in range(ROUNDS):
        vector = slopes @ vector
        largest = float(vector.max(initial=0.0))
        if not 0.0 < largest < math.inf:
            return 0.0
        vector, growth = vector / largest, growth + math.log(largest) / ROUNDS
    return math.exp(growth)
