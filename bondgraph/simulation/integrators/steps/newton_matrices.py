"""Matrices mu/h M - J for a real and a complex mu: assembly, factorisation, solution."""

from __future__ import annotations

from compiler.api import Floats

from ..linear_algebra.factors import ComplexFactors, back, back_complex, eliminate, eliminate_complex, is_negative
from ..linear_algebra.sparse import FINE, SINGULAR, complex_back, complex_factors, real_back, real_factors
from ..workspace import IntegratorWorkspace


def factorise_pair(s: IntegratorWorkspace, factors: ComplexFactors, real: float, imaginary: float) -> int:
    """Factorise mu M - J for a complex mu; return `FINE`, `SINGULAR`, or `ANEW` if another order is needed. `factors`: where they are dense."""
    if s.sparse != 0:
        return complex_factors(s.pattern, real, imaginary, s.jacobian)
    n = s.n
    re = factors.re
    im = factors.im
    for i in range(n * n):
        re[i] = 0.0
        im[i] = 0.0
    for i in range(s.differential):
        re[i * n + i] = real
        im[i * n + i] = imaginary
    for k in range(s.entry_count):
        re[s.rows[k] * n + s.columns[k]] -= s.jacobian[k]
    return FINE if eliminate_complex(factors) else SINGULAR


def factorise_real(s: IntegratorWorkspace, shift: float) -> int:
    """Factorise shift M - J for a real shift; return as `factorise_pair`."""
    if s.sparse != 0:
        return real_factors(s.pattern, shift, s.jacobian)
    n = s.n
    real = s.real.matrix
    for i in range(n * n):
        real[i] = 0.0
    for i in range(s.differential):
        real[i * n + i] = shift
    for k in range(s.entry_count):
        real[s.rows[k] * n + s.columns[k]] -= s.jacobian[k]
    if not eliminate(s.real):
        return SINGULAR
    s.negative = is_negative(s.real)
    return FINE


def solve_real(s: IntegratorWorkspace, x: Floats) -> None:
    """Replace the right-hand side by the solution."""
    if s.sparse != 0:
        real_back(s.pattern, x)
    else:
        back(s.real, x)


def solve_complex(s: IntegratorWorkspace, xr: Floats, xi: Floats) -> None:
    """Replace the right-hand side by the solution."""
    if s.sparse != 0:
        complex_back(s.pattern, xr, xi)
    else:
        back_complex(s.complex, xr, xi)
