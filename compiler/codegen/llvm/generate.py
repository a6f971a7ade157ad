"""A lowered state space to a program in machine code: written as LLVM IR, compiled, and bound to numpy arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...jit.machine import AS_WRITTEN, object_code
from ..lower import count_operations
from ..lowered import Lowered
from ..numpy.generate import hybrid_note, name_tables, of_invariants
from ..numpy.write import Writer
from ..program import NameTable, Program, TimeFunctions
from ..time_functions import time_functions_of
from .bind import bind
from .module import Module
from .program_image import KernelRows, ProgramImage

Compile = Callable[[str, int], bytes]

# LLVM takes more than proportional time for long functions without branches: lines up to which a level of it is used. Code at level 0
# takes about 1.5 times as long as code at level 2, which is soon less than the time for better compilation.
LEVELS = ((1_500, 2), (4_000, 1))


def generate_program(lowered: Lowered) -> Program:
    """A program of the native target."""
    return bind(*generate_code(lowered))


def generate_code(lowered: Lowered, compile_: Compile = object_code) -> tuple[ProgramImage, tuple[bytes, ...]]:
    """A program as data and object code; `compile_` makes object code from the text of a module and an optimization level."""
    writer = Writer(lowered)
    modules = Module(writer, True), Module(writer, False)
    texts = [module.text() for module in modules]
    codes = compile_(texts[0], _level(modules[0])), compile_(texts[1], 0)
    functions = tuple(function for module in modules for function in module.functions)
    rows = tuple(module.rows for module in modules if module.rows is not None)
    return _described(lowered, texts[0], functions, rows, time_functions_of(lowered, writer.constants)), codes


def _level(module: Module) -> int:
    """Optimization level of a module. Loops over kernels are limited by memory: LLVM's passes only make their code longer."""
    level = next((level for most, level in LEVELS if module.operations <= most), 0)
    return AS_WRITTEN if level and module.rows is not None and not module.needs.called else level


def _described(lowered: Lowered, text: str, functions: tuple[tuple[str, tuple[str, ...], int], ...], rows: tuple[KernelRows, ...],
               time_functions: TimeFunctions | None) -> ProgramImage:  # fmt: skip
    space = lowered.space
    tables = {
        heading: NameTable(tuple(r[0] for r in rows), tuple(r[1] for r in rows))
        for heading, rows in name_tables(lowered)
    }
    values = [space.variables[v].value or 0.0 for v in (*lowered.parameters, *lowered.inputs)]
    count = len(lowered.parameters)
    return ProgramImage(
        space.name, text, tables, tuple(values[:count]), tuple(values[count:]), _places(sorted(lowered.jacobian)),
        _places(sorted(lowered.sensitivities)), _places(sorted(lowered.invariant_slopes)), of_invariants(lowered),
        tuple(limit.note for limit in lowered.limits), count_operations(lowered.rates),
        lowered.differentiated, functions, rows, hybrid_note(lowered), time_functions,
    )  # fmt: skip


def _places(places: Sequence[tuple[int, int]]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    return tuple(p[0] for p in places), tuple(p[1] for p in places)
