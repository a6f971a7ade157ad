"""Polynomial through the last step ends, which is more accurate between them than that of any single step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(slots=True)
class End:
    """Time, state and rates at the end of a step."""

    time: float
    state: Any
    slope: Any


def hermite(ends: list[End], times: Any) -> Any:
    """Return the polynomial through values and rates at three instants, at `times`; shape (times, n).

    The first instant of a run has no rates. By divided differences from the last one back (Stoer and Bulirsch, Introduction to Numerical Analysis,
    section 2.1.5).
    """
    known = [e for e in reversed(ends) for _ in range(1 if e.slope is None else 2)]
    nodes = np.array([e.time for e in known])
    column = np.stack([e.state for e in known])
    coefficients = [column[0]]
    for order in range(1, len(nodes)):
        gaps = nodes[order:] - nodes[:-order]
        steep = [known[i].slope if gap == 0 else (column[i + 1] - column[i]) * (1 / gap) for i, gap in enumerate(gaps)]
        column = np.stack(steep)
        coefficients.append(column[0])
    value = np.tile(coefficients[-1], (len(times), 1))
    for node, coefficient in zip(nodes[-2::-1], coefficients[-2::-1], strict=True):
        value = value * (times - node)[:, None] + coefficient
    return value
