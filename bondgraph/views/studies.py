"""Studies as plain text for terminals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .analyses import title
from .tables import aligned, short, visible

if TYPE_CHECKING:
    from ..studies.tolerances import MonteCarlo

STRONGEST = 8  # parameters of a quantity that are shown


def montecarlo_text(found: MonteCarlo) -> str:
    """Statistics of each quantity, then what moves it."""
    count = f"{len(found)} points, seed {found.seed}"
    parts = [title(found.model, found.experiment, count), _statistics(found)]
    parts += [_shares(found, i) for i in range(len(found.quantities))]
    parts += [visible(note) for note in found.notes]
    return "\n\n".join(parts)


def _statistics(found: MonteCarlo) -> str:
    rows: list[tuple[str, ...]] = [("", "unit", "mean", "standard deviation", "2.5 %", "median", "97.5 %")]
    for name in found.quantities:
        told = found.statistics(name)
        unit, scale, offset = found.shown.get(name, (found.units[name], 1.0, 0.0))
        numbers = [told.get(w, np.nan) * scale + offset for w in ("mean", "2.5 %", "50 %", "97.5 %")]
        mean, *quantiles = (f"{x:.7g}" for x in numbers)
        spread = f"{told.get('standard deviation', np.nan) * scale:.4g}"
        rows.append((short(name), "" if unit == "1" else visible(unit), mean, spread, *quantiles))
    return aligned(rows, "<<>>>>>")


def _shares(found: MonteCarlo, i: int) -> str:
    """Parameters in the order in which they swing a quantity."""
    name = found.quantities[i]
    low, high = (f"{100 * t:g} %" for t in found.swing.tails)
    head = [f"what moves {short(name)}", f"at {low}", f"at {high}"]
    if found.indices is not None:
        head += ["alone", "in all", "+-"]
    ends = found.swing.ends[i] - found.swing.middle[i]
    order = np.argsort(-np.nan_to_num(np.abs(ends).max(axis=1), nan=-1.0), kind="stable")[:STRONGEST]
    scale = found.shown.get(name, ("", 1.0, 0.0))[1]
    rows = [tuple(head)]
    for j in order:
        row = [short(found.parameters[j]), *(f"{x * scale:+.4g}" for x in ends[j])]
        if found.indices is not None:
            around = found.indices.total_interval[i, j]
            row += [f"{100 * found.indices.first[i, j]:.1f} %", f"{100 * found.indices.total[i, j]:.1f} %"]
            row += [f"{50 * (around[1] - around[0]):.1f} %"]
        rows.append(tuple(row))
    return aligned(rows, "<" + ">" * (len(head) - 1))
