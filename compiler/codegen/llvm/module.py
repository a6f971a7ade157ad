"""A module of LLVM IR: one function for each function of a program, the support that they call, and their lists of numbers."""

from __future__ import annotations

from collections.abc import Sequence

from ...algebra.expression import Expression, Symbol
from ...jit.translate import translate
from ...jit.values import float_text
from ..limits import Leaf
from ..loop_rolling import OrderedFunction, ordered
from ..lowered import Lowered
from ..numpy.write import Writer
from ..program_image import KernelRows
from . import runtime
from .kernels import Kernels
from .write import HEAD, LlvmLines, LlvmNeeds


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
