"""The subset of Python as C: the same numbers as the same source run by Python."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
from math import isnan, nan
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from compiler.jit.c_source import BEGINNING, c_number, c_source
from compiler.jit.kinds import TranslationError

if TYPE_CHECKING:
    from compiler.jit.arrays import Floats, Ints

COMPILER = shutil.which("gcc") or shutil.which("cc") or ""
WEIGHTS, ORDER, MIXED = (0.5, 1.5, -2.0), (2, 0, 1), (1, 2.5, 3)
FACTOR, MANY, YES = 3.0, 7, True


def weighted(x: Floats, n: int) -> float:
    total = 0.0
    for i in range(n):
        total += WEIGHTS[ORDER[i % 3]] * x[i] + MIXED[ORDER[i % 3]]
    for i in range(n - 1, -1, -1):
        total = FACTOR * total - x[i]
    return total


def again(x: Floats, n: int) -> float:
    return weighted(x[1:], n - 1) + WEIGHTS[0] if YES else nan


def extremes(a: float, b: float, c: float) -> float:
    return 100.0 * min(a, b, c) + 10.0 * max(a, b, c) + min(a, c) + abs(b)


def whole_extremes(a: int, b: int, c: int) -> int:
    """Comparisons of whole numbers beyond 2^53, where doubles do not tell them apart."""
    return min(a, b, c) - max(a, b, c) + min(b, c) + abs(c) - MANY


def shares(a: int, b: int) -> float:
    return a / b + 2.0**3 + float(a) / 4


def hashed(x: int) -> int:
    y = x ^ (x >> 7)
    y = y * 6364136223846793005 + 1442695040888963407
    return (y & 1023) + int(0.9 * FACTOR) - 3 * 2


def stepped(n: int) -> float:
    """Loops with one, two and three bounds, upwards and downwards, also of negative numbers."""
    total = 0.0
    for i in range(-n, n + 2):
        total = 1.5 * total + i
    for i in range(1, n, 2):
        total = 1.25 * total + i
    for i in range(-n, 3, 2):
        total = 1.25 * total + i
    for i in range(n, 1, -2):
        total = 0.75 * total - i
    return total


def compared(a: float, b: float) -> float:
    """A sum of conditions is a whole number, so that a half is lost on its way into one."""
    count = (a < b) + (a <= 2.0)
    count = count + 3
    share = count / 2
    both = max(a < b, b < 0.0)
    return share + both


def chosen(x: float, n: int, out: Floats, places: Ints) -> None:
    """Stores, `if`, `while`, `break`, conditions as values."""
    count = 0
    whole = 1 if n > 2 else MANY
    while True:
        if count >= n or isnan(x):
            break
        if not (count == 1 and x > 0.0):
            out[count] = x if 0.0 < x <= 1.0 else -x
        else:
            out[count] = 9.0
        places[count] = count * whole
        count += 1
    out[n] = max(1, n) / 2


def listed(x: float) -> float:
    return [x][0]


ALL = (weighted, again, extremes, whole_extremes, shares, hashed, stepped, compared, chosen)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Any:
    if not COMPILER:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("c")
    beginning = "#include <math.h>\n#include <stdint.h>\n#include <stdlib.h>\n" + BEGINNING
    (folder / "code.c").write_text(beginning + c_source(ALL), encoding="utf-8")
    flags = ["-O1", "-std=c11", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run([COMPILER, *flags, "code.c", "-o", "code.so", "-lm"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "code.so"))


def run(library: Any, function: Any, *given: Any) -> Any:
    """The value by C."""
    kinds = {float: ctypes.c_double, int: ctypes.c_int64}
    found = getattr(library, function.__name__)
    found.restype = kinds.get({"float": float, "int": int}.get(function.__annotations__["return"]))  # type: ignore[arg-type]
    found.argtypes = [kinds.get(type(v), ctypes.c_void_p) for v in given]
    return found(*(v.ctypes.data if isinstance(v, np.ndarray) else v for v in given))


BIG = 2**53


@pytest.mark.parametrize(
    ("function", "given"),
    [
        (weighted, (np.array([1.0, -2.5, 3.25, 4.0]), 4)),
        (again, (np.array([1.0, -2.5, 3.25, 4.0]), 4)),
        *((extremes, v) for v in ((1.0, 2.0, 3.0), (3.0, 1.0, 2.0), (2.0, -3.0, 1.5), (2.5, 2.5, -1.0))),
        *((whole_extremes, v) for v in ((BIG, BIG + 1, BIG + 3), (BIG + 5, BIG + 1, BIG), (4, -7, 2), (0, 5, -9))),
        (shares, (7, 2)),
        (shares, (-9, 4)),
        (hashed, (123456789,)),
        (stepped, (3,)),
        (stepped, (6,)),
        *((compared, v) for v in ((1.0, 2.0), (2.0, 1.0), (3.0, 4.0), (3.0, -1.0))),
    ],
)
def test_c_has_the_numbers_of_python(library: Any, function: Any, given: tuple[Any, ...]) -> None:
    expected = function(*given)
    assert run(library, function, *given) == (expected if function is not hashed else _wrapped(given[0]))


def _wrapped(x: int) -> int:
    """`hashed` in 64 bits, as machine words have it."""
    y = (x ^ (x >> 7)) * 6364136223846793005 + 1442695040888963407
    return (y % 2**64 & 1023) + 2 - 6


@pytest.mark.parametrize(("x", "n"), [(0.5, 4), (-2.0, 2), (1.0, 3), (math.nan, 2)])
def test_c_stores_what_python_stores(library: Any, x: float, n: int) -> None:
    stored = [(np.zeros(n + 1), np.zeros(n, dtype=np.int64)) for _ in range(2)]
    chosen(x, n, *stored[0])  # type: ignore[arg-type]
    run(library, chosen, x, n, *stored[1])
    for a, b in zip(*stored, strict=True):
        assert a.tolist() == b.tolist()


def test_lists_have_the_type_of_their_items_and_are_written_once() -> None:
    text = c_source([again])
    assert text.count("static const int64_t list_2[] = {2, 0, 1};") == 1
    assert text.count("static const double list_1[] = {0.5, 1.5, (-2.0)};") == 1
    assert text.count("static const double list_3[] = {1.0, 2.5, 3.0};") == 1
    assert text.count("[] = ") == 3
    assert "list_1[list_2[(i % 3)]]" in text and "list_1[0]" in text and "list_3[list_2[(i % 3)]]" in text
    assert (
        "static double weighted(const double *x, int64_t n)" in text
        and "\ndouble again(const double *x, int64_t n)" in text
    )


def test_least_and_largest_follow_the_type() -> None:
    assert "smaller(smaller(a, b), c)" in c_source([extremes]) and "larger(larger(a, b), c)" in c_source([extremes])
    assert "fewer(fewer(a, b), c)" in c_source([whole_extremes]) and "more(more(a, b), c)" in c_source([whole_extremes])
    assert "llabs(c)" in c_source([whole_extremes]) and "fabs(b)" in c_source([extremes])


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.0, "1.0"),
        (0.0, "0.0"),
        (-0.0, "(-0.0)"),
        (-2.5, "(-2.5)"),
        (1e-300, "1e-300"),
        (math.inf, "INFINITY"),
        (-math.inf, "-INFINITY"),
        (math.nan, "NAN"),
    ],
)
def test_numbers_are_exact(value: float, text: str) -> None:
    assert c_number(value) == text


def test_a_sum_of_conditions_is_declared_as_a_whole_number() -> None:
    text = c_source([compared])
    assert "int64_t count = " in text and "double share = " in text and "int64_t both = " in text and "more(" in text


def blocks(to: Floats, source: Floats, n: int) -> float:
    rows = to[n:]
    total = 0.0
    for i in range(n):
        doubled = 2.0 * source[i]
        rows[i] = doubled
    if n > 1:
        last = source[0]
    else:
        last = 0.0
    total += last
    for i in range(n):
        total += weighted(source[i:], 1)
    return total


def test_what_is_only_read_is_constant_and_variables_are_declared_in_their_block() -> None:
    """But not one that two blocks set for what comes behind them."""
    text = c_source([blocks])
    assert (
        "double blocks(double *to, const double *source, int64_t n)" in text
        and "double weighted(const double *x" in text
    )
    assert "    double last;\n    double *rows = (to + n);" in text and "        double doubled = (2.0" in text
    assert text.count("for (int64_t i = 0; i < n; i += 1) {") == 3


def test_what_lies_outside_of_the_subset_is_refused() -> None:
    with pytest.raises(TranslationError, match="List is not in the subset"):
        c_source([listed])
