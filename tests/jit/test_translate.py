"""The subset of Python as machine code: the same numbers, bit by bit, as the same source run by Python."""

from __future__ import annotations

import ctypes
import importlib
import math
from collections.abc import Callable
from math import copysign, floor, isfinite, isnan, pow, sqrt, ulp
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("llvmlite")

from compiler.jit.arrays import Record
from compiler.jit.kinds import TranslationError
from compiler.jit.machine import MachineCode, object_code
from compiler.jit.translate import translate
from compiler.jit.values import Choices

if TYPE_CHECKING:
    from compiler.jit.arrays import Floats, Ints

WEIGHTS, ORDER = (0.5, 1.5, -2.0), (2, 0, 1)
FACTOR = 3.0


class Sums(Record):
    n: int
    total: float
    values: Floats
    order: Ints


def weighted(x: Floats, n: int) -> float:
    total = 0.0
    for i in range(n):
        total += WEIGHTS[ORDER[i % 3]] * x[i]
    return total


def gather(s: Sums) -> int:
    """Loops forwards and backwards, fields, slices, a call."""
    count = 0
    for i in range(s.n - 1, -1, -1):
        if s.values[s.order[i]] < 0.0:
            continue
        if count >= 4:
            break
        s.total += s.values[s.order[i]] / FACTOR
        count += 1
    k = 0
    while k < s.n and s.values[k] != 0.0:
        s.values[k] *= -1.0
        k += 1
    s.total -= weighted(s.values[1:], s.n - 1)
    return count * 10 + k


