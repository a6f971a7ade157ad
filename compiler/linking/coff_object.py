"""COFF object files of Windows: their sections, symbols and relocations, each place checked. Layout: PE Format, Microsoft Learn."""

from __future__ import annotations

import struct
from collections.abc import Iterator

from ..fast_dataclass import dataclass
from .object_file import LinkError, ObjectFile, ObjectSymbol, Relocation, Section, checked, fields_of, text_at

HEADER, SECTION, SYMBOL, RELOCATION = "<HHIIIHH", "<QIIIIIIHHI", "<QIhHBB", "<IIH"
MOST_SECTIONS = 0xFEFF  # more of them are another format
CODE, DATA, ZEROS = 0x20, 0x40, 0x80
LEFT_OUT = 0x2000A00  # notes to the linker, and what may be discarded
MANY_RELOCATIONS, FULL = 0x1000000, 0xFFFF
EXECUTE, WRITE = 0x20000000, 0x80000000
EXTERNAL, STATIC, LABEL, FILE = 2, 3, 6, 103
# Kinds of relocation: a whole address; a distance from the end of its four bytes, and up to one from five bytes further on.
ABSOLUTE, AFTER, LAST_AFTER = 1, 4, 9


@dataclass(frozen=True, slots=True)
class _CoffHeader:
    """Entry of the table of sections."""

    name: str
    size: int
    offset: int
    relocations: int
    count: int
    flags: int


def read_coff(data: bytes) -> ObjectFile:
    """Return the parts of an object file. Raises `LinkError`."""
    machine, count, _, table, symbols, extra, _ = fields_of(HEADER, data, 0)
    if extra or not 0 < count <= MOST_SECTIONS:
        raise LinkError("this is no COFF object")
    start, width = struct.calcsize(HEADER), struct.calcsize(SECTION)
    headers = {i + 1: _header(data, start + width * i) for i in range(count)}
    sections = checked({i: _section(data, h) for i, h in headers.items() if _is_loaded(h)})
    names = _symbols(data, table, symbols, sections)
    relocations = tuple(r for i in sections for r in _relocations(data, i, headers[i], sections[i], len(names)))
    return ObjectFile(machine, sections, names, relocations)


def _header(data: bytes, place: int) -> _CoffHeader:
    name, _, _, size, offset, relocations, _, count, _, flags = fields_of(SECTION, data, place)
    return _CoffHeader(_short(name), size, offset, relocations, count, flags)


def _is_loaded(header: _CoffHeader) -> bool:
    """Return True for what comes to memory."""
    return bool(header.flags & (CODE | DATA | ZEROS)) and not header.flags & LEFT_OUT


def _section(data: bytes, header: _CoffHeader) -> Section:
    place = header.flags >> 20 & 15
    content = b"" if header.flags & ZEROS else data[header.offset : header.offset + header.size]
    if not header.flags & ZEROS and len(content) != header.size:
        raise LinkError("the object is cut off")
    flags = bool(header.flags & WRITE), bool(header.flags & EXECUTE)
    return Section(header.name, content, header.size, 1 << place - 1 if place else 16, *flags)


def _symbols(data: bytes, table: int, count: int, sections: dict[int, Section]) -> tuple[ObjectSymbol, ...]:
    """Return the symbols by their numbers; those of notes behind a symbol have no name."""
    width = struct.calcsize(SYMBOL)
    texts, symbols, notes = data[table + width * count :], list[ObjectSymbol](), 0
    if len(data) < table + width * count:
        raise LinkError("the table of symbols is damaged")
    for number in range(count):
        name, value, place, _, storage, more = fields_of(SYMBOL, data, table + width * number)
        if notes:
            notes -= 1
            symbols.append(ObjectSymbol("", None, 0, 0, False))
            continue
        if storage not in (EXTERNAL, STATIC, LABEL, FILE) or (place == 0 and value):
            raise LinkError("the object has symbols that are not supported")
        notes, section = more, sections.get(place)
        if section is not None and value > section.size:
            raise LinkError("a symbol lies outside of its section")
        text = _short(name) if name & 0xFFFFFFFF else text_at(texts, name >> 32)
        symbols.append(
            ObjectSymbol(text if place >= 0 else "", place if place > 0 else None, value, 0, storage == EXTERNAL)
        )
    return tuple(symbols)


def _relocations(data: bytes, number: int, header: _CoffHeader, section: Section, symbols: int) -> Iterator[Relocation]:
    width, start, count = struct.calcsize(RELOCATION), header.relocations, header.count
    if header.flags & MANY_RELOCATIONS and count == FULL:  # the first one has their number, itself among them
        count = fields_of(RELOCATION, data, start)[0] - 1
        start += width
    if start + width * count > len(data):
        raise LinkError("a table of relocations is damaged")
    for offset, symbol, kind in struct.iter_unpack(RELOCATION, data[start : start + width * max(count, 0)]):
        if symbol >= symbols:
            raise LinkError("a relocation is damaged")
        addend = _addend(section, offset, kind)
        yield Relocation(number, offset, kind, symbol, addend)


def _addend(section: Section, offset: int, kind: int) -> int:
    """Return what is added to an address: the number in its place, less the distance to the end of an instruction."""
    (number,) = fields_of("<q" if kind == ABSOLUTE else "<i", section.data, offset)
    return number - kind if AFTER <= kind <= LAST_AFTER else number


def _short(name: int) -> str:
    """Return a name that has room in eight bytes."""
    return name.to_bytes(8, "little").rstrip(b"\0").decode("utf-8", "replace")
