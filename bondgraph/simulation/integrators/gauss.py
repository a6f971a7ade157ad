"""Gauss collocation of order 6 in equal steps, with conservation of the stored energy: for lossless models.

The method is symmetric, conserves quadratic energies exactly and others for very long (Hairer, Lubich and Wanner, Geometric Numerical
Integration, second edition 2006, chapters II and VI). The remaining error, from rounding and from energies that are neither quadratic nor canonical,
is removed by the shortest change of the scaled state to the energy of the start (section IV.4), at each step and at each reported instant. Stages
are solved to rounding, and steps are summed with compensation, otherwise a random walk of the state would appear after 1e5 periods.
"""

import numpy as np

_R15 = 15**0.5
C = (0.5 - _R15 / 10, 0.5, 0.5 + _R15 / 10)
A = (
    5 / 36, 2 / 9 - _R15 / 15, 5 / 36 - _R15 / 30,
    5 / 36 + _R15 / 24, 2 / 9, 5 / 36 - _R15 / 24,
    5 / 36 + _R15 / 30, 2 / 9 + _R15 / 15, 5 / 36,
)  # fmt: skip
B = (5 / 18, 4 / 9, 5 / 18)
ITERATIONS = 40  # most iterations of Newton's method
SLOW = 6  # number of iterations after which the Jacobian is computed again
CLOSE = 1e-9  # relative to the largest states: a change below it that shrinks no more is rounding
PROJECTIONS = 2
# Dense output: integral of the polynomial through the rates at start, stages and end; coefficients of its powers 1 … 5 by row.
_NODES = np.array([0.0, *C, 1.0])
WITHIN = tuple((np.linalg.inv(np.vander(_NODES, increasing=True)) / np.arange(1, 6)[:, None]).ravel().tolist())