def arithmetic(a: float, b: float) -> float:
    whole = int(a)
    x = abs(a) + max(a, b, 1.0) - min(a, 2.0 * b) + float(whole // 3 + abs(whole) % 4)
    if isnan(a) or not isfinite(b):
        return -1.0
    y = sqrt(abs(b)) * copysign(2.0, a) + floor(b) + pow(abs(a), 0.25) + ulp(a)
    return x / y if y != 0.0 and x != 0.0 else (-x if a < b <= 1.0 else 2.0**-52)


def bits(a: int, b: int) -> int:
    z = (a ^ (a >> 30)) * b & 0xFFFFFFFFFFFFFFFF
    return (z ^ (z >> 27)) & 0xFFFFFFFFFFFF


def loaded(function: Callable[..., Any], result: Any, *kinds: Any) -> Callable[..., Any]:
    code = MachineCode(object_code(translate([function]), 2))
    found = ctypes.CFUNCTYPE(result, *kinds)(code.address(function.__name__))
    found.code = code  # type: ignore[attr-defined]
    return found


@pytest.mark.parametrize("level", [0, 2])
def test_arrays_records_and_loops(level: int) -> None:
    code = MachineCode(object_code(translate([gather]), level))

    class Record(ctypes.Structure):
        _fields_ = (
            ("n", ctypes.c_int64),
            ("total", ctypes.c_double),
            ("values", ctypes.c_void_p),
            ("order", ctypes.c_void_p),
        )

    generator = np.random.default_rng(3)
    for n in range(1, 12):
        values = generator.normal(size=n)
        values[generator.integers(n)] = 0.0
        order = generator.permutation(n)
        here, there = values.copy(), values.copy()
        python = Sums(n=n, total=0.125, values=here, order=order)
        record = Record(n, 0.125, there.ctypes.data, order.ctypes.data)
        answer = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(code.address("gather"))(ctypes.addressof(record))
        assert answer == gather(python) and record.total == python.total
        assert here.tolist() == there.tolist()


def test_arithmetic() -> None:
    compiled = loaded(arithmetic, ctypes.c_double, ctypes.c_double, ctypes.c_double)
    generator = np.random.default_rng(1)
    cases = [
        *generator.normal(size=(200, 2)).tolist(),
        (0.0, 0.0),
        (-0.0, 1.0),
        (3.0, 3.0),
        (7.9, -1e-300),
        (9.0, math.inf),
        (math.nan, 1.0),
    ]
    for a, b in cases:
        if isnan(a):
            assert compiled(a, b) == -1.0
        elif a >= 0 or a == int(a):  # // of whole numbers goes towards zero in machine code
            assert compiled(a, b) == arithmetic(a, b), (a, b)


def test_whole_numbers_have_64_bits() -> None:
    compiled = loaded(bits, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)
    generator = np.random.default_rng(1)
    for a, b in generator.integers(0, 2**62, size=(50, 2)).tolist():
        assert compiled(a, b) == bits(a, b)


def unknown_name(x: float) -> float:
    return x + nowhere  # type: ignore[name-defined]  # noqa: F821


def a_list(x: float) -> float:
    y = [x]
    return y[0]


def a_power(x: float) -> float:
    return x**2.5


def mixed(x: float) -> int:
    return x  # type: ignore[return-value]


def no_value(x: float) -> float:  # type: ignore[return]  # noqa: RET503
    if x > 0.0:
        return x


@pytest.mark.parametrize("function", [unknown_name, a_list, a_power, mixed, no_value])
def test_what_is_outside_of_the_subset_is_told(function: Callable[..., Any]) -> None:
    with pytest.raises(TranslationError, match=function.__name__):
        translate([function])


def test_a_file_that_has_changed_since_it_was_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its lines would be those of another function."""
    file = tmp_path / "scaled_by_two.py"
    file.write_text(
        "def first(x: float) -> float:\n    return x\n\n\ndef scaled(x: float, y: float) -> float:\n    return 2.0 * x * y\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    scaled = importlib.import_module("scaled_by_two").scaled
    assert "fmul" in translate([scaled])
    file.write_text("\n\n\n\n" + file.read_text())
    with pytest.raises(TranslationError, match="has changed since"):
        translate([scaled])


YES, NO = True, False


def doubled(x: float, n: int) -> float:
    return 2.0 * x + n


def tripled(x: float, n: int) -> float:
    return 3.0 * x - n


def whole(x: float) -> int:
    return int(x)


CHOICE, UNEQUAL = (doubled, tripled, doubled), (doubled, whole)


def chosen(x: float, n: int) -> float:
    return CHOICE[n](x, n) if YES else -1.0


def truths(n: int, m: int) -> int:
    """Whole numbers as conditions."""
    count = 0
    while n:
        n -= 1
        count += 10
    if (m and count) or NO:
        count += 1
    return count + (2 if not m else 4)


def of_different_types(x: float, n: int) -> float:
    return UNEQUAL[n](x)


def of_no_functions(x: float, n: int) -> float:
    return FACTOR[n](x)  # type: ignore[index, no-any-return]


def a_called_field(s: Sums) -> float:
    return s.n(2.0)  # type: ignore[operator, no-any-return]


def a_float_as_condition(x: float) -> float:
    return 1.0 if x else 2.0


def the_last_item(x: Floats) -> float:
    return x[-1]


def test_a_tuple_of_functions_is_called_by_a_number() -> None:
    """Any number beyond the last calls the last."""
    compiled = loaded(chosen, ctypes.c_double, ctypes.c_double, ctypes.c_int64)
    assert [compiled(1.25, n) for n in range(3)] == [chosen(1.25, n) for n in range(3)] == [2.5, 2.75, 4.5]
    assert [compiled(1.25, n) for n in (7, -1)] == [9.5, 1.5]


def test_whole_numbers_are_conditions() -> None:
    compiled = loaded(truths, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)
    cases = [(n, m) for n in (0, 1, 3) for m in (-2, 0, 1)]
    assert [compiled(*c) for c in cases] == [truths(*c) for c in cases]


@pytest.mark.parametrize(
    ("function", "why"),
    [
        (of_different_types, "`UNEQUAL` is no tuple of functions of one type"),
        (of_no_functions, "`FACTOR` is no tuple of functions of one type"),
        (a_called_field, "only functions can be called"),
        (a_float_as_condition, "not a truth"),
        (the_last_item, "counted from the first"),
    ],
)
def test_what_can_be_neither_called_nor_asked_is_told(function: Callable[..., Any], why: str) -> None:
    with pytest.raises(TranslationError, match=why):
        translate([function])


def halved(x: float, n: int) -> float:
    return 0.5 * x + n


BOTH = doubled, halved


def by_number(x: float, n: int) -> float:
    total = 0.0
    for k in range(n):
        total += BOTH[k % 2](x, k)
    return total


class TestChoices:
    """Parts of a module that are not worth their compilation."""

    @staticmethod
    def compiled(choices: Choices) -> tuple[str, float]:
        text = translate([by_number], choices=choices)
        code = MachineCode(object_code(text, 1))
        function = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double, ctypes.c_int64)(code.address("by_number"))
        return text, function(3.0, 4)

    def test_all(self) -> None:
        text, value = self.compiled(Choices())
        assert value == by_number(3.0, 4) == 2 * (6.0 + 1.5) + 6.0
        assert "llvm.loop" not in text

    def test_a_function_that_no_number_reaches(self) -> None:
        text, value = self.compiled(Choices(frozenset((doubled,))))
        assert value == 4 * 1.5 + 6.0
        assert "@doubled" not in text

    def test_a_function_of_another_module(self) -> None:
        """It answers that it is absent until it is linked."""
        text = translate([by_number], choices=Choices(elsewhere=frozenset((doubled,)), absent=5))
        code, other = MachineCode(object_code(text, 1)), MachineCode(object_code(translate([doubled]), 1))
        function = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double, ctypes.c_int64)(code.address("by_number"))
        assert function(3.0, 4) == 2 * (5.0 + 1.5) + 4.0
        code.link("doubled", other.address("doubled"))
        assert function(3.0, 4) == by_number(3.0, 4)

    def test_loops_that_stay_loops_give_the_same(self) -> None:
        text, value = self.compiled(Choices(vectors=frozenset()))
        assert value == by_number(3.0, 4)
        assert text.count("!llvm.loop") == 1
        assert self.compiled(Choices(vectors=frozenset(("test_translate",))))[0] == translate([by_number])
