"""Machine code of the solvers, the same for all models: compiled once per machine, then loaded."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from compiler.api import MachineCode

from ....native import kernel
from ..acceptance.zero_crossings import roots_along, states_along
from ..dense_output.dense_output import scaled_along
from ..linear_algebra.balancing import balance
from ..linear_algebra.eliminations import plan_eliminations, put_rows
from ..linear_algebra.least_degree import least_degree
from ..linear_algebra.sparse import real_factors
from ..pilot.loop import coarse
from ..pilot.step import euler
from ..projection.projection import hold_all, least_all, rates_all
from .advance import advance, begin

OPTIMISED = 2
WHOLE, POINTER = ctypes.c_int64, ctypes.c_void_p


@lru_cache
def machine_code() -> MachineCode:
    """Return the machine code of the solvers."""

    def text() -> str:
        from compiler.api import translate

        of_steps: list[Callable[..., Any]] = [begin, advance, euler, coarse, roots_along, states_along, scaled_along]
        of_matrices: list[Callable[..., Any]] = [balance, real_factors, least_degree, plan_eliminations, put_rows]
        return translate([*of_steps, hold_all, least_all, rates_all, *of_matrices])

    return MachineCode(kernel("stepping", text, OPTIMISED))


@lru_cache
def called(name: str, result: Any, *arguments: Any) -> Any:
    """Return a function of that code."""
    return ctypes.CFUNCTYPE(result, *arguments)(machine_code().address(name))
