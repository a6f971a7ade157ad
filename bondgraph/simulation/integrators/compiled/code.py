"""Machine code of the solvers, the same for all models: compiled once per machine, then loaded.

It is two modules, as compiling takes seconds: one with the methods that `automatic` chooses among, and the loop over steps with all methods, which is made
when a run names one of the others.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import Any

from compiler.api import MachineCode

from ....native import kernel
from ..methods import ANY

OPTIMISED = 1  # level 2 takes half as long again, and its steps are no faster
WHOLE, POINTER = ctypes.c_int64, ctypes.c_void_p


@lru_cache
def machine_code(by_any: bool = False) -> MachineCode:
    """Return the machine code of the solvers, or of the loop over steps by any method."""

    def text() -> str:
        from compiler.api import Choices, translate

        from .sources import NAMED, SOURCES, VECTORS

        if by_any:
            return translate([SOURCES[ANY]], choices=Choices(vectors=VECTORS))
        return translate(list(SOURCES.values()), choices=Choices(NAMED, VECTORS))

    return MachineCode(kernel("stepping by any method" if by_any else "stepping", text, OPTIMISED))


@lru_cache
def called(name: str, result: Any, *arguments: Any) -> Any:
    """Return a function of that code."""
    address = machine_code(True).address("advance") if name == ANY else machine_code().address(name)
    return ctypes.CFUNCTYPE(result, *arguments)(address)
