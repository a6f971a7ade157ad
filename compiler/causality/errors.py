"""Errors of causality: BG3xx."""

from __future__ import annotations

from ..errors import Diagnostic
from ..fast_dataclass import dataclass
from ..source import Span


@dataclass(frozen=True, slots=True)
class StrokeConflict(Diagnostic):
    """BG301: two demands contradict each other."""

    code = "BG301"
    title = "{what}"
    advice = "{hint}"
    what: str
    hint: str
    chain: tuple[tuple[Span, str], ...]

    def related(self) -> tuple[tuple[Span, str], ...]:
        return self.chain
