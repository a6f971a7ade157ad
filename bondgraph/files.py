"""Files that are written completely or not at all, and files that are followed."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


def check_writable(path: str | os.PathLike[str]) -> Path:
    """Return the file that `path` names, with links resolved.

    Raises OSError if a file cannot be written there: its folder is missing or closed, or the existing entry is no plain file or is write-protected.
    """
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "there is no such folder", str(Path(path).parent))
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "this is a folder", str(path))
    if target.exists() and not target.is_file():
        raise FileExistsError(errno.EEXIST, "this is no plain file", str(path))
    if not os.access(target if target.exists() else target.parent, os.W_OK):
        raise PermissionError(errno.EACCES, "writing is not permitted", str(path))
    return target


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Provide a stream that becomes the file `path` when the block ends without an exception; otherwise nothing changes.

    The bytes go to a temporary file of the same folder, which is then renamed in one step. Raises OSError.
    """
    target = check_writable(path)
    temporary = target.with_name(f".{target.name[:64]}.{os.urandom(6).hex()}.part")
    # Opened without `tempfile`, so that a new file gets the permissions of the user's umask.
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())  # a full disk raises here, before the old file is replaced
        if target.exists():
            os.chmod(temporary, stat.S_IMODE(target.stat().st_mode))
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` as UTF-8 with its line ends unchanged, completely or not at all. Raises OSError."""
    with replacing(path) as stream:
        stream.write(text.encode("utf-8"))


class FollowedFiles:
    """Files whose changes are seen: when each was last written, and its size in bytes."""

    __slots__ = ("_seen",)

    def __init__(self) -> None:
        self._seen: dict[Path, tuple[int, int]] = {}

    def changed(self, paths: Iterable[Path]) -> bool:
        """Return True if one of the files changed since a call had it; a file that is new to this has not."""
        stamps = {path: _stamp(path) for path in paths}
        changed = any(self._seen.get(path, stamp) != stamp for path, stamp in stamps.items())
        self._seen = stamps
        return changed


def _stamp(path: Path) -> tuple[int, int]:
    try:
        found = path.stat()
    except OSError:
        return 0, 0
    return found.st_mtime_ns, found.st_size
