"""A lowered state space to a program in machine code: written as LLVM IR, compiled, and bound to numpy arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ...fast_dataclass import dataclass
from ...jit.machine import AS_WRITTEN, object_code
from ..description import image_of
from ..lowered import Lowered
from ..numpy.write import Writer
from ..program import Program
from ..program_image import ProgramImage
from ..structure import more_of, slope_places
from ..time_functions import constants_of_signals, time_functions_of
from .bind import bind
from .module import Module

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
    codes = compile_(texts[0], level_of(modules[0])), compile_(texts[1], 0)
    functions = tuple(function for module in modules for function in module.functions)
    rows = tuple(module.rows for module in modules if module.rows is not None)
    timed = time_functions_of(lowered, writer.constants), constants_of_signals(lowered, writer.constants)
    return image_of(lowered, texts[0], functions, rows, timed), codes


def level_of(module: Module) -> int:
    """Optimization level of a module. Loops over kernels are limited by memory: LLVM's passes only make their code longer."""
    level = next((level for most, level in LEVELS if module.operations <= most), 0)
    return AS_WRITTEN if level and module.rows is not None and not module.needs.called else level


@dataclass(frozen=True, slots=True)
class LibraryModule:
    """Text of a module, optimization level, number of values of each function, and rows and columns of the slopes (see `structure.py`)."""

    text: str
    level: int
    counts: Mapping[str, int]
    slopes: tuple[tuple[int, int], ...]


def library_module(lowered: Lowered, names: Sequence[str]) -> LibraryModule:
    """Return the module with these functions of the program, as far as it has them, and those of `more_of`."""
    more = more_of(lowered)
    module = Module(Writer(lowered, more), True, frozenset((*names, *(row.name for row, _ in more))))
    text = module.text()
    counts = {name: count for name, _, count in module.functions}
    return LibraryModule(text, level_of(module), counts, tuple(slope_places(lowered)))
