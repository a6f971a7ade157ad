"""mu/h M - J for a real and a complex mu: assembled, factorised with partial pivoting and rows scaled, solved; see `factorise.dense`.

Matrices lie row by row, real and imaginary parts in two arrays.
"""

from __future__ import annotations

from math import isfinite, sqrt
from typing import TYPE_CHECKING

from .. import radau
from .sparse import FINE, SINGULAR, complex_back, complex_factors, real_back, real_factors
from .stepper import Stepper

if TYPE_CHECKING:
    from ....door import Floats, Ints

MU_REAL, MU_RE, MU_IM = float(radau.MU_REAL), float(radau.MU_COMPLEX.real), float(radau.MU_COMPLEX.imag)


def factorise(s: Stepper, size: float) -> int:
    """mu/h M - J for the real mu and a complex one, rows scaled: `FINE`, `SINGULAR`, or `ANEW`: in another order."""
    n = s.n
    if s.sparse != 0:
        done = real_factors(s.pattern, MU_REAL / size, s.jacobian)
        if done != FINE:
            return done
        return complex_factors(s.pattern, MU_RE / size, MU_IM / size, s.jacobian)
    for i in range(n * n):
        s.real[i] = 0.0
        s.complex_re[i] = 0.0
        s.complex_im[i] = 0.0
    for i in range(s.differential):
        s.real[i * n + i] = MU_REAL / size
        s.complex_re[i * n + i] = MU_RE / size
        s.complex_im[i * n + i] = MU_IM / size
    for k in range(s.entry_count):
        place = s.rows[k] * n + s.columns[k]
        s.real[place] -= s.jacobian[k]
        s.complex_re[place] -= s.jacobian[k]
    if eliminate(n, s.real, s.real_scale, s.real_pivots) and factorise_complex(s):
        s.negative = is_negative(n, s.real, s.real_pivots)
        return FINE
    return SINGULAR


def is_negative(n: int, a: Floats, pivots: Ints) -> int:
    """The sign of a determinant: that of the pivots and of the exchanges of rows."""
    count = 0
    for k in range(n):
        if a[k * n + k] < 0.0:
            count += 1
        if pivots[k] != k:
            count += 1
    return count % 2


def eliminate(n: int, a: Floats, scale: Floats, pivots: Ints) -> bool:
    """Factors in the place of a real matrix; false if it is singular."""
    for i in range(n):
        largest = 0.0
        for j in range(n):
            largest = max(largest, abs(a[i * n + j]))
        scale[i] = 1.0 / largest if largest > 0.0 and isfinite(largest) else 1.0
        for j in range(n):
            a[i * n + j] *= scale[i]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(a[i * n + k]) > abs(a[best * n + k]):
                best = i
        pivots[k] = best
        if best != k:
            swap(a[k * n :], a[best * n :], n)
        pivot = a[k * n + k]
        if pivot == 0.0 or not isfinite(pivot):
            return False
        for i in range(k + 1, n):
            if a[i * n + k] != 0.0:
                by = a[i * n + k] / pivot
                a[i * n + k] = by
                for j in range(k + 1, n):
                    a[i * n + j] -= by * a[k * n + j]
    for i in range(n * n):
        if not isfinite(a[i]):
            return False
    return True


def factorise_complex(s: Stepper) -> bool:
    """False if the matrix is singular."""
    n = s.n
    re = s.complex_re
    im = s.complex_im
    for i in range(n):
        largest = 0.0
        for j in range(n):
            largest = max(largest, sqrt(re[i * n + j] * re[i * n + j] + im[i * n + j] * im[i * n + j]))
        s.complex_scale[i] = 1.0 / largest if largest > 0.0 and isfinite(largest) else 1.0
        for j in range(n):
            re[i * n + j] *= s.complex_scale[i]
            im[i * n + j] *= s.complex_scale[i]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(re[i * n + k]) + abs(im[i * n + k]) > abs(re[best * n + k]) + abs(im[best * n + k]):
                best = i
        s.complex_pivots[k] = best
        if best != k:
            swap(re[k * n :], re[best * n :], n)
            swap(im[k * n :], im[best * n :], n)
        pr = re[k * n + k]
        pi = im[k * n + k]
        size = pr * pr + pi * pi
        if size == 0.0 or not isfinite(size):
            return False
        for i in range(k + 1, n):
            ar = re[i * n + k]
            ai = im[i * n + k]
            if ar != 0.0 or ai != 0.0:
                br = (ar * pr + ai * pi) / size
                bi = (ai * pr - ar * pi) / size
                re[i * n + k] = br
                im[i * n + k] = bi
                for j in range(k + 1, n):
                    re[i * n + j] -= br * re[k * n + j] - bi * im[k * n + j]
                    im[i * n + j] -= br * im[k * n + j] + bi * re[k * n + j]
    for i in range(n * n):
        if not isfinite(re[i]) or not isfinite(im[i]):
            return False
    return True


def swap(a: Floats, b: Floats, n: int) -> None:
    """Two rows change places."""
    for j in range(n):
        kept = a[j]
        a[j] = b[j]
        b[j] = kept


def solve_real(s: Stepper, x: Floats) -> None:
    """The solution in the place of the right side."""
    if s.sparse != 0:
        real_back(s.pattern, x)
    else:
        back(s.n, s.real, s.real_scale, s.real_pivots, x)


def back(n: int, a: Floats, scale: Floats, pivots: Ints, x: Floats) -> None:
    """The same for what `eliminate` made."""
    for i in range(n):
        x[i] *= scale[i]
    for k in range(n):
        best = pivots[k]
        if best != k:
            kept = x[k]
            x[k] = x[best]
            x[best] = kept
    for i in range(n):
        total = x[i]
        for j in range(i):
            total -= a[i * n + j] * x[j]
        x[i] = total
    for i in range(n - 1, -1, -1):
        total = x[i]
        for j in range(i + 1, n):
            total -= a[i * n + j] * x[j]
        x[i] = total / a[i * n + i]


def solve_complex(s: Stepper, xr: Floats, xi: Floats) -> None:
    """The solution in the place of the right side."""
    if s.sparse != 0:
        complex_back(s.pattern, xr, xi)
        return
    n = s.n
    re = s.complex_re
    im = s.complex_im
    for i in range(n):
        xr[i] *= s.complex_scale[i]
        xi[i] *= s.complex_scale[i]
    for k in range(n):
        best = s.complex_pivots[k]
        if best != k:
            swap(xr[k:], xr[best:], 1)
            swap(xi[k:], xi[best:], 1)
    for i in range(n):
        tr = xr[i]
        ti = xi[i]
        for j in range(i):
            tr -= re[i * n + j] * xr[j] - im[i * n + j] * xi[j]
            ti -= re[i * n + j] * xi[j] + im[i * n + j] * xr[j]
        xr[i] = tr
        xi[i] = ti
    for i in range(n - 1, -1, -1):
        tr = xr[i]
        ti = xi[i]
        for j in range(i + 1, n):
            tr -= re[i * n + j] * xr[j] - im[i * n + j] * xi[j]
            ti -= re[i * n + j] * xi[j] + im[i * n + j] * xr[j]
        pr = re[i * n + i]
        pi = im[i * n + i]
        size = pr * pr + pi * pi
        xr[i] = (tr * pr + ti * pi) / size
        xi[i] = (ti * pr - tr * pi) / size
