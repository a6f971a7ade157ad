"""Page of a model: its text, its bond graph, equations, animated runs, in one self-contained HTML file."""

from __future__ import annotations

from ...analysed_model import AnalysedModel
from .document import document_of
from .shell import page_text

__all__ = ["document_of", "page_text", "report_text"]


def report_text(model: AnalysedModel) -> str:
    """Return the page of a model with all its experiments and modes, as the text of an HTML file. Raises `CompilationFailed`."""
    return page_text(document_of(model))
