"""Free response: reach of a free linear motion from a state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from compiler.api import Array, address_of

from ..integrators.compiled.code import POINTER, WHOLE, called
from ..integrators.linear_algebra import balancing

if TYPE_CHECKING:
    from compiler.api import Program

LARGEST = 200  # most states for which the modes are computed
# Relative to the largest entry, and to itself: an entry that may be rounding, and its change then
SMALL, CHANGED = 1e-10, 1e-3
BEYOND = 1e2  # lengths of a run: what takes longer to get to a rest does not
WELL_TOLD = 1e6  # largest condition number of the eigenvectors with which the modes are separable


def slopes_of(
    program: Program, time: float, state: Array, inputs: Array, constants: Array, mode: Array, smallest: Array
) -> Any:
    """Return Jacobians (…, n, n) without entries that are rounding of terms that cancel: they change with the last digits of what they read, and with
    angles of the size of rounding, `smallest`."""
    slopes = np.asarray(program.jacobian(time, state, inputs, constants, mode))
    sizes = np.abs(slopes)
    small = (slopes != 0) & (sizes < SMALL * sizes.max(axis=(-2, -1), keepdims=True, initial=0.0))
    if not small.any():
        return slopes
    states, others = (x * (1 + 8 * np.finfo(float).eps * (1 + np.arange(x.shape[-1]) % 3)) for x in (state, constants))
    change = np.abs(program.jacobian(time, states + smallest, inputs, others, mode) - slopes)
    return np.where(small & (change > CHANGED * sizes), 0.0, slopes)


def balance(matrix: Array, compiled: bool) -> tuple[Any, Any]:
    """Return a matrix balanced, and the powers of two used; by machine code or by its source."""
    count = len(matrix)
    if not compiled:
        entries, scale = matrix.ravel().tolist(), [1.0] * count
        balancing.balance(count, entries, scale)
        return np.array(entries).reshape(count, count), np.array(scale)
    a, powers = np.array(matrix, dtype=float), np.ones(count)
    called("balance", None, WHOLE, POINTER, POINTER)(count, address_of(a), address_of(powers))
    return a, powers


@dataclass(frozen=True, slots=True)
class FreeResponse:
    """Modes of a linear motion: each state reaches at most the sum of their amplitudes. Arrays (…, n, n), (…, n, n), (…, n)."""

    amplitudes: Any
    inverse: Any
    scale: Any
    fastest: Any  # largest of its rates, 1/s; shape (…,)
    matrix: Any  # in units of the scale

    def __call__(self, x: Array) -> Any:
        modes = np.abs(self.inverse @ (x / self.scale)[..., None])
        return (self.amplitudes @ modes)[..., 0] * self.scale

    def rest(self, rates: Array, length: float) -> Any:
        """Return the displacement to the point of zero rates according to the Jacobian, shape (…, n); not finite where there is no restoring force, or
        only rounding of one: in a run of this length nothing gets there."""
        scaled = rates / self.scale
        away = -item_by_item(np.linalg.solve, self.matrix, scaled[..., None])[..., 0]
        reached = np.linalg.norm(away, axis=-1) <= BEYOND * length * np.linalg.norm(scaled, axis=-1)
        return np.where(reached[..., None], away, np.nan) * self.scale

    def is_slower_than(self, rate: Array | float, jacobians: Array) -> Any:
        """Return True where all modes of other Jacobians, shape (…, k, n, n), are slower; Jacobians that are not finite are ignored."""
        whole: Any = np.isfinite(jacobians).all(axis=(-2, -1))
        finite = np.where(whole[..., None, None], jacobians, 0.0)
        units = self.scale[..., None, None, :] / self.scale[..., None, :, None]
        slower: Any = np.asarray(
            np.abs(finite * units).sum(axis=-1).max(axis=(-2, -1), initial=0.0) <= rate
        )  # by a bound
        if not slower.all():
            rates = np.abs(np.linalg.eigvals(finite[~slower])).max(axis=(-2, -1), initial=0.0)
            slower[~slower] = rates <= np.asarray(rate)[~slower]
        return slower

    def of(self, row: int) -> FreeResponse:
        """Return one of several motions."""
        return FreeResponse(*(x[row] for x in (self.amplitudes, self.inverse, self.scale, self.fastest, self.matrix)))


def item_by_item(function: Callable[..., Any], *stacks: Array) -> Any:
    """Return the values of a function of numpy's linear algebra for stacks of matrices, shape (…,), NaN for a matrix that it refuses."""
    try:
        return function(*stacks)
    except np.linalg.LinAlgError:
        if stacks[0].ndim == 2:
            return np.full(stacks[-1].shape, np.nan)
        regular = np.linalg.slogdet(stacks[0])[0] != 0
        if not regular.all():
            found = np.full(stacks[-1].shape, np.nan, dtype=stacks[-1].dtype)
            found[regular] = item_by_item(function, *(stack[regular] for stack in stacks))
            return found
        return np.array([item_by_item(function, *items) for items in zip(*stacks, strict=True)])


