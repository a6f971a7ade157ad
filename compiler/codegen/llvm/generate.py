"""A lowered state space to a program in machine code: written as LLVM IR, compiled, and bound to numpy arrays.

A module has one function for each function of a program, the support that they call, and their lists of numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ...algebra.expression import Expression, Symbol
from ...fast_dataclass import dataclass
from ...jit.machine import AS_WRITTEN, object_code
from ...jit.translate import translate
from ...jit.values import float_text
from ..description import image_of
from ..limits import Leaf
from ..loop_rolling import OrderedFunction, ordered
from ..lowered import Lowered
from ..numpy.write import Writer
from ..program import Program
from ..program_image import KernelRows, ProgramImage
from ..structure import more_of, slope_places
from ..time_functions import constants_of_signals, time_functions_of
from . import runtime
from .evaluate import bind
from .kernels import Kernels
from .write import HEAD, LlvmLines, LlvmNeeds

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


def mode_size(lowered: Lowered) -> int:
    """Length of the mode: truth values of conditions, and discrete variables."""
    return max(len(lowered.switches), lowered.events.size if lowered.events.present else 0)


class Module:
    """Writer of a module with some functions of a program. `functions` gives for each: name, arguments in Python, number of values."""

    def __init__(self, writer: Writer, hot: bool, chosen: frozenset[str] | None = None) -> None:
        """`chosen`: names of the functions of a library, which is one module without kernels."""
        self.lowered, self.writer, self.hot, self.chosen = writer.lowered, writer, hot, chosen
        self.needs = LlvmNeeds()
        self.functions: list[tuple[str, tuple[str, ...], int]] = []
        self.operations = 0
        self.rows: KernelRows | None = None  # data of the kernels, if there are any

    def text(self) -> str:
        """The whole module: either the functions that are called at every step, or the others."""
        constants = self.writer.constants
        self.functions, self.operations = [], 0
        known: dict[Expression, tuple[str, int]] = {node: ("constants", i) for i, node in enumerate(constants)}
        space = self.lowered.space
        counts = {"state": len(space.states) + len(space.unknowns), "input": len(self.lowered.inputs)}
        known |= {Symbol(Leaf("state", i)): ("state", i) for i in range(counts["state"])}
        known |= {Symbol(Leaf("input", i)): ("inputs", i) for i in range(counts["input"])}
        known |= {Symbol(Leaf("mode", i)): ("mode", i) for i in range(mode_size(self.lowered))}
        wanted = [] if self.hot and self.chosen is None else [self._constants(constants)]
        for row, roots in self.writer.functions:
            if row.hot == self.hot if self.chosen is None else row.name in self.chosen:
                self.functions.append((row.name, tuple(row.arguments.split(", ")), len(roots)))
                wanted.append(ordered(row.name, roots, known))
        parts = self._parts(wanted)
        needed = list(dict.fromkeys(runtime.BY_OPERATOR[o] for o in sorted(self.needs.called)))
        supporting = translate(needed if self.hot or self.chosen is not None else [runtime.batch, *needed])
        declared = [
            f"declare double @{name}"
            for name in sorted(self.needs.declared)
            if f"declare double @{name}" not in supporting
        ]
        arrays = [
            f"{name} = private unnamed_addr constant [{len(v)} x double] [{', '.join(f'double {float_text(x)}' for x in v)}]"
            for v, name in self.needs.arrays.items()
        ]
        return "\n".join([*arrays, *declared, supporting, *parts, ""])

    def _constants(self, nodes: Sequence[Expression]) -> OrderedFunction:
        parameters = range(len(self.lowered.parameters))
        leaves: dict[Expression, tuple[str, int]] = {Symbol(Leaf("parameter", i)): ("constants", i) for i in parameters}
        self.functions.append(("constants", ("parameters",), len(nodes)))
        return ordered("constants", nodes, leaves)

    def _parts(self, functions: Sequence[OrderedFunction]) -> list[str]:
        """Text of the functions: straight-line code if it is short or has few equal parts, else over kernels."""
        if self.chosen is None and (kernels := Kernels.of(self.lowered, functions)) is not None:
            suffix = "hot" if self.hot else "cold"
            self.rows = kernels.rows(suffix)
            parts, self.operations = kernels.text(self.needs, suffix)
            return parts
        return [self._function(f) for f in functions]

    def _function(self, function: OrderedFunction) -> str:
        body = LlvmLines(self.needs, function.known)
        lines = body.write(function.order, function.roots)
        self.operations += len(lines)
        return "\n".join([f"define void @{function.name}{HEAD}", *body.opening, *lines, "  ret void", "}"])
