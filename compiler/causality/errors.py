"""Errors of causality: BG3xx."""

from __future__ import annotations

from ..errors import WordedDiagnostic
from ..fast_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class StrokeConflict(WordedDiagnostic):
    """BG301: two demands contradict each other."""

    code = "BG301"
