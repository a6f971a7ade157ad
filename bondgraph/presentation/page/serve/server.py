"""HTTP server of the page, of changes of the file, and of runs. It uses the standard library, with a bounded number of threads, one per connection.

Connections are limited in number, and in the time for sending a request. The server answers only its own pages, at its own address, with the token
that it gave them. A foreign page open in the same browser can send requests to this machine. It cannot read the token, its `Origin` differs, and if
its own name resolves to this machine (DNS rebinding), the `Host` is that name.
"""

from __future__ import annotations

import io
import ipaddress
import os
import secrets
import socket
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ....errors import UsageError
from ..shell import page_text
from .answers import answered, looked_up
from .request import Limits, RequestRefused, body_length, check_headers
from .session import Session

PATIENCE = 20.0  # s that a request for changes waits
HEADERS = {
    "Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff", "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin", "Cross-Origin-Opener-Policy": "same-origin",
}  # fmt: skip
BUSY = b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
SOON = 1.0  # s for a closed connection to go
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


class Server(ThreadingHTTPServer):
    """HTTP server on one address of this machine; `guard.address` is that of the page. Raises `UsageError` for an impossible address."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 128

    def __init__(self, session: Session, host: str = "127.0.0.1", port: int = 0, limits: Limits | None = None) -> None:
        self.limits = limits or Limits()
        self.connections = Connections(self.limits.connections)
        host = host.strip().removeprefix("[").removesuffix("]")
        if not host:
            raise UsageError(
                "BR924", "`--host` is empty;", "127.0.0.1 is this machine alone, 0.0.0.0 all addresses that it has"
            )
        if ":" in host:
            self.address_family = socket.AF_INET6
        try:
            super().__init__((host, port), Handler)
        except (OSError, ValueError, TypeError) as problem:
            raise UsageError(
                "BR925", f"the server cannot listen on `{host}`, port {port}: {getattr(problem, 'strerror', None) or problem};",
                "`--host` is a name or an address of this machine, `--port 0` takes any free port",
            ) from None  # fmt: skip
        self.session = session
        self.guard = Guard(host, self.server_port)

    def start(self) -> None:
        """Load the file, and follow it in a separate thread."""
        self.session.load()
        threading.Thread(target=self.session.watch, daemon=True).start()

    def process_request(self, request: Any, client_address: object) -> None:
        """Answer a connection in a thread, or refuse it if too many are being answered."""
        if self.connections.admit(request):
            super().process_request(request, client_address)
            return
        with suppress(OSError):
            request.settimeout(0.1)
            request.sendall(BUSY)
        self.shutdown_request(request)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection, and make room for the next one."""
        self.connections.release(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: object) -> None:
        """Ignore the error of a page that is closed while it waits for changes."""
        if not isinstance(sys.exc_info()[1], (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)

    def end(self) -> None:
        """Stop answering."""
        self.session.ended.set()
        with self.session.news:
            self.session.news.notify_all()
        self.shutdown()
        self.server_close()


class Handler(BaseHTTPRequestHandler):
    """Requests of one connection. The token is checked before a body is read."""

    protocol_version = "HTTP/1.1"
    default_request_version = "HTTP/1.0"  # for a request line without one: the answer has a status nevertheless
    server_version, sys_version = "bondgraph", ""
    requestline, request_version = "", "HTTP/1.1"  # before the first request line
    server: Server

    def setup(self) -> None:
        super().setup()
        self.rfile.close()
        self.incoming = RequestStream(self.connection, self.server.limits)
        self.rfile = io.BufferedReader(self.incoming)
        self.refused = False

    def finish(self) -> None:
        if self.refused:
            drain(self.connection, self.server.limits)
        super().finish()

    def handle_one_request(self) -> None:
        """Read a request and answer it."""
        self.server.connections.await_request(self.connection)
        self.incoming.begin_request()
        try:
            super().handle_one_request()
        except RequestRefused as refused:
            self._refuse(refused.status, str(refused))
        except OSError:
            raise
        except Exception as problem:
            self._refuse(500, f"a defect of ours, not of your file ({type(problem).__name__}: {problem})")
            if os.environ.get("BONDGRAPH_DEBUG"):
                raise

    def handle_expect_100(self) -> bool:
        """Delay the permission to send a body: the token is checked first."""
        return True

    def do_GET(self) -> None:
        check_headers(self.headers)
        if self.headers.get("Transfer-Encoding") is not None or self.headers.get("Content-Length", "0").strip() != "0":
            raise RequestRefused(400, "a question by GET has no body")
        try:
            asked = urlsplit(self.path)
        except ValueError:
            raise RequestRefused(400, "the address is none") from None
        query = parse_qs(asked.query, keep_blank_values=True)
        if asked.path == "/":
            self._check_token(query.get("token", [""])[0])
            page = page_text(self.server.session.page(), "server", self.server.guard.token)
            self._answer(200, page, "text/html; charset=utf-8")
        elif asked.path == "/favicon.ico":
            self._answer(404, "", "text/plain; charset=utf-8")
        else:
            self._check_token(self.headers.get("X-Bondgraph-Token", ""))
            self._respond(*looked_up(self.server.session, asked.path, query, PATIENCE))

    def do_POST(self) -> None:
        check_headers(self.headers)
        self._check_token(self.headers.get("X-Bondgraph-Token", ""))
        limits, session = self.server.limits, self.server.session
        has_text = self.path in ("/save", "/check", "/hover", "/complete")
        body = self._body(body_length(self.headers, limits.text if has_text else limits.body))
        self._respond(*answered(session, self.path, body))

    def _respond(self, status: int, words: str) -> None:
        self._answer(status, words) if status == 200 else self._tell(status, words)

    def _check_token(self, token: str) -> None:
        """Raise `RequestRefused` if the request is not from a page of this server."""
        refusal = self.server.guard.refusal(self.headers, token)  # type: ignore[arg-type]
        if refusal:
            raise RequestRefused(403, refusal)
        self.server.connections.trust(self.connection)

    def _body(self, length: int) -> bytes:
        if self.headers.get("Expect", "").lower() == "100-continue":
            self.send_response_only(100)
            self.end_headers()
        self.incoming.expect_body(length)
        body = self.rfile.read(length)
        if len(body) < length:
            raise RequestRefused(400, "the question is shorter than its Content-Length")
        return body

    def _tell(self, status: int, words: str) -> None:
        self._answer(status, words + "\n", "text/plain; charset=utf-8")

    def _refuse(self, status: int, words: str) -> None:
        """Send the reason, and close: the data after an incompletely read request are no request."""
        self.close_connection = self.refused = True
        with suppress(OSError):
            self._tell(status, words)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuse a request that the standard library could not read; no part of it is repeated."""
        self._refuse(int(code), "this is no request that the server knows")

    def _answer(self, status: int, words: str, kind: str = "application/json") -> None:
        body = words.encode("utf-8")
        self.connection.settimeout(self.server.limits.sending)
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body)

    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        """Write no log: nobody reads it, and addresses contain the token."""

    def log_message(self, format: str, *arguments: Any) -> None:
        """Write no log."""


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


@dataclass(frozen=True)
class Guard:
    """Address `host` and `port` of the server; `token` is new in each server."""

    host: str
    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    @property
    def address(self) -> str:
        """Address of the page, with the token."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{name}:{self.port}/?token={self.token}"

    def refusal(self, headers: Mapping[str, str], token: str) -> str:
        """Return the reason for refusing a request; empty if it is accepted."""
        host = headers.get("Host", "")
        if not self._is_ours(host):
            return "this server does not answer to that name"
        origin = headers.get("Origin")
        if origin is not None and origin != f"http://{host}":
            return "a page from elsewhere asks nothing of this server"
        if headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            return "a page from elsewhere asks nothing of this server"
        if not secrets.compare_digest(token.encode("utf-8", "replace"), self.token.encode()):
            return "the address of the page has a token in it, which is missing here or is another's"
        return ""

    def _is_ours(self, host: str) -> bool:
        name, colon, port = host.rpartition(":")
        if not colon or port != str(self.port):
            return False
        if name in LOOPBACK or name.strip("[]") == self.host:
            return True
        listens_to_all = _is_number(self.host) and ipaddress.ip_address(self.host).is_unspecified
        return listens_to_all and _is_number(name.strip("[]"))  # a stranger's name is no number


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
