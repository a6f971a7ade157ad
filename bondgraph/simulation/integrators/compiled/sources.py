"""Functions of the source that Python calls, by name. A run whose machine code is cached does not import them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..acceptance.zero_crossings import roots_along, states_along
from ..dense_output.dense_output import scaled_along
from ..linear_algebra.balancing import balance
from ..linear_algebra.eliminations import plan_eliminations, put_rows
from ..linear_algebra.least_degree import least_degree
from ..linear_algebra.sparse import real_factors
from ..pilot.loop import coarse, last_step
from ..pilot.step import euler
from ..projection.projection import least_singular_values, project_all, rates_projected
from .advance import advance, begin

SOURCES: dict[str, Callable[..., Any]] = {
    function.__name__: function
    for function in (
        begin, advance, euler, coarse, last_step, roots_along, states_along, scaled_along, least_singular_values, project_all, rates_projected,
        balance, real_factors, least_degree, plan_eliminations, put_rows,
    )
}  # fmt: skip
