"""ELF object files: their sections, symbols and relocations, each place checked. Layout: System V ABI, chapters 4 and 5."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence

from ..fast_dataclass import dataclass
from .object_file import (
    MOST_BYTES,
    LinkError,
    ObjectFile,
    ObjectSymbol,
    Relocation,
    Section,
    checked,
    fields_of,
    text_at,
)

HEADER, SECTION, SYMBOL, RELOCATION = "<QQHHIQQQIHHHHHH", "<IIQQQQIIQQ", "<IBBHQQ", "<QQq"
BEGINNING = 0x00010102464C457F  # the first eight bytes: ELF, 64 bits, least byte first, version 1
RELOCATABLE = 1
PROGBITS, SYMTAB, RELA, NOBITS, REL, GROUP = 1, 2, 4, 8, 9, 17
WRITE, ALLOC, EXECUTE, THREAD_LOCAL, COMPRESSED = 1, 2, 4, 0x400, 0x800
UNDEFINED, FIRST_SPECIAL = 0, 0xFF00
INDIRECT = 10  # type of a symbol that is chosen when the library is loaded


@dataclass(frozen=True, slots=True)
class _ElfHeader:
    """Entry of the table of sections."""

    name: int
    kind: int
    flags: int
    address: int
    offset: int
    size: int
    link: int
    info: int
    alignment: int
    entry: int


def read_elf(data: bytes) -> ObjectFile:
    """Return the parts of an object file. Raises `LinkError`."""
    machine, headers, names = _headers(data)
    if any(h.kind in (REL, GROUP) for h in headers):
        raise LinkError("the object has sections that are not supported")
    if any(text_at(names, h.name).startswith(".rela") and not _is_whole(h, headers, names) for h in headers):
        raise LinkError("a table of relocations is damaged")
    sections = checked(
        {i: _section(data, h, text_at(names, h.name)) for i, h in enumerate(headers) if _is_loaded(h, names)}
    )
    tables = [h for h in headers if h.kind == SYMTAB]
    if len(tables) != 1:
        raise LinkError("the object has no table of symbols, or several")
    symbols = tuple(_symbols(data, headers, tables[0], sections))
    return ObjectFile(machine, sections, symbols, tuple(_relocations(data, headers, sections, len(symbols))))


def _headers(data: bytes) -> tuple[int, list[_ElfHeader], bytes]:
    """Return the machine, the table of sections, and the text of their names."""
    fields = fields_of(HEADER, data, 0)
    beginning, kind, machine, offset = fields[0], fields[2], fields[3], fields[7]
    width, count, naming = fields[12], fields[13], fields[14]
    if beginning != BEGINNING or kind != RELOCATABLE:
        raise LinkError("this is no ELF object of 64 bits")
    if width != struct.calcsize(SECTION) or not 0 < count < FIRST_SPECIAL or naming >= count:
        raise LinkError("the table of sections is damaged")
    headers = [_ElfHeader(*fields_of(SECTION, data, offset + width * i)) for i in range(count)]
    return machine, headers, _content(data, headers[naming])


def _is_whole(header: _ElfHeader, headers: Sequence[_ElfHeader], names: bytes) -> bool:
    """Return True if a table of relocations is one of the section that its name says."""
    if header.kind != RELA or header.info >= len(headers):
        return False
    return text_at(names, header.name) == f".rela{text_at(names, headers[header.info].name)}"


def _is_loaded(header: _ElfHeader, names: bytes) -> bool:
    """Return True for what comes to memory; tables for unwinding do not, as nothing is thrown."""
    loaded = header.flags & ALLOC and header.kind in (PROGBITS, NOBITS) and text_at(names, header.name) != ".eh_frame"
    if loaded and header.flags & (THREAD_LOCAL | COMPRESSED):
        raise LinkError("the object has data of single threads, or compressed ones")
    return bool(loaded)


def _section(data: bytes, header: _ElfHeader, name: str) -> Section:
    flags = bool(header.flags & WRITE), bool(header.flags & EXECUTE)
    content = b"" if header.kind == NOBITS else _content(data, header)
    return Section(name, content, header.size, max(header.alignment, 1), *flags)


def _symbols(data: bytes, headers: Sequence[_ElfHeader], table: _ElfHeader, sections: dict[int, Section]) -> Iterator[ObjectSymbol]:  # fmt: skip
    if table.link >= len(headers):
        raise LinkError("the table of symbols is damaged")
    names = _content(data, headers[table.link])
    for fields in _rows(SYMBOL, data, table):
        name, information, _, place, value, size = fields
        if information & 15 == INDIRECT or (place >= FIRST_SPECIAL and information & 15 != 4):  # 4: name of the file
            raise LinkError("the object has symbols that are not supported")
        number = None if place == UNDEFINED or place >= FIRST_SPECIAL else place
        section = sections.get(number) if number is not None else None
        if section is not None and value + size > section.size:
            raise LinkError("a symbol lies outside of its section")
        yield ObjectSymbol(text_at(names, name), number, value, size, information >> 4 != 0)


def _relocations(data: bytes, headers: Sequence[_ElfHeader], sections: dict[int, Section], symbols: int) -> Iterator[Relocation]:  # fmt: skip
    for header in headers:
        if header.kind != RELA or header.info not in sections:
            continue
        for offset, information, addend in _rows(RELOCATION, data, header):
            if information >> 32 >= symbols or abs(addend) > MOST_BYTES:
                raise LinkError("a relocation is damaged")
            yield Relocation(header.info, offset, information & 0xFFFFFFFF, information >> 32, addend)


def _rows(form: str, data: bytes, header: _ElfHeader) -> Iterator[tuple[int, ...]]:
    content, width = _content(data, header), struct.calcsize(form)
    if header.entry != width or len(content) % width:
        raise LinkError("a table of the object is damaged")
    return struct.iter_unpack(form, content)


def _content(data: bytes, header: _ElfHeader) -> bytes:
    if header.kind == NOBITS or header.offset + header.size > len(data):
        raise LinkError("the object is cut off")
    return data[header.offset : header.offset + header.size]
