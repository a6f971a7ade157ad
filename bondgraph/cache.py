"""Persistent cache of compiled programs and object code (never of results) in the user's cache folder.

The folder (`BONDGRAPH_CACHE`, else `bondgraph` in the system's cache folder) belongs to the user alone. An entry is a file whose name is the hash of
all data on which it depends, and begins with the hash of its own content. It is written completely or not at all, so any number of processes may share
the folder. An invalid entry is ignored. `BONDGRAPH_CACHE=` (empty) turns the cache off.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
import pickle
import stat
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

VARIABLE = "BONDGRAPH_CACHE"
SCHEMA = b"bondgraph-cache/1\n"
MOST_BYTES = 500_000_000
LARGEST_ENTRY = 100_000_000
PRUNED_TO = 0.7  # fraction of the largest size that remains after pruning
PACKAGES = ("bondgraph", "compiler")
_unseen: dict[Path, float] = {}  # bytes stored since a folder was looked at


def fetch(key: str) -> Any:
    """Return the value of a key; None if there is no valid entry."""
    folder = _folder()
    if folder is None:
        return None
    path = folder / key
    try:
        with open(path, "rb") as stream:
            found = os.fstat(stream.fileno())
            if not stat.S_ISREG(found.st_mode) or not _ours(found) or found.st_size > LARGEST_ENTRY:
                return None
            content = stream.read(LARGEST_ENTRY + 1)
    except OSError:
        return None
    head, digest, body = content[: len(SCHEMA)], content[len(SCHEMA) :][:32], content[len(SCHEMA) + 32 :]
    if head != SCHEMA or hashlib.sha256(key.encode() + body).digest() != digest:
        return None
    try:
        os.utime(path)  # pruning removes the least recently used entries
        return _CacheUnpickler(io.BytesIO(body)).load()
    except Exception:  # the value can be made again, whatever the error
        return None


def keep(key: str, value: object) -> None:
    """Store a value under a key, if possible."""
    folder = _folder()
    if folder is None:
        return
    body = pickle.dumps(value, protocol=5)
    if len(body) > LARGEST_ENTRY // 2:
        return
    content = SCHEMA + hashlib.sha256(key.encode() + body).digest() + body
    temporary = folder / f".{key[:16]}.{os.urandom(8).hex()}.part"
    try:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o600)
        try:
            with os.fdopen(descriptor, "wb") as stream:
                stream.write(content)
            os.replace(temporary, folder / key)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        _prune(folder, len(content))
    except OSError:
        return  # a full or read-only disk is no error


def folder_of(name: str) -> Path | None:
    """Return the path of a folder of files in the cache folder; None if nothing can be stored."""
    folder = _folder()
    return None if folder is None else folder / name


def key_of(*parts: object) -> str:
    """Return a key for all data on which a value depends; it includes the version of our own code."""
    digest = hashlib.sha256(code_version().encode())
    for part in parts:
        data = part if isinstance(part, bytes) else str(part).encode("utf-8", "surrogatepass")
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()


@lru_cache
def code_version() -> str:
    """Return a unique text of this code and this Python: names, sizes and times of our files."""
    digest = hashlib.sha256()
    root = Path(__file__).resolve().parent.parent
    for package in PACKAGES:
        for folder, folders, files in os.walk(root / package):
            folders[:] = sorted(f for f in folders if f != "__pycache__")
            for name in sorted(files):
                found = os.stat(os.path.join(folder, name))
                digest.update(f"{folder}/{name} {found.st_size} {found.st_mtime_ns}\n".encode())
    return f"{digest.hexdigest()} {sys.version} {sys.platform}"


def has_changed() -> bool:
    """Return True if a file of ours has changed since this process first computed that version."""
    return code_version.__wrapped__() != code_version()


class _CacheUnpickler(pickle.Unpickler):
    """Unpickler of our own data classes and paths only, so that a pickle cannot run code."""

    def find_class(self, module: str, name: str) -> Any:
        known = (module.startswith("compiler.") and name[:1].isupper()) or module.startswith("pathlib")
        if not known:
            raise pickle.UnpicklingError(f"{module}.{name}")
        return super().find_class(module, name)


def _prune(folder: Path, stored: int) -> None:
    """Remove the least recently used entries if the folder is too large. It is looked at for each hundredth of the largest size that a process has stored."""
    _unseen[folder] = _unseen.get(folder, math.inf) + stored
    if _unseen[folder] < MOST_BYTES / 100:
        return
    _unseen[folder], entries = 0, []
    with os.scandir(folder) as found:
        for entry in found:
            if entry.is_dir(follow_symlinks=False):
                continue
            told = entry.stat(follow_symlinks=False)
            entries.append((told.st_mtime, told.st_size, entry.path))
    total = sum(size for _, size, _ in entries)
    if total <= MOST_BYTES:
        return
    for _, size, path in sorted(entries):
        if total <= PRUNED_TO * MOST_BYTES:
            return
        Path(path).unlink(missing_ok=True)
        total -= size


def _folder() -> Path | None:
    """Return the folder, created if necessary; None if nothing can be stored, or if another user could write there."""
    path = _place()
    if path is None:
        return None
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = os.lstat(path)
        if stat.S_ISLNK(found.st_mode) or not stat.S_ISDIR(found.st_mode) or not _ours(found):
            return None
        if os.name == "posix" and stat.S_IMODE(found.st_mode) != 0o700:
            os.chmod(path, 0o700)
    except (OSError, RuntimeError):
        return None
    return path


def _place() -> Path | None:
    given = os.environ.get(VARIABLE)
    if given is not None:
        return Path(given).absolute() if given else None
    if sys.platform == "win32":
        home = os.environ.get("LOCALAPPDATA")
        return Path(home) / "bondgraph" / "cache" if home else None
    try:
        home_folder = Path.home()
    except RuntimeError:
        return None
    if sys.platform == "darwin":
        return home_folder / "Library" / "Caches" / "bondgraph"
    kept = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(kept) if os.path.isabs(kept) else home_folder / ".cache") / "bondgraph"


def _ours(found: os.stat_result) -> bool:
    """Return True if a file or folder belongs to this user, and no other may write to it."""
    if not hasattr(os, "geteuid"):  # Windows; a browser
        return True
    return found.st_uid == os.geteuid() and not found.st_mode & 0o022
