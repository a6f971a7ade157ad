"""Journal of a study in a file: the results of each task as soon as they exist, so that after a crash no point is computed twice.

The file begins with a digest of all data that determine the results: the text and its imports, the request, the points, our own code. Records
follow: number of results, length, hash, and the results by the indices of their points. A record is written in one piece and synced; an incomplete
last record (after a power failure) is cut off. Results are read by an unpickler that accepts only arrays and our own data classes.
"""

from __future__ import annotations

import hashlib
import io
import os
import pickle
import struct
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO

from ..errors import RunFailed, UsageError

if TYPE_CHECKING:
    from ..analysed_model import AnalysedModel
    from .point_request import PointRequest

SCHEMA = b"bondgraph-journal/1\n"
_HEAD = struct.Struct("<QQ")  # number of results, length
_HASH = 32
_PLAIN = {
    # paths of a text
    *((home, name) for home in ("pathlib", "pathlib._local") for name in ("PosixPath", "WindowsPath")),
    ("collections", "OrderedDict"),
    ("collections", "Counter"),
    ("builtins", "complex"),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy.core.numeric", "_frombuffer"),
}


class Journal:
    """A file from which a study goes on. It is kept when the study is finished: the same study then has its results at once."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self._stream: BinaryIO | None = None

    def begun(self, model: AnalysedModel, question: PointRequest, points: Sequence[Any]) -> dict[int, Any]:
        """Return the stored results by the index of their point; create the file if there is none.

        Raises `UsageError` for a file of another study or kind, OSError.
        """
        head = SCHEMA + digest_of(model, question, points)
        self._stream = open(self.path, "r+b" if os.path.exists(self.path) else "x+b")  # noqa: SIM115
        _alone(self._stream, self.path)
        content = self._stream.read()
        if not content or (len(content) < len(head) and head.startswith(content)):
            self._stream.seek(0)
            self._stream.truncate()
            self._write(head)
            return {}
        if not content.startswith(SCHEMA):
            self.close()
            raise UsageError("BR467", f"`{self.path}` is no journal of a study")
        if not content.startswith(head):
            self.close()
            raise UsageError(
                "BR468", f"`{self.path}` is the journal of another study: the model, what is asked, the points or this program have changed since;",
                "name another file, or remove it",
            )  # fmt: skip
        try:
            found, whole = _records(content, len(head))
        except pickle.UnpicklingError as problem:
            self.close()
            raise UsageError("BR469", f"`{self.path}` holds what no study writes ({problem}): it is not read") from None
        self._stream.seek(whole)
        self._stream.truncate()
        return {i: x for i, x in found.items() if i < len(points)}

    def add(self, answers: Mapping[int, Any]) -> None:
        """Write some results by the indices of their points, completely or not at all."""
        body = _packed({i: _readable(answer) for i, answer in answers.items()})
        head = _HEAD.pack(len(answers), len(body))
        self._write(head + hashlib.sha256(head + body).digest() + body)

    def close(self) -> None:
        """Close the file."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _write(self, content: bytes) -> None:
        assert self._stream is not None
        self._stream.write(content)
        self._stream.flush()
        os.fsync(self._stream.fileno())


def digest_of(model: AnalysedModel, question: PointRequest, points: Sequence[Any]) -> bytes:
    """Return the digest of all data that determine the results."""
    from .. import cache
    from .point_request import key_of

    files = [(str(s.path), s.text) for s in model.compilation().files]
    return bytes.fromhex(cache.key_of(key_of(model), files, repr(question), *map(repr, points)))


def _alone(stream: BinaryIO, path: str) -> None:
    """Lock the file: two processes with one journal would compute all points twice. Raises `UsageError`."""
    try:
        import fcntl
    except ImportError:  # this system has no such locks
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        stream.close()
        raise UsageError("BR419", f"the journal `{path}` is in use by another process") from None


def _records(content: bytes, begin: int) -> tuple[dict[int, Any], int]:
    """Return the results by index, and the end of the last complete record."""
    found: dict[int, Any] = {}
    at = begin
    while at + _HEAD.size + _HASH <= len(content):
        _, length = _HEAD.unpack_from(content, at)
        start = at + _HEAD.size + _HASH
        head, told = content[at : at + _HEAD.size], content[at + _HEAD.size : start]
        body = content[start : start + length]
        if len(body) < length or hashlib.sha256(head + body).digest() != told:
            break
        some = _JournalUnpickler(io.BytesIO(body)).load()
        if not isinstance(some, dict):
            raise pickle.UnpicklingError(type(some).__name__)
        found |= some
        at = start + length
    return found, at


def _packed(what: object) -> bytes:
    """Return a pickle by the classes' own definitions. Definitions that others registered for the process, as Dask for exceptions, would not be readable."""
    stream = io.BytesIO()
    pickler = pickle.Pickler(stream, protocol=5)
    pickler.dispatch_table = {}
    pickler.dump(what)
    return stream.getvalue()


def _readable(answer: object) -> Any:
    """Return a result that can be read back. An exception at a point may contain any object: then its text is stored."""
    if not isinstance(answer, Exception):
        return answer
    try:
        _JournalUnpickler(io.BytesIO(_packed(answer))).load()
    except Exception:
        return RunFailed("BR466", f"{answer}")
    return answer


class _JournalUnpickler(pickle.Unpickler):
    """Unpickler of arrays and our own data classes only, so that a file cannot run code."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _PLAIN:
            return super().find_class(module, name)
        if _ours(module) and name[:1].isupper() and name.isidentifier():
            found = super().find_class(module, name)
            if isinstance(found, type) and _ours(found.__module__):  # not a class that our module only imports
                return found
        raise pickle.UnpicklingError(f"{module}.{name}")


def _ours(module: str) -> bool:
    return module.split(".")[0] in ("bondgraph", "compiler")
