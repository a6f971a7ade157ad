"""Errors of causality: BG3xx."""

from ..errors import WordedDiagnostic


class StrokeConflict(WordedDiagnostic):
    """BG301: two demands contradict each other."""

    code = "BG301"
