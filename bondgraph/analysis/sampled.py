"""A sampled loop (`every`) at rest, in discrete time: its stability, and its frequency response.

Between samples x' = A x + E m + B u; at each sample m+ = G x + H m + K u is held for a period T. With the exact solution over a period, the loop's
eigenvalues z are those of [[P + Q G, Q H], [G, H]], P = exp(A T), Q = (integral of exp(A s) ds) E. A harmonic input exp(i w t) gives held values
m = M z^k with z = exp(i w T), whose part at w is M (1 - exp(-i w T))/(i w T): what the continuous outputs have of frequency w is the response
(Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., 1997, chapter 7), up to the Nyquist frequency 1/(2 T).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.api import Array, Leaf, Tape

from ..errors import RunFailed, UsageError
from .eigenvalues import EPS
from .linear import Linearization, linear_units
from .operating_point import Lookup, OperatingPoint, reduction
from .reduced import Reduced
from .response import NO_VALUES, POINTS, Response, frequencies_between, transfer, with_extrema
from .sensitivity import unit_directions
from .singular_slopes import jumps
from .verdict import Verdict

ERROR = 64.0  # units in the last place, of a period's solution


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """Sampled loop: `continuous` has A, and E and B side by side in B and D.

    `held` (k, r + k + p): derivatives of sampled values by the free coordinates, the held values and the inputs; `period` in s.
    """

    continuous: Linearization
    held: Any
    period: float

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of free coordinates and of held values."""
        return len(self.continuous.A), len(self.held)

    @property
    def step(self) -> tuple[Any, Any]:
        """Matrices P (r, r) and Q (r, k): the states after a period."""
        from scipy.linalg import expm

        r, k = self.sizes
        whole = np.zeros((r + k, r + k))
        whole[:r, :r], whole[:r, r:] = self.continuous.A, self.continuous.B[:, :k]
        done = expm(whole * self.period)
        return done[:r, :r], done[:r, r:]

    @property
    def matrix(self) -> Any:
        """Matrix of states and held values from one sample to the next, (r + k, r + k)."""
        r, k = self.sizes
        P, Q = self.step
        G, H = self.held[:, :r], self.held[:, r : r + k]
        return np.block([[P + Q @ G, Q @ H], [G, H]])


def is_sampled(point: OperatingPoint) -> bool:
    """Return True if the model has sampled events."""
    hybrid = point.program.hybrid
    return hybrid is not None and any(e.sampled for e in hybrid.events)


def sampled_loop(point: OperatingPoint) -> SampledLoop:
    """Return the loop of a point at equilibrium; inputs are the point's `by`. Raises `UsageError` for several periods."""
    from ..simulation.events.equilibrium import sampled_settings
    from ..simulation.segments.sampling import sampling_of

    program, space = point.program, point.compilation.state_space
    settings = sampled_settings(point.constraints)
    periods = sorted({period for _, _, period in settings})
    if len(periods) != 1:
        raise UsageError(
            "BR246", f"the model is sampled every {', '.join(f'{p:g} s' for p in periods)}: its discrete loop is that of one period;",
            "give all `every` the same, or simulate",
        )  # fmt: skip
    assert program.hybrid is not None
    rows = sampling_of(program.hybrid.sampling(point.constraints.constants))
    if rows[:, 2:4].any() or np.ptp(rows[:, 1]):
        raise UsageError(
            "BR267", "the samples of the model are late by a delay, a jitter or different offsets: its discrete loop is that of one instant in a period;",
            "leave these out, or simulate",
        )  # fmt: skip
    reduced = reduction(point)
    values = point.lowered.values
    rates = [values[space.states[i].rate] for i in reduced.chosen]
    outputs = [values[v] for v in space.outputs.values()]
    new = [point.lowered.events.values[s] for s, _, _ in settings]
    modes, places = program.hybrid.modes.names if program.hybrid is not None else (), [p for _, p, _ in settings]
    directions, width = _directions(point, reduced, places)
    tape = point.tape("sampled loop", lambda: [*rates, *outputs, *new])
    states = tuple(np.take(program.states.names, reduced.chosen))
    table = _smooth_table(
        point, tape, directions, width, places, (*states, *space.outputs, *(modes[p] for p in places))
    )
    r, k = len(reduced.chosen), len(settings)
    above, middle, sampled = np.split(table, [r, r + len(outputs)])
    inputs = (*(modes[p] for p in places), *point.by)
    linear = Linearization(
        program.name, point.made.plan.experiment, point.time, states, inputs,
        program.outputs.names, linear_units(point), above[:, :r], above[:, r:], middle[:, :r], middle[:, r:], point.state[reduced.chosen],
        np.zeros(k + len(point.by)), point.outputs, point.rates[reduced.chosen], point.unneeded,
    )  # fmt: skip
    return SampledLoop(linear, sampled, periods[0])


