"""States that have got very much farther than a look ahead saw: nothing else tells of a motion that loose tolerances have let loose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..stretch.stepper import Solver, Stepper

BEYOND = 1e4  # times what the look ahead saw


def notes_of_beyond(stepper: Stepper, solver: Solver) -> list[str]:
    """A note on the state that is farthest beyond its magnitude where a stretch ends; none where that was given, or has been told."""
    names, units = stepper.program.states.names, stepper.program.states.units
    tolerances = stepper.tolerances
    count = len(names)
    far = np.where(tolerances.held[:count], 0.0, np.abs(np.asarray(solver.state)[:count]))
    if not (far > BEYOND).any():
        return []
    worst = int(np.argmax(far))
    begin = f"`{names[worst]}` has got "
    if any(note.startswith(begin) for note in stepper.result.notes):
        return []
    value = solver.state[worst] * tolerances.magnitude[worst]
    return [
        f"{begin}to {value:.4g} {units[worst]} at t = {float(solver.time):.6g} s, {far[worst]:.2g} times what a look ahead saw: it grows without bound, "
        "or the tolerance let it beyond a value from which there is no way back, as zero is for a concentration; compare with a tolerance that is ten "
        "times tighter, or give its own (`tolerance`)"
    ]
