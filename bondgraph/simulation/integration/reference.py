"""Steps without machine code for a segment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..integrators.methods import EXPLICIT
from ..segments.timeline import Segment

if TYPE_CHECKING:
    from ..integrators.compiled.interpreted import Interpreted
    from .integration_state import IntegrationState


def interpreted(
    stepper: IntegrationState, stretch: Segment, x: Any, method: int = EXPLICIT, size: float = np.inf
) -> Interpreted:
    """Return a method that runs in Python, from the start of a segment; `size` of the first step, or of all, if the method needs that."""
    from ..integrators.compiled.fields import fields_at
    from ..integrators.compiled.interpreted import Interpreted

    fixed = (stepper.program, stepper.inputs, stepper.constants, stepper.tolerances, stretch)
    values = fields_at(*fixed, x, stepper.longest, stepper.signals(stretch), method)
    return Interpreted(stepper.program, values, stepper.constraints, size)
