"""Project folder: files outside of it are not read."""

from __future__ import annotations

from pathlib import Path


def project_folder(file: Path) -> Path:
    """The nearest ancestor with a `bondgraph.toml` or `pyproject.toml`; else the file's own folder."""
    for folder in file.resolve().parents:
        if (folder / "bondgraph.toml").is_file() or (folder / "pyproject.toml").is_file():
            return folder
    return file.resolve().parent


def within_project(target: Path, root: Path, library: Path | None) -> bool:
    """Return True if a file, with links resolved, lies in the project folder or in the library."""
    return target.is_relative_to(root) or (library is not None and target.is_relative_to(library.resolve()))


def is_there(target: Path) -> bool:
    """Return True if a file can be read there; False for names that the file system cannot hold."""
    try:
        return target.is_file()
    except (OSError, ValueError):
        return False
