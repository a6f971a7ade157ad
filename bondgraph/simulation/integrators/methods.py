"""Integration methods: the rows of the table of solvers that make steps, by their numbers in compiled code."""

from __future__ import annotations

from compiler.api import AUTOMATIC, SOLVERS

from ...errors import UsageError

METHODS = tuple(row for row in SOLVERS.values() if row.parts)
EXPLICIT, EXPONENTIAL, RADAU = (METHODS.index(SOLVERS[word]) for word in ("explicit", "exponential", "radau"))
CHOSEN = frozenset((EXPLICIT, EXPONENTIAL, RADAU))  # those that `automatic` chooses among
# Functions of the first module of machine code that others call (`compiled/code.py`).
SHARED = "advance", "begin", "roots_along", "states_along", "real_factors"
# Facts of the methods, for compiled code; the function and module of their steps.
PARTS, ESTIMATES, STAGES = (tuple(getattr(row, name) for row in METHODS) for name in ("parts", "estimate", "stages"))
STEP_NAMES = tuple(f"{row.steps or row.word}_step" for row in METHODS)
STIFF, CONSERVING, EXACT, THROUGH_ENDS = (
    tuple(int(getattr(row, name)) for row in METHODS) for name in ("stiff", "conserving", "exact", "through_ends")
)


def chosen_solver(word: str | None) -> str:
    """Return the requested solver. Raises `UsageError`."""
    if word is None:
        return AUTOMATIC
    if word not in SOLVERS:
        raise UsageError("BR711", f"there is no solver `{word}`; solvers are {', '.join(SOLVERS)}")
    return word
