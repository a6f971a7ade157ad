"""Growth warning: states that have moved far beyond the range of the pilot run; no other check sees a motion made unstable by loose tolerances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..segments.context import LastStep, SegmentContext

BEYOND = 1e4  # factor on the largest value in the pilot run


def notes_of_beyond(context: SegmentContext, solver: LastStep, notes: Sequence[str]) -> list[str]:
    """Return a note on the state farthest beyond its magnitude at the end of a segment; none if its magnitude was given, or after a first note in `notes`."""
    names, units = context.program.states.names, context.program.states.units
    tolerances = context.tolerances
    count = len(names)
    far = np.where(tolerances.held[:count], 0.0, np.abs(np.asarray(solver.state)[:count]))
    if not (far > BEYOND).any():
        return []
    worst = int(np.argmax(far))
    begin = f"`{names[worst]}` has got "
    if any(note.startswith(begin) for note in notes):
        return []
    value = solver.state[worst] * tolerances.magnitude[worst]
    return [
        f"{begin}to {value:.4g} {units[worst]} at t = {float(solver.time):.6g} s, {far[worst]:.2g} times what a look ahead saw: it grows without bound, "
        "or the tolerance let it beyond a value from which there is no way back, as zero is for a concentration; compare with a tolerance that is ten "
        "times tighter, or give its own (`tolerance`)"
    ]
