"""The server: the page, the news of the file, runs. Of the standard library, a thread for each request."""

from __future__ import annotations

import json
import math
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ...errors import UsageError
from ..shell import page_text
from .guard import Guard
from .session import Session

LONGEST = 65_536  # bytes of a question
PATIENCE = 20.0  # s for which a question for news waits
HEADERS = {
    "Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff", "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin", "Cross-Origin-Opener-Policy": "same-origin",
}  # fmt: skip


class Server(ThreadingHTTPServer):
    """Listens on one address of this machine. `guard.address` is where the page is."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, session: Session, host: str = "127.0.0.1", port: int = 0) -> None:
        super().__init__((host, port), Handler)
        self.session = session
        self.guard = Guard(host, self.server_port)

    def start(self) -> None:
        """Load the file, and follow it in a thread of its own."""
        self.session.load()
        threading.Thread(target=self.session.watch, daemon=True).start()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that is closed while it waits for news is no error."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)

    def end(self) -> None:
        """No further answers."""
        self.session.ended.set()
        with self.session.news:
            self.session.news.notify_all()
        self.shutdown()
        self.server_close()


class Handler(BaseHTTPRequestHandler):
    """One request."""

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "bondgraph", ""
    server: Server

    def do_GET(self) -> None:
        asked = urlsplit(self.path)
        query = parse_qs(asked.query)
        if asked.path == "/":
            if self._may(query.get("token", [""])[0]):
                page = page_text(self.server.session.page(), self.server.guard.token)
                self._answer(200, page, "text/html; charset=utf-8")
        elif asked.path == "/favicon.ico":
            self._answer(404, "", "text/plain; charset=utf-8")
        elif self._may(self.headers.get("X-Bondgraph-Token", "")):
            if asked.path == "/changes":
                since = query.get("since", ["-1"])[0]
                self._answer(200, self.server.session.change(int(since) if since.isdigit() else -1, PATIENCE))
            elif asked.path == "/modes":
                self._answer(200, self.server.session.modes())
            else:
                self._tell(404, "there is nothing here")

    def do_POST(self) -> None:
        length = self.headers.get("Content-Length", "")
        if not length.isdigit() or int(length) > LONGEST:
            self.close_connection = True
            self._tell(413, "a question is short, and says how long it is")
            return
        body = self.rfile.read(int(length))
        if not self._may(self.headers.get("X-Bondgraph-Token", "")):
            return
        if self.path == "/stop":
            self._answer(200, self.server.session.stop())
            return
        if self.path != "/run":
            self._tell(404, "there is nothing here")
            return
        try:
            experiment, settings = _question(body)
            self._answer(200, self.server.session.run(experiment, settings))
        except UsageError as problem:
            self._tell(400, str(problem))

    def _may(self, token: str) -> bool:
        refusal = self.server.guard.refusal(self.headers, token)  # type: ignore[arg-type]
        if refusal:
            self._tell(403, refusal)
        return not refusal

    def _tell(self, status: int, words: str) -> None:
        self._answer(status, words + "\n", "text/plain; charset=utf-8")

    def _answer(self, status: int, words: str, kind: str = "application/json") -> None:
        body = words.encode("utf-8")
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Nobody reads it, and addresses have the token in them."""


def _question(body: bytes) -> tuple[str, dict[str, float]]:
    """The experiment and the values of a request. Raises `UsageError`."""
    try:
        told = json.loads(body)
        experiment, settings = told["experiment"], told["settings"]
        values = {str(name): float(value) for name, value in settings.items()}
    except (ValueError, TypeError, KeyError, AttributeError):
        raise UsageError("a question is an experiment and numbers by name, in JSON") from None
    if not isinstance(experiment, str) or not all(math.isfinite(v) for v in values.values()):
        raise UsageError("an experiment has a name, and a value is a finite number")
    return experiment, values
