"""Gauss collocation of order 6 in equal steps, with the stored energy held: for what loses none.

The method is symmetric, conserves quadratic energies exactly and others for very long (Hairer, Lubich and Wanner, Geometric Numerical
Integration, second edition 2006, chapters II and VI). What is left of rounding and of energies that are neither quadratic nor canonical is taken out by
the shortest change of the scaled state to the energy of the start (section IV.4), at each step and at each reported instant. Stages are solved for to
rounding, and steps summed up with what rounding drops, or a random walk of the state would be seen after 1e5 periods.
"""

from __future__ import annotations

import numpy as np

_R15 = 15**0.5
C = (0.5 - _R15 / 10, 0.5, 0.5 + _R15 / 10)
A = (
    5 / 36, 2 / 9 - _R15 / 15, 5 / 36 - _R15 / 30,
    5 / 36 + _R15 / 24, 2 / 9, 5 / 36 - _R15 / 24,
    5 / 36 + _R15 / 30, 2 / 9 + _R15 / 15, 5 / 36,
)  # fmt: skip
B = (5 / 18, 4 / 9, 5 / 18)
ITERATIONS = 40  # of Newton's method
SLOW = 6  # of them, beyond which the Jacobian is formed anew
CLOSE = 1e-9  # in parts of the largest states: where a change that shrinks no more is rounding
PROJECTIONS = 2
# Between its ends a step is the integral of the polynomial through the slopes at start, stages and end: coefficients of its powers 1 … 5 by row.
_NODES = np.array([0.0, *C, 1.0])
WITHIN = tuple((np.linalg.inv(np.vander(_NODES, increasing=True)) / np.arange(1, 6)[:, None]).ravel().tolist())
