"""Places of a library in memory, and what is put there: the same for all formats."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field

from ..fast_dataclass import dataclass
from .machines import Machine, PatchPlace
from .object_file import LinkError, ObjectFile, Relocation, Section

# A symbol: the number of its object, and its number there.
Name = tuple[int, int]
Entry = str | Name
NEAR = 16  # bytes beyond a section or a name that an addend may reach: distances count from the end of an instruction


@dataclass(frozen=True, slots=True)
class SharedLibrary:
    """Request of a library: its name, the names that others see, and the libraries of the system with the names that each defines."""

    name: str
    exported: tuple[str, ...]
    system: tuple[tuple[str, frozenset[str]], ...]


@dataclass(slots=True)
class LibraryLayout:
    """Library in the making: places of sections, of entries in the table of addresses, and of jumps through it.

    Addresses in memory are places in the file. `at_load`: what the system's loader puts: a place, the address there, and an addend.
    """

    machine: Machine
    objects: tuple[ObjectFile, ...]
    library: SharedLibrary
    defined: dict[str, Name] = field(default_factory=dict)
    at: dict[Name, int] = field(default_factory=dict)  # (object, section) -> address
    entries: dict[Entry, int] = field(default_factory=dict)
    jumps: dict[str, int] = field(default_factory=dict)
    at_load: list[tuple[int, Entry, int]] = field(default_factory=list)

    # ------------------------------------------------------------ names
    def define(self) -> None:
        """Find the symbol that each name means: the first object's."""
        for number, item in enumerate(self.objects):
            for place, symbol in enumerate(item.symbols):
                if symbol.visible and symbol.section is not None:
                    self.defined.setdefault(symbol.name, (number, place))

    def relocations(self) -> list[tuple[int, Relocation]]:
        """Return all relocations with the numbers of their objects."""
        return [(n, r) for n, item in enumerate(self.objects) for r in item.relocations]

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

    def outside(self) -> list[str]:
        """Return the names that the library takes from the system, each of which one of its libraries must define."""
        entries = [self.resolved(n, r.symbol) for n, r in self.relocations()]
        names = sorted({e for e in entries if isinstance(e, str)})
        known_names = {name for _, defines in self.library.system for name in defines}
        if missing := [n for n in names if n not in known_names]:
            raise LinkError(f"`{missing[0]}` is defined nowhere")
        return names

    def exported(self, name: str) -> Name:
        """Return the symbol of a function that others see."""
        symbol_found = self.defined.get(name)
        if symbol_found is None:
            raise LinkError(f"`{name}` is to be exported, but is not defined")
        item = self.objects[symbol_found[0]]
        section = item.sections.get(item.symbols[symbol_found[1]].section or 0)
        if section is None or not section.executable:
            raise LinkError(f"`{name}` is to be exported, but is no code")
        return symbol_found

    # ------------------------------------------------------------ places
    def take_entries(self) -> None:
        """Find what needs an entry in the table of addresses: what is read through it, and each name from outside that is called."""
        machine = self.machine
        by_jump = {*machine.direct} if machine.at_load[2] else {*machine.direct, machine.absolute}
        for number, relocation in self.relocations():
            entry = self.resolved(number, relocation.symbol)
            if isinstance(entry, str) and relocation.kind in by_jump:
                self.entries[entry] = self.jumps[entry] = 0
            elif relocation.kind in machine.through:
                self.entries[entry] = 0

    def absolute(self) -> int:
        """Return the number of whole addresses in sections."""
        return sum(r.kind == self.machine.absolute for _, r in self.relocations())

    def lay(self, end: int, chosen: Callable[[Section], bool]) -> int:
        """Give places to the sections that are chosen, from an end on; return the new end."""
        for number, item in enumerate(self.objects):
            for index, section in item.sections.items():
                if chosen(section):
                    end = aligned(end, section.alignment)
                    self.at[number, index] = end
                    end += section.size
        return end

    def lay_jumps(self, end: int) -> int:
        """Give places to the jumps; return the new end."""
        size = self.machine.jump_size
        end = aligned(end, size)
        for number, name in enumerate(self.jumps):
            self.jumps[name] = end + number * size
        return end + len(self.jumps) * size

    def lay_entries(self, start: int, entries: Sequence[Entry]) -> int:
        """Give places to entries in the table of addresses; return the new end."""
        for number, entry in enumerate(entries):
            self.entries[entry] = start + 8 * number
        return start + 8 * len(entries)

    # ------------------------------------------------------------ content
    def fill(self, image: bytearray) -> None:
        """Copy the sections, write the jumps, and put the addresses in."""
        for (number, index), place in self.at.items():
            section = self.objects[number].sections[index]
            if section.data:
                image[place : place + section.size] = section.data
        for name, place in self.jumps.items():
            self.machine.jump(image, place, self.entries[name])
        for number, relocation in self.relocations():
            self._patch(image, self.objects[number].sections[relocation.section], number, relocation)

    def _patch(self, image: bytearray, section: Section, number: int, relocation: Relocation) -> None:
        machine, kind, addend = self.machine, relocation.kind, relocation.addend
        entry = self.resolved(number, relocation.symbol)
        width = 8 if kind == machine.absolute else 4
        if not 0 <= relocation.offset <= section.size - width or not section.data:
            raise LinkError("a relocation lies outside of its section")
        at = self.at[number, relocation.section] + relocation.offset
        if kind == machine.absolute:
            self._target(entry, addend)
            self.at_load.append((at, entry, addend))
        elif kind in machine.through:
            machine.through[kind](PatchPlace(image, at, self.entries[entry] + addend))
        elif kind in machine.direct:
            machine.direct[kind](PatchPlace(image, at, self._target(entry, addend)))
        else:
            raise LinkError(f"relocations of kind {kind} are not supported")

    def _target(self, entry: Entry, addend: int) -> int:
        """Return the address of a symbol, or of the jump to a name, with an addend, which stays near."""
        if isinstance(entry, str):
            address = start = self.jumps.get(entry, 0)
            size = 0
        else:
            symbol = self.objects[entry[0]].symbols[entry[1]]
            assert symbol.section is not None
            address, size = self.address(entry), self.objects[entry[0]].sections[symbol.section].size
            start = address - symbol.value
        if not start - NEAR <= address + addend <= start + size + NEAR:
            raise LinkError("a relocation leaves its section")
        return address + addend


def texts_of(names: Sequence[str]) -> tuple[bytes, dict[str, int]]:
    """Return a table of texts, and the place of each."""
    table, places = b"\0", dict[str, int]()
    for name in dict.fromkeys(names):
        places[name] = len(table)
        table += name.encode("utf-8") + b"\0"
    return table, places


def aligned(place: int, step: int) -> int:
    """Return the first multiple of a step from a place on."""
    return (place + step - 1) // step * step
