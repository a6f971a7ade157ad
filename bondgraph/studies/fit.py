"""Parameter estimation from measured data: weighted least squares with generated derivatives, and the uncertainty of the result.

`scipy.optimize.least_squares` (trust region, bounds) in coordinates of size 1: a parameter over its scale, or its logarithm. With given sigmas the
covariance is (J'J)^-1 and intervals are normal; where the scatter is larger than sigmas allow, or none are given, it is multiplied by the scatter
found, and intervals are Student's (Seber and Wild, Nonlinear Regression, 1989, section 5.1).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from compiler.api import Array, BoundedParameter

from ..analysed_model import AnalysedModel
from ..errors import RunFailed, UsageError
from ..quantities import quantity
from ..simulation.settings import Settings
from .fit_problem import Problem, sought
from .fitted import Fit, Fitted
from .identify import OPEN, SearchEnd, directions, explanations, uncertainty
from .measured import Measurements, read_measured
from .scalar_study import quantities_of

TOLERANCE = 1e-9  # relative tolerance of steps, of the sum of squares, and of its gradient at the start
MOST_STEPS = 100
NEAREST = 1e-6  # relative to the largest singular value: regularisation towards the start in undetermined directions
MOST_PARAMETERS = 100
SAME = 1e-7  # relative to the residuals and their derivatives: difference of two programs that agree


def fit(
    model: AnalysedModel, files: Sequence[str | os.PathLike[str] | Measurements], given: Mapping[str, str | BoundedParameter], experiment: str | None,
    settings: Settings, explain: bool | None = None,
) -> Fit:  # fmt: skip
    """Return the parameters that fit the data best.

    `explain`: examine small sets of parameters too (None: if the data leave parameters undetermined). Raises `UsageError`, `CompilationFailed`,
    `RunFailed`, OSError.
    """
    if not given or len(given) > MOST_PARAMETERS:
        raise UsageError("BR407", f"name the parameters to fit, from one to {MOST_PARAMETERS}")
    quantities = quantities_of(model, given, experiment, settings)
    starts = {n: quantity(v, quantities[n].kind, n) for n, v in settings.items() if n in given}
    wanted = [sought(s, quantities[n].kind, n) if isinstance(s, str) else s for n, s in given.items()]
    wanted = [replace(s, start=starts.get(s.name, s.start)) for s in wanted]
    left = {n: v for n, v in settings.items() if n not in given}
    data = _data(model, files, experiment, left, frozenset(given))
    problem = Problem(model, data, wanted, experiment, left)
    found = _checked(problem, solve(problem))
    sure = uncertainty(problem, found)
    told = directions(problem, found)
    open_ = any(d.open for d in told)
    subsets = explanations(problem, solve) if (explain if explain is not None else open_) else ()
    values = problem.values(found.coordinates)
    fitted = tuple(
        Fitted(n, quantities[n].unit, float(problem.start[i]), float(values[i]), *sure.of(i))
        for i, n in enumerate(problem.names)
    )
    compilation = model.compilation(model.scene(experiment, left))
    return Fit(
        compilation.whole_graph.name, compilation.plan.experiment, fitted, sure.correlations, problem.series, tuple(problem.computed(found.coordinates)),
        found.squares, found.count - len(fitted), problem.weighted, sure.scatter, told, subsets, (*sure.notes, *_notes(found, problem)),
    )  # fmt: skip


def _checked(problem: Problem, found: SearchEnd) -> SearchEnd:
    """Check the result of a program made with the author's values against programs with the values compiled in.

    If they differ, the values decide more than numbers, and the search is repeated with a program for each value.
    """
    quick = found.residuals
    problem.compile_in()
    honest = problem.residuals(found.coordinates)
    size = float(np.abs(quick).max(initial=0.0)) + float(np.abs(found.slopes).max(initial=0.0))
    if np.isfinite(honest).all() and np.abs(honest - quick).max(initial=0.0) <= SAME * size:
        problem.compiled_in = False
        return found
    return solve(problem)


def solve(problem: Problem, free: Sequence[int] | None = None, most: int = MOST_STEPS) -> SearchEnd:
    """Minimise the sum of squares; among equal minima one that is reached first from the start. Only the parameters `free` change (None: all).

    Raises `RunFailed` if the model fails at the start.
    """
    from scipy.optimize import least_squares

    start = problem.coordinates(problem.start)
    places = np.arange(len(start)) if free is None else np.array(free)
    low, high = problem.bounds

    def whole(x: Array) -> Array:
        found = start.copy()
        found[places] = x
        return found

    first = problem.residuals(start)
    if not np.isfinite(first).all():
        raise RunFailed("BR408", f"where the search begins the model has no answer: {problem.failure}")
    inside = np.clip(start[places], low[places], high[places])
    sizes = np.linalg.svd(problem.slopes(start)[:, places], compute_uv=False)
    is_open = len(sizes) < len(places) or not sizes[-1] > OPEN * sizes[0]
    pull = NEAREST * float(sizes.max(initial=0.0)) * np.eye(len(places)) if is_open else np.zeros((0, len(places)))
    settled = max(TOLERANCE * float(np.abs(problem.slopes(start)[:, places].T @ first).max()), 1e-15)
    done: Any = least_squares(
        lambda x: np.concatenate([problem.residuals(whole(x)), pull @ (x - inside)]), inside,
        jac=lambda x: np.concatenate([problem.slopes(whole(x))[:, places], pull]), bounds=(low[places], high[places]),
        xtol=TOLERANCE, ftol=TOLERANCE, gtol=settled, max_nfev=most,
    )  # fmt: skip
    at = whole(done.x)
    return SearchEnd(
        at, problem.residuals(at), problem.slopes(at), bool(done.status > 0), places[done.active_mask != 0], is_open
    )


def _data(
    model: AnalysedModel, files: Sequence[str | os.PathLike[str] | Measurements], experiment: str | None, settings: Settings, taken: frozenset[str]
) -> list[Measurements]:  # fmt: skip
    if not files:
        raise UsageError("BR409", "there are no data:", "name a file")
    graph = model.compilation(model.scene(experiment, settings)).whole_graph
    settable = frozenset(n for n, q in graph.quantities.items() if q.role in ("parameter", "input"))
    space = model.compilation(model.scene(experiment, settings), everything=True).state_space
    units = {v.name: v.unit for v in space.variables} | {n: space.variables[v].unit for n, v in space.outputs.items()}
    units |= {n: q.kind for n, q in {**graph.quantities, **graph.outputs}.items()}
    data = [f if isinstance(f, Measurements) else read_measured(f, units, settable) for f in files]
    for one in data:
        both = sorted(taken & set(one.settings))
        if both:
            raise UsageError("BR410", f"{one.file}: `{both[0]}` is fitted, and set line by line:", "one of the two")
    return data


def _notes(found: SearchEnd, problem: Problem) -> list[str]:
    notes = []
    if problem.following:
        names = ", ".join(f"`{n}`" for n in problem.following)
        notes.append(f"{names} follows from others in the model; here it is taken by itself, and stays when these move")
    if not found.ended:
        notes.append(f"the search did not settle within {MOST_STEPS} steps: the values are not the best ones yet")
    if found.open:
        notes.append(
            "the data leave parameters open: other values meet them as well as these, which the search reached first"
        )
    if len(found.held):
        names = ", ".join(f"`{problem.names[i]}`" for i in found.held)
        notes.append(f"{names} ended on a bound: intervals there say little")
    return notes
