"""ELF objects to one shared library that a system's loader takes: System V ABI, chapter 5.

Three parts in memory: names and constants (read), code (execute), addresses and data (write). All addresses are bound when the library
is loaded, the stack is not executable, and only the exported names are seen from outside.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field

from ..fast_dataclass import dataclass
from .elf_object import (
    BEGINNING,
    HEADER,
    RELOCATION,
    SYMBOL,
    ElfObject,
    LinkError,
    ObjectSymbol,
    Relocation,
    Section,
    read_object,
)
from .machines import MACHINES, Machine, PatchPlace

SHARED = 3
LOAD, DYNAMIC, STACK = 1, 2, 0x6474E551
READ, WRITE, EXECUTE = 4, 2, 1
SEGMENT, PARTS = "<IIQQQQQQ", 5
NEEDED, HASH, STRTAB, SYMTAB, RELA, RELASZ, RELAENT, STRSZ, SYMENT, SONAME = 1, 4, 5, 6, 7, 8, 9, 10, 11, 14
FLAGS, FLAGS_1, BIND_NOW, NOW = 30, 0x6FFFFFFB, 8, 1
GLOBAL_FUNCTION = 0x12

# A symbol: the number of its object, and its number there.
Name = tuple[int, int]
Entry = str | Name


@dataclass(slots=True)
class _Plan:
    """Library in the making: places of sections, of entries in the table of addresses, and of jumps through it."""

    machine: Machine
    objects: tuple[ElfObject, ...]
    defined: Mapping[str, Name]
    at: dict[Name, int] = field(default_factory=dict)  # (object, section) -> address
    entries: dict[Entry, int] = field(default_factory=dict)
    jumps: dict[str, int] = field(default_factory=dict)

    def resolved(self, number: int, symbol: int) -> Entry:
        """Return the symbol that defines this one, its own object's before others'; a name if a library of the system defines it."""
        symbol_found = self.objects[number].symbols[symbol]
        if symbol_found.section is not None:
            return number, symbol
        if not symbol_found.name:
            raise LinkError("a relocation has no symbol")
        return self.defined.get(symbol_found.name, symbol_found.name)

    def address(self, name: Name) -> int:
        """Return the address of a defined symbol."""
        symbol = self.objects[name[0]].symbols[name[1]]
        place = None if symbol.section is None else self.at.get((name[0], symbol.section))
        if place is None:
            raise LinkError(f"`{symbol.name}` lies in a section that does not come to memory")
        return place + symbol.value


@dataclass(frozen=True, slots=True)
class SharedLibrary:
    """Request of a library: its name, the names that others see, and the libraries of the system with the names that each defines."""

    name: str
    exported: tuple[str, ...]
    system: tuple[tuple[str, frozenset[str]], ...]


def link(objects: Sequence[bytes], library: SharedLibrary) -> bytes:
    """Return the bytes of a shared library of some objects. Raises `LinkError`."""
    read = tuple(map(read_object, objects))
    machines = {o.machine for o in read}
    if len(machines) != 1 or not machines <= MACHINES.keys():
        raise LinkError("the objects are not all of one known processor")
    defined: dict[str, Name] = {}
    for number, item in enumerate(read):
        for place, symbol in enumerate(item.symbols):
            if symbol.visible and symbol.section is not None:
                defined.setdefault(symbol.name, (number, place))
    plan = _Plan(MACHINES[machines.pop()], read, defined)
    return _ImageWriter(plan, library).image()


class _ImageWriter:
    """Writer of the image. Addresses in memory are places in the file."""

    def __init__(self, plan: _Plan, library: SharedLibrary) -> None:
        self.plan, self.library = plan, library
        self.relocations = [(n, r) for n, item in enumerate(plan.objects) for r in item.relocations]
        self.outside = self._outside()
        self.exported = [(name, self._exported(name)) for name in library.exported]
        self.places = {name: i for i, name in enumerate(self.outside, 1)}
        self.texts, self.text_places = _texts([*self.outside, *library.exported, library.name, *self._needed()])
        self.at_load: list[tuple[int, int, int]] = []

    def _outside(self) -> list[str]:
        """Return the names that the library takes from the system, each of which one of its libraries must define."""
        entries = [self.plan.resolved(n, r.symbol) for n, r in self.relocations]
        names = sorted({e for e in entries if isinstance(e, str)})
        known_names = {name for _, defines in self.library.system for name in defines}
        if missing := [n for n in names if n not in known_names]:
            raise LinkError(f"`{missing[0]}` is defined nowhere")
        return names

    def _needed(self) -> list[str]:
        return [name for name, defines in self.library.system if not defines.isdisjoint(self.outside)]

    def _exported(self, name: str) -> Name:
        symbol_found = self.plan.defined.get(name)
        if symbol_found is None:
            raise LinkError(f"`{name}` is to be exported, but is not defined")
        item = self.plan.objects[symbol_found[0]]
        section = item.sections.get(item.symbols[symbol_found[1]].section or 0)
        if section is None or not section.executable:
            raise LinkError(f"`{name}` is to be exported, but is no code")
        return symbol_found

    # ------------------------------------------------------------ places in memory
    def image(self) -> bytes:
        """Return the whole file."""
        count = 1 + len(self.outside) + len(self.exported)
        hashes = _aligned(struct.calcsize(HEADER) + PARTS * struct.calcsize(SEGMENT), 8)
        symbols = _aligned(hashes + 4 * (3 + count), 8)
        texts = symbols + count * struct.calcsize(SYMBOL)
        self._take_entries()
        absolute = sum(r.kind == self.plan.machine.absolute for _, r in self.relocations)
        loads = _aligned(texts + len(self.texts), 8)
        end = loads + struct.calcsize(RELOCATION) * (len(self.plan.entries) + absolute)
        end = self._lay(end, lambda s: not s.writable and not s.executable)
        page = self.plan.machine.page
        code = _aligned(end, page)
        code_end = self._lay_jumps(self._lay(code, lambda s: s.executable))
        data = _aligned(code_end, page)
        table = self._lay_entries(data)
        rows = 2 * (len(self._needed()) + 11)
        data_end = self._lay(table + 8 * rows, lambda s: s.writable and bool(s.data))
        whole_end = self._lay(data_end, lambda s: s.writable and not s.data)
        image = bytearray(data_end)
        self._copy(image)
        self._relocate(image)
        self._put_names(image, hashes, symbols, texts)
        for number, row in enumerate(self.at_load):
            struct.pack_into(RELOCATION, image, loads + number * struct.calcsize(RELOCATION), *row)
        self._put_dynamic(image, table, (hashes, texts, symbols, loads))
        parts = (
            (LOAD, READ, 0, end, end, page),
            (LOAD, READ | EXECUTE, code, code_end - code, code_end - code, page),
            (LOAD, READ | WRITE, data, data_end - data, whole_end - data, page),
            (DYNAMIC, READ | WRITE, table, 8 * rows, 8 * rows, 8),
            (STACK, READ | WRITE, 0, 0, 0, 16),
        )
        _put_head(image, self.plan.machine, parts)
        return bytes(image)

    def _lay(self, end: int, chosen: Callable[[Section], bool]) -> int:
        """Give places to the sections that are chosen, from an end on; return the new end."""
        for number, item in enumerate(self.plan.objects):
            for index, section in item.sections.items():
                if chosen(section):
                    end = _aligned(end, section.alignment)
                    self.plan.at[number, index] = end
                    end += section.size
        return end

    def _take_entries(self) -> None:
        """Find what needs an entry in the table of addresses: what is read through it, and each name from outside that is called."""
        machine = self.plan.machine
        for number, relocation in self.relocations:
            entry = self.plan.resolved(number, relocation.symbol)
            outside = isinstance(entry, str)
            if relocation.kind in machine.through or (outside and relocation.kind in machine.direct):
                self.plan.entries[entry] = 0
            if isinstance(entry, str) and relocation.kind in machine.direct:
                self.plan.jumps[entry] = 0

    def _lay_jumps(self, end: int) -> int:
        size = self.plan.machine.jump_size
        end = _aligned(end, size)
        for number, name in enumerate(self.plan.jumps):
            self.plan.jumps[name] = end + number * size
        return end + len(self.plan.jumps) * size

    def _lay_entries(self, start: int) -> int:
        for number, entry in enumerate(self.plan.entries):
            self.plan.entries[entry] = start + 8 * number
        return start + 8 * len(self.plan.entries)

    # ------------------------------------------------------------ content
    def _copy(self, image: bytearray) -> None:
        for (number, index), place in self.plan.at.items():
            section = self.plan.objects[number].sections[index]
            if section.data:
                image[place : place + section.size] = section.data

    def _relocate(self, image: bytearray) -> None:
        plan, (named, relative, _) = self.plan, self.plan.machine.at_load
        for entry, place in plan.entries.items():
            if isinstance(entry, str):
                self.at_load.append((place, self.places[entry] << 32 | named, 0))
            else:
                self.at_load.append((place, relative, plan.address(entry)))
        for name, place in plan.jumps.items():
            plan.machine.jump(image, place, plan.entries[name])
        for number, relocation in self.relocations:
            self._patch(image, plan.objects[number].sections[relocation.section], number, relocation)

    def _patch(self, image: bytearray, section: Section, number: int, relocation: Relocation) -> None:
        plan, machine, kind = self.plan, self.plan.machine, relocation.kind
        entry = plan.resolved(number, relocation.symbol)
        width = 8 if kind == machine.absolute else 4
        if not 0 <= relocation.offset <= section.size - width or not section.data:
            raise LinkError("a relocation lies outside of its section")
        at = plan.at[number, relocation.section] + relocation.offset
        if kind == machine.absolute:
            if not section.writable:
                raise LinkError(f"section {section.name} has addresses, but is not to be written")
            if isinstance(entry, str):
                self.at_load.append((at, self.places[entry] << 32 | machine.at_load[2], relocation.addend))
            else:
                self.at_load.append((at, machine.at_load[1], self._target(entry, relocation.addend)))
        elif kind in machine.through:
            machine.through[kind](PatchPlace(image, at, plan.entries[entry] + relocation.addend))
        elif kind in machine.direct:
            address = (
                plan.jumps[entry] + relocation.addend
                if isinstance(entry, str)
                else self._target(entry, relocation.addend)
            )
            machine.direct[kind](PatchPlace(image, at, address))
        else:
            raise LinkError(f"relocations of kind {kind} are not supported")

    def _target(self, name: Name, addend: int) -> int:
        """Return the address of a symbol with an addend, which stays near its section."""
        symbol: ObjectSymbol = self.plan.objects[name[0]].symbols[name[1]]
        assert symbol.section is not None
        address, size = self.plan.address(name), self.plan.objects[name[0]].sections[symbol.section].size
        start = address - symbol.value
        if not start - 16 <= address + addend <= start + size + 16:
            raise LinkError("a relocation leaves its section")
        return address + addend

    def _put_names(self, image: bytearray, hashes: int, symbols: int, texts: int) -> None:
        """Write the table of names. All stand in one chain: a library of an FMU has few."""
        count = 1 + len(self.outside) + len(self.exported)
        chain = [*range(2, count), 0] if count > 1 else []
        struct.pack_into(f"<{3 + count}I", image, hashes, 1, count, min(count - 1, 1), 0, *chain)
        image[texts : texts + len(self.texts)] = self.texts
        rows = [(self.text_places[n], GLOBAL_FUNCTION, 0, 0, 0, 0) for n in self.outside]
        for name, where in self.exported:
            symbol = self.plan.objects[where[0]].symbols[where[1]]
            rows.append((self.text_places[name], GLOBAL_FUNCTION, 0, 1, self.plan.address(where), symbol.size))
        for number, row in enumerate(rows, 1):
            struct.pack_into(SYMBOL, image, symbols + number * struct.calcsize(SYMBOL), *row)

    def _put_dynamic(self, image: bytearray, table: int, places: tuple[int, int, int, int]) -> None:
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
        rows += [(RELA, loads), (RELASZ, width * len(self.at_load)), (RELAENT, width)] if self.at_load else []
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


def _texts(names: Sequence[str]) -> tuple[bytes, dict[str, int]]:
    """Return a table of texts, and the place of each."""
    table, places = b"\0", dict[str, int]()
    for name in dict.fromkeys(names):
        places[name] = len(table)
        table += name.encode("utf-8") + b"\0"
    return table, places


def _aligned(place: int, step: int) -> int:
    return (place + step - 1) // step * step
