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

    def evaluate(*given: Any) -> Any:
        arrays: list[Any] = [_NONE] * 5
        single = True
        for place, value in zip(places, given, strict=True):
            if place:
                array = (
                    value if type(value) is np.ndarray and value.dtype == _DOUBLE else np.asarray(value, dtype=float)
                )
                single = single and array.ndim == 1
                arrays[place] = array if array.flags.c_contiguous else np.ascontiguousarray(array)
            else:
                arrays[0] = value
                single = single and np.ndim(value) == 0
        if single:
            out = np.empty(size)
            at = 0.0 if arrays[0] is _NONE else float(arrays[0])
            one(at, *[a.__array_interface__["data"][0] for a in arrays[1:]], out.__array_interface__["data"][0])
            return out
        return _batch(address, many, arrays, size)

    evaluate.code = code  # type: ignore[attr-defined]  # keeps the machine code in memory
    return evaluate


def _batch(address: int, many: Any, arrays: list[Any], size: int) -> Any:
    """The function at every point of the leading axes."""
    if arrays[0] is not _NONE:
        arrays[0] = np.asarray(arrays[0], dtype=float)[..., None]
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
