"""Functions of the source that Python calls, by name. A run whose machine code is cached does not import them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..acceptance.crossing_search import narrow, survey
from ..acceptance.event_indicators import decide, doubt, evaluate, keep, look_ahead, reread
from ..acceptance.zero_crossings import roots_along, states_along
from ..dense_output.dense_output import scaled_along
from ..linear_algebra.balancing import balance
from ..linear_algebra.eliminations import plan_eliminations, put_rows
from ..linear_algebra.least_degree import least_degree
from ..linear_algebra.sparse import real_factors
from ..loop_newton import holds, measured_loops, solve_rows
from ..methods import EXPLICIT, EXPONENTIAL, SHARED
from ..pilot.loop import coarse, pilot_step
from ..pilot.step import euler
from ..projection.projection import least_singular_values, project_all, rates_projected
from .advance import STEPS, advance, advance_through, begin, begin_segment
from .each_record import each_record

SOURCES: dict[str, Callable[..., Any]] = {
    function.__name__: function
    for function in (
        begin, begin_segment, advance, advance_through, euler, coarse, pilot_step, roots_along, states_along, scaled_along, evaluate, doubt,
        look_ahead, decide, keep, reread, survey, narrow, least_singular_values, project_all, rates_projected, balance, real_factors, least_degree,
        plan_eliminations, put_rows, holds, measured_loops, solve_rows, each_record,
    )
}  # fmt: skip
SOURCES |= {step.__name__: step for step in STEPS}
# Functions that modules call in another one: the steps that are long, and what all of them need of the first module.
APART = frozenset({*STEPS, *(SOURCES[name] for name in SHARED)} - {STEPS[EXPLICIT], STEPS[EXPONENTIAL]})
# Files with loops over all states in each step. LLVM takes as long for the vectors of a loop as for the rest of it; elsewhere runs are no faster by them.
VECTORS = frozenset((
    "evaluation", "explicit_step", "rodas_step", "sparse", "factors", "norms", "step_control", "dop853_dense", "trial_interpolant",
))  # fmt: skip
