"""Requests of a caller for an inversion, in quantities; at equilibrium or along a path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ...keywords import AnalysisRequest, PathKeywords
from ...quantities import quantity, refuse_two_readings
from ..sensitivity import independent
from .equations import drives_of
from .feed_forward import FeedForward
from .inverse_path import PathRequest, invert_path
from .static import Inversion, asked_for, invert

if TYPE_CHECKING:
    from ...compiled_model import CompiledModel

    Quantity = str | float


def inverted(
    model: CompiledModel, targets: Mapping[str, Any], inputs: Sequence[str], asked: AnalysisRequest, to: Quantity | None, along: PathKeywords
) -> Inversion | FeedForward:  # fmt: skip
    """Return the same as `Model.invert`."""
    from ...simulation.run_options import seconds

    drives = drives_of(inputs)
    quantities = model.compilation(model.scene(asked.experiment)).whole_graph.quantities
    refuse_two_readings(targets if to is None else along.get("limits") or {}, quantities)
    names = tuple(n for d in drives for n in (d.push, d.pull) if n is not None)
    _, fixed = independent(model, names, asked.experiment, asked.settings or {})
    asked = replace(asked, settings=fixed)
    if to is None:
        wanted = asked_for(model, targets, asked.experiment)
        return invert(model, replace(asked, outputs=tuple(wanted), by=names), wanted, drives)
    known = model.compilation(model.scene(asked.experiment, fixed)).whole_graph.quantities
    # unknown names are refused later
    most = {n: quantity(v, known[n].kind, n) if n in known else 0.0 for n, v in (along.get("limits") or {}).items()}
    start = along.get("start")
    span = 0.0 if start is None else seconds(start), seconds(to), along.get("points", 501)
    return invert_path(PathRequest(model, targets, asked, *span, along.get("moving", False), most), inputs)
