"""Libraries of Windows by our own linker: called on Linux with the conventions of Windows, under Wine, read by another tool, and made of damaged objects."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import pytest

from compiler.jit.machine import object_code
from compiler.linking.layout import SharedLibrary
from compiler.linking.link import link, read_object
from compiler.linking.object_file import LinkError
from tests.linking.damaged_objects import EXPORTED, FIRST, SECOND, link_damaged
from tests.linking.windows_loader import function, here, loaded, needs_wine, read, under_wine

pytestmark = pytest.mark.machine_code
SYSTEM = (("ucrtbase.dll", frozenset(("sin", "cos", "floor", "pow"))), ("ntdll.dll", frozenset(("__chkstk",))))
# More than a page of the stack, a function of the system by its address in constant data, and one that LLVM makes of its own.
THIRD = """
@waves = private constant [2 x ptr] [ptr @sin, ptr @cos]
declare double @sin(double)
declare double @cos(double)
declare double @llvm.floor.f64(double)
define double @deep(i64 %n, double %x) {
  %room = alloca [2000 x double]
  %p = getelementptr [2000 x double], ptr %room, i64 0, i64 %n
  store double %x, ptr %p
  %y = load double, ptr %p
  %z = call double @llvm.floor.f64(double %y)
  ret double %z
}
define double @wave(i64 %n, double %x) {
  %p = getelementptr [2 x ptr], ptr @waves, i64 0, i64 %n
  %f = load ptr, ptr %p
  %y = call double %f(double %x)
  ret double %y
}
"""


def library(*more: str, exported: tuple[str, ...] = EXPORTED, system: tuple[tuple[str, frozenset[str]], ...] = SYSTEM) -> bytes:  # fmt: skip
    objects = [object_code(text, 0, "win64") for text in (FIRST, SECOND, *more)]
    return link(objects, SharedLibrary("some.dll", exported, system))


@here
def test_functions_of_a_library_are_called() -> None:
    """Calls into the mathematical library, constants, addresses in data, memory that begins as zero, calls between objects."""
    places = loaded(library(THIRD, exported=(*EXPORTED, "deep", "wave")))
    twice, weighted, circle, both = (function(places[n], "double", "double") for n in ("twice", "weighted", "circle", "both"))  # fmt: skip
    chosen, deep, wave = (function(places[n], "double", "i64", "double") for n in ("chosen", "deep", "wave"))
    assert (twice(0.7), weighted(0.7), both(0.7)) == (1.4, 3.5, 14.0)
    assert circle(0.7) == math.sin(0.7) + math.cos(0.7)
    assert [chosen(n, 0.7) for n in (0, 1)] == [1.4, 3.5]
    assert [deep(n, -2.5) for n in (0, 1999)] == [-3.0, -3.0]
    assert [wave(n, 0.7) for n in (0, 1)] == [math.sin(0.7), math.cos(0.7)]
    counted = [function(loaded(data)["counted"], "i64") for data in [library()] * 2]
    assert [counted[0](), counted[0](), counted[1]()] == [1, 2, 1]  # each library has its own data


def test_another_tool_reads_a_library() -> None:
    """Parts, names, the table for unwinding in order, and the addresses that move with the library."""
    found = read(library(THIRD, exported=(*EXPORTED, "deep", "wave")))
    flags = [(s.Name.rstrip(b"\0"), s.Characteristics >> 29) for s in found.sections]
    assert flags == [(b".rdata", 2), (b".text", 3), (b".data", 6), (b".reloc", 2)]  # 1 execute, 2 read, 4 write
    assert {e.dll: [i.name for i in e.imports] for e in found.DIRECTORY_ENTRY_IMPORT} == {
        b"ucrtbase.dll": [b"cos", b"floor", b"sin"], b"ntdll.dll": [b"__chkstk"],
    }  # fmt: skip
    names = [s.name.decode() for s in found.DIRECTORY_ENTRY_EXPORT.symbols]
    assert names == sorted((*EXPORTED, "deep", "wave"))
    begins = [row.struct.BeginAddress for row in found.DIRECTORY_ENTRY_EXCEPTION]
    code = next(s for s in found.sections if s.Name.startswith(b".text"))
    assert len(begins) > 5 and begins == sorted(begins) and all(map(code.contains_rva, begins))
    assert sum(e.type == 10 for block in found.DIRECTORY_ENTRY_BASERELOC for e in block.entries) == 4
    assert found.OPTIONAL_HEADER.SizeOfImage % 4096 == 0 and found.is_dll() and not found.verify_checksum()


CHECK = """
declare void @ExitProcess(i32)
define void @check(ptr %window, ptr %library, ptr %line, i32 %show) {
  %a = call double @circle(double 0.0)
  %b = call double @chosen(i64 1, double 2.0)
  %c = call double @deep(i64 1999, double 21.5)
  %ab = fadd double %a, %b
  %abc = fadd double %ab, %c
  %code = fptoui double %abc to i32
  call void @ExitProcess(i32 %code)
  ret void
}
declare double @circle(double)
declare double @chosen(i64, double)
declare double @deep(i64, double)
"""


@needs_wine
def test_wine_runs_a_library(tmp_path: Path) -> None:
    """Cos 0 + 5*2 + floor 21.5 = 32 is the number with which its own function ends the process."""
    system = (*SYSTEM, ("kernel32.dll", frozenset(("ExitProcess",))))
    (tmp_path / "some.dll").write_bytes(library(THIRD, CHECK, exported=("check",), system=system))
    assert under_wine(tmp_path / "some.dll") == 32


def test_many_relocations_of_a_section() -> None:
    """More than 65 535 have their number in the first of them."""
    row = ", ".join(["ptr @one"] * 66_000 + ["ptr @two"])
    rows = "".join(f"define void @{name}() {{\n  ret void\n}}\n" for name in ("one", "two"))
    found = read_object(object_code(f"{rows}@table = global [66001 x ptr] [{row}]", 0, "win64"))
    names = [(r.offset, found.symbols[r.symbol].name) for r in found.relocations if found.sections[r.section].writable]
    assert names == [(8 * i, "one" if i < 66_000 else "two") for i in range(66_001)]


def test_what_is_not_there_is_named() -> None:
    with pytest.raises(LinkError, match="`tan` is to be exported, but is not defined"):
        library(exported=("tan",))
    with pytest.raises(LinkError, match="`table` is to be exported, but is no code"):
        library("@table = global i64 1", exported=("table",))
    with pytest.raises(LinkError, match="`__chkstk` is defined nowhere"):
        library(THIRD, system=SYSTEM[:1])
    with pytest.raises(LinkError, match="one known processor"):
        link([object_code(SECOND, 0, p) for p in ("win64", "linux64")], SharedLibrary("some.dll", (), SYSTEM))
    for data in (b"\x64\x86", b"\x64\x86" + bytes(200), b"MZ" + bytes(200)):
        with pytest.raises(LinkError):
            link([data], SharedLibrary("some.dll", (), SYSTEM))


# Fields of a header, an entry of the table of sections, a symbol, a relocation: place and width.
FIELDS = {
    "header": ((0, 2), (2, 2), (8, 4), (12, 4), (16, 2)),
    "section": ((0, 8), (16, 4), (20, 4), (24, 4), (32, 2), (36, 4)),
    "symbol": ((0, 4), (4, 4), (8, 4), (12, 2), (16, 2)),
    "relocation": ((0, 4), (4, 4), (8, 2)),
}


def _fields(data: bytes) -> list[tuple[int, int]]:
    """Place and width of all fields of the tables of an object."""
    _, count, _, table, symbols = struct.unpack_from("<HHIII", data)
    rows = [("header", 0), *(("section", 20 + 40 * i) for i in range(count))]
    rows += [("symbol", table + 18 * i) for i in range(symbols)]
    for i in range(count):
        (start,), (number,) = struct.unpack_from("<I", data, 44 + 40 * i), struct.unpack_from("<H", data, 52 + 40 * i)
        rows += [("relocation", start + 10 * k) for k in range(number)]
    return [(at + place, width) for kind, at in rows for place, width in FIELDS[kind]]


def _check_library(image: bytes) -> None:
    """All that a loader takes lies where it may: parts apart and one behind the other, tables and addresses within them, exported names in code."""
    (start,) = struct.unpack_from("<I", image, 60)
    (count,), (size,) = struct.unpack_from("<H", image, start + 6), struct.unpack_from("<I", image, start + 80)
    tables = [struct.unpack_from("<II", image, start + 136 + 8 * i) for i in range(16)]
    parts = {}
    end = 4096
    for i in range(count):
        name, memory, at, length, place, flags = struct.unpack_from("<8sIIII12xI", image, start + 264 + 40 * i)
        parts[name.rstrip(b"\0")] = (at, at + memory)
        assert memory and at == end and place + length <= len(image) and (place == at or name.startswith(b".reloc"))
        assert flags >> 29 in (2, 3, 6)
        end = at + memory + 4095 & -4096
    assert end == size < 1 << 29
    constants, code = parts[b".rdata"], parts[b".text"]
    assert all(constants[0] <= at and at + length <= constants[1] for at, length in (tables[i] for i in (0, 1, 3, 12)) if length)  # fmt: skip
    functions, names = struct.unpack_from("<II", image, tables[0][0] + 28)
    for i in range(len(EXPORTED)):
        assert code[0] <= struct.unpack_from("<I", image, functions + 4 * i)[0] <= code[1]
        assert constants[0] <= struct.unpack_from("<I", image, names + 4 * i)[0] < constants[1]
    place, length = tables[5]
    at = len(image) - (length + 511 & -512)
    assert length == 0 or place == parts[b".reloc"][0]
    stop = at + length
    while at < stop:
        page, length = struct.unpack_from("<II", image, at)
        for row in struct.unpack_from(f"<{(length - 8) // 2}H", image, at + 8):
            (address,) = struct.unpack_from("<Q", image, page + (row & 4095)) if row else (0x180000000 + 4096,)
            assert 4096 - 16 <= address - 0x180000000 <= size + 16
        at += length


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(50))
def test_damaged_objects_are_linked_soundly_or_refused(seed: int) -> None:
    good = [object_code(text, 0, "win64") for text in (FIRST, SECOND)]
    link_damaged(good, SharedLibrary("some.dll", EXPORTED, SYSTEM), _fields(good[0]), _check_library, seed)
