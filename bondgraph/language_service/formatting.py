"""The formatted text of a file."""

from __future__ import annotations

from pathlib import Path

from compiler.api import CompilationFailed, Source, format_text

from .workspace import Workspace


def formatted(workspace: Workspace, path: Path) -> str | None:
    """Return the text as `bondgraph fmt` writes it; None for one that cannot be read."""
    document = workspace.project.document(path)
    try:
        return format_text(Source(str(path), document.text, path))
    except CompilationFailed:
        return None
