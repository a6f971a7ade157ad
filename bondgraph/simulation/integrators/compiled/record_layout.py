"""Record layout: records of machine code in one block of memory, whose layout is computed once for a program and cached with it.

A record of the stepper has more than a hundred fields, most of them work arrays of known size. Created one by one for each run they would cost more
than the steps of a small model. So a run takes a block of zeros, copies the words that are the same for all runs into it, and writes its own values.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from compiler.api import INTS, Array, Fields, Handed, Program, address_of, record_of

from .code import POINTER, WHOLE, called, function_address

WORD = 8  # bytes
UNINTERRUPTED = 8  # records in a call of machine code, during which Python can neither interrupt it nor hold it up
_WHOLE, _DOUBLE = np.dtype(np.int64), np.dtype(float)
_C_TYPES = {"double": ctypes.c_double, "i64": ctypes.c_int64}


class RecordLayout:
    """Layout of the fields of a record, and the values common to all records of its kind.

    `values`: numbers, initial arrays, of which each record gets a copy, and nested records; a field that is not in it is set per record. `addresses`:
    those of functions.
    """

    def __init__(self, noun: type, values: Mapping[str, Any], addresses: Mapping[str, int]) -> None:
        self.addresses = addresses
        fields = record_of(noun).fields
        self.structure = _layout(noun)
        self.places = {name: (place, kind) for place, (name, kind) in enumerate(fields.items())}
        self.lacking = frozenset(n for n, kind in fields.items() if n not in values and not isinstance(kind, Handed))
        words: list[int] = []
        inside: list[int] = []  # indices of words that are addresses within the block
        arrays: list[tuple[int, str, Any]] = []
        self.functions: list[tuple[int, str]] = []  # indices of words that are addresses of functions, and their fields
        self._lay(fields, values, words, inside, arrays)
        arrays.sort(key=lambda item: not item[2].any())  # nonzero arrays first: the rest of a block is zeros
        own = [np.ravel(a).view(np.int64) for _, _, a in arrays if a.any()]
        size = len(words)
        self.views: dict[str, tuple[int, int, bool]] = {}  # its own arrays: place, length, True for integers
        for at, name, array in arrays:
            words[at] = WORD * size
            self.views[name] = size, array.size, array.dtype == _WHOLE
            size += array.size
        self.head = np.concatenate([np.array(words, dtype=np.int64), *own])
        self.inside, self.size = np.array(inside, dtype=int), size + 1

    def _lay(
        self, fields: Mapping[str, Any], values: Mapping[str, Any], words: list[int], inside: list[int], arrays: list[tuple[int, str, Any]],
        within: str = "",
    ) -> int:  # fmt: skip
        """Lay out the words of a record and of its nested records; return its place."""
        place = len(words)
        words += [0] * len(fields)
        for at, (name, kind) in enumerate(fields.items(), place):
            if isinstance(kind, Handed):
                self.functions.append((at, name))
                words[at] = self.addresses.get("jacobian_entries" if name == "entries" else name, 0)
            elif name not in values:
                continue
            elif isinstance(kind, Fields):
                words[at] = WORD * self._lay(kind.fields, values[name], words, inside, arrays, f"{within}{name}.")
                inside.append(at)
            elif kind in _C_TYPES:
                number = np.array(values[name], dtype=float if kind == "double" else np.int64)
                words[at] = int(number.view(np.int64))
            else:
                array = np.ascontiguousarray(values[name], dtype=_WHOLE if kind == INTS else _DOUBLE)
                arrays.append((at, within + name, array))
                inside.append(at)
        return place


class RecordArray:
    """A record in a separate block; arrays and numbers by the names of its fields. `given` values are pointed to, not copied."""

    def __init__(self, form: RecordLayout, given: Mapping[str, Any]) -> None:
        if not given.keys() >= form.lacking:
            raise KeyError(f"not given: {', '.join(sorted(form.lacking - given.keys()))}")
        self._form = form
        numbers: Any = np.zeros(form.size)
        self._numbers = numbers
        self._words = self._numbers.view(np.int64)
        self.address: int = address_of(numbers)
        self._words[: len(form.head)] = form.head
        self._words[form.inside] += self.address
        self._arrays: dict[str, Any] = {}
        self.record = form.structure.from_buffer(self._numbers)
        self.put(given)

    def put(self, values: Mapping[str, Any]) -> None:
        """Set fields: numbers are copied, arrays and records are pointed to."""
        places, words = self._form.places, self._words
        for name, value in values.items():
            place, kind = places[name]
            if kind == "double":
                self._numbers[place] = value
            elif kind == "i64":
                words[place] = value
            elif isinstance(kind, Fields):
                words[place] = value.address
                self._arrays[name] = value
            else:
                dtype = _WHOLE if kind == INTS else _DOUBLE
                if type(value) is not np.ndarray or value.dtype != dtype or not value.flags.c_contiguous:
                    value = np.ascontiguousarray(value, dtype=dtype)
                self._arrays[name] = value
                words[place] = address_of(value)

    def saved(self, written: Iterable[str]) -> tuple[Any, dict[str, Any], dict[str, Any]]:
        """Return its numbers and arrays for `restore`; `written`: the given arrays into which machine code writes."""
        return self._numbers.copy(), dict(self._arrays), {name: self[name].copy() for name in written}

    def restore(self, saved: tuple[Any, Mapping[str, Any], Mapping[str, Any]]) -> None:
        """Make all values as they were when they were saved."""
        numbers, arrays, written = saved
        self._numbers[:], self._arrays = numbers, dict(arrays)
        for name, values in written.items():
            self._arrays[name][:] = values

    def call(self, source: str, *arguments: Any) -> int:
        """Call a function of the source on this record, with integers and arrays."""
        values = [a if type(a) is int else address_of(a) for a in arguments] if arguments else ()
        return _called(source, *map(type, arguments))(self.address, *values)  # type: ignore[no-any-return]

    def __getitem__(self, name: str) -> Any:
        array = self._arrays.get(name)
        if array is not None:
            return array
        if name in self._form.views:
            begin, size, whole = self._form.views[name]
            array = self._arrays[name] = (self._words if whole else self._numbers)[begin : begin + size]
            return array
        if self._form.places[name][1] in _C_TYPES:
            return getattr(self.record, name)
        raise KeyError(name)

    def __setitem__(self, name: str, value: Array | int) -> None:
        self.put({name: value})


class RecordBatch:
    """Records of one kind in one block, a row for each of `count` runs; numbers and arrays of all by the names of their fields.

    Numbers are common to all, or one for each, shape (count,); arrays are common to all, shape (m,), or one for each, shape (count, m).
    """

    def __init__(self, form: RecordLayout, count: int, given: Mapping[str, Any]) -> None:
        self._form, self.count = form, count
        self._numbers: Any = np.zeros((count, form.size))
        self._words = self._numbers.view(np.int64)
        self.addresses: Any = address_of(self._numbers) + WORD * form.size * np.arange(count)
        self._words[:, : len(form.head)] = form.head
        self._words[:, form.inside] += self.addresses[:, None]
        self._arrays: dict[str, Any] = {}
        self.put(given)

    def put(self, values: Mapping[str, Any]) -> None:
        """Set fields: numbers are copied, arrays and records are pointed to."""
        for name, value in values.items():
            place, kind = self._form.places[name]
            if isinstance(kind, str) and kind in _C_TYPES:
                (self._numbers if kind == "double" else self._words)[:, place] = value
                continue
            self._arrays[name] = value
            if isinstance(kind, Fields):
                self._words[:, place] = value.addresses if isinstance(value, RecordBatch) else value.address
                continue
            value = self._arrays[name] = np.ascontiguousarray(value, dtype=_WHOLE if kind == INTS else _DOUBLE)
            if value.ndim > 1:
                self.point(name, value, np.arange(self.count))
            else:
                self._words[:, place] = address_of(value)

    def point(self, name: str, array: Array, rows: Any) -> None:
        """Point a field of each record to a row of a contiguous array (…, m), by the index of the row."""
        self._arrays[name] = array
        self._words[:, self._form.places[name][0]] = address_of(array) + WORD * array.shape[1] * rows

    def call(self, source: str, rows: Any, number: int = 0) -> Any:
        """Call a function of the source on the records of these rows, one after another; return its answers, shape (rows,)."""
        answers = np.zeros(len(rows), dtype=np.int64)
        step, records = function_address(source), address_of(self._numbers)
        each = called("each_record", None, POINTER, WHOLE, POINTER, WHOLE, POINTER, WHOLE, POINTER)
        for first in range(0, len(rows), UNINTERRUPTED):
            some, found = np.array(rows[first : first + UNINTERRUPTED], dtype=np.int64), answers[first:]
            each(step, len(some), address_of(some), self._form.size, records, number, address_of(found))
        return answers

    def __getitem__(self, name: str) -> Any:
        if name in self._arrays:
            return self._arrays[name]
        if name in self._form.views:
            begin, size, whole = self._form.views[name]
            return (self._words if whole else self._numbers)[:, begin : begin + size]
        place, kind = self._form.places[name]
        if not isinstance(kind, str) or kind not in _C_TYPES:
            raise KeyError(name)
        return (self._numbers if kind == "double" else self._words)[:, place]


@lru_cache
def _called(source: str, *types: type) -> Any:
    """Return a function of the source on a record, with integers and arrays."""
    return called(source, WHOLE, POINTER, *[WHOLE if kind is int else POINTER for kind in types])


@lru_cache
def _layout(noun: type) -> type[ctypes.Structure]:
    """Return the memory layout of a record."""
    fields = [(n, _C_TYPES.get(k, ctypes.c_void_p) if isinstance(k, str) else ctypes.c_void_p) for n, k in record_of(noun).fields.items()]  # fmt: skip
    return type(noun.__name__, (ctypes.Structure,), {"_fields_": fields})


def form_of(noun: type, program: Program, key: object, values: Callable[[], Mapping[str, Any]]) -> RecordLayout:
    """Return the layout of a record for a program, cached with it. `key`: further data on which it depends."""
    forms = program.kept
    form: RecordLayout | None = forms.get((noun, key))
    if form is None:
        assert program.native is not None
        form = forms[noun, key] = RecordLayout(noun, values(), program.native.addresses)
    return form
