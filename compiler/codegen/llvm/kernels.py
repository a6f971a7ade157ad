"""Kernels as LLVM IR: a loop for each shape over rows of integers, and functions that call them in order.

The length of the code depends on the number of shapes, not of instances. The rows are data, passed when the code is loaded (`bind_…`).
"""

from __future__ import annotations

from array import array

from ...jit.values import float_text
from ..loop_rolling import ARRAYS, Kernel, RolledFunctions, read
from ..program_image import KernelRows
from .write import HEAD, LlvmLines, LlvmNeeds

ON_THE_STACK = 4096  # numbers in between that a function keeps on the stack; more come from the heap
_GIVEN = ("state", "inputs", "constants", "mode", "out")
_HANDED = ", ".join(f"ptr %{a}" for a in (*_GIVEN, "work", "numbers"))
_READ_ONLY = ", ".join(
    f"ptr {'' if a in ('out', 'work') else 'noalias readonly '}nocapture %{a}" for a in (*_GIVEN, "work", "numbers")
)

# Place of a value: in `out`, or for ~place in `work`.
_TARGET = (
    "  %target.n = load i32, ptr %row",
    "  %target.w = sext i32 %target.n to i64",
    "  %target.o = icmp sge i64 %target.w, 0",
    "  %target.c = xor i64 %target.w, -1",
    "  %target.i = select i1 %target.o, i64 %target.w, i64 %target.c",
    "  %target.a = select i1 %target.o, ptr %out, ptr %work",
    "  %target = getelementptr inbounds double, ptr %target.a, i64 %target.i",
)


class Kernels(RolledFunctions):
    """Functions of a module, over shared kernels."""

    def rows(self, suffix: str) -> KernelRows:
        """Rows and numbers that the kernels read."""
        return KernelRows(suffix, array("i", self.streams).tobytes(), array("d", self.shapes.table()).tobytes())

    def text(self, needs: LlvmNeeds, suffix: str) -> tuple[list[str], int]:
        """Text of the kernels, of the functions that call them and of the function that binds the rows; and the number of lines of the kernels."""
        kernels = list(self.shapes.kernels.values())
        written = [self._kernel(needs, kernel) for kernel in kernels]
        functions = [self._function(name, suffix) for name in self.plans]
        bound = (
            f"@streams_{suffix} = internal global ptr null\n@numbers_{suffix} = internal global ptr null\n"
            f"define void @bind_{suffix}(ptr %streams, ptr %numbers) {{\nentry:\n  store ptr %streams, ptr @streams_{suffix}\n"
            f"  store ptr %numbers, ptr @numbers_{suffix}\n  ret void\n}}"
        )
        heap = "declare noalias ptr @malloc(i64)\ndeclare void @free(ptr)"
        lines = sum(text.count("\n") for text in written)
        return [bound, heap, *written, *functions], lines

    # ------------------------------------------------------------ a loop over instances
    def _kernel(self, needs: LlvmNeeds, kernel: Kernel) -> str:
        if kernel.expression is None:
            return _sum_kernel(kernel.number)
        differ = [i for i, value in enumerate(kernel.literals) if value is None]
        width = 1 + len(kernel.reads) + len(differ)
        body = LlvmLines(needs, {})
        loads: list[str] = []

        def item(place: int, home: str, name: str) -> None:
            loads.extend(
                (
                    f"  %{name}.i = getelementptr inbounds i32, ptr %row, i64 {place}",
                    f"  %{name}.n = load i32, ptr %{name}.i",
                    f"  %{name}.w = zext i32 %{name}.n to i64",
                    f"  %{name}.p = getelementptr inbounds double, ptr %{home}, i64 %{name}.w",
                    f"  %{name} = load double, ptr %{name}.p",
                )
            )

        for number, home in enumerate(kernel.reads):
            item(1 + number, home, f"x{number}")
            body.names[read(home, number)] = f"%x{number}"
        for number, value in enumerate(kernel.literals):
            body.names[read("number", number)] = f"%n{number}" if value is None else float_text(value)
        for place, number in enumerate(differ, 1 + len(kernel.reads)):
            item(place, "numbers", f"n{number}")
        lines = body.compute(kernel.expression, kernel.count)
        return "\n".join(
            [
                f"define internal ptr @kernel.{kernel.number}(ptr %rows, i64 %count, double %time, {_READ_ONLY}) {{",
                "entry:",
                *body.opening,
                "  br label %again",
                "again:",
                "  %number = phi i64 [ 0, %entry ], [ %more, %again ]",
                "  %row = phi ptr [ %rows, %entry ], [ %next, %again ]",
                *loads,
                *_TARGET,
                *lines,
                f"  %next = getelementptr inbounds i32, ptr %row, i64 {width}",
                "  %more = add nuw nsw i64 %number, 1",
                "  %go = icmp ult i64 %more, %count",
                "  br i1 %go, label %again, label %done",
                "done:",
                "  ret ptr %next",
                "}",
            ]
        )

    # ------------------------------------------------------------ a function
    def _function(self, name: str, suffix: str) -> str:
        plan = self.plans[name]
        used = sorted({kernel.number for kernel, _ in plan.runs})
        heap = plan.work > ON_THE_STACK
        room = f"  %work = alloca [{max(1, plan.work)} x double], align 16"
        if heap:
            room = f"  %work = call ptr @malloc(i64 {8 * plan.work})"
        cases = [f"    i64 {number}, label %run.{number}" for number in used]
        joined = ", ".join(f"[ %after.{number}, %run.{number} ]" for number in used)
        return "\n".join(
            [
                f"define void @{name}{HEAD}",
                room,
                f"  %streams = load ptr, ptr @streams_{suffix}",
                f"  %numbers = load ptr, ptr @numbers_{suffix}",
                f"  %first = getelementptr inbounds i32, ptr %streams, i64 {self.starts[name]}",
                "  br label %look",
                "look:",
                f"  %at = phi ptr [ %first, %entry ]{', [ %on, %next ]' if used else ''}",
                "  %kernel.n = load i32, ptr %at",
                "  %kernel = sext i32 %kernel.n to i64",
                "  %count.p = getelementptr inbounds i32, ptr %at, i64 1",
                "  %rows = getelementptr inbounds i32, ptr %at, i64 2",
                "  switch i64 %kernel, label %done [",
                *cases,
                "  ]",
                *[line.replace("%count.w", f"%count.{number}") for number in used for line in _run(number)],
                *(["next:", f"  %on = phi ptr {joined}", "  br label %look"] if used else []),
                "done:",
                *(["  call void @free(ptr %work)"] if heap else []),
                "  ret void",
                "}",
            ]
        )


