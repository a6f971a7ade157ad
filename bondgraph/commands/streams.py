"""Standard streams of a command's process: none is missing, and none can end the process.

A reader that has seen enough (`| head -1`), a closed stream and a full device end no command: it goes on, writes its files and ends with its own exit
code. `Outlet.problem` stores the error, for a message at the end.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Any, TextIO

from .error_reporting import USAGE


class Outlet(io.RawIOBase):
    """The raw stream `target` until it cannot be written; from then on output is discarded, and `problem` has the error."""

    def __init__(self, target: io.RawIOBase) -> None:
        self.target = target
        self.problem: OSError | None = None

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self.target.fileno()

    def isatty(self) -> bool:
        return self.target.isatty()

    def write(self, data: Any) -> int | None:
        if self.problem is None:
            try:
                return self.target.write(data)
            except OSError as problem:
                self.problem = problem
        return len(data)

    @property
    def is_told(self) -> bool:
        """True if the error must be reported: not for a reader that has closed the pipe."""
        return self.problem is not None and self.problem.errno not in (errno.EPIPE, errno.EBADF)


def open_streams() -> Outlet | None:
    """Replace the standard output and errors by outlets, and closed streams by the null device.

    Return the outlet of the standard output; None if it is no file of this process. No file opened later gets the number of a closed stream.
    """
    if None in (sys.stdin, sys.stdout, sys.stderr):
        while (descriptor := os.open(os.devnull, os.O_RDWR)) < 3:
            pass
        os.close(descriptor)
    outlet, sys.stdout = _guarded(sys.stdout, 1)
    _, sys.stderr = _guarded(sys.stderr, 2)
    return outlet


def _guarded(stream: TextIO | None, descriptor: int) -> tuple[Outlet | None, TextIO]:
    """Return an outlet to a stream (None: to the null device), and the text stream that writes to it and accepts every character."""
    buffer = io.FileIO(descriptor, "w", closefd=False) if stream is None else getattr(stream, "buffer", None)
    raw = getattr(buffer, "raw", buffer)  # an unbuffered stream writes to the raw one
    if not isinstance(raw, io.RawIOBase):  # text collected within this process
        return None, stream or io.StringIO()
    outlet = Outlet(raw)
    encoding = stream.encoding if stream is not None else "utf-8"
    lines = outlet.isatty() or descriptor == 2
    return outlet, io.TextIOWrapper(io.BufferedWriter(outlet), encoding, "backslashreplace", line_buffering=lines)


def told_at_the_end(outlet: Outlet | None, code: int) -> int:
    """Return the exit code `code`, or that of a failed output that a reader expects."""
    sys.stdout.flush()
    if outlet is not None and outlet.is_told and outlet.problem is not None:
        print(f"bondgraph: the standard output cannot be written: {outlet.problem.strerror}", file=sys.stderr)
        code = code or USAGE
    sys.stderr.flush()
    return code
