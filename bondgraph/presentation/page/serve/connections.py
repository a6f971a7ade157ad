"""Connections of the server: limits on their number, and on the time for sending a request."""

from __future__ import annotations

import io
import socket
import threading
import time
from contextlib import suppress
from typing import Any

from .request import Limits, RequestRefused

SOON = 1.0  # s for a closed connection to go


class Connections:
    """Open connections, at most `most`. Those without a valid token yet are closed for new ones, the oldest first."""

    def __init__(self, most: int) -> None:
        self.most = most
        self._changed = threading.Condition()
        self._open: set[socket.socket] = set()
        self._unproven: dict[socket.socket, None] = {}  # in the order of their waiting

    def __len__(self) -> int:
        return len(self._open)

    def proven(self) -> int:
        """Number of connections that are being answered."""
        with self._changed:
            return len(self._open) - len(self._unproven)

    def admit(self, connection: socket.socket) -> bool:
        """Accept a new connection; return False if all others are being answered."""
        with self._changed:
            if len(self._open) >= self.most and self._unproven:
                oldest = next(iter(self._unproven))
                del self._unproven[oldest]
                with suppress(OSError):
                    oldest.shutdown(socket.SHUT_RDWR)  # wakes its thread, which then ends
                self._changed.wait_for(lambda: len(self._open) < self.most, SOON)
            if len(self._open) >= self.most:
                return False
            self._open.add(connection)
            self._unproven[connection] = None
            return True

    def await_request(self, connection: socket.socket) -> None:
        """Note that a connection waits for its next request, and may be closed from now on."""
        with self._changed:
            if connection in self._open:
                self._unproven.pop(connection, None)
                self._unproven[connection] = None

    def trust(self, connection: socket.socket) -> None:
        """Note that the request of a connection has a valid token."""
        with self._changed:
            self._unproven.pop(connection, None)

    def release(self, connection: socket.socket) -> None:
        """Remove a connection that ends."""
        with self._changed:
            self._open.discard(connection)
            self._unproven.pop(connection, None)
            self._changed.notify_all()


class RequestStream(io.RawIOBase):
    """Bytes of requests as they arrive. All parts of a request share one time limit, however slowly they arrive, and one size limit."""

    def __init__(self, connection: socket.socket, limits: Limits) -> None:
        self._connection, self._limits = connection, limits
        self.begin_request()

    def begin_request(self) -> None:
        """Start the time and size limits of the next request."""
        self._deadline = time.monotonic() + self._limits.receiving
        self._received, self._most = 0, self._limits.head

    def expect_body(self, length: int) -> None:
        """Allow `length` more bytes."""
        self._most += length

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        """Read bytes into a buffer and return their number; 0 at the end. Raises `RequestRefused`, or `TimeoutError` if no request had begun."""
        try:
            self._connection.settimeout(max(self._deadline - time.monotonic(), 1e-3))
            count = self._connection.recv_into(buffer)
        except TimeoutError:
            if not self._received:
                raise
            raise RequestRefused(408, f"the request was not complete within {self._limits.receiving:g} s") from None
        self._received += count
        if self._received > self._most:
            raise RequestRefused(431, f"request line and headers have at most {self._limits.head} bytes")
        return count


def drain(connection: socket.socket, limits: Limits) -> None:
    """Announce the end of sending, and discard received data for a short time: closing at once could lose the answer."""
    end = time.monotonic() + limits.draining
    with suppress(OSError):
        connection.shutdown(socket.SHUT_WR)
        while (left := end - time.monotonic()) > 0:
            connection.settimeout(left)
            if not connection.recv(65_536):
                return
