"""Shared libraries of our own linker: loaded and called, read by other tools, and made of damaged objects."""

from __future__ import annotations

import ctypes
import math
import platform
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from compiler.jit.machine import object_code
from compiler.linking.layout import SharedLibrary
from compiler.linking.link import link, read_object
from compiler.linking.machines import AARCH64, PatchPlace
from compiler.linking.object_file import LinkError
from tests.linking.damaged_objects import EXPORTED, FIRST, SECOND, link_damaged

pytestmark = pytest.mark.machine_code
here = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64", reason="libraries of Linux on x86-64 are loaded"
)
SYSTEM = (("libm.so.6", frozenset(("sin", "cos", "pow"))), ("libc.so.6", frozenset(("memset",))))


def library(platform: str = "linux64", exported: tuple[str, ...] = EXPORTED) -> bytes:
    objects = [object_code(text, 0, platform) for text in (FIRST, SECOND)]
    return link(objects, SharedLibrary("some.so", exported, SYSTEM))


@here
def test_functions_of_a_library_are_called(tmp_path: Path) -> None:
    """Calls into the mathematical library, constants, addresses in data, memory that begins as zero, calls between objects."""
    path = tmp_path / "some.so"
    path.write_bytes(library())
    loaded = ctypes.CDLL(str(path))
    for name in EXPORTED[:-1]:
        getattr(loaded, name).restype = ctypes.c_double
    x = ctypes.c_double(0.7)
    assert loaded.twice(x) == 1.4
    assert loaded.weighted(x) == 3.5
    assert loaded.circle(x) == math.sin(0.7) + math.cos(0.7)
    assert [loaded.chosen(ctypes.c_int64(n), x) for n in (0, 1)] == [1.4, 3.5]
    assert loaded.both(x) == 14.0
    assert [loaded.counted() for _ in range(3)] == [1, 2, 3]
    with pytest.raises(AttributeError):
        _ = loaded.other  # it is not exported


@here
def test_two_libraries_have_their_own_data(tmp_path: Path) -> None:
    paths = [tmp_path / "one.so", tmp_path / "two.so"]
    for path in paths:
        path.write_bytes(library())
    one, two = (ctypes.CDLL(str(path)) for path in paths)
    assert [one.counted(), one.counted(), two.counted()] == [1, 2, 1]


