"""Machine code of the solvers, the same for all models: compiled once per machine, then loaded.

It is several modules, as compiling takes seconds, each made when a run first needs it: the loop over steps with the short ones, the passing of events, and
the step of each other method.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from threading import RLock
from typing import Any

from compiler.api import MachineCode

from ....native import kernel
from ..methods import METHODS, SHARED, STEP_NAMES
from ..outcomes import ABSENT

OPTIMISED = 1  # level 2 takes half as long again, and its steps are no faster
WHOLE, POINTER = ctypes.c_int64, ctypes.c_void_p

STEPPING = "stepping"
PARTS = {  # functions that are not in the first module
    **dict.fromkeys(
        ("advance_through", "evaluate", "doubt", "look_ahead", "decide", "keep", "reread", "survey", "narrow"),
        "stepping through events",
    ),
    **{f"{row.word}_step": f"steps of {row.name}" for row in METHODS if not row.steps},
    "each_record": "runs of a batch",
}

_CODES: dict[str, MachineCode] = {}
_LOADING = RLock()  # threads share one code: a step is linked to it once


def machine_code(part: str) -> MachineCode:
    """Return the machine code of a module."""
    with _LOADING:
        if part not in _CODES:
            _CODES[part] = _loaded(part)
        return _CODES[part]


def _loaded(part: str) -> MachineCode:
    def text() -> str:
        from compiler.api import Choices, translate

        from .sources import APART, SOURCES, VECTORS

        own = [function for name, function in SOURCES.items() if PARTS.get(name, STEPPING) == part]
        return translate(own, choices=Choices(vectors=VECTORS, elsewhere=APART.difference(own), absent=ABSENT))

    code = MachineCode(kernel(part, text, OPTIMISED))
    for name in SHARED if part != STEPPING else ():
        code.link(name, machine_code(STEPPING).address(name))
    return code


def link_step(method: int) -> None:
    """Let the loop over steps call the step of a method, which answered that it is absent."""
    name = STEP_NAMES[method]
    machine_code(STEPPING).link(name, machine_code(PARTS[name]).address(name))


def function_address(name: str) -> int:
    """Return the address of a function of that code."""
    return machine_code(PARTS.get(name, STEPPING)).address(name)


@lru_cache
def called(name: str, result: Any, *arguments: Any) -> Any:
    """Return a function of that code."""
    return ctypes.CFUNCTYPE(result, *arguments)(function_address(name))
