"""Call of a function on many records, one after another, in the subset that becomes machine code: threads wait for the interpreter once for all of them."""

from __future__ import annotations

from collections.abc import Callable

from compiler.api import Floats, Ints

# Record, and a number; a function that takes none leaves it in its register.
Step = Callable[["Floats", int], int]


def each_record(step: Step, count: int, rows: Ints, size: int, records: Floats, number: int, answers: Ints) -> None:
    """Call a function on `count` rows of the records, which have this size each; put its answers."""
    for i in range(count):
        answers[i] = step(records[rows[i] * size :], number)
