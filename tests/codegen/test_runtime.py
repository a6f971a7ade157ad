"""Functions of the runtime as plain Python, and calls of machine code through functions of Python in its place."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from compiler.codegen.llvm import runtime
from compiler.codegen.llvm.evaluate import ROLES, dense, functions, hand_over, mode_at


@pytest.mark.parametrize("x", [-8.0, -1.5, 0.0, 0.3, 27.0])
@pytest.mark.parametrize("n", [1.0, 3.0, 5.0, -1.0, -3.0])
def test_an_odd_root_is_that_of_the_sign(x: float, n: float) -> None:
    if x == 0.0 and n < 0:  # a pole
        return
    found = runtime.root(x, n)
    assert found**n == pytest.approx(x, rel=1e-14) and math.copysign(1, found) == math.copysign(1, x)


@pytest.mark.parametrize("n", [2.0, 4.0, 0.0, -2.0])
def test_an_even_root_is_not_defined(n: float) -> None:
    assert math.isnan(runtime.root(4.0, n))


def test_a_root_that_is_no_whole_number_is_a_power() -> None:
    assert runtime.root(4.0, 0.5) == pytest.approx(16.0, rel=1e-15)
    assert runtime.root(2.0, 2.5) == pytest.approx(2**0.4, rel=1e-15)
    assert runtime.root(3.0, math.inf) == 1.0


@pytest.mark.parametrize("strides", [(1, 2, 3, 1, 2), (0, 0, 0, 0, 0), (1, 0, 3, 0, 1)])
def test_a_batch_passes_each_point_what_begins_there(strides: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    arrays = [rng.normal(size=20) for _ in range(5)]
    out = np.zeros(8)

    def function(time: float, *given: Any) -> None:
        *rest, result = given
        result[0], result[1] = time, sum(a[0] for a in rest)

    names = ("times", "states", "inputs", "constants", "modes")
    by = ("by_time", "by_state", "by_inputs", "by_constants", "by_mode")
    record = SimpleNamespace(
        **dict(zip(names, arrays, strict=True)), **dict(zip(by, strides, strict=True)), out=out, size=2
    )
    runtime.batch(function, 3, cast(Any, record))
    expected = [
        [arrays[0][i * strides[0]], sum(a[i * s] for a, s in zip(arrays[1:], strides[1:], strict=True))]
        for i in range(3)
    ]
    assert out.reshape(4, 2).tolist() == [*expected, [0.0, 0.0]]


# ---------------------------------------------------------------- functions of arrays
ONE = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.POINTER(ctypes.c_double)] * 5)
MANY = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.POINTER(ctypes.c_int64))
SIZE = 2


class Code:
    """Functions of Python at addresses, as machine code has them; each result is 1000*time + sums of the first items."""

    def __init__(self) -> None:
        self.batches = 0
        self.one, self.many = ONE(self._one), MANY(self._many)

    @staticmethod
    def _one(time: float, *given: Any) -> None:
        *arrays, out = given
        out[0] = 1000 * time + sum(10**-i * a[0] for i, a in enumerate(arrays))
        out[1] = -out[0]

    def _many(self, address: int, count: int, record: Any) -> None:
        self.batches += 1
        assert address == self.at(self.one)
        places, strides = record[:6], [*record[6:11], record[11]]
        for i in range(count):
            moved = [p + 8 * i * s for p, s in zip(places, strides, strict=True)]
            time, *rest = (ctypes.cast(m, ctypes.POINTER(ctypes.c_double)) for m in moved)
            self._one(time[0], *rest)

    @staticmethod
    def at(function: Any) -> int:
        found = ctypes.cast(function, ctypes.c_void_p).value
        assert found is not None
        return found

    def address(self, name: str) -> int:
        assert name == "batch"
        return self.at(self.many)

    def function(self, roles: Sequence[str]) -> Callable[..., Any]:
        described = [("f", tuple(roles), SIZE)]
        return functions(described, {"f": self.at(self.one)}, cast(Any, self))["f"]


def expected(roles: Sequence[str], given: Sequence[Any]) -> Any:
    """The same results by numpy's own broadcasting; an argument that is not taken counts as zero."""
    total: Any = 0.0
    for role, value in zip(roles, given, strict=True):
        place = ROLES.index("constants" if role == "parameters" else role)
        array = np.asarray(value, dtype=float)
        total = total + (1000 * array if place == 0 else 10.0 ** (1 - place) * array[..., 0])
    return np.stack([total, -total], axis=-1)


