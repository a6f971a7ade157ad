"""Processors: how an address is put into an instruction, and what the loader of a library is told of it.

x86-64: System V ABI, AMD64 supplement, section 4.4; of Windows: PE Format, COFF relocations. AArch64: ELF for the Arm 64-bit
architecture, section 5.7.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping

from ..fast_dataclass import dataclass
from .object_file import LinkError

PAGE = 0x1000


@dataclass(frozen=True, slots=True)
class PatchPlace:
    """Place to be written: the image, its own address, and the address (with the addend) to be put there."""

    image: bytearray
    at: int
    address: int


Patch = Callable[[PatchPlace], None]


@dataclass(frozen=True, slots=True)
class Machine:
    """A processor. `direct` kinds of relocation take the address of a symbol, `through` those of its entry in the table of addresses.

    `absolute` is the kind of a whole address in data. `at_load` are the numbers for the loader: address of a name in the table,
    address relative to the library, address of a name in data (0: that of a jump to the name takes its place).
    """

    number: int
    absolute: int
    direct: Mapping[int, Patch]
    through: Mapping[int, Patch]
    at_load: tuple[int, int, int]
    page: int  # largest page of a system with this processor
    jump_size: int
    jump: Callable[[bytearray, int, int], None]  # image, own place, place of the entry that is jumped to


def _number(place: PatchPlace, form: str, value: int) -> None:
    try:
        struct.pack_into(form, place.image, place.at, value)
    except struct.error:
        raise LinkError("an address is out of reach") from None


def _relative(place: PatchPlace) -> None:
    _number(place, "<i", place.address - place.at)


def _jump_x86(image: bytearray, at: int, entry: int) -> None:
    image[at : at + 2] = b"\xff\x25"  # jmp *(entry)
    _number(PatchPlace(image, at + 2, 0), "<i", entry - (at + 6))


X86_64 = Machine(
    number=62, absolute=1,
    direct={2: _relative, 4: _relative}, through={9: _relative, 41: _relative, 42: _relative},
    at_load=(6, 8, 1), page=PAGE, jump_size=8, jump=_jump_x86,
)  # fmt: skip


def _from_start(place: PatchPlace) -> None:
    _number(place, "<I", place.address)


# What its addends lack of the end of an instruction, the reader of objects has taken off.
X86_64_WINDOWS = Machine(
    number=0x8664, absolute=1,
    direct={3: _from_start, **dict.fromkeys(range(4, 10), _relative)}, through={},
    at_load=(0, 10, 0), page=PAGE, jump_size=8, jump=_jump_x86,
)  # fmt: skip


def _word(place: PatchPlace, mask: int, value: int) -> None:
    """Put bits into an instruction."""
    if place.at % 4:
        raise LinkError("an instruction is not aligned")
    (word,) = struct.unpack_from("<I", place.image, place.at)
    struct.pack_into("<I", place.image, place.at, (word & ~mask & 0xFFFFFFFF) | (value & mask))


def _far(place: PatchPlace) -> None:
    """Put the distance of pages into `adrp`."""
    pages = (place.address >> 12) - (place.at >> 12)
    if not -(1 << 20) <= pages < 1 << 20:
        raise LinkError("an address is out of reach")
    _word(place, 0x60FFFFE0, (pages & 3) << 29 | (pages >> 2 & 0x7FFFF) << 5)


def _within(shift: int) -> Patch:
    """Return the patch that puts the place within a page, in units of 2^shift bytes, into `add`, `ldr` or `str`."""

    def put(place: PatchPlace) -> None:
        if place.address & ((1 << shift) - 1):
            raise LinkError("data are not aligned")
        _word(place, 0xFFF << 10, (place.address & 0xFFF) >> shift << 10)

    return put


def _call(place: PatchPlace) -> None:
    distance = place.address - place.at
    if distance % 4 or not -(1 << 27) <= distance < 1 << 27:
        raise LinkError("a call is out of reach")
    _word(place, 0x3FFFFFF, distance >> 2)


def _jump_arm(image: bytearray, at: int, entry: int) -> None:
    struct.pack_into("<4I", image, at, 0x90000010, 0xF9400211, 0xD61F0220, 0xD503201F)  # adrp x16; ldr x17; br x17; nop
    _far(PatchPlace(image, at, entry))
    _within(3)(PatchPlace(image, at + 4, entry))


AARCH64 = Machine(
    number=183, absolute=257,
    direct={
        261: _relative, 275: _far, 277: _within(0), 278: _within(0), 284: _within(1), 285: _within(2), 286: _within(3),
        299: _within(4), 282: _call, 283: _call,
    },
    through={311: _far, 312: _within(3)},
    at_load=(1025, 1027, 257), page=0x10000, jump_size=16, jump=_jump_arm,
)  # fmt: skip

MACHINES: Mapping[int, Machine] = {m.number: m for m in (X86_64, AARCH64, X86_64_WINDOWS)}