def _run(number: int) -> list[str]:
    """One case of the switch between kernels."""
    call = f"call ptr @kernel.{number}(ptr %rows, i64 %count.w, double %time, {_HANDED})"
    return [
        f"run.{number}:",
        f"  %count.n{number} = load i32, ptr %count.p",
        f"  %count.w = zext i32 %count.n{number} to i64",
        f"  %after.{number} = {call}",
        "  br label %next",
    ]


def _sum_kernel(number: int) -> str:
    """Kernel of long sums, in the order of their terms. Each row holds the place of the sum, the number of terms, and the terms."""
    bases = [
        line
        for place, name in enumerate(ARRAYS)
        for line in (
            f"  %base.{name} = getelementptr inbounds ptr, ptr %bases, i64 {place}",
            f"  store ptr %{name}, ptr %base.{name}",
        )
    ]
    return "\n".join(
        [
            f"define internal ptr @kernel.{number}(ptr %rows, i64 %count, double %time, {_READ_ONLY}) {{",
            "entry:",
            f"  %bases = alloca [{len(ARRAYS)} x ptr], align 16",
            *bases,
            "  br label %again",
            "again:",
            "  %number = phi i64 [ 0, %entry ], [ %more, %end ]",
            "  %row = phi ptr [ %rows, %entry ], [ %on, %end ]",
            *_TARGET,
            "  %terms.p = getelementptr inbounds i32, ptr %row, i64 1",
            "  %terms = load i32, ptr %terms.p",
            "  %start = getelementptr inbounds i32, ptr %row, i64 2",
            "  br label %term",
            "term:",
            "  %left = phi i32 [ %terms, %again ], [ %fewer, %term ]",
            "  %at = phi ptr [ %start, %again ], [ %on, %term ]",
            f"  %sum = phi double [ {float_text(-0.0)}, %again ], [ %grown, %term ]",
            "  %code = load i32, ptr %at",
            "  %sign = and i32 %code, 1",
            "  %away = icmp ne i32 %sign, 0",
            "  %code.a = lshr i32 %code, 1",
            "  %array = and i32 %code.a, 7",
            "  %array.w = zext i32 %array to i64",
            "  %index = lshr i32 %code, 4",
            "  %index.w = zext i32 %index to i64",
            "  %base.p = getelementptr inbounds ptr, ptr %bases, i64 %array.w",
            "  %base = load ptr, ptr %base.p",
            "  %value.p = getelementptr inbounds double, ptr %base, i64 %index.w",
            "  %value = load double, ptr %value.p",
            "  %turned = fneg double %value",
            "  %signed = select i1 %away, double %turned, double %value",
            "  %grown = fadd double %sum, %signed",
            "  %on = getelementptr inbounds i32, ptr %at, i64 1",
            "  %fewer = sub i32 %left, 1",
            "  %go = icmp ne i32 %fewer, 0",
            "  br i1 %go, label %term, label %end",
            "end:",
            "  store double %grown, ptr %target",
            "  %more = add nuw nsw i64 %number, 1",
            "  %further = icmp ult i64 %more, %count",
            "  br i1 %further, label %again, label %done",
            "done:",
            "  ret ptr %on",
            "}",
        ]
    )
