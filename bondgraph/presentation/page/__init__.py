"""Page of a model: its text, its bond graph, equations, animated runs, in one self-contained HTML file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .document import document_of
from .shell import page_text

if TYPE_CHECKING:
    from ...analysed_model import AnalysedModel

__all__ = ["document_of", "page_text", "report_text"]


def report_text(model: AnalysedModel) -> str:
    """Return the page of a model with all its experiments and modes, as the text of an HTML file. Raises `CompilationFailed`."""
    return page_text(document_of(model))
