"""Objects of one processor and format to a library."""

from __future__ import annotations

from collections.abc import Sequence

from .coff_object import read_coff
from .elf_library import elf_library
from .elf_object import read_elf
from .layout import LibraryLayout, SharedLibrary
from .machines import MACHINES, X86_64_WINDOWS
from .object_file import LinkError, ObjectFile
from .pe_library import pe_library


def link(objects: Sequence[bytes], library: SharedLibrary) -> bytes:
    """Return the bytes of a shared library of some objects. Raises `LinkError`."""
    read = tuple(map(read_object, objects))
    machines = {o.machine for o in read}
    if len(machines) != 1 or not machines <= MACHINES.keys():
        raise LinkError("the objects are not all of one known processor")
    layout = LibraryLayout(MACHINES[machines.pop()], read, library)
    layout.define()
    return pe_library(layout) if layout.machine is X86_64_WINDOWS else elf_library(layout)


def read_object(data: bytes) -> ObjectFile:
    """Return the parts of an object file. Raises `LinkError`."""
    is_coff = data[:2] == X86_64_WINDOWS.number.to_bytes(2, "little")
    return read_coff(data) if is_coff else read_elf(data)
