"""Objects for Windows and macOS, which no test runs here: their headers, what they define, and that they call nothing but the libraries of those systems."""

from __future__ import annotations

import struct

import pytest

from compiler.codegen.llvm.generate import generate_code
from compiler.jit import machine
from tests.compiling import MODELS, compiled

pytestmark = pytest.mark.machine_code
SYSTEMS = {  # LLVM's name, processor, kind of the object, the number that it has for the processor
    "win64": ("x86_64-pc-windows-msvc", "x86-64", "COFF", 0x8664),
    "darwin64": ("x86_64-apple-macosx11.0", "x86-64", "Mach-O", 0x01000007),
    "darwin-arm64": ("arm64-apple-macosx11.0", "generic", "Mach-O", 0x0100000C),
}
OF_THE_SYSTEM = {"COFF": {"_fltused"}, "Mach-O": {"__sincos_stret", "__bzero", "bzero", "memset_pattern16"}}


def coff(code: bytes) -> tuple[int, dict[str, bool]]:
    """Number of the processor, and the global names with True where the object defines them."""
    processor, _, _, table, count, _, _ = struct.unpack_from("<HHIIIHH", code)
    names, place = {}, 0
    while place < count:
        raw, value, section, _, storage, more = struct.unpack_from("<8sIhHBB", code, table + 18 * place)
        if storage == 2:  # external
            start = table + 18 * count + struct.unpack("<4xI", raw)[0]
            name = raw.rstrip(b"\0") if raw[:4] != b"\0" * 4 else code[start : code.index(b"\0", start)]
            names[name.decode()] = section > 0 or value > 0
        place += 1 + more
    return processor, names


def mach_o(code: bytes) -> tuple[int, dict[str, bool]]:
    """The same of Mach-O, whose names begin with an underscore."""
    magic, processor, _, kind, commands, _, _, _ = struct.unpack_from("<8I", code)
    assert (magic, kind) == (0xFEEDFACF, 1)  # 64 bits; an object
    names, place = {}, 32
    for _ in range(commands):
        command, size = struct.unpack_from("<II", code, place)
        if command == 2:  # the table of symbols
            table, count, texts, _ = struct.unpack_from("<4I", code, place + 8)
            for i in range(count):
                text, sort, _, _, _ = struct.unpack_from("<IBBHQ", code, table + 16 * i)
                if sort & 1:  # external
                    start = texts + text
                    names[code[start + 1 : code.index(b"\0", start)].decode()] = sort & 0x0E != 0
        place += size
    return processor, names


@pytest.mark.parametrize("system", SYSTEMS)
def test_an_object_for_another_system(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    triple, processor, kind, number = SYSTEMS[system]
    monkeypatch.setitem(machine.PLATFORMS, system, (triple, processor))
    codes: list[bytes] = []

    def compile_(text: str, level: int) -> bytes:
        codes.append(machine.object_code(text, 1, system))
        return machine.object_code(text, level)

    generate_code(compiled(MODELS / "pendulum.bg", everything=True).lowered, compile_)
    read = [(coff if kind == "COFF" else mach_o)(code) for code in codes]
    names = {name: defined for _, found in reversed(read) for name, defined in found.items()}
    assert {processor for processor, _ in read} == {number}
    assert {"derivative", "jacobian_entries", "output"} <= {n for n, defined in names.items() if defined}
    called = {n for _, found in read for n, defined in found.items() if not defined}
    assert called & {"sin", "cos", "__sincos_stret"}
    assert called <= {*machine.LIBRARY} | OF_THE_SYSTEM[kind], called
