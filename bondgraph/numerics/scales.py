"""Sizes by which numbers of different units are compared: of the rows and columns of a matrix, and of quantities of one unit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from compiler.api import Array, IntArray


def nonzero(sizes: Array) -> Any:
    """Return sizes with 1 in the place of zeros."""
    return np.where(sizes > 0, sizes, 1.0)


def equilibrated(matrix: Array) -> tuple[Any, Any, Any]:
    """Return a matrix with its rows, then its columns, over their largest entries; and these, (rows,) and (columns,), 1 in the place of zeros."""
    rows = nonzero(np.abs(matrix).max(axis=1, initial=0.0))
    matrix = matrix / rows[:, None]
    columns = nonzero(np.abs(matrix).max(axis=0, initial=0.0))
    return matrix / columns, rows, columns


def group_numbers(groups: Sequence[object]) -> Any:
    """Return the number of the group of each item, in the order of first use; shape (items,)."""
    numbers = {group: number for number, group in enumerate(dict.fromkeys(groups))}
    return np.array([numbers[group] for group in groups], dtype=int)


def largest_of_group(sizes: Array, numbers: IntArray) -> Any:
    """Return for each item the largest of the sizes, which are not negative, in its group; shape (…, items)."""
    most = np.zeros((*sizes.shape[:-1], int(numbers.max(initial=-1)) + 1))
    np.maximum.at(most.T, numbers, sizes.T)
    return most[..., numbers]
