"""Steps without machine code for a segment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..segments.timeline import Segment
from ..steps.methods import EXPLICIT

if TYPE_CHECKING:
    from ..steps.compiled.interpreted import Interpreted
    from .stepper import IntegrationState


def interpreted(
    stepper: IntegrationState, stretch: Segment, x: Any, method: int = EXPLICIT, size: float = np.inf
) -> Interpreted:
    """Return a method that runs in Python, from the start of a segment; `size` of the first step, or of all, if the method needs that."""
    from ..steps.compiled.fields import fields_at
    from ..steps.compiled.interpreted import Interpreted

    fixed = (stepper.program, stepper.inputs, stepper.constants, stepper.tolerances, stretch)
    values = fields_at(*fixed, x, stepper.longest, stepper.signals(stretch), method)
    return Interpreted(stepper.program, values, stepper.constraints, size)
