"""Machine code of the solvers, the same for all models: compiled once per machine, then loaded."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import Any

from compiler.api import MachineCode

from ....native import kernel

OPTIMISED = 1  # level 2 takes half as long again, and its steps are no faster
WHOLE, POINTER = ctypes.c_int64, ctypes.c_void_p


@lru_cache
def machine_code() -> MachineCode:
    """Return the machine code of the solvers."""

    def text() -> str:
        from compiler.api import translate

        from .sources import SOURCES

        return translate(list(SOURCES.values()))

    return MachineCode(kernel("stepping", text, OPTIMISED))


@lru_cache
def called(name: str, result: Any, *arguments: Any) -> Any:
    """Return a function of that code."""
    return ctypes.CFUNCTYPE(result, *arguments)(machine_code().address(name))
