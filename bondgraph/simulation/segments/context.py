"""Unchanging data of an integration, given to those that only read them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from compiler.api import Program

from .trajectory import Tolerances


@dataclass(frozen=True, slots=True)
class SegmentContext:
    """A program with the constants (…,), inputs (…,) and reported instants (points,) of a phase, and its tolerances, in SI."""

    program: Program
    constants: Any
    inputs: Any
    instants: Any
    tolerances: Tolerances

    @property
    def whole(self) -> float:
        """Length of the phase, s."""
        return float(self.instants[-1] - self.instants[0])


class LastStep(Protocol):
    """Data of a method's last step that diagnoses read: scaled states (n,), and errors in units of the tolerance (n,)."""

    @property
    def time(self) -> Any: ...

    @property
    def state(self) -> Any: ...

    @property
    def error(self) -> Any: ...

    @property
    def last_step(self) -> tuple[Any, Any]: ...