NUMBERS = np.random.default_rng(3).normal(size=(4, 5, 3))
POINT, ROWS, GRID = NUMBERS[0, 0], NUMBERS[0], NUMBERS
TIMES = np.array([0.5, 1.5, 2.5, 3.5, 4.5])
FULL: dict[str, tuple[tuple[Any, ...], int]] = {
    "one point": ((2.0, POINT, POINT + 1, POINT + 2, POINT + 3), 0),
    "an int as time": ((2, POINT, POINT + 1, POINT + 2, POINT + 3), 0),
    "a number of numpy as time": ((np.float64(2.0), POINT, POINT + 1, POINT + 2, POINT + 3), 0),
    "an array of no axes as time": ((np.array(2.0), POINT, POINT + 1, POINT + 2, POINT + 3), 0),
    "lists": ((2.0, [1.0, 2.0], [3.0], [4.0], [5.0]), 0),
    "integers": ((2.0, np.array([1, 2]), POINT, POINT, POINT), 0),
    "gaps": ((2.0, ROWS[:, 0], ROWS[:, 1], POINT[::2], POINT[::-1]), 0),
    "times with a state each": ((TIMES, ROWS, POINT, POINT + 1, POINT + 2), 1),
    "times in gaps": ((np.repeat(TIMES, 2)[::2], ROWS, POINT, POINT + 1, POINT + 2), 1),
    "states in gaps": ((TIMES, GRID[0, :, ::2], POINT, POINT + 1, POINT + 2), 1),
    "one state for all times": ((TIMES, POINT, POINT, POINT + 1, POINT + 2), 1),
    "one time for all states": ((1.5, ROWS, POINT, POINT + 1, POINT + 2), 1),
    "all with an axis": ((TIMES, ROWS, ROWS + 1, ROWS + 2, ROWS + 3), 1),
    "a grid": ((TIMES, GRID, ROWS, POINT, GRID + 2), 1),
    "axes that are stretched": ((TIMES[:1], GRID, GRID[:, :1], ROWS[:1], POINT), 1),
    "a square grid": ((TIMES[:4], GRID[:, :4], POINT, POINT + 1, POINT + 2), 1),
    "inputs with an axis": ((TIMES, ROWS, ROWS + 1, POINT, POINT + 2), 1),
    "inputs with an axis at one point": ((2.0, POINT, ROWS, POINT, POINT), 1),
    "times alone": ((TIMES, POINT, POINT, POINT, POINT), 1),
    "one time of an array": ((TIMES[:1], ROWS[:1], POINT, POINT, POINT), 1),
}  # fmt: skip


@pytest.mark.parametrize("name", FULL)
def test_a_function_of_all_arguments_broadcasts_as_numpy_does(name: str) -> None:
    code, (given, batches) = Code(), FULL[name]
    found, wanted = code.function(ROLES)(*given), expected(ROLES, given)
    assert found.shape == wanted.shape and found == pytest.approx(wanted, rel=1e-14)
    assert code.batches == batches


@pytest.mark.parametrize(
    ("roles", "given", "batches"),
    [
        (("parameters",), (POINT,), 0),
        (("parameters",), ([1.0, 2.0],), 0),
        (("parameters",), (ROWS,), 1),
        (("parameters",), (GRID[:, 0],), 1),
        (("time", "constants"), (2.0, POINT), 0),
        (("time", "constants"), (2, POINT), 0),
        (("time", "constants"), (TIMES, POINT), 1),
        (("time", "constants"), (TIMES, ROWS), 1),
        (("time", "constants"), (2.0, GRID), 1),
        (("state", "constants"), (POINT, POINT[::2]), 0),
        (("state", "constants"), (ROWS, POINT), 1),
    ],
)
def test_a_function_of_some_arguments_gets_zero_for_the_others(
    roles: tuple[str, ...], given: tuple[Any, ...], batches: int
) -> None:
    code = Code()
    function = code.function(roles)
    found, wanted = function(*given), expected(roles, given)
    assert found.shape == wanted.shape and found == pytest.approx(wanted, rel=1e-14)
    assert code.batches == batches
    with pytest.raises(TypeError, match=f"{len(roles)} arguments, not {len(roles) + 1}"):
        function(*given, 1.0)


