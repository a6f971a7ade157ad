"""Libraries of Windows in memory on Linux: mapped and moved by pefile, called across the two conventions by code of LLVM's."""

from __future__ import annotations

import ctypes
import mmap
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from compiler.jit.machine import MachineCode, object_code

pefile = pytest.importorskip("pefile")

here = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64",
    reason="code for x86-64 is called with addresses of Linux",
)
WINE = shutil.which("wine64") or shutil.which("wine")
needs_wine = pytest.mark.skipif(WINE is None, reason="there is no Wine")
PLACE = ("IMAGE_DIRECTORY_ENTRY_EXPORT", "IMAGE_DIRECTORY_ENTRY_IMPORT", "IMAGE_DIRECTORY_ENTRY_BASERELOC", "IMAGE_DIRECTORY_ENTRY_EXCEPTION")  # fmt: skip
TYPES = {"double": ctypes.c_double, "i64": ctypes.c_int64, "i32": ctypes.c_int32, "ptr": ctypes.c_void_p, "void": None}
# What a library takes from the system: result, arguments. Those that are not named take a number.
SYSTEM = {
    "calloc": ("ptr", "i64", "i64"), "free": ("void", "ptr"), "memcpy": ("ptr", "ptr", "ptr", "i64"), "memmove": ("ptr", "ptr", "ptr", "i64"),
    "memset": ("ptr", "ptr", "i32", "i64"), "strlen": ("i64", "ptr"), **dict.fromkeys(("atan2", "fmod", "pow", "hypot", "remainder", "copysign"), ("double",) * 3),
}  # fmt: skip
_kept: list[Any] = []  # what is in memory stays there


def called(result: str, arguments: Sequence[str], target: str, to: str = "", of: str = "") -> str:
    """The body of a function that calls a target; `to` and `of`: conventions of the target and of the function."""
    names = ", ".join(f"{kind} %a{i}" for i, kind in enumerate(arguments))
    end = "ret void" if result == "void" else f"ret {result} %r"
    return f"{result} @NAME({names}) {{\n  {'' if result == 'void' else '%r = '}call {to} {result} {target}({names})\n  {end}\n}}"


def machine_code(text: str) -> MachineCode:
    _kept.append(code := MachineCode(object_code(text, 0)))
    return code


def imports(names: Sequence[str]) -> Mapping[str, int]:
    """Addresses, for callers by the convention of Windows, of what a library takes; the stack of Linux grows of itself."""
    rows = ["define win64cc void @win.__chkstk() {\n  ret void\n}"]
    for name in {*names} - {"__chkstk"}:
        result, *arguments = SYSTEM.get(name, ("double", "double"))
        rows.append(f"declare {result} @{name}({', '.join(arguments)})")
        rows.append(f"define win64cc {called(result, arguments, f'@{name}')}".replace("@NAME", f"@win.{name}"))
    code = machine_code("\n".join(rows))
    return {name: code.address(f"win.{name}") for name in names}


def loaded(data: bytes) -> dict[str, int]:
    """Map a library at an address that it did not choose; return the addresses of what it exports."""
    library = read(data)
    memory = mmap.mmap(-1, library.OPTIONAL_HEADER.SizeOfImage, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    base = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    _kept.append(memory)
    taken = [i for entry in getattr(library, "DIRECTORY_ENTRY_IMPORT", ()) for i in entry.imports]
    places = [(i.name.decode(), i.address - library.OPTIONAL_HEADER.ImageBase) for i in taken]
    image = bytearray(library.get_memory_mapped_image(ImageBase=base).ljust(len(memory), b"\0"))
    addresses = imports([name for name, _ in places])
    for name, place in places:
        image[place : place + 8] = addresses[name].to_bytes(8, "little")
    memory[:] = bytes(image)
    return {s.name.decode(): base + s.address for s in library.DIRECTORY_ENTRY_EXPORT.symbols}


def read(data: bytes) -> Any:
    """A library as pefile reads it, which finds nothing wrong but that it has no function to begin with."""
    library = pefile.PE(data=data, fast_load=True)
    library.parse_data_directories([pefile.DIRECTORY_ENTRY[n] for n in PLACE])
    assert not [w for w in library.get_warnings() if "AddressOfEntryPoint" not in w and "Byte 0x00" not in w]
    return library


def function(address: int, result: str, *arguments: str) -> Any:
    """A function of a library, to be called from Python."""
    text = f"define {called(result, arguments, f'inttoptr (i64 {address} to ptr)', 'win64cc')}".replace("@NAME", "@f")
    return ctypes.CFUNCTYPE(TYPES[result], *(TYPES[a] for a in arguments))(machine_code(text).address("f"))


def under_wine(library: Path) -> int:
    """Call `check` of a library in a process of Wine; return the number with which it ends the process."""
    assert WINE is not None
    environment = {"WINEPREFIX": str(library.parent / "prefix"), **os.environ, "WINEDEBUG": "-all"}
    command = [WINE, "rundll32", f"{library.name},check"]
    return subprocess.run(command, cwd=library.parent, env=environment, check=False, timeout=300).returncode
