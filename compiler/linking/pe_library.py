"""COFF objects to one library that the loader of Windows takes: PE Format (PE32+), Microsoft Learn.

Parts in memory: names, tables and constants (read), code (execute), data (write), and a list of the whole addresses, which the loader
changes where the library comes to another place. Tables for unwinding come along: callers of Windows walk the stack by them.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from .layout import LibraryLayout, aligned, texts_of
from .object_file import LinkError

BASE = 0x180000000  # address for which libraries of Windows are written
START, TABLES, FILE_STEP = 0x40, 16, 0x200
FILE_HEADER, OPTIONAL, SECTION = "<4sHHIIIHH", "<HBBIIIIIQIIHHHHHHIIIIHHQQQQII", "<8sIIIIIIHHI"
LIBRARY, OPTIONAL_64, VERSION, GRAPHICAL = 0x2022, 0x20B, 6, 2
ANYWHERE = 0x160  # takes any address, also a high one; what is no code is not executed
EXPORTS, IMPORTS, UNWINDING, RELOCATIONS, ADDRESSES = 0, 1, 3, 5, 12
CODE, DATA, DISCARDABLE, EXECUTE, READ, WRITE = 0x20, 0x40, 0x2000000, 0x20000000, 0x40000000, 0x80000000
ROW_OF_UNWINDING, ROW_OF_IMPORTS = 12, 20

# Name, address, bytes in memory, place in the file, bytes there, flags.
_Part = tuple[bytes, int, int, int, int, int]


def pe_library(layout: LibraryLayout) -> bytes:
    """Return the bytes of a library. Raises `LinkError`."""
    page = layout.machine.page
    layout.take_entries()
    exported = sorted((name, layout.exported(name)) for name in layout.library.exported)
    names = [name for name, _ in exported]
    exports_end = page + len(_exports(page, layout.library.name, names, [0] * len(names)))
    imports = aligned(exports_end, 8)
    taken = _taken(layout)
    imported, entries, addresses = _imports(imports, taken)
    layout.entries.update(entries)
    unwinding = aligned(imports + len(imported), 4)
    unwinding_end = layout.lay(unwinding, lambda s: s.name == ".pdata")
    end = layout.lay(unwinding_end, lambda s: s.name != ".pdata" and not s.writable and not s.executable)
    code = aligned(end, page)
    code_end = layout.lay_jumps(layout.lay(code, lambda s: s.executable))
    data = aligned(code_end, page)
    data_end = layout.lay(data, lambda s: s.writable and bool(s.data))
    whole_end = layout.lay(data_end, lambda s: s.writable and not s.data)
    image = bytearray(aligned(data_end, FILE_STEP))
    layout.fill(image)
    _sort(image, unwinding, unwinding_end)
    image[page:exports_end] = _exports(
        page, layout.library.name, names, [layout.address(where) for _, where in exported]
    )
    image[imports : imports + len(imported)] = imported
    relocations, places = aligned(whole_end, page), _put_addresses(image, layout)
    parts = [
        _part(b".rdata", page, end, end, DATA | READ),
        _part(b".text", code, code_end, code_end, CODE | READ | EXECUTE),
        _part(b".data", data, whole_end, data_end, DATA | READ | WRITE),
        (b".reloc", relocations, len(places), len(image), aligned(len(places), FILE_STEP), DATA | READ | DISCARDABLE),
    ]
    tables = {
        EXPORTS: (page, exports_end - page), IMPORTS: (imports, ROW_OF_IMPORTS * (len(taken) + 1)), UNWINDING: (unwinding, unwinding_end - unwinding),
        RELOCATIONS: (relocations, len(places)), ADDRESSES: addresses,
    }  # fmt: skip
    _put_head(image, layout, [part for part in parts if part[2]], tables)
    return bytes(image + places.ljust(aligned(len(places), FILE_STEP), b"\0"))


def _part(name: bytes, start: int, end: int, file_end: int, flags: int) -> _Part:
    """Return a part whose place in the file is its address."""
    return name, start, end - start, start, aligned(file_end, FILE_STEP) - start, flags


def _taken(layout: LibraryLayout) -> list[tuple[str, list[str]]]:
    """Return the libraries of the system that are needed, each with the names that are taken from it."""
    left, taken = layout.outside(), []
    for library, defines in layout.library.system:
        taken.append((library, [n for n in left if n in defines]))
        left = [n for n in left if n not in defines]
    return [(library, names) for library, names in taken if names]


def _exports(start: int, library: str, names: Sequence[str], addresses: Sequence[int]) -> bytes:
    """Return the table of what others see; the names are in order."""
    count, functions = len(names), start + 40
    pointers, numbers, place = functions + 4 * count, functions + 8 * count, functions + 10 * count
    texts, at = texts_of([library, *names])
    head = struct.pack("<IIHH7I", 0, 0, 0, 0, place + at[library], 1, count, count, functions, pointers, numbers)
    rows = struct.pack(f"<{2 * count}I{count}H", *addresses, *(place + at[n] for n in names), *range(count))
    return head + rows + texts


def _imports(start: int, taken: Sequence[tuple[str, Sequence[str]]]) -> tuple[bytes, dict[str, int], tuple[int, int]]:
    """Return the tables of what is taken, the place of each name's address, and that of all addresses with its size."""
    size = 8 * sum(len(names) + 1 for _, names in taken)
    lookups = aligned(start + ROW_OF_IMPORTS * (len(taken) + 1), 8)
    addresses, place = lookups + size, lookups + 2 * size
    rows, cells, texts, entries = b"", list[int](), b"", dict[str, int]()
    for library, names in taken:
        at = 8 * len(cells)
        rows += struct.pack("<5I", lookups + at, 0, 0, place + len(texts), addresses + at)
        texts += _even(library.encode("utf-8"))
        for name in names:
            entries[name] = addresses + 8 * len(cells)
            cells.append(place + len(texts))
            texts += bytes(2) + _even(name.encode("utf-8"))
        cells.append(0)
    table = struct.pack(f"<{len(cells)}Q", *cells)
    return rows.ljust(lookups - start, b"\0") + table + table + texts, entries, (addresses, size)


