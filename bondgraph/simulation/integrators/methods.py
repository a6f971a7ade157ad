"""Integration methods: the names that an author uses, and their names in a result."""

from __future__ import annotations

from compiler.api import SOLVERS

from ...errors import UsageError

AUTOMATIC = "automatic"
RADAU, EXPLICIT, ENERGY, RODAS = 0, 1, 2, 3  # indices of the methods in compiled code
NAMES = {RADAU: "Radau IIA 5", EXPLICIT: "Dormand-Prince 8", ENERGY: "Gauss 6 with constant energy", RODAS: "Rodas5P"}


def chosen_solver(word: str | None) -> str:
    """Return the requested solver. Raises `UsageError`."""
    if word is None:
        return AUTOMATIC
    if word not in SOLVERS:
        raise UsageError(f"there is no solver `{word}`; solvers are {', '.join(SOLVERS)}")
    return word