def in_whole_state(reach: FreeResponse, basis: Any | None, size: int) -> FreeResponse:
    """Return the motion of the whole state, which lies along the columns of a basis."""
    if basis is None:
        return reach
    (count, modes), amplitudes, inverse = basis.shape, np.zeros((size, size)), np.zeros((size, size), dtype=complex)
    amplitudes[:count, :modes] = np.abs(basis) @ (reach.scale[:, None] * reach.amplitudes)
    inverse[:modes, :count] = reach.inverse / reach.scale @ basis.T
    return FreeResponse(amplitudes, inverse, np.ones(size), reach.fastest, reach.matrix)


def free_response(jacobian: Array, compiled: bool, length: float) -> FreeResponse | None:
    """Return the free linear motion of a state; None if its modes are too many, or too close to each other to separate their amplitudes.

    `compiled`: there is machine code for it.
    """
    motions = free_responses(jacobian[None], compiled, length)
    return motions[0][1].of(0) if motions else None


def free_responses(jacobians: Array, compiled: bool, length: float) -> list[tuple[Any, FreeResponse]]:
    """Return the free linear motions of states with Jacobians of shape (k, n, n): indices of those that have one, and their motions, real modes apart."""
    rows = np.flatnonzero(np.isfinite(jacobians).all(axis=(-2, -1)))
    if not 0 < jacobians.shape[-1] <= LARGEST or not len(rows):
        return []
    balanced, scale = map(np.array, zip(*(balance(jacobians[row], compiled) for row in rows), strict=True))
    try:
        rates, shapes = np.linalg.eig(balanced)
    except np.linalg.LinAlgError:
        if len(rows) == 1:
            return []
        return [
            ((row,), motion) for row in rows for _, motion in free_responses(jacobians[row : row + 1], compiled, length)
        ]
    real = ~rates.imag.any(axis=-1)
    motions: list[tuple[Any, FreeResponse]] = []
    for chosen, some in ((real, shapes[real].real), (~real, shapes[~real])):
        if not chosen.any():
            continue
        inverse = item_by_item(np.linalg.inv, some)
        with np.errstate(all="ignore"):
            separable = _squares(some) * _squares(inverse) <= WELL_TOLD**2
        for row in np.flatnonzero(~separable):
            separable[row] = np.isfinite(inverse[row]).all() and np.linalg.cond(some[row]) <= WELL_TOLD
        places = np.flatnonzero(chosen)[separable]
        for row, still in zip(np.flatnonzero(separable), BEYOND * length * np.abs(rates[places]) < 1, strict=True):
            if (
                still.sum() > 1
            ):  # they part in no such run: their sum counts, as their amplitudes are large where they are nearly one
                some[row][:, still], inverse[row][still] = _of_states(some[row][:, still], inverse[row][still])
        if len(places):
            fastest = np.abs(rates[places]).max(axis=-1)
            motion = FreeResponse(np.abs(some[separable]), inverse[separable], scale[places], fastest, balanced[places])
            motions.append((rows[places], motion))
    return motions


def _of_states(shapes: Array, inverse: Array) -> tuple[Any, Any]:
    """Return the factors of a product of shapes (n, s) and rows (s, n) of which the rows give the values of s states, by elimination with pivots."""
    left, chosen = shapes.copy(), list[int]()
    for column in range(left.shape[1]):
        chosen.append(int(np.abs(left[:, column]).argmax()))
        left -= np.outer(left[:, column] / left[chosen[-1], column], left[chosen[-1]])
    return np.linalg.solve(shapes[chosen].T, shapes.T).T, shapes[chosen] @ inverse


def _squares(matrices: Array) -> Any:
    """Return the sums of the squares of absolute values, shape (k,)."""
    return np.square(np.abs(matrices)).reshape(len(matrices), -1).sum(axis=-1)
