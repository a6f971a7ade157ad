"""Source of the steps where there is no machine code: its loops as array operations of numpy, its linear algebra by LAPACK and SuperLU."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from compiler.api import Array, Vectorised

from ..linear_algebra import factors, sparse
from ..linear_algebra.factorise import dense
from ..linear_algebra.sparse import FINE, SINGULAR

FEW = 6  # unknowns of a system up to which the loops of the source itself are faster


def interpreted(name: str, unknowns: int, sparse: int) -> Callable[..., Any]:
    """Return a function of the source as it is, or with array operations, which is faster for more unknowns, and has sparse factors without a pattern."""
    from .sources import SOURCES

    return SOURCES[name] if unknowns <= FEW and not sparse else _vectorised()[SOURCES[name]]


@lru_cache
def _vectorised() -> Vectorised:
    return Vectorised(__package__.rpartition(".")[0], {
        factors.eliminate: _eliminate, factors.eliminate_complex: _eliminate_complex, factors.back: _back,
        factors.back_complex: _back_complex, factors.is_negative: lambda f: int(f.solved.negative),
        sparse.real_factors: _real_factors, sparse.complex_factors: _complex_factors, sparse.real_back: _back,
        sparse.complex_back: _back_complex,
    })  # fmt: skip


# ------------------------------------------------------------ `factors.py` by LAPACK
def _eliminate(f: Any) -> bool:
    f.solved = dense(f.matrix.reshape(f.n, f.n))
    return f.solved is not None


def _eliminate_complex(f: Any) -> bool:
    f.solved_complex = dense((f.re + 1j * f.im).reshape(f.n, f.n))
    return f.solved_complex is not None


def _back(f: Any, x: Array) -> None:
    x[: f.n] = f.solved.solve(x[: f.n])


def _back_complex(f: Any, xr: Array, xi: Array) -> None:
    found = f.solved_complex.solve(xr[: f.n] + 1j * xi[: f.n])
    xr[: f.n], xi[: f.n] = found.real, found.imag


# ------------------------------------------------------------ `sparse.py` by SuperLU
def _real_factors(p: Any, shift: float, entries: Array) -> int:
    try:
        p.solved = p.shifted_by(shift, entries)
    except (RuntimeError, ValueError):
        return SINGULAR
    return FINE


def _complex_factors(p: Any, re: float, im: float, entries: Array) -> int:
    try:
        p.solved_complex = p.shifted_by(complex(re, im), entries)
    except (RuntimeError, ValueError):
        return SINGULAR
    return FINE
