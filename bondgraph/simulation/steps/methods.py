"""The methods that step, by the names that an author gives them, and how a result names them."""

from __future__ import annotations

from ...door import SOLVERS
from ...errors import UsageError

AUTOMATIC = "automatic"
RADAU, EXPLICIT, ENERGY, RODAS = 0, 1, 2, 3  # of those that step, the number in compiled code
NAMES = {RADAU: "Radau IIA 5", EXPLICIT: "Dormand-Prince 8", ENERGY: "Gauss 6 with constant energy", RODAS: "Rodas5P"}


def chosen_solver(word: str | None) -> str:
    """The solver that is asked for. Raises `UsageError`."""
    if word is None:
        return AUTOMATIC
    if word not in SOLVERS:
        raise UsageError(f"there is no solver `{word}`; solvers are {', '.join(SOLVERS)}")
    return word
