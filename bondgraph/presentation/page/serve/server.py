"""HTTP server of the page, of changes of the file, and of runs. It uses the standard library, with a bounded number of threads, one per connection."""

from __future__ import annotations

import io
import os
import socket
import sys
import threading
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ....errors import UsageError
from ..shell import page_text
from .answers import answered, looked_up
from .connections import Connections, RequestStream, drain
from .guard import Guard
from .request import Limits, RequestRefused, body_length, check_headers
from .session import Session

PATIENCE = 20.0  # s that a request for changes waits
HEADERS = {
    "Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff", "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin", "Cross-Origin-Opener-Policy": "same-origin",
}  # fmt: skip
BUSY = b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"


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