def _smooth_table(
    point: OperatingPoint, tape: Tape, directions: Mapping[Leaf, Any], width: int, held: Sequence[int], names: Sequence[str]
) -> Array:  # fmt: skip
    """Return the slopes (len(names), width) of a tape's roots along directions. Raises `RunFailed` for infinite ones, kinks and jumps."""

    def at(lookup: Lookup) -> tuple[Array, Array]:
        values, slopes = tape.slopes(lookup, directions, width)
        rows = [np.zeros(width) if row is None else row for row in slopes]
        return np.array(values), np.reshape(rows, (len(slopes), width))

    here, table = at(point.lookup)
    if not np.isfinite(table).all():
        raise RunFailed("BR247", "something in the sampled loop has no finite slope at its rest")
    places = jumps(lambda side, far, way: at(point.lookup_beside(side, far, way, held))[0], here)
    point.refuse_kinks([names[i] for i in places], "jumps at")
    beside = lambda side, far, way: at(point.lookup_beside(side, far, way, held))[1]  # noqa: E731
    return point.smoothed(beside, table, lambda place: names[place // width])


def _directions(point: OperatingPoint, reduced: Reduced, modes: list[int]) -> tuple[dict[Leaf, Any], int]:
    """Return the derivatives of the program's symbols by free coordinates, held values and inputs, with unknowns following; and their number."""
    n, r, k, p = point.count, len(reduced.chosen), len(modes), len(point.by)
    width = r + k + p
    states = np.concatenate([reduced.directions, np.zeros((n, k)), reduced.following], axis=1)
    directions = {Leaf("state", i): row for i, row in enumerate(states) if row.any()}
    directions |= {Leaf("mode", place): np.eye(width)[r + j] for j, place in enumerate(modes)}
    directions |= unit_directions(point.compilation, point.by, width, r + k)
    if point.all > n:
        lowered = point.lowered
        residuals = [lowered.values[u.residual] for u in point.compilation.state_space.unknowns]
        tape = point.tape("residuals of a sampled loop", lambda: residuals)
        _, found = tape.slopes(point.lookup, directions, width)
        right = np.array([np.zeros(width) if row is None else row for row in found])
        own = point.jacobian[n:, n:]
        try:
            follow = -np.linalg.solve(own, right)
        except np.linalg.LinAlgError as problem:
            raise RunFailed("BR248", "an algebraic loop of the model has no slope at this rest") from problem
        directions |= {Leaf("state", n + i): row for i, row in enumerate(follow)}
    return directions, width


def sampled_verdict(point: OperatingPoint) -> Verdict:
    """Return the verdict of a sampled loop: `growth` is log(abs(z))/T of the largest eigenvalue z of a period. Raises `UsageError` for several periods."""
    from scipy.linalg import eig, matrix_balance

    point = point.one_sided()
    loop = sampled_loop(point)
    if point.kinks:
        return Verdict(math.nan, math.nan, None, kink=point.kinks[0])
    r, _ = loop.sizes
    read = loop.continuous.A.any(axis=0) | loop.held[:, :r].any(axis=0)  # an angle that nothing reads does not count
    keep = np.concatenate([read, np.ones(len(loop.held), dtype=bool)])
    matrix = matrix_balance(loop.matrix[np.ix_(keep, keep)], permute=False)[0]
    values, left, right = eig(matrix, left=True, right=True)
    lengths = np.abs(np.einsum("ij,ij->j", left.conj(), right))
    size = ERROR * EPS * (len(matrix) + float(np.abs(loop.continuous.A).sum(axis=1).max(initial=0.0)) * loop.period)
    with np.errstate(divide="ignore", invalid="ignore"):
        bounds = size * np.einsum("ij,ij->j", np.abs(left), np.abs(matrix) @ np.abs(right)) / lengths
        rates = np.log(values.astype(complex)) / loop.period
    bounds = np.where(np.isfinite(bounds), bounds, np.inf)
    sizes = np.abs(values)
    unsure = tuple(complex(v) for v, s, b in zip(rates, sizes, bounds, strict=True) if abs(s - 1) <= b and v.imag >= 0)
    worst = int(np.argmax(sizes))
    growth = float(np.log(sizes[worst]) / loop.period) if sizes[worst] > 0 else -np.inf
    stable = False if (sizes - 1 > bounds).any() else None if unsure else True
    return Verdict(growth, float(bounds[worst] / loop.period), stable, unsure, neutral=int((~keep).sum()))


def sampled_response(point: OperatingPoint, low: float | None, high: float | None, points: int = POINTS) -> Response:  # fmt: skip
    """Return the response of the continuous outputs at the frequency of the inputs, `low` to `high` in Hz, at most the Nyquist frequency."""
    loop = sampled_loop(point)
    linear, nyquist = loop.continuous, 0.5 / loop.period
    if not point.by or not linear.outputs:
        raise UsageError(
            "BR233", "a frequency response leads from an input to an output:", "name one that the model has (or a parameter as input)",
        )  # fmt: skip
    if high is not None and high > nyquist * (1 + 1e-12):
        raise UsageError(
            "BR249", f"the model is sampled every {loop.period:g} s: its response goes up to half that rate, {nyquist:g} Hz, not to {high:g} Hz",
        )  # fmt: skip
    values = np.linalg.eigvals(loop.matrix).astype(complex)
    poles = np.log(values[values != 0]) / loop.period
    if low is None and len(poles):
        low = min(float(np.abs(poles).min(initial=np.inf)) / 20 / np.pi, nyquist / 100)
    frequencies = frequencies_between(poles, low, nyquist if high is None else high, points)
    note = (
        f"sampled every {loop.period:g} s: the part of the outputs at the frequency of the input, up to {nyquist:g} Hz"
    )
    notes = tuple(filter(None, (note, linear.note)))
    made = Response(
        linear.model, linear.experiment, point.by, linear.outputs, linear.units, frequencies, NO_VALUES.astype(complex), NO_VALUES, notes=notes
    )  # fmt: skip
    undamped = np.abs(poles.real) * loop.period <= ERROR * EPS * len(loop.matrix)
    return with_extrema(made, lambda f: _at(loop, f), poles, undamped & (poles.imag != 0))


def _at(loop: SampledLoop, frequencies: Array) -> Any:
    """Return the response at frequencies (f,) in Hz, (f, m, p)."""
    r, k = loop.sizes
    P, Q = loop.step
    G, H, K = loop.held[:, :r], loop.held[:, r : r + k], loop.held[:, r + k :]
    whole = transfer(loop.continuous, 2j * np.pi * frequencies)  # (f, m, k + p)
    result = np.empty((len(frequencies), whole.shape[1], K.shape[1]), dtype=complex)
    A, B = loop.continuous.A, loop.continuous.B[:, k:]
    for i, frequency in enumerate(frequencies):
        w = 2 * np.pi * frequency
        z = np.exp(1j * w * loop.period)
        try:
            driven = np.linalg.solve(1j * w * np.eye(r) - A, B.astype(complex)) if r else np.zeros((0, B.shape[1]))
            by_held = np.linalg.solve(z * np.eye(r) - P, Q.astype(complex)) if r else np.zeros((0, k))
            held = np.linalg.solve(np.eye(k) - H / z - G @ by_held, G @ driven + K)
        except np.linalg.LinAlgError:
            result[i] = np.inf
            continue
        part = -np.expm1(-1j * w * loop.period) / (1j * w * loop.period)
        result[i] = whole[i, :, :k] @ (held * part) + whole[i, :, k:]
    return result