@pytest.mark.parametrize("platform", ["linux64", "linux-aarch64"])
def test_another_tool_reads_a_library(platform: str, tmp_path: Path) -> None:
    if not (tool := shutil.which("readelf")):
        pytest.skip("no readelf")
    path = tmp_path / "some.so"
    path.write_bytes(library(platform))
    command = [tool, "-W", "-l", "-d", "-r", "-s", "--use-dynamic", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    parts = [line.split() for line in done.stdout.splitlines()]
    loads = [p[6:-1] for p in parts if p[:1] == ["LOAD"]]
    assert loads == [["R"], ["R", "E"], ["RW"]]
    assert any(p[:1] == ["GNU_STACK"] and "RW" in p for p in parts)
    assert "BIND_NOW" in done.stdout and "libm.so.6" in done.stdout and "libc.so.6" not in done.stdout
    names = {p[-1]: p[-2] for p in parts if len(p) == 8 and p[3] == "FUNC"}
    assert {n for n, place in names.items() if place == "UND"} == {"sin", "cos"}
    assert {n for n, place in names.items() if place != "UND"} == set(EXPORTED)


def test_addresses_in_instructions_of_arm() -> None:
    """The pair `adrp`, `ldr` that reads the constant of `weighted` leads to it: 5.0 at byte 16 of the list."""
    data = library("linux-aarch64")
    place, size = _symbol(data, "weighted")
    words = struct.unpack_from(f"<{size // 4}I", data, place)
    far = next(i for i, w in enumerate(words) if w & 0x9F000000 == 0x90000000)
    pages = (words[far] >> 29 & 3) | (words[far] >> 5 & 0x7FFFF) << 2
    pages -= (pages & 1 << 20) * 2
    page = ((place + 4 * far) >> 12) + pages << 12
    near = next(w for w in words[far + 1 :] if w & 0x3B000000 in (0x39000000, 0x11000000))
    shift = 3 if near & 0x3B000000 == 0x39000000 else 0
    at = page + ((near >> 10 & 0xFFF) << shift)
    assert 5.0 in struct.unpack_from("<3d", data, at)


@pytest.mark.parametrize(("kind", "unit", "reach", "field"), [(283, 4, 1 << 27, 26), (275, 4096, 1 << 32, 21)])
def test_reach_of_instructions_of_arm(kind: int, unit: int, reach: int, field: int) -> None:
    """`bl` holds 26 bits of words, so 128 MiB either way; `adrp` 21 bits of pages, 4 GiB either way. One unit more is refused, and no other bit changes."""
    empty = {283: 0x94000000, 275: 0x90000010}[kind]
    for distance in (-reach, -unit, 0, unit, reach - unit):
        image = bytearray(struct.pack("<I", empty))
        AARCH64.direct[kind](PatchPlace(image, 0, distance))
        (word,) = struct.unpack("<I", image)
        bits = word & 0x3FFFFFF if kind == 283 else (word >> 29 & 3) | (word >> 5 & 0x7FFFF) << 2
        assert (bits - (bits >> field - 1 << field)) * unit == distance
        assert word & ~(0x3FFFFFF if kind == 283 else 0x60FFFFE0) == empty
    for distance in (-reach - unit, reach):
        with pytest.raises(LinkError, match="out of reach"):
            AARCH64.direct[kind](PatchPlace(bytearray(4), 0, distance))


def _symbol(data: bytes, name: str) -> tuple[int, int]:
    """Address and size of an exported function, from the table that the loader reads."""
    (start,) = struct.unpack_from("<Q", data, 32)
    count = struct.unpack_from("<H", data, 56)[0]
    parts = [struct.unpack_from("<IIQQQQQQ", data, start + 56 * i) for i in range(count)]
    place, length = next((p[2], p[5]) for p in parts if p[0] == 2)
    table = dict(struct.unpack_from("<QQ", data, place + i) for i in range(0, length, 16))
    for i in range(1, 1000):
        row = struct.unpack_from("<IBBHQQ", data, table[6] + 24 * i)
        text = table[5] + row[0]
        if data[text : data.index(b"\0", text)].decode() == name:
            return row[4], row[5]
    raise AssertionError(name)


def test_what_is_not_there_is_named() -> None:
    with pytest.raises(LinkError, match="`tan` is to be exported, but is not defined"):
        library(exported=("tan",))
    with pytest.raises(LinkError, match="`other` is defined nowhere"):
        link([object_code(FIRST, 0, "linux64")], SharedLibrary("some.so", (), SYSTEM))
    with pytest.raises(LinkError, match="one known processor"):
        link([object_code(SECOND, 0, p) for p in ("linux64", "linux-aarch64")], SharedLibrary("some.so", (), SYSTEM))
    for data in (b"", b"\x7fELF", b"MZ" + bytes(200), bytes(64)):
        with pytest.raises(LinkError):
            read_object(data)


# Fields of a header, an entry of the table of sections, a symbol, a relocation: place and width.
FIELDS = {
    "header": ((0, 8), (16, 2), (18, 2), (40, 8), (58, 2), (60, 2), (62, 2)),
    "section": ((0, 4), (4, 4), (8, 8), (16, 8), (24, 8), (32, 8), (40, 4), (44, 4), (48, 8), (56, 8)),
    "symbol": ((0, 4), (4, 2), (6, 2), (8, 8), (16, 8)),
    "relocation": ((0, 8), (8, 4), (12, 4), (16, 8)),
}


def _fields(data: bytes) -> list[tuple[int, int]]:
    """Place and width of all fields of the tables of an object."""
    (start,), (count,) = struct.unpack_from("<Q", data, 40), struct.unpack_from("<H", data, 60)
    rows = [("header", 0), *(("section", start + 64 * i) for i in range(count))]
    for i in range(count):
        kind, offset, size = (struct.unpack_from(f, data, start + 64 * i + p)[0] for f, p in (("<I", 4), ("<Q", 24), ("<Q", 32)))  # fmt: skip
        if kind in (2, 4):
            rows += [("symbol" if kind == 2 else "relocation", at) for at in range(offset, offset + size, 24)]
    return [(at + place, width) for kind, at in rows for place, width in FIELDS[kind]]


def _check_library(image: bytes) -> None:
    """All that a loader takes lies where it may: parts apart, tables and addresses within them, exported names in code."""
    (start,), (count,) = struct.unpack_from("<Q", image, 32), struct.unpack_from("<H", image, 56)
    parts = [struct.unpack_from("<IIQQQQQQ", image, start + 56 * i) for i in range(count)]
    read, code, data = ((p[3], p[3] + p[6]) for p in parts if p[0] == 1)
    assert read[1] <= code[0] <= code[1] <= data[0] <= data[1] < 1 << 29
    assert all(p[2] == p[3] and p[2] + p[5] <= len(image) and p[5] <= p[6] for p in parts if p[0] == 1)
    place, length = next((p[2], p[5]) for p in parts if p[0] == 2)
    table = dict(struct.unpack_from("<QQ", image, place + i) for i in range(0, length, 16))
    (symbols,) = struct.unpack_from("<I", image, table[4] + 4)
    assert table[6] + 24 * symbols <= table[5] and table[5] + table[10] <= read[1]
    for at in range(table.get(7, 0), table.get(7, 0) + table.get(8, 0), 24):
        offset, information, addend = struct.unpack_from("<QQq", image, at)
        assert data[0] <= offset <= data[1] - 8 and information >> 32 < symbols
        assert information >> 32 or -16 <= addend <= data[1] + 16
    for name in EXPORTED:
        begin, size = _symbol(image, name)
        assert code[0] <= begin and begin + size <= code[1]


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(50))
def test_damaged_objects_are_linked_soundly_or_refused(seed: int) -> None:
    good = [object_code(text, 0, ("linux64", "linux-aarch64")[seed % 2]) for text in (FIRST, SECOND)]
    link_damaged(good, SharedLibrary("some.so", EXPORTED, SYSTEM), _fields(good[0]), _check_library, seed)
