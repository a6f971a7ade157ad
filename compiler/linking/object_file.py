"""Object code as the linker sees it, of either format, and the reading of numbers and names, each place checked."""

from __future__ import annotations

import struct

from ..fast_dataclass import dataclass

MOST_BYTES = 1 << 28  # of one section, and of all
MOST_ALIGNED = 4096  # a page


class LinkError(ValueError):
    """Object code that cannot be linked: it is damaged, or asks for what no library of ours has."""


@dataclass(frozen=True, slots=True)
class Section:
    """Part of an object that comes to memory. `data` is empty where it begins as zeros."""

    name: str
    data: bytes
    size: int
    alignment: int
    writable: bool
    executable: bool


@dataclass(frozen=True, slots=True)
class ObjectSymbol:
    """Name in an object. `section` is None for one that another object or library defines."""

    name: str
    section: int | None
    value: int
    size: int
    visible: bool


@dataclass(frozen=True, slots=True)
class Relocation:
    """Place in a section where the address of a symbol is put, in a way that `kind` names."""

    section: int
    offset: int
    kind: int
    symbol: int
    addend: int


@dataclass(frozen=True, slots=True)
class ObjectFile:
    """Object code: the processor, sections that come to memory by their numbers, all symbols, and relocations."""

    machine: int
    sections: dict[int, Section]
    symbols: tuple[ObjectSymbol, ...]
    relocations: tuple[Relocation, ...]


def fields_of(form: str, data: bytes, offset: int) -> tuple[int, ...]:
    """Return the numbers at a place. Raises `LinkError`."""
    try:
        return struct.unpack_from(form, data, offset)
    except (struct.error, OverflowError):
        raise LinkError("the object is cut off") from None


def text_at(names: bytes, place: int) -> str:
    """Return the text that ends with a zero. Raises `LinkError`."""
    end = names.find(b"\0", place)
    if end < 0:
        raise LinkError("a name of the object is cut off")
    return names[place:end].decode("utf-8", "replace")


def checked(sections: dict[int, Section]) -> dict[int, Section]:
    """Return sections whose sizes and flags are possible. Raises `LinkError`."""
    for section in sections.values():
        alignment = section.alignment
        if alignment & (alignment - 1) or alignment > MOST_ALIGNED or section.size > MOST_BYTES:
            raise LinkError(f"section {section.name} is damaged")
        if section.writable and section.executable:
            raise LinkError(f"section {section.name} is to be written and to be executed")
        if not section.data and section.size and not section.writable:
            raise LinkError(f"section {section.name} has no content")
    if sum(s.size for s in sections.values()) > MOST_BYTES:
        raise LinkError("the object is too large")
    return sections