def _even(text: bytes) -> bytes:
    """Return a text with its end, of an even number of bytes."""
    return text.ljust(aligned(len(text) + 1, 2), b"\0")


def _sort(image: bytearray, start: int, end: int) -> None:
    """Put the functions of the table for unwinding in order, as the system searches it."""
    if (end - start) % ROW_OF_UNWINDING:
        raise LinkError("the table for unwinding is damaged")
    rows = sorted(struct.iter_unpack("<III", image[start:end]))
    image[start:end] = b"".join(struct.pack("<III", *row) for row in rows)


def _put_addresses(image: bytearray, layout: LibraryLayout) -> bytes:
    """Write the whole addresses; return the list of their places, by pages."""
    pages: dict[int, list[int]] = {}
    end = 0
    for place, entry, addend in sorted(layout.at_load, key=lambda row: row[0]):
        if place < end:
            raise LinkError("two addresses lie in one place")
        end = place + 8
        address = layout.jumps[entry] if isinstance(entry, str) else layout.address(entry)
        struct.pack_into("<Q", image, place, BASE + address + addend)
        kind = layout.machine.at_load[1] << 12
        pages.setdefault(place & -layout.machine.page, []).append(kind | place % layout.machine.page)
    result = b""
    for page, rows in pages.items():
        rows += [0] * (len(rows) % 2)
        result += struct.pack(f"<II{len(rows)}H", page, 8 + 2 * len(rows), *rows)
    return result


def _put_head(
    image: bytearray, layout: LibraryLayout, parts: Sequence[_Part], tables: dict[int, tuple[int, int]]
) -> None:
    page, optional = layout.machine.page, struct.calcsize(OPTIONAL) + 8 * TABLES
    whole = aligned(parts[-1][1] + parts[-1][2], page)
    code = sum(p[4] for p in parts if p[5] & CODE)
    data = sum(p[4] for p in parts if not p[5] & CODE)
    code_start = next((p[1] for p in parts if p[5] & CODE), 0)
    struct.pack_into("<2s58xI", image, 0, b"MZ", START)
    numbers = (b"PE", layout.machine.number, len(parts), 0, 0, 0, optional, LIBRARY)
    struct.pack_into(FILE_HEADER, image, START, *numbers)
    place = START + struct.calcsize(FILE_HEADER)
    struct.pack_into(
        OPTIONAL, image, place, OPTIONAL_64, 0, 0, code, data, 0, 0, code_start, BASE, page, FILE_STEP, VERSION, 0, 0, 0, VERSION, 0, 0,
        whole, FILE_STEP, 0, GRAPHICAL, ANYWHERE, 1 << 20, page, 1 << 20, page, 0, TABLES,
    )  # fmt: skip
    for number, table in tables.items():
        if table[1]:
            struct.pack_into("<II", image, place + optional - 8 * (TABLES - number), *table)
    for number, (name, address, memory, at, size, flags) in enumerate(parts):
        row = (name, memory, address, size, at, 0, 0, 0, 0, flags)
        struct.pack_into(SECTION, image, place + optional + number * struct.calcsize(SECTION), *row)
