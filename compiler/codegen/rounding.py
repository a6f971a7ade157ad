"""Bounds on the rounding of the indicators of conditions, by running error analysis over their operations.

Beside its value each operation has a bound on its error: what those of its operands move it, and its own rounding (Higham, Accuracy and Stability of
Numerical Algorithms, 2002, section 3.3). Exact are whole numbers and the mode; states are rounded in units of their magnitudes.
"""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algebra.intervals import BASIC, LIBRARY, plain
from ..algebra.operators import CONDITIONS
from ..algebra.systems import LEADING, banded_shape, dense, dense_count

if TYPE_CHECKING:
    from .program import TimeFunctions

Rounded = tuple[Any, Any]  # a value, and a bound on its error: numbers, or arrays (instants,)
JUMPING = CONDITIONS | {"sign", "floor", "ceil", "noise"}  # no error of an operand counts: a jump is a crossing


def rounding_of(functions: TimeFunctions, times: Any, states: Any, magnitude: Any, given: dict[str, Any]) -> Any:
    """Return bounds on the rounding of all indicators at instants, shape (instants, indicators); NaN where there is none.

    `states`: (instants, n), with their magnitudes; `given`: the values of constants, inputs and the mode.
    """
    known: dict[int, Rounded] = {}
    with np.errstate(all="ignore"):
        for number in functions.needed(functions.indicators):
            operator, operands = functions.nodes[number]
            if operator == "state":
                value = states[:, operands[0]]
                known[number] = value, BASIC * np.maximum(np.abs(value), magnitude[operands[0]])
            elif operator in ("number", "time", "constant", "input", "mode"):
                value = (
                    given[operator][operands[0]] if operator in given else times if operator == "time" else operands[0]
                )
                exact = operator == "mode" or (operator == "number" and value == round(value))
                known[number] = value, 0.0 if exact else BASIC * np.abs(value)
            else:
                known[number] = _applied(operator, [known[o] for o in operands])
        return np.stack([np.broadcast_to(known[i][1], times.shape) for i in functions.indicators], axis=-1)


def _applied(operator: str, operands: list[Rounded]) -> Rounded:
    """Return the value of an operation, with a bound on its error."""
    values, errors = [x[0] for x in operands], [x[1] for x in operands]
    match operator:
        case "add":  # in any order
            own = 0.5 * BASIC * (len(values) - 1) * sum(np.abs(v) for v in values)
            return plain(operator, values), sum(errors) + own
        case "multiply":
            return reduce(_product, operands)
        case "select":
            return tuple(np.where(values[0], x[1], x[2]) for x in (values, errors))
        case "solve" | "banded":
            return _solved(operator, operands)
        case "item":
            return tuple(x[..., int(values[1])] for x in operands[0])
    value = plain(operator, values)
    error = 0.0 if operator in JUMPING else LIBRARY * np.abs(value)
    if operator not in JUMPING:
        for i, own in enumerate(errors):
            if np.any(own):
                moved = [plain(operator, [*values[:i], values[i] + side * own, *values[i + 1 :]]) for side in (-1, 1)]
                error = error + np.fmax(*(np.nan_to_num(np.abs(m - value), nan=0.0) for m in moved))
    return value, error


def _product(a: Rounded, b: Rounded) -> Rounded:
    value = a[0] * b[0]
    return value, np.abs(a[0]) * b[1] + (np.abs(b[0]) + b[1]) * a[1] + BASIC * np.abs(value)


def _solved(operator: str, operands: list[Rounded]) -> Rounded:
    """Return the solution of a linear system, arrays (..., n), and a bound on its error by the inverse of the matrix."""
    if operator == "banded":
        operands = dense(banded_shape([x[0] for x in operands[:LEADING]]), operands, (0.0, 0.0))
    n = dense_count(len(operands))
    values, errors = (np.stack(np.broadcast_arrays(*(x[k] for x in operands)), axis=-1) for k in (0, 1))
    matrix, of_matrix = (x[..., : n * n].reshape(*x.shape[:-1], n, n) for x in (values, errors))
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return (np.full((*values.shape[:-1], n), np.nan),) * 2
    solution = (inverse @ values[..., n * n :, None])[..., 0]
    size = np.abs(solution)[..., None]
    residual = (of_matrix + n * BASIC * np.abs(matrix)) @ size + errors[..., n * n :, None]
    return solution, (np.abs(inverse) @ residual)[..., 0] + BASIC * size[..., 0]
