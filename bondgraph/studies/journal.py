"""What of a study is done, in a file: each task's answers as soon as they are there, so that after a crash nothing is made twice.

The file begins with a digest of all that the answers depend on: the text and what it imports, the question, the points, our own code. Behind
it stand records: how many answers, the length, a hash, the answers by the numbers of their points. A record is written in one piece and synced; a tail that is
not whole (the power went) is cut off. Answers are read back by an unpickler that knows arrays and our own nouns, and nothing else.
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
    from ..model import Model
    from .sharing import Question

SCHEMA = b"bondgraph-journal/1\n"
_HEAD = struct.Struct("<QQ")  # answers, length
_HASH = 32
_PLAIN = {
    *((home, name) for home in ("pathlib", "pathlib._local") for name in ("PosixPath", "WindowsPath")),  # of a text
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
    """A file that a study goes on from. It is kept when the study is done: the same study then has its answers at once."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self._stream: BinaryIO | None = None

    def begun(self, model: Model, question: Question, points: Sequence[Any]) -> dict[int, Any]:
        """What is there, by the number of its point; the file is begun if there is none. Raises `UsageError` for a file of something
        else, OSError."""
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
            raise self._closed(f"`{self.path}` is no journal of a study")
        if not content.startswith(head):
            raise self._closed(
                f"`{self.path}` is the journal of another study: the model, what is asked, the points or this program have changed "
                "since; name another file, or remove it"
            )
        try:
            found, whole = _records(content, len(head))
        except pickle.UnpicklingError as problem:
            raise self._closed(f"`{self.path}` holds what no study writes ({problem}): it is not read") from None
        self._stream.seek(whole)
        self._stream.truncate()
        return {i: x for i, x in found.items() if i < len(points)}

    def add(self, answers: Mapping[int, Any]) -> None:
        """Some answers by the numbers of their points, whole or not at all."""
        body = _packed({i: _readable(answer) for i, answer in answers.items()})
        head = _HEAD.pack(len(answers), len(body))
        self._write(head + hashlib.sha256(head + body).digest() + body)

    def close(self) -> None:
        """Let go of the file."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _write(self, content: bytes) -> None:
        assert self._stream is not None
        self._stream.write(content)
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def _closed(self, what: str) -> UsageError:
        self.close()
        return UsageError(what)


def digest_of(model: Model, question: Question, points: Sequence[Any]) -> bytes:
    """Of all that the answers depend on."""
    from ..cache import code_version
    from .sharing import key_of

    digest = hashlib.sha256()
    files = [(str(s.path), s.text) for s in model.compilation().files]
    for part in (code_version(), key_of(model), repr(files), repr(question), *map(repr, points)):
        data = part.encode("utf-8", "surrogatepass")
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.digest()


def _alone(stream: BinaryIO, path: str) -> None:
    """Two processes that write one journal would make everything twice. Raises `UsageError`."""
    try:
        import fcntl
    except ImportError:  # no such locks on this system
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        stream.close()
        raise UsageError(f"the journal `{path}` is in use by another process") from None


def _records(content: bytes, begin: int) -> tuple[dict[int, Any], int]:
    """The answers by number, and where the last whole record ends."""
    found: dict[int, Any] = {}
    at = begin
    while at + _HEAD.size + _HASH <= len(content):
        _, length = _HEAD.unpack_from(content, at)
        start = at + _HEAD.size + _HASH
        head, told, body = (
            content[at : at + _HEAD.size],
            content[at + _HEAD.size : start],
            content[start : start + length],
        )
        if len(body) < length or hashlib.sha256(head + body).digest() != told:
            break
        some = _Known(io.BytesIO(body)).load()
        if not isinstance(some, dict):
            raise pickle.UnpicklingError(type(some).__name__)
        found |= some
        at = start + length
    return found, at


def _packed(what: Any) -> bytes:
    """As classes say themselves. What others have told pickle for all of this process, as Dask does for exceptions, would not be read."""
    stream = io.BytesIO()
    pickler = pickle.Pickler(stream, protocol=5)
    pickler.dispatch_table = {}
    pickler.dump(what)
    return stream.getvalue()


def _readable(answer: Any) -> Any:
    """An answer as it can be read again. What went wrong at a point may hold anything: then its words are kept."""
    if not isinstance(answer, Exception):
        return answer
    try:
        _Known(io.BytesIO(_packed(answer))).load()
    except Exception:
        return RunFailed(str(answer))
    return answer


class _Known(pickle.Unpickler):
    """Arrays and our own nouns: nothing that a file could be made to do."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _PLAIN:
            return super().find_class(module, name)
        if _ours(module) and name[:1].isupper() and name.isidentifier():
            found = super().find_class(module, name)
            if isinstance(found, type) and _ours(found.__module__):  # not one that a module of ours only uses
                return found
        raise pickle.UnpicklingError(f"{module}.{name}")


def _ours(module: str) -> bool:
    return module.split(".")[0] in ("bondgraph", "compiler")
