"""Modes as data for an animated page: complex amplitudes of all bonds and poses, about the equilibrium."""

from __future__ import annotations

from typing import Any

from ...analysis.modes import Mode
from ..text.tables import visible
from .numbers import packed
from .runs import PageModel

MOST = 24
SHARES = 4  # most elements named


def modes_data(watched: PageModel) -> list[dict[str, Any]]:
    """Return the modes, slowest first. Raises as `Model.operating_point`."""
    from ...analysis.equilibrium import equilibrium
    from ...analysis.modes import modes
    from ...analysis.operating_point import AnalysisRequest

    names = tuple(dict.fromkeys([*watched.bonds.names, *watched.scenes.names]))
    if not names:
        return []
    point = watched.model.operating_point(AnalysisRequest(outputs=names))
    rest = equilibrium(point).outputs
    poses = packed([rest[name] for name in watched.scenes.names], single=False)
    return [_mode(watched, mode) | {"rest": poses} for mode in modes(point)[:MOST]]


def _mode(watched: PageModel, mode: Mode) -> dict[str, Any]:
    import numpy as np

    seen = mode.outputs
    bonds = watched.bonds.values({n: np.asarray(seen[n]) for n in watched.bonds.names}, 1)[:, 0]
    poses = np.array([seen[n] for n in watched.scenes.names], dtype=complex)
    return {
        "frequency": mode.frequency, "damping": None if mode.damping != mode.damping else mode.damping,
        "energy": [(visible(n), share) for n, share in list(mode.energy.items())[:SHARES]],
        "bonds": {"re": packed(bonds.real), "im": packed(bonds.imag)},
        "poses": {"re": packed(poses.real, False), "im": packed(poses.imag, False)},
    }  # fmt: skip
