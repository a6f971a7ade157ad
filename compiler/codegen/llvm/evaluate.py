"""Machine code as functions of numpy arrays with leading axes, as every target has them. Calls run outside of the interpreter's lock."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from math import prod
from typing import Any

import numpy as np

from ...native.machine import MachineCode
from .described import Rows

ROLES = ("time", "state", "inputs", "constants", "mode")
_POINTER = ctypes.c_void_p
_One = ctypes.CFUNCTYPE(None, ctypes.c_double, *([_POINTER] * 5))
_Many = ctypes.CFUNCTYPE(None, _POINTER, ctypes.c_int64, *([_POINTER] * 6), *([ctypes.c_int64] * 6))
_NONE = np.zeros(1)
_DOUBLE = np.dtype(float)

Function = Callable[..., Any]


def functions(
    described: Sequence[tuple[str, tuple[str, ...], int]], addresses: Mapping[str, int], code: MachineCode
) -> dict[str, Function]:
    """The functions of a program by name."""
    many = _Many(code.address("batch"))
    return {name: _function(addresses[name], many, arguments, size, code) for name, arguments, size in described}


def hand_over(code: MachineCode, rows: Rows) -> None:
    """Put the rows that kernels go through where the code finds them; they live as long as it."""
    arrays = np.frombuffer(rows.streams, dtype=np.int32), np.frombuffer(rows.numbers + bytes(8), dtype=float)
    ctypes.CFUNCTYPE(None, _POINTER, _POINTER)(code.address(f"bind_{rows.suffix}"))(*map(_address, arrays))
    code.keep(arrays)


def dense(entries: Function, pattern: Any, count: int) -> Function:
    """The dense matrix from its entries."""

    def jacobian(time: Any, state: Any, inputs: Any, constants: Any, mode: Any) -> Any:
        found = entries(time, state, inputs, constants, mode)
        matrix = np.zeros((*found.shape[:-1], count, count))
        matrix[(..., *pattern)] = found
        return matrix

    return jacobian


def _function(address: int, many: Any, arguments: Sequence[str], size: int, code: MachineCode) -> Function:
    """One function; what it does not take is handed a zero."""
    one = _One(address)
    places = [ROLES.index("constants" if a == "parameters" else a) for a in arguments]
    timed, count = 0 in places, len(places)
    nothing = _address(_NONE)

    def evaluate(*given: Any) -> Any:
        if len(given) != count:
            raise TypeError(f"{count} arguments, not {len(given)}")
        if not timed or isinstance(given[0], float):  # most calls are for one point, and take less time than any care
            pointers = [nothing] * 5
            for place, value in zip(places, given):  # noqa: B905  # counted above
                if place:
                    if (
                        type(value) is not np.ndarray
                        or value.ndim != 1
                        or value.dtype != _DOUBLE
                        or not value.flags.c_contiguous
                    ):
                        break
                    pointers[place] = value.__array_interface__["data"][0]
            else:
                out = np.empty(size)
                one(given[0] if timed else 0.0, *pointers[1:], out.__array_interface__["data"][0])
                return out
        return _in_general(given)

    def _in_general(given: tuple[Any, ...]) -> Any:
        arrays: list[Any] = [_NONE] * 5
        single = True
        for place, value in zip(places, given, strict=True):
            array = np.asarray(value, dtype=float)
            single = single and array.ndim == (1 if place else 0)
            arrays[place] = np.ascontiguousarray(array) if place else array
        if not single:
            return _batch(address, many, arrays, size)
        out = np.empty(size)
        one(float(arrays[0]) if timed else 0.0, *map(_address, arrays[1:]), _address(out))
        return out

    evaluate.code = code  # type: ignore[attr-defined]  # keeps the machine code in memory
    return evaluate


def _batch(address: int, many: Any, arrays: list[Any], size: int) -> Any:
    """The function at every point of the leading axes."""
    if arrays[0] is not _NONE:
        arrays[0] = arrays[0][..., None]
    shapes = {a.shape[:-1] for a in arrays if a.ndim > 1}
    if len(shapes) == 1:  # nothing to broadcast, and no wait for it
        (shape,) = shapes
        flat = [a if a.flags.c_contiguous else np.ascontiguousarray(a) for a in arrays]
    else:
        shape = np.broadcast_shapes(*shapes)
        flat = [np.ascontiguousarray(np.broadcast_to(a, (*shape, a.shape[-1])) if a.ndim > 1 else a) for a in arrays]
    strides = [a.shape[-1] if a.ndim > 1 else 0 for a in arrays]
    out = np.empty((*shape, size))
    many(address, prod(shape), *map(_address, flat), _address(out), *strides, size)
    return out


def _address(array: Any) -> int:
    found: int = array.__array_interface__["data"][0]
    return found
