"""Monte Carlo study: effect of the tolerances of parameters on a model's equilibrium, frequencies or runs.

Points: the sample; for Sobol indices the additional points, of which the first are the sample's own; for the tornado each parameter at two
quantiles, the others at their medians. All points are shared among the workers together.

Points of Sobol's sequence, scrambled by a seed (Owen; `scipy.stats.qmc`), fill the unit cube evenly: means converge nearly as 1/n instead of
1/sqrt(n). Correlations are those of a Gaussian copula: of the normal variables with the same quantiles as the values (Nelsen, An Introduction to
Copulas, 2006, section 2.3), so that each parameter keeps its own distribution.

Distributions come from texts such as `normal(1.95 um, 50 nm)`, `truncated(normal(…), 1.8 um, 2.1 um)`. The quantile function of each (inverse of the
distribution function) converts quasi-random points in the unit cube, and correlations by a Gaussian copula, into values.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import DISTRIBUTIONS, SPREAD, Array, Distribution, MonteCarloRequest, fault, kinds_told

from ..errors import RunFailed, UsageError
from ..quantities import quantity, unit_written
from ..simulation.run_options import DEFAULT_RTOL, check_run_options
from ..simulation.settings import Settings
from .scalar_study import Failed, ScalarStudy, check_steps, compilation_notes, quantities_of
from .tolerances import Indices, MonteCarlo, Swing, indices, mixed
from .workers import Workers, answers

if TYPE_CHECKING:
    from compiler.api import StateSpace

    from ..analysed_model import AnalysedModel

MOST_INDICES = 1024  # most rows for Sobol indices by default
TAILS = 0.1, 0.9  # quantiles of a parameter in the tornado
MOST_SAMPLES = 10_000_000
MOST_NAMES = 1000
IMPOSSIBLE = -1e-10  # an eigenvalue below it is more than rounding
EDGE = 2.0**-53  # distance from the edge of the cube, where an unbounded distribution has no value
_CALL = re.compile(r"\s*([a-z]+)\s*\((.*)\)\s*", re.DOTALL)


def montecarlo(model: AnalysedModel, chance: MonteCarloRequest, study: ScalarStudy, workers: Workers) -> MonteCarlo:
    """Run the study. Raises `UsageError`, `CompilationFailed`, and `RunFailed` if no point of the sample has a result."""
    check_steps(study.of, "a study with chance")
    check_run_options(study.run.options)
    _check(chance, study.run.settings)
    names = tuple(name for name, _ in chance.vary)
    drawn = quantities_of(model, dict(chance.vary), study.run.experiment, study.run.settings)
    units = {n: q.unit for n, q in drawn.items()}
    given = [distribution(d, drawn[n].kind, n) if isinstance(d, str) else checked(d, n) for n, d in chance.vary]
    correlation = correlation_matrix(names, dict(chance.correlations))
    rows = 0 if correlation is not None else _rows(chance)
    shares = cube(chance.samples, 2 * len(names) if rows else len(names), chance.seed)
    sample = values_of(shares[:, : len(names)], given, correlation)
    parts = [sample]
    if rows:
        other = values_of(shares[:rows, len(names) :], given, None)
        parts += [other, mixed(sample[:rows], other)]
    parts.append(_tornado_points(given))
    points = [dict(zip(names, map(float, row), strict=True)) for part in parts for row in part]
    found = answers(model, study, points, workers)
    quantities = tuple(dict.fromkeys(n for x in found if not isinstance(x, Failed) for n in x))
    bounds = np.cumsum([len(p) for p in parts])[:-1]
    failures = {i: x.why for i, x in enumerate(found[: len(sample)]) if isinstance(x, Failed)}
    if len(failures) == len(sample):
        raise RunFailed("BR437", f"not one of {len(sample)} points has an answer; the first: {failures[0]}")
    tables = np.split(_table(found, quantities), bounds)
    told: Indices | None = None
    notes = [*_notes(tables[0], quantities, failures), *compilation_notes(model, study.run, points)]
    if rows:
        told, lost = indices(tables[0][:rows], tables[1], tables[2], chance.seed, _noise(study, quantities))
        notes += [*_index_notes(told, lost, rows), *_vague_notes(told, names, quantities)]
    elif correlation is not None:
        notes.append(
            "the parameters are correlated: no share of a variance is one's own, so there are no Sobol indices"
        )
    compilation = study.run.compilation(model)
    return MonteCarlo(
        compilation.whole_graph.name, compilation.plan.experiment, study.of, chance.seed, {n: _text(d) for n, d in zip(names, given, strict=True)},
        dict(chance.correlations), _units(compilation.state_space, units, quantities), names, quantities, sample,
        tables[0], failures, told, _swing(tables[-1], len(names)), tuple(notes),
        {r.name: (r.unit, r.scale, r.offset) for r in compilation.plan.report},
    )  # fmt: skip


def _check(chance: MonteCarloRequest, settings: Settings) -> None:
    if not chance.vary:
        raise UsageError("BR438", "nothing varies:", "name a parameter and its distribution")
    if len(chance.vary) > MOST_NAMES:
        raise UsageError("BR439", f"at most {MOST_NAMES} parameters vary at once; these are {len(chance.vary)}")
    if not 2 <= chance.samples <= MOST_SAMPLES:
        raise UsageError("BR440", f"samples = {chance.samples}: from 2 to {MOST_SAMPLES}")
    if chance.indices is not None and (chance.indices < 0 or chance.indices & (chance.indices - 1)):
        raise UsageError("BR441", f"Sobol indices stand on a power of two of rows, or on none; not on {chance.indices}")
    if chance.indices is not None and chance.indices > chance.samples:
        raise UsageError(
            "BR442", f"Sobol indices stand on {chance.indices} rows, but there are only {chance.samples} samples"
        )
    both = sorted({name for name, _ in chance.vary} & set(settings))
    if both:
        raise UsageError("BR443", f"`{both[0]}` is set and varies:", "one of the two")


def _rows(chance: MonteCarloRequest) -> int:
    if chance.indices is not None:
        return chance.indices
    return 1 << (min(chance.samples, MOST_INDICES).bit_length() - 1)


def _tornado_points(given: Sequence[Distribution]) -> Array:
    """Return the point with all parameters at their medians; then those with each at its two tails."""
    middle = np.array([quantiles(d, np.array([0.5]))[0] for d in given])
    rows = [middle]
    for j, one in enumerate(given):
        for value in quantiles(one, np.array(TAILS)):
            row = middle.copy()
            row[j] = value
            rows.append(row)
    return np.array(rows)


def _swing(table: Array, count: int) -> Swing:
    return Swing(TAILS, table[0], np.moveaxis(table[1:].reshape(count, 2, -1), 2, 0))


def _table(found: Sequence[Any], quantities: Sequence[str]) -> Array:
    rows = [{} if isinstance(x, Failed) else x for x in found]
    return np.array([[row.get(n, np.nan) for n in quantities] for row in rows], dtype=float).reshape(len(rows), -1)


def _units(space: StateSpace, units: Mapping[str, str], quantities: Sequence[str]) -> dict[str, str]:
    of_outputs = {n: space.variables[v].unit for n, v in space.outputs.items()}
    return dict(units) | {n: of_outputs.get(n, "Hz") for n in quantities}


def _notes(table: Array, quantities: Sequence[str], failures: Mapping[int, str]) -> list[str]:
    notes = []
    if failures:
        first = next(iter(failures))
        notes.append(
            f"{len(failures)} of {len(table)} points failed and are in no statistic; point {first + 1}: {failures[first]}"
        )
    answered = len(table) - len(failures)
    for name, column in zip(quantities, table.T, strict=True):
        there = int(np.isfinite(column).sum())
        if there < answered:
            notes.append(f"`{name}` is there at {there} of {answered} points only: others have fewer modes that move")
    return notes


def _index_notes(told: Indices | None, lost: int, rows: int) -> list[str]:
    if told is None:
        return [f"no Sobol indices: only {rows - lost} of {rows} rows of points have answers throughout"]
    if lost:
        return [f"the Sobol indices stand on {told.count} of {rows} rows: {lost} have points that failed"]
    return []


def _noise(study: ScalarStudy, quantities: Sequence[str]) -> Array:
    """Return the relative errors of quantities (m,): the tolerance for the end of a run, else 0."""
    rtol = (study.run.options.rtol or DEFAULT_RTOL) if "simulate" in study.of else 0.0
    return np.array([0.0 if n.startswith("frequency ") else rtol for n in quantities])


def _vague_notes(told: Indices | None, names: Sequence[str], quantities: Sequence[str]) -> list[str]:
    """Return notes on quantities whose shares of variance are not determined."""
    notes = []
    for i, name in enumerate(quantities if told is not None else ()):
        assert told is not None
        vague = [
            n
            for n, first, total in zip(names, told.first[i], told.total[i], strict=True)
            if not np.isfinite(first + total)
        ]
        if not vague:
            continue
        still = not np.isfinite(told.total_interval[i]).any()
        why = f"{told.count} rows of points leave intervals that hold all shares"
        if still:
            why = "it does not vary but for rounding and tolerance"
        some = "no parameter" if len(vague) == len(names) else f"not {', '.join(f'`{n}`' for n in vague)}"
        notes.append(f"the shares of the variance of `{name}` are not determined ({some} can be told): {why}")
    return notes


def _text(given: Distribution) -> str:
    numbers = ", ".join(f"{x:.9g}" for x in given.numbers)
    inner = f"{given.kind}({numbers})"
    if given.low == -np.inf and given.high == np.inf:
        return inner
    return f"truncated({inner}, {given.low:.9g}, {given.high:.9g})"


def cube(count: int, size: int, seed: int) -> Array:
    """Return points in the unit cube of `size` dimensions, shape (count, size). The first 2^k are as even as any 2^k."""
    from scipy.stats import qmc

    power = max(0, math.ceil(math.log2(count)))
    return np.asarray(qmc.Sobol(size, scramble=True, rng=np.random.default_rng(seed)).random_base2(power)[:count])


def correlation_matrix(names: Sequence[str], pairs: Mapping[tuple[str, str], float]) -> Array | None:
    """Return the matrix of the copula from its pairs; None if all are independent. Raises `UsageError` for an impossible one."""
    if not pairs:
        return None
    matrix = np.eye(len(names))
    seen: set[frozenset[str]] = set()
    for (one, other), value in pairs.items():
        for name in (one, other):
            if name not in names:
                raise UsageError("BR444", f"correlation of `{one}` and `{other}`: `{name}` has no distribution")
        if one == other or frozenset((one, other)) in seen:
            raise UsageError("BR445", f"correlation of `{one}` and `{other}`: one number for each pair of two")
        if not -1 <= value <= 1:
            raise UsageError("BR446", f"correlation of `{one}` and `{other}`: {value:g} is not between -1 and 1")
        seen.add(frozenset((one, other)))
        i, j = names.index(one), names.index(other)
        matrix[i, j] = matrix[j, i] = value
    values, vectors = np.linalg.eigh(matrix)
    if values[0] < IMPOSSIBLE:
        weights = vectors[:, 0]
        told = ", ".join(f"`{names[i]}`" for i in np.argsort(-np.abs(weights)) if abs(weights[i]) > 0.1)
        raise UsageError(
            "BR447", f"no quantities are correlated like this: {told} contradict each other (the matrix has the eigenvalue {values[0]:.3g})",
        )  # fmt: skip
    return matrix


def values_of(shares: Array, distributions: Sequence[Distribution], correlation: Array | None) -> Array:
    """Return values (n, k) at points of the unit cube (n, k)."""
    if correlation is not None:
        from scipy.special import ndtr, ndtri

        values, vectors = np.linalg.eigh(correlation)
        root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T  # symmetric root, also of singular matrices
        shares = ndtr(ndtri(np.clip(shares, EDGE, 1 - EDGE)) @ root)
    return np.stack([quantiles(d, shares[:, j]) for j, d in enumerate(distributions)], axis=1)


def quantiles(given: Distribution, shares: Array) -> Array:
    """Return the quantiles at these probabilities."""
    frozen = _frozen(given)
    first, last = float(frozen.cdf(given.low)), float(frozen.cdf(given.high))
    shares = np.clip(first + shares * (last - first), EDGE, 1 - EDGE)
    return np.asarray(np.clip(frozen.ppf(shares), given.low, given.high))


def _frozen(given: Distribution) -> Any:
    from scipy import stats

    match given.kind, given.numbers:
        case "normal", (mean, spread):
            return stats.norm(mean, spread)
        case "lognormal", (mean, spread):
            sigma = math.sqrt(math.log1p((spread / mean) ** 2))
            return stats.lognorm(sigma, scale=mean * math.exp(-(sigma**2) / 2))
        case "uniform", (low, high):
            return stats.uniform(low, high - low)
        case _, (low, mode, high):
            return stats.triang((mode - low) / (high - low), low, high - low)
    raise AssertionError(given.kind)


def distribution(text: str, unit: str, name: str) -> Distribution:
    """Return the distribution of a text; `unit` is one of the parameter's kind, `name` the parameter's. Raises `UsageError`."""
    call = _CALL.fullmatch(text)
    if call is None or call[1] not in (*DISTRIBUTIONS, "truncated"):
        raise UsageError("BR401", f"{name}: `{text.strip()}` is no distribution; there are {kinds_told()}")
    parts = _parts(call[2])
    if call[1] == "truncated":
        return _truncated(parts, unit, name, text)
    words = DISTRIBUTIONS[call[1]]
    if len(parts) != len(words):
        raise UsageError(
            "BR402", f"{name}: {call[1]} takes {len(words)} numbers: {', '.join(words)}; this is `{text.strip()}`"
        )
    numbers = tuple(
        _spread(p, unit, name) if word == SPREAD else quantity(p, unit, name)
        for p, word in zip(parts, words, strict=True)
    )
    return checked(Distribution(call[1], numbers), name)


def _spread(text: str, unit: str, name: str) -> float:
    """Return a difference in SI: for temperatures without the offset, for ratios in dB as a number."""
    for own, written in (("degC", "K"), ("degF", "K"), ("dB", "[1]")):
        if unit_written(text) == own:
            raise UsageError("BR403", f"{name}: a standard deviation is a difference;", f"write it in {written}")
    return quantity(text, unit, name)


def _truncated(parts: Sequence[str], unit: str, name: str, text: str) -> Distribution:
    if len(parts) != 3:
        raise UsageError("BR404", f"{name}: truncated takes a distribution, low and high; this is `{text.strip()}`")
    inner = distribution(parts[0], unit, name)
    low, high = (quantity(p, unit, name) for p in parts[1:])
    return checked(Distribution(inner.kind, inner.numbers, max(low, inner.low), min(high, inner.high)), name)


def checked(found: Distribution, name: str) -> Distribution:
    """Return the same distribution, if it is valid. Raises `UsageError`."""
    wrong = fault(found)
    if wrong:
        raise UsageError("BR405", f"{name}: {wrong}")
    ends = _frozen(found).cdf([found.low, found.high])
    if not ends[1] - ends[0] > 1e-12:
        raise UsageError("BR406", f"{name}: nothing of the distribution lies between {found.low:g} and {found.high:g}")
    return found


def _parts(text: str) -> list[str]:
    """Split at the commas outside parentheses."""
    found, depth, begin = [], 0, 0
    for i, mark in enumerate(text):
        depth += (mark in "([") - (mark in ")]")
        if mark == "," and depth == 0:
            found.append(text[begin:i])
            begin = i + 1
    return [*found, text[begin:]]
