"""Dense output of Radau at many instants at once: the quintic through the last step ends, and the collocation polynomial of the last step."""

from __future__ import annotations

from typing import Any

import numpy as np

from .radau import P


def sampled(s: Any, times: Any) -> Any:
    """Return scaled states within the last step of a record or solver, shape (times, n): as `compiled.within.scaled_at`."""
    times = np.asarray(times)
    cubic = collocation(s, times)
    if s.ends < 3:
        return cubic
    quintic = _quintic(s, times)
    limit = 10 * (s.absolute + s.relative * np.abs(s.end_state.reshape(3, s.n)[2]))
    return np.where((np.abs(quintic - cubic) <= limit) & np.isfinite(limit), quintic, cubic)


def collocation(s: Any, times: Any) -> Any:
    """Return the collocation polynomial of the last step; shape (times, n).

    The step adds its integral to a state: integrals along it agree with the states, stiff parts included.
    """
    before, after = s.end_time[s.ends - 2], s.end_time[s.ends - 1]
    at = (np.asarray(times) - before) / (after - before)
    value: Any = s.end_state.reshape(3, s.n)[s.ends - 2] + (np.stack([at, at**2, at**3]).T @ P.T) @ s.stages.reshape(
        3, s.n
    )
    return value


def _quintic(s: Any, times: Any) -> Any:
    """Return the polynomial through values and rates at three instants, at `times`; shape (times, n).

    The first instant of a run has no rates. By divided differences from the last one back (Stoer and Bulirsch, Introduction to Numerical Analysis,
    section 2.1.5).
    """
    states, slopes = s.end_state.reshape(3, s.n), s.end_slope.reshape(3, s.n)
    known = [end for end in (2, 1, 0) for _ in range(2 if end or s.first_sloped else 1)]
    nodes = np.array([float(s.end_time[end]) for end in known])
    column = np.stack([states[end] for end in known])
    coefficients = [column[0]]
    for order in range(1, len(nodes)):
        gaps = nodes[order:] - nodes[:-order]
        steep = [
            slopes[known[i]] if gap == 0 else (column[i + 1] - column[i]) * (1 / gap) for i, gap in enumerate(gaps)
        ]
        column = np.stack(steep)
        coefficients.append(column[0])
    value = np.tile(coefficients[-1], (len(times), 1))
    for node, coefficient in zip(nodes[-2::-1], coefficients[-2::-1], strict=True):
        value = value * (times - node)[:, None] + coefficient
    return value
