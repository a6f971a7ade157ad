"""Files that a live page shows and saves: one, or all models of a folder. What changed on disk meanwhile is never overwritten."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from hashlib import sha256
from itertools import islice
from pathlib import Path

from ....errors import UsageError
from ....files import write_text

MOST = 500  # most files of a list
NEW = re.compile(r"[^\W_][\w .-]{0,80}\.bg")


def stamp(path: Path) -> str:
    """Return what tells one content of a file from another; empty without a file. Raises OSError."""
    return sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def models_in(folder: Path) -> tuple[str, ...]:
    """Return the models of a folder and of those in it; hidden folders are left out."""
    return tuple(islice(_models(folder), MOST))


def _models(folder: Path) -> Iterator[str]:
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        models = (Path(place, name) for name in sorted(names) if name.endswith(".bg") and not name.startswith("."))
        yield from (path.relative_to(folder).as_posix() for path in models)


def path_of(folder: Path, name: str) -> Path:
    """Return the file of a name: one of the list, or a new one. Raises `UsageError`."""
    if name not in models_in(folder) and not NEW.fullmatch(name):
        raise UsageError("BR945", f"`{name[:80]}` is no model of the folder;", "a new one is called NAME.bg")
    return folder / name


def save(path: Path, text: str, before: str) -> str:
    """Write a file whose content was `before` (a stamp), with the line ends that it has; return the stamp that it has then. Raises OSError.

    Another content stays as it is, and its stamp is returned.
    """
    present = stamp(path)
    if present == before:
        ends = path.exists() and b"\r\n" in path.read_bytes()
        write_text(path, text.replace("\n", "\r\n") if ends else text)
    return present
