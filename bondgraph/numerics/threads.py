"""Threads of the linear algebra of numpy and scipy: one for small matrices, where several wait for each other for longer than they compute.

Beside a process that computes, the threads of OpenBLAS, which wait actively, take 2 to 30 times as long as one of them (measured for rows of four-bars).
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

_Arguments = ParamSpec("_Arguments")
_Found = TypeVar("_Found")

LARGE = 400  # order of dense matrices from which several threads gain
NAMES = (  # functions that return and set the number of threads
    ("scipy_openblas_get_num_threads64_", "scipy_openblas_set_num_threads64_"),
    ("scipy_openblas_get_num_threads", "scipy_openblas_set_num_threads"),
    ("openblas_get_num_threads64_", "openblas_set_num_threads64_"),
    ("openblas_get_num_threads", "openblas_set_num_threads"),
    ("MKL_Get_Max_Threads", "MKL_Set_Num_Threads"),
)

_LOCK = threading.Lock()
_held = 0  # number of contexts that are entered
_before: list[tuple[Callable[[int], object], int]] = []  # setters, and numbers of threads outside


class OneThread:
    """Context that holds linear algebra to one thread if no matrix is of a larger order than `LARGE`; several threads of Python may enter. Linux only."""

    def __init__(self, order: int) -> None:
        self._holds = order <= LARGE and sys.platform == "linux"

    def __enter__(self) -> None:
        global _held
        if self._holds:
            with _LOCK:
                _held += 1
                if _held == 1:
                    for get, put in _libraries("scipy.linalg" in sys.modules):
                        if (count := get()) > 1:
                            _before.append((put, count))
                            put(1)

    def __exit__(self, *failed: object) -> None:
        global _held
        if self._holds:
            with _LOCK:
                _held -= 1
                if not _held:
                    _release()


def on_one_thread(call: Callable[_Arguments, _Found]) -> Callable[_Arguments, _Found]:
    """Return the call with linear algebra held to one thread, until it finds that its matrices are large."""

    @wraps(call)
    def held(*values: _Arguments.args, **options: _Arguments.kwargs) -> _Found:
        import scipy.linalg  # noqa: F401  # an analysis needs it, and its library is held too

        with OneThread(0):
            return call(*values, **options)

    return held


def release_for(order: int) -> None:
    """Give linear algebra its threads back, if matrices of this order gain from them."""
    if order > LARGE:
        with _LOCK:
            _release()


def _release() -> None:
    for put, count in _before:
        put(count)
    _before.clear()


@lru_cache
def _libraries(with_scipy: bool) -> tuple[tuple[Callable[[], int], Callable[[int], object]], ...]:
    """Return the functions of each loaded library; `with_scipy`: scipy, which brings another one, is loaded."""
    import ctypes  # on use: a model is loaded without it

    try:
        with open("/proc/self/maps", encoding="utf-8") as maps:
            paths = {line.split(maxsplit=5)[5].strip() for line in maps if "blas" in line or "mkl_rt" in line}
    except (OSError, IndexError):
        return ()
    functions = []
    for path in sorted(paths):
        try:
            library = ctypes.CDLL(path)
        except OSError:
            continue
        for get, put in NAMES:
            if hasattr(library, get) and hasattr(library, put):
                functions.append((getattr(library, get), getattr(library, put)))
                break
    return tuple(functions)
