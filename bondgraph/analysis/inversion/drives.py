"""Unknown of an inversion: a single input, or a pair with one of them zero, which pushes or pulls."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

PROBE = 1e-3  # of the natural size of an input: value at which the derivative of a square is evaluated instead of zero


@dataclass(frozen=True, slots=True)
class Drive:
    """One unknown: an input, or two inputs with one of them zero. `power` 2: the unknown is the square of the input.

    A single input of power 2 is positive: its negative would have the same effect.
    """

    push: str
    pull: str | None
    power: int = 1

    def settings(self, strength: float) -> dict[str, float]:
        """Return the values of the inputs."""
        size = math.sqrt(abs(strength)) if self.power == 2 else abs(strength)
        if self.pull is None:
            return {self.push: strength if self.power == 1 else math.copysign(size, strength)}
        return {self.push: size, self.pull: 0.0} if strength >= 0 else {self.push: 0.0, self.pull: size}

    def slope(self, strength: float, columns: Mapping[str, Any]) -> Any:
        """Return the derivative by the unknown, from the derivatives by the inputs."""
        if self.pull is None and self.power == 1:
            return columns[self.push]
        if self.pull is None:
            return columns[self.push] / (2 * math.sqrt(abs(strength)))
        column = columns[self.push] if strength >= 0 else -columns[self.pull]
        return column / (2 * math.sqrt(abs(strength))) if self.power == 2 else column


def drives_of(names: Sequence[str]) -> tuple[Drive, ...]:
    """Return the drives of names such as `push1/pull1` (a pair) or `fx` (a single input)."""
    return tuple(Drive(push.strip(), pull.strip() or None) for push, _, pull in (n.partition("/") for n in names))
