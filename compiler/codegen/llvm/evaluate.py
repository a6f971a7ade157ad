"""Machine code as functions of numpy arrays with leading axes, as every target has them. Calls run outside of the interpreter's lock."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ...native.machine import MachineCode
from ..program import HybridNote
from .described import Rows

ROLES = ("time", "state", "inputs", "constants", "mode")
_POINTER = ctypes.c_void_p
_One = ctypes.CFUNCTYPE(None, ctypes.c_double, *([_POINTER] * 5))
_Many = ctypes.CFUNCTYPE(None, _POINTER, ctypes.c_int64, *([_POINTER] * 6), *([ctypes.c_int64] * 6))
_NONE = np.zeros(1)
_NOWHERE = _NONE.__array_interface__["data"][0]  # where an array without items may lie
_DOUBLE = np.dtype(float)

Function = Callable[..., Any]


def functions(
    described: Sequence[tuple[str, tuple[str, ...], int]], addresses: Mapping[str, int], code: MachineCode
) -> dict[str, Function]:
    """The functions of a program by name."""
    many = _Many(code.address("batch"))
    found = {name: _function(addresses[name], many, arguments, size, code) for name, arguments, size in described}
    whole = [(name, size) for name, arguments, size in described if arguments == ROLES]
    return found | {name: _at_once(addresses[name], found[name], size) for name, size in whole}


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


def mode_at(note: HybridNote, found: Mapping[str, Function]) -> Function:
    """The mode from the conditions on time and on states, with what only events change as it starts."""
    places = [condition.position for condition in note.conditions]
    strict = np.array([condition.strict for condition in note.conditions], dtype=bool)

    def evaluate(time: Any, state: Any, inputs: Any, constants: Any) -> Any:
        leading = np.broadcast_shapes(np.shape(time), *(np.shape(a)[:-1] for a in (state, inputs, constants)))
        mode = np.zeros((*leading, note.size))
        mode[..., : len(note.modes.names)] = found["mode_start"](constants)
        mode[..., list(note.timed)] = found["switches"](time, constants)
        for _ in places:  # one may be asked under another
            roots = found["roots"](time, state, inputs, constants, mode)
            mode[..., places] = (roots < 0) | ((roots == 0) & ~strict)
        return mode

    return evaluate


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


def _at_once(address: int, otherwise: Function, size: int) -> Function:
    """A function of everything, quickly for one instant; `otherwise` is the same for anything else."""
    one, at = _One(address), ctypes.addressof
    view: Callable[[Any], Any] = ctypes.c_char.from_buffer

    def evaluate(time: Any, state: Any, inputs: Any, constants: Any, mode: Any) -> Any:
        if not type(state) is type(inputs) is type(constants) is type(mode) is np.ndarray:
            return otherwise(time, state, inputs, constants, mode)
        if not state.ndim == inputs.ndim == constants.ndim == mode.ndim == 1 or (
            type(time) is not float and np.ndim(time)
        ):
            return otherwise(time, state, inputs, constants, mode)
        if not state.dtype is inputs.dtype is constants.dtype is mode.dtype is _DOUBLE:
            return otherwise(time, state, inputs, constants, mode)
        out = np.empty(size)
        try:
            places = [at(view(a)) if a.size else _NOWHERE for a in (state, inputs, constants, mode, out)]
        except TypeError:  # not contiguous, or not to be written
            return otherwise(time, state, inputs, constants, mode)
        one(time, *places)
        return out

    return evaluate


def _batch(address: int, many: Any, arrays: list[Any], size: int) -> Any:
    """The function at every point of the leading axes."""
    if _is_plain(arrays):
        count, strides = len(arrays[1]), [1, arrays[1].shape[1], 0, 0, 0]
        out = np.empty((count, size))
        many(address, count, *map(_address, arrays), _address(out), *strides, size)
        return out
    if arrays[0] is not _NONE:
        arrays[0] = np.asarray(arrays[0], dtype=float)[..., None]
    shape = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
    strides = [a.shape[-1] if a.ndim > 1 else 0 for a in arrays]
    flat = [np.ascontiguousarray(np.broadcast_to(a, (*shape, a.shape[-1])) if a.ndim > 1 else a) for a in arrays]
    out = np.empty((*shape, size))
    count = int(np.prod(shape, dtype=int))
    many(address, count, *(_address(a) for a in flat), _address(out), *strides, size)
    return out


def _is_plain(arrays: list[Any]) -> bool:
    """Whether these are so many instants and as many states, and nothing else differs between them."""
    time, state, *others = arrays
    return (
        type(time) is np.ndarray
        and time is not _NONE
        and time.dtype == _DOUBLE
        and time.flags.c_contiguous
        and time.ndim == 1
        and state.ndim == 2
        and len(state) == len(time)
        and all(a.ndim == 1 for a in others)
    )


def _address(array: Any) -> int:
    found: int = array.__array_interface__["data"][0]
    return found
