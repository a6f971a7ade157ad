"""ELF objects to one shared library that a system's loader takes: System V ABI, chapter 5.

Three parts in memory: names and constants (read), code (execute), addresses and data (write). All addresses are bound when the library
is loaded, the stack is not executable, and only the exported names are seen from outside.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from .elf_object import BEGINNING, HEADER, RELOCATION, SYMBOL
from .layout import LibraryLayout, aligned, texts_of
from .machines import Machine
from .object_file import LinkError, fields_of

SHARED, LIBRARY = 3, b"\x7fELF\x02"
LOAD, DYNAMIC, STACK = 1, 2, 0x6474E551
READ, WRITE, EXECUTE = 4, 2, 1
SEGMENT, PARTS = "<IIQQQQQQ", 5
NEEDED, HASH, STRTAB, SYMTAB, RELA, RELASZ, RELAENT, STRSZ, SYMENT, SONAME = 1, 4, 5, 6, 7, 8, 9, 10, 11, 14
FLAGS, FLAGS_1, BIND_NOW, NOW = 30, 0x6FFFFFFB, 8, 1
GLOBAL_FUNCTION = 0x12


def elf_library(layout: LibraryLayout) -> bytes:
    """Return the bytes of a library. Raises `LinkError`."""
    return _ImageWriter(layout).image()


def check_length(library: bytes) -> None:
    """Raise `LinkError` if a library of 64 bits, of any tool, ends before what a loader maps of it: to read there ends the process."""
    if not library.startswith(LIBRARY):
        return
    fields = fields_of(HEADER, library, 0)
    for number in range(fields[11]):
        kind, _, offset, _, _, size, _, _ = fields_of(SEGMENT, library, fields[6] + fields[10] * number)
        if kind == LOAD and offset + size > len(library):
            raise LinkError("the library is cut off")


class _ImageWriter:
    """Writer of the image."""

    def __init__(self, layout: LibraryLayout) -> None:
        self.layout, self.library = layout, layout.library
        self.outside = layout.outside()
        self.exported = [(name, layout.exported(name)) for name in self.library.exported]
        self.places = {name: i for i, name in enumerate(self.outside, 1)}
        names = [*self.outside, *self.library.exported, self.library.name, *self._needed()]
        self.texts, self.text_places = texts_of(names)

    def _needed(self) -> list[str]:
        return [name for name, defines in self.library.system if not defines.isdisjoint(self.outside)]

    # ------------------------------------------------------------ places in memory
    def image(self) -> bytes:
        """Return the whole file."""
        layout, page = self.layout, self.layout.machine.page
        layout.take_entries()
        hashes = aligned(struct.calcsize(HEADER) + PARTS * struct.calcsize(SEGMENT), 8)
        count = 1 + len(self.outside) + len(self.exported)
        symbols = aligned(hashes + 4 * (3 + count), 8)
        texts = symbols + count * struct.calcsize(SYMBOL)
        loads = aligned(texts + len(self.texts), 8)
        end = loads + struct.calcsize(RELOCATION) * (len(layout.entries) + layout.absolute())
        end = layout.lay(end, lambda s: not s.writable and not s.executable)
        code = aligned(end, page)
        code_end = layout.lay_jumps(layout.lay(code, lambda s: s.executable))
        data = aligned(code_end, page)
        table = layout.lay_entries(data, [*layout.entries])
        rows = 2 * (len(self._needed()) + 11)
        data_end = layout.lay(table + 8 * rows, lambda s: s.writable and bool(s.data))
        whole_end = layout.lay(data_end, lambda s: s.writable and not s.data)
        image = bytearray(data_end)
        layout.fill(image)
        self._put_names(image, hashes, symbols, texts)
        at_load = self._rows_at_load(data)
        for number, row in enumerate(at_load):
            struct.pack_into(RELOCATION, image, loads + number * struct.calcsize(RELOCATION), *row)
        self._put_dynamic(image, table, (hashes, texts, symbols, loads), len(at_load))
        parts = (
            (LOAD, READ, 0, end, end, page),
            (LOAD, READ | EXECUTE, code, code_end - code, code_end - code, page),
            (LOAD, READ | WRITE, data, data_end - data, whole_end - data, page),
            (DYNAMIC, READ | WRITE, table, 8 * rows, 8 * rows, 8),
            (STACK, READ | WRITE, 0, 0, 0, 16),
        )
        _put_head(image, layout.machine, parts)
        return bytes(image)

    def _rows_at_load(self, data: int) -> list[tuple[int, int, int]]:
        """Return what the loader puts in: entries of the table of addresses, then addresses in data, from a place on."""
        layout, (named, relative, in_data) = self.layout, self.layout.machine.at_load
        rows = [(place, entry, 0, named) for entry, place in layout.entries.items()]
        rows += [(*row, in_data) for row in layout.at_load]
        if any(row[0] < data for row in rows):
            raise LinkError("a section has addresses, but is not to be written")
        return [
            (place, self.places[entry] << 32 | kind, addend) if isinstance(entry, str) else (place, relative, layout.address(entry) + addend)
            for place, entry, addend, kind in rows
        ]  # fmt: skip

    def _put_names(self, image: bytearray, hashes: int, symbols: int, texts: int) -> None:
        """Write the table of names. All stand in one chain: a library of an FMU has few."""
        count = 1 + len(self.outside) + len(self.exported)
        chain = [*range(2, count), 0] if count > 1 else []
        struct.pack_into(f"<{3 + count}I", image, hashes, 1, count, min(count - 1, 1), 0, *chain)
        image[texts : texts + len(self.texts)] = self.texts
        rows = [(self.text_places[n], GLOBAL_FUNCTION, 0, 0, 0, 0) for n in self.outside]
        for name, where in self.exported:
            symbol = self.layout.objects[where[0]].symbols[where[1]]
            rows.append((self.text_places[name], GLOBAL_FUNCTION, 0, 1, self.layout.address(where), symbol.size))
        for number, row in enumerate(rows, 1):
            struct.pack_into(SYMBOL, image, symbols + number * struct.calcsize(SYMBOL), *row)

    def _put_dynamic(self, image: bytearray, table: int, places: tuple[int, int, int, int], count: int) -> None:
        hashes, texts, symbols, loads = places
        width = struct.calcsize(RELOCATION)
        rows = [*((NEEDED, self.text_places[n]) for n in self._needed()), (SONAME, self.text_places[self.library.name])]
        rows += [
            (HASH, hashes),
            (STRTAB, texts),
            (SYMTAB, symbols),
            (STRSZ, len(self.texts)),
            (SYMENT, struct.calcsize(SYMBOL)),
        ]
        rows += [(RELA, loads), (RELASZ, width * count), (RELAENT, width)] if count else []
        rows += [(FLAGS, BIND_NOW), (FLAGS_1, NOW)]
        for number, row in enumerate(rows):
            struct.pack_into("<QQ", image, table + 16 * number, *row)


def _put_head(image: bytearray, machine: Machine, parts: Sequence[tuple[int, int, int, int, int, int]]) -> None:
    size, segment = struct.calcsize(HEADER), struct.calcsize(SEGMENT)
    numbers = (BEGINNING, 0, SHARED, machine.number, 1, 0, size, 0, 0, size, segment, PARTS, 64, 0, 0)
    struct.pack_into(HEADER, image, 0, *numbers)
    for number, (kind, flags, place, length, memory, alignment) in enumerate(parts):
        struct.pack_into(
            SEGMENT, image, size + number * segment, kind, flags, place, place, place, length, memory, alignment
        )
