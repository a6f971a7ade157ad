"""Requests of a caller for an inversion, in quantities; at equilibrium or along a path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ...quantities import quantity
from ..operating_point import AnalysisRequest, operating_point
from ..sensitivity import independent
from .along import Along, invert_along
from .drives import drives_of
from .feed_forward import FeedForward
from .static import Inversion, asked_for, invert

if TYPE_CHECKING:
    from ...compiled_model import CompiledModel

    Quantity = str | float
    Told = tuple[Quantity, Quantity, int, bool, Mapping[str, Quantity]]  # start, stop, points, moving, limits


def inverted(
    model: CompiledModel, targets: Mapping[str, Any], inputs: Sequence[str], experiment: str | None, settings: Mapping[str, Quantity],
    along: Told | None,
) -> Inversion | FeedForward:  # fmt: skip
    """Return the same as `Model.invert`."""
    from ...simulation.run import seconds

    drives = drives_of(inputs)
    names = tuple(n for d in drives for n in (d.push, d.pull) if n is not None)
    _, fixed = independent(model, names, experiment, settings)
    if along is None:
        wanted = asked_for(model, targets, experiment)
        return invert(operating_point(model, AnalysisRequest(experiment, fixed, tuple(wanted), names)), wanted, drives)
    start, stop, points, moving, limits = along
    known = model.compilation(model.scene(experiment, fixed)).whole_graph.quantities
    # unknown names are refused later
    most = {n: quantity(v, known[n].unit, n) if n in known else 0.0 for n, v in limits.items()}
    path = Along(seconds(start), seconds(stop), points, moving, most)
    return invert_along(model, targets, inputs, AnalysisRequest(experiment, fixed), path)
