"""Machine code as functions of numpy arrays with leading axes, as in every target. Calls release the interpreter's lock."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from math import prod
from struct import Struct
from typing import Any

import numpy as np

from ...jit.machine import MachineCode, address_of
from ..program import HybridNote, Native, Program
from ..program_image import KernelRows, ProgramImage, program_of

ROLES = ("time", "state", "inputs", "constants", "mode")
_POINTER = ctypes.c_void_p
_One = ctypes.CFUNCTYPE(None, ctypes.c_double, *([_POINTER] * 5))
_Many = ctypes.CFUNCTYPE(None, _POINTER, ctypes.c_int64, _POINTER)
_arrays = Struct("=12q").pack  # the record `runtime.BatchArrays`: addresses of the arrays, strides
_NONE = np.zeros(1)
_NOWHERE = address_of(_NONE)  # address of an array without items
_DOUBLE = np.dtype(float)

Function = Callable[..., Any]


def functions(
    described: Sequence[tuple[str, tuple[str, ...], int]], addresses: Mapping[str, int], code: MachineCode
) -> dict[str, Function]:
    """Functions of a program by name."""
    many = _Many(code.address("batch"))
    found = {name: _function(addresses[name], many, arguments, size, code) for name, arguments, size in described}
    whole = [(name, size) for name, arguments, size in described if arguments == ROLES]
    return found | {name: _at_once(addresses[name], many, found[name], size) for name, size in whole}


def hand_over(code: MachineCode, rows: KernelRows) -> None:
    """Write the addresses of the rows that kernels read into the code. The rows live as long as the code."""
    arrays = np.frombuffer(rows.streams, dtype=np.int32), np.frombuffer(rows.numbers + bytes(8), dtype=float)
    ctypes.CFUNCTYPE(None, _POINTER, _POINTER)(code.address(f"bind_{rows.suffix}"))(*map(address_of, arrays))
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
    """Function that returns the mode from the conditions on time and on states, with discrete variables at their start."""
    places = [condition.position for condition in note.conditions]
    strict = np.array([condition.strict for condition in note.conditions], dtype=bool)

    def evaluate(time: Any, state: Any, inputs: Any, constants: Any) -> Any:
        leading = np.broadcast_shapes(np.shape(time), *(np.shape(a)[:-1] for a in (state, inputs, constants)))
        mode = np.zeros((*leading, note.size))
        mode[..., : len(note.modes.names)] = found["mode_start"](constants)
        mode[..., list(note.timed)] = found["switches"](time, constants)
        for _ in places:  # a condition may depend on another
            roots = found["roots"](time, state, inputs, constants, mode)
            mode[..., places] = (roots < 0) | ((roots == 0) & ~strict)
            if note.counted:
                mode[..., list(note.counted)] = found["counts"](time, state, inputs, constants, mode)
        return mode

    return evaluate


def _function(address: int, many: Any, arguments: Sequence[str], size: int, code: MachineCode) -> Function:
    """One function. An argument that it does not take is passed as zero."""
    one = _One(address)
    places = [ROLES.index("constants" if a == "parameters" else a) for a in arguments]
    timed, count = 0 in places, len(places)
    nothing = address_of(_NONE)

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
                    pointers[place] = address_of(value)
            else:
                out = np.empty(size)
                one(given[0] if timed else 0.0, *pointers[1:], address_of(out))
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
        one(float(arrays[0]) if timed else 0.0, *map(address_of, arrays[1:]), address_of(out))
        return out

    evaluate.code = code  # type: ignore[attr-defined]  # keeps the machine code in memory
    return evaluate


def _at_once(address: int, many: Any, otherwise: Function, size: int) -> Function:
    """Function of all arguments, fast for one instant and for several instants with a state each, or also inputs. `otherwise` does all other calls."""
    one, at = _One(address), ctypes.addressof
    view: Callable[[Any], Any] = (ctypes.c_char * 0).from_buffer
    # inputs and constants of the last call for one instant, with views: most share them
    last: tuple[Any, ...] = (None,) * 4

    def evaluate(time: Any, state: Any, inputs: Any, constants: Any, mode: Any) -> Any:
        if not (
            type(state) is type(inputs) is type(constants) is type(mode) is np.ndarray
            and constants.ndim == mode.ndim == 1
            and state.dtype is inputs.dtype is constants.dtype is mode.dtype is _DOUBLE
        ):
            return otherwise(time, state, inputs, constants, mode)
        single = state.ndim == inputs.ndim == 1 and (type(time) is float or not np.ndim(time))
        several = not single and _is_plain(time) and state.ndim == 2 and len(state) == len(time)
        if not single and not (several and (inputs.ndim == 1 or inputs.shape[:-1] == time.shape)):
            return otherwise(time, state, inputs, constants, mode)
        out = np.empty(size if single else (len(time), size))
        try:
            if several:
                places = [at(view(a)) if a.size else _NOWHERE for a in (state, inputs, constants, mode, out)]
                by_row = inputs.shape[1] if inputs.ndim > 1 else 0
                many(address, len(time), _arrays(at(view(time)), *places, 1, state.shape[1], by_row, 0, 0, size))
                return out
            nonlocal last
            fixed = last
            if fixed[0] is not inputs or fixed[1] is not constants:
                fixed = last = inputs, constants, view(inputs), view(constants)
            one(time, view(state), *fixed[2:], view(mode), view(out))
        except TypeError:  # not contiguous, or not to be written
            return otherwise(time, state, inputs, constants, mode)
        return out

    return evaluate


def _is_plain(time: Any) -> bool:
    """Return True for a non-empty 1-D array of times in doubles."""
    return type(time) is np.ndarray and time.ndim == 1 and time.dtype is _DOUBLE and time.size > 0


def _batch(address: int, many: Any, arrays: list[Any], size: int) -> Any:
    """Evaluate the function at every point of the leading axes."""
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
    many(address, prod(shape), _arrays(*map(address_of, flat), address_of(out), *strides, size))
    return out


def bind(image: ProgramImage, codes: Sequence[bytes]) -> Program:
    """Program from its data and object code."""
    machine = MachineCode(*codes)
    for rows in image.rows:
        hand_over(machine, rows)
    native = Native(machine.addresses(name for name, _, _ in image.functions), machine)
    found = functions(image.functions, native.addresses, machine)
    count = len(image.names["STATES"].names) + len(image.names["UNKNOWNS"].names)
    pattern = tuple(np.array(part, dtype=int) for part in image.pattern)
    found["jacobian"] = dense(found["jacobian_entries"], pattern, count)
    if image.hybrid is not None:
        found["mode_at"] = mode_at(image.hybrid, found)
    return program_of(image, found, native)
