"""Radau IIA of order 5 for M y' = f(t, y) with M = diag(1 … 1, 0 … 0): differential equations, and those with unknowns of loops.

Hairer and Wanner, Solving Ordinary Differential Equations II, sections IV.8 (the method, its simplified Newton iteration, its
error estimate) and VI.1 (problems with M). The step is in `steps/radau_step.py`, its coefficients beside it. Four things differ from the program that
comes with that book:

- Within a step the quintic through values and derivatives at the last three step ends is evaluated, which has the order of the
  method; the derivative at a step's end is that of the collocation polynomial, so that stiffness does not magnify its error.
- The caller gives states divided by their magnitudes; the factorisation scales rows.
- At the end of a step, the unknowns of loops must solve their equations, whatever Jacobian the iteration used.
- A step that is rejected repeatedly although it gets shorter is distinguished from one that is too long: the remaining error is round-off.
"""

from __future__ import annotations

import numpy as np

_S6 = 6**0.5
C = np.array([(4 - _S6) / 10, (4 + _S6) / 10, 1.0])
MU_REAL = 3 + 3 ** (2 / 3) - 3 ** (1 / 3)  # eigenvalue of the inverse of the method's matrix
# The collocation polynomial is y0 + Z.T P [s, s^2, s^3]; D gives its derivative at the end.
P = np.array(
    [
        [13 / 3 + 7 * _S6 / 3, -23 / 3 - 22 * _S6 / 3, 10 / 3 + 5 * _S6],
        [13 / 3 - 7 * _S6 / 3, -23 / 3 + 22 * _S6 / 3, 10 / 3 - 5 * _S6],
        [1 / 3, -8 / 3, 10 / 3],
    ]
)
D = P @ np.array([1.0, 2.0, 3.0])
INNER = tuple(C[:-1].tolist())  # fractions of a step at which the limits of a model are checked
SLOWEST = 0.9  # largest contraction assumed for a single component of the stages
CREEPING = 0.5  # contraction below which components need no separate check
UNSOLVED = 0.5  # ratio to the residual of a loop equation before the last change: a larger one is no solution
SOLVED = 0.01  # in units of the tolerance: error of a loop unknown that counts as solved
NEARLY = 0.1  # the same, estimated by the last change and the ratio of the residuals, that needs no check
UNCONVERGED = 3  # failed iterations, with a Jacobian of the start, behind which the unknowns of loops are solved there
MOST_SOLVING, DAMPED = 200, 1e-9  # iterations of that solution, and the least fraction of a change that it takes
NOISE = 1e-15  # relative to the terms of a loop equation: smaller residuals count as zero
ROUNDED = 1e-12  # relative to the terms of such an equation: rounding
STIFF = 300.0  # relative change of a state in a step, if the others did not follow, from which it counts as stiff
SURE = 0.3  # in units of the tolerance: two polynomials within a step that differ by less are accurate
NEAR = 1e-4  # fraction of a step: distance of two values of a central difference quotient, somewhat over EPS^(1/3)
SLOW = 0.1  # contraction above which Newton's method computes the Jacobian again there
BACK_ITERATIONS, BACK_PATIENT = 8, 1  # iterations of Newton's method there; successive slow ones with a new Jacobian
LEFT = 1e-3  # in units of the tolerance: its remaining error
FIRST_ULPS = 1e3  # in units in the last place of the time: least first step
SMALLEST, LARGEST = 0.2, 8.0  # ratios of two steps
GROWN = 2.0  # factor behind a step whose estimate is rounding: a longer step has less
# A step over a kink of a law with an error above this fraction of the tolerance ends at the kink instead, unless the kink is nearer to
# its start than a fraction of it; but not repeatedly.
BENT, NEAREST, MOST_BENDS = 0.1, 1e-2, 4
CLOSE = 1e-9  # fraction of a step: accuracy of the place of a kink
BEYOND = 1e-6  # fraction of a step that ends at a kink: distance behind it at which the other side is evaluated
STUBBORN, SHORTER = 8, 1e-3  # rejected tries after which steps shorter by this factor must have reduced the error
PATIENT = 3  # rejected tries after which steps get much shorter


class StepFailed(Exception):
    """Raised if no step is short enough; `what` failed last: newton, error, or round-off where shorter steps were no better."""

    def __init__(self, what: str) -> None:
        self.what = what