def test_no_instants_have_no_results() -> None:
    assert Code().function(ROLES)(TIMES[:0], ROWS[:0], POINT, POINT, POINT).shape == (0, SIZE)


def test_a_dense_matrix_has_its_entries_in_their_places() -> None:
    matrix = dense(lambda *given: np.asarray(given[1]), (np.array([0, 2, 1]), np.array([1, 2, 0])), 3)
    assert matrix(0.0, POINT, None, None, None).tolist() == [[0, POINT[0], 0], [POINT[2], 0, 0], [0, 0, POINT[1]]]
    many = matrix(0.0, GRID, None, None, None)
    assert many.shape == (4, 5, 3, 3) and many[2, 3].tolist() == matrix(0.0, GRID[2, 3], None, None, None).tolist()
    assert np.count_nonzero(many) == GRID.size


def test_a_mode_is_that_of_its_conditions() -> None:
    """One discrete variable, a condition on time, then two on states: the second holds at zero, and asks the first."""
    conditions = [SimpleNamespace(position=2, strict=True), SimpleNamespace(position=3, strict=False)]
    note = SimpleNamespace(conditions=conditions, size=4, modes=SimpleNamespace(names=("n",)), timed=(1,), counted=())

    def roots(time: Any, state: Any, inputs: Any, constants: Any, mode: Any) -> Any:
        return np.stack([state[..., 0], np.where(mode[..., 2] == 1, state[..., 1], 1.0)], axis=-1)

    found: dict[str, Any] = {
        "mode_start": lambda constants: constants[..., :1],
        "switches": lambda time, constants: np.asarray(time)[..., None] - 1,
        "roots": roots,
    }
    mode = mode_at(cast(Any, note), found)
    nothing, seven = np.zeros(0), np.array([7.0])
    for state, expected in (
        ((-1.0, -1.0), (1, 1)),
        ((-1.0, 0.0), (1, 1)),
        ((-1.0, 1.0), (1, 0)),
        ((0.0, -1.0), (0, 0)),
        ((1.0, -1.0), (0, 0)),
    ):
        assert mode(3.0, np.array(state), nothing, seven).tolist() == [7.0, 2.0, *expected]
    states = np.array([[[-1.0, 0.0], [1.0, 0.0]]])
    assert mode(3.0, states, nothing, seven).tolist() == [[[7.0, 2.0, 1, 1], [7.0, 2.0, 0, 0]]]
    many = mode(np.array([3.0, 5.0]), np.array([[-1.0, 0.0], [1.0, 0.0]]), nothing, seven)
    assert many.tolist() == [[7.0, 2.0, 1, 1], [7.0, 4.0, 0, 0]]


def test_rows_of_kernels_are_handed_over_by_their_addresses() -> None:
    """A number of zero bits follows the numbers, so that an empty list has an address, too."""
    streams, numbers = np.array([3, -1, 7], dtype=np.int32), np.array([0.5, -2.0])
    bound: list[Any] = []

    def bind(first: Any, second: Any) -> None:
        bound.append((first[:3], second[:3]))

    pointers = ctypes.POINTER(ctypes.c_int32), ctypes.POINTER(ctypes.c_double)
    function = ctypes.CFUNCTYPE(None, *pointers)(bind)
    kept: list[Any] = []
    addresses = {"bind_3": Code.at(function)}
    code = SimpleNamespace(address=addresses.__getitem__, keep=kept.append)
    hand_over(
        cast(Any, code), cast(Any, SimpleNamespace(streams=streams.tobytes(), numbers=numbers.tobytes(), suffix="3"))
    )
    assert bound == [([3, -1, 7], [0.5, -2.0, 0.0])]
    ((first, second),) = kept
    assert first.tolist() == [3, -1, 7] and second.tolist() == [0.5, -2.0, 0.0]
