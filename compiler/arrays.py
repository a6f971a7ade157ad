"""Types of numpy arrays for annotations; importing them does not load numpy."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Array: TypeAlias = "NDArray[np.float64]"
IntArray: TypeAlias = "NDArray[np.integer]"
BoolArray: TypeAlias = "NDArray[np.bool_]"
ComplexArray: TypeAlias = "NDArray[np.complex128]"
