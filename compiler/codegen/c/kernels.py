"""Kernels as C: a function with a loop for each shape over rows of integers, and functions that call them in the order of their rows.

The length of the code depends on the number of shapes, not of instances. The rows are data of the file, the same as those of native code.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...algebra.expression import Expression, Symbol
from ...jit.c_source import c_number
from ..limits import Leaf
from ..loop_rolling import ARRAYS, Kernel, RolledFunctions, read

GIVEN = ("time", "state", "inputs", "constants", "mode", "out")
IN_A_LINE = 24  # numbers of the data
# Lines that compute an expression over named values, of which a system has several, into `target`.
Compute = Callable[[Expression, dict[Expression, str], int], list[str]]

_TARGET = "double *target = row[0] >= 0 ? out + row[0] : work + ~row[0];"
_SUM = """    const double *const arrays[] = {%s};
    for (; count > 0; count--) {
        %s
        const int32_t *const end = row + 2 + row[1];
        double sum = -0.0;
        for (row += 2; row < end; row++) {
            const double term = arrays[(*row >> 1) & 7][*row >> 4];
            sum += *row & 1 ? -term : term;
        }
        *target = sum;
    }"""


class CKernels(RolledFunctions):
    """Functions of a file, over shared kernels."""

    def kernels(self, compute: Compute) -> list[str]:
        """Text of the data and of the kernels."""
        table = [c_number(x) for x in self.shapes.table()] or ["0.0"]
        data = [_data("double", "numbers", table), _data("int32_t", "kernel_rows", list(map(str, self.streams)))]
        return [*data, *(_kernel(kernel, compute) for kernel in self.shapes.kernels.values())]

    def body(self, name: str) -> list[str]:
        """Lines of a function: the kernels of its rows, until these end."""
        plan = self.plans[name]
        if not plan.runs:
            return []
        calls = [
            f"        case {n}: at = kernel_{n}(at + 2, at[1], {', '.join(GIVEN)}, work); break;"
            for n in sorted({kernel.number for kernel, _ in plan.runs})
        ]
        return [
            f"double work[{max(1, plan.work)}];", "(void)work;", f"for (const int32_t *at = kernel_rows + {self.starts[name]}; *at >= 0;) {{",
            "    switch (*at) {", *(call[4:] for call in calls), "    default: return;", "    }", "}",
        ]  # fmt: skip


def _data(kind: str, name: str, items: Sequence[str]) -> str:
    lines = [", ".join(items[i : i + IN_A_LINE]) for i in range(0, len(items), IN_A_LINE)]
    body = ",\n    ".join(lines)
    return f"static const {kind} {name}[] = {{\n    {body}\n}};"


def _kernel(kernel: Kernel, compute: Compute) -> str:
    arrays = ", ".join(f"const double *{a}" for a in GIVEN[1:-1])
    head = f"static const int32_t *kernel_{kernel.number}(const int32_t *row, int32_t count, double time, {arrays}, double *out, double *work)"
    unused = " ".join(f"(void){a};" for a in (*GIVEN, "work"))
    if kernel.expression is None:
        body = _SUM % (", ".join(ARRAYS), _TARGET)
    else:
        differ = [i for i, value in enumerate(kernel.literals) if value is None]
        names: dict[Expression, str] = {Symbol(Leaf("time", 0)): "time"}
        names |= {read(home, i): f"x{i}" for i, home in enumerate(kernel.reads)}
        names |= {read("number", i): f"n{i}" if x is None else c_number(x) for i, x in enumerate(kernel.literals)}
        loads = [f"const double x{i} = {home}[row[{1 + i}]];" for i, home in enumerate(kernel.reads)]
        loads += [f"const double n{i} = numbers[row[{at}]];" for at, i in enumerate(differ, 1 + len(kernel.reads))]
        width = 1 + len(kernel.reads) + len(differ)
        lines = [*loads, _TARGET, *compute(kernel.expression, names, kernel.count)]
        inner = "\n".join(f"        {line}" for line in lines)
        body = f"    for (; count > 0; count--, row += {width}) {{\n{inner}\n    }}"
    return f"{head}\n{{\n    {unused}\n{body}\n    return row;\n}}"
