"""Requests that no page of ours sends: each gets a status and a sentence, or is closed in time, and the server answers the next one."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from bondgraph.errors import UsageError
from bondgraph.presentation.page.serve import Server, Session
from bondgraph.presentation.page.serve.request import Limits, RequestRefused, body_length, known_version, run_request

TEXT = """model Swing {
  parameter m = 2 kg, k = 8 [N/m]
  Se drive : F = 1 N
  1  body
  I  mass   : p = m*v
  C  spring : F = k*x
  drive -> body -> mass, spring
  output x = spring.x
  experiment go { simulate 0 .. 1 s; report x in m }
}
"""
SHORT = Limits(receiving=1.0, draining=0.2, connections=8)
LONG = 60  # s until a test fails that gets no answer; a first run compiles
GOOD = json.dumps({"experiment": "go", "settings": {"k": 4}}).encode()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    path = tmp_path_factory.mktemp("serve") / "swing.bg"
    path.write_text(TEXT, encoding="utf-8")
    serving = Server(Session(path), limits=SHORT)
    thread = threading.Thread(target=serving.serve_forever, args=(0.02,), daemon=True)
    serving.start()
    assert serving.session.loaded is not None and not serving.session.shown.problems
    thread.start()
    yield serving
    serving.end()
    thread.join()


def exchange(server: Server, sent: bytes) -> tuple[int, str]:
    """The status and the body that come back for bytes, until the server closes or has said all; 0 if nothing comes."""
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=LONG) as connection:
        with suppress(ConnectionError):  # where the server closed before all was sent, its answer counts
            connection.sendall(sent)
        return answer_of(connection)


def answer_of(connection: socket.socket) -> tuple[int, str]:
    """The status and the body that come on a connection until its end; 0 if nothing comes."""
    received = b""
    with suppress(ConnectionError):
        while part := connection.recv(65_536):
            received += part
    head, _, body = received.partition(b"\r\n\r\n")
    return int(head.split(b" ", 2)[1]) if head else 0, body.decode()


def request(server: Server, line: str, *headers: str, body: bytes = b"", token: str | None = None) -> bytes:
    """A request of raw bytes with the server's name and token, that closes after the answer."""
    shown = server.guard.token if token is None else token
    lines = [
        line,
        f"Host: 127.0.0.1:{server.server_port}",
        f"X-Bondgraph-Token: {shown}",
        "Connection: close",
        *headers,
    ]
    return "\r\n".join(lines).encode("latin-1") + b"\r\n\r\n" + body


def post(server: Server, body: bytes, *headers: str, token: str | None = None) -> tuple[int, str]:
    given = headers or (f"Content-Length: {len(body)}",)
    return exchange(server, request(server, "POST /run HTTP/1.1", *given, body=body, token=token))


LENGTHS = {
    "²": 400, "5²": 400, "": 400, "-5": 400, "+5": 400, "5.0": 400, "5e0": 400, "0x5": 400, "1_0": 400, "5, 5": 400, "5 5": 400, "many": 400,
    "nan": 400, "9" * 400: 413, "1" + "0" * 5000: 413, "65537": 413, "99999999": 413,
}  # fmt: skip


@pytest.mark.parametrize("length", LENGTHS, ids=lambda length: length[:8] or "nothing")
def test_odd_lengths(server: Server, length: str) -> None:
    status, words = post(server, GOOD, f"Content-Length: {length}")
    assert status == LENGTHS[length] and words.strip()


def test_lengths_that_are_fine(server: Server) -> None:
    for length in (f"{len(GOOD)}", f"000{len(GOOD)}", "0" * 3000 + f"{len(GOOD)}", f"{len(GOOD)} \t"):
        status, words = post(server, GOOD, f"Content-Length: {length}")
        assert status == 200 and json.loads(words)["kind"] == "run"


def headers_of(server: Server) -> list[tuple[list[str], int]]:
    length, host = f"Content-Length: {len(GOOD)}", f"Host: 127.0.0.1:{server.server_port}"
    return [
        (["Accept: */*"], 411),  # no length
        (["Transfer-Encoding: chunked"], 411),
        ([length, "Transfer-Encoding: chunked"], 411),
        ([length, "Transfer-Encoding: identity"], 411),
        ([length, length], 400),
        ([length, "Content-Length: 5"], 400),
        ([length, host], 400),
        ([length, "Host: evil.example"], 400),
        ([length, f"X-Bondgraph-Token: {server.guard.token}"], 400),
        ([length, "Origin: http://evil.example"], 403),
        ([length, f"Origin: http://{host[6:]}", "Origin: http://evil.example"], 400),
        ([length, "no colon here"], 400),
        ([length, ": no name"], 400),
        ([f"Content-Length : {len(GOOD)}"], 400),
        ([length, *(f"X-{i}: y" for i in range(200))], 431),
        ([length, "X-Long: " + "y" * 70_000], 431),
        ([length, *(f"X-{i}: " + "y" * 60_000 for i in range(4))], 431),
    ]


@pytest.mark.parametrize("case", range(17))
def test_odd_headers(server: Server, case: int) -> None:
    headers, expected = headers_of(server)[case]
    status, words = post(server, GOOD, *headers)
    assert status == expected and words.strip(), headers[-1][:60]


def test_all_odd_headers_are_tried(server: Server) -> None:
    assert len(headers_of(server)) == 17


SINCE = [
    "²",
    "%C2%B2",
    "",
    "-1",
    "+1",
    "1.0",
    "1e3",
    "0x1",
    "1_0",
    "nan",
    "many",
    "9" * 400,
    "9" * 5000,
    "%D9%A3",
    "1%00",
    "1&since=2",
]


@pytest.mark.parametrize("since", SINCE, ids=lambda since: since[:8] or "nothing")
def test_odd_versions(server: Server, since: str) -> None:
    status, words = exchange(server, request(server, f"GET /changes?since={since} HTTP/1.1"))
    assert status == 400 and "since" in words


def test_versions_that_are_fine(server: Server) -> None:
    for query in ("", "?since=0", "?since=000", "?since=999999999999999"):
        status, words = exchange(server, request(server, f"GET /changes{query} HTTP/1.1"))
        assert status == 200 and json.loads(words)["version"] == server.session.version


def settings_of(value: str, name: str = "k") -> bytes:
    return f'{{"experiment": "go", "settings": {{"{name}": {value}}}}}'.encode()


BODIES = [
    settings_of(value)
    for value in (
        "1" + "0" * 400, "-1" + "0" * 400, "1" + "0" * 5000, "1e400", "-1e400", "NaN", "Infinity", "-Infinity", "true", "false", "null",
        "[4]", '{"k": 4}', "[" * 20_000 + "]" * 20_000, "04", "4,", "0x4", "4 m",
    )
] + [
    b"", b" ", b"null", b"4", b'"go"', b"[]", b"{}", b"\x00", b"\xff\xfe", GOOD.decode().encode("utf-16"), b"\xef\xbb\xbf" + GOOD, GOOD[:-1],
    GOOD + GOOD, b"[" * 60_000, b'{"a":' * 13_000, b"[" * 30_000 + b"]" * 30_000, b'{"experiment": "go"}', b'{"settings": {}}',
    b'{"experiment": null, "settings": {}}', b'{"experiment": 1, "settings": {}}', b'{"experiment": {}, "settings": {}}',
    b'{"experiment": "go", "settings": null}', b'{"experiment": "go", "settings": [["k", 4]]}', b'{"experiment": "go", "settings": "k"}',
    b'{"experiment": "go", "settings": {"k": 4, "k": 5}}', b'{"experiment": "go", "experiment": "no", "settings": {}}',
    b'{"experiment": "no", "settings": {}}', b'{"experiment": "go", "settings": {"z": 1}}', b'{"experiment": "\\ud800", "settings": {}}',
    b'{"experiment": "go", "settings": {"\\ud800": 1}}', b'{"experiment": "go", "settings": {"": 1}}',
]  # fmt: skip


@pytest.mark.parametrize("case", range(len(BODIES)))
def test_odd_bodies(server: Server, case: int, capfd: pytest.CaptureFixture[str]) -> None:
    status, words = post(server, BODIES[case])
    assert status == 400 and words.strip(), BODIES[case][:60]
    assert capfd.readouterr() == ("", "")


def test_values_at_the_ends_of_the_numbers_are_run_or_told(server: Server) -> None:
    """A mass as large as that moves in no time; a stiffness would ring for longer than somebody waits."""
    for name, value in (("k", "0"), ("k", "-0.0"), ("k", "5e-324"), ("m", "1e300"), ("m", "1" + "0" * 300)):
        status, words = post(server, settings_of(value, name))
        assert status == 200 and json.loads(words)["kind"] in ("run", "failed"), (name, value)


LINES = {
    "GET //[ HTTP/1.1": 404, "GET http://[x/ HTTP/1.1": 400, "GET http://[::1 HTTP/1.1": 400, "GET /../../etc/passwd HTTP/1.1": 404,
    "GET /%2e%2e/%2e%2e/etc/passwd HTTP/1.1": 404, "GET /..%2f HTTP/1.1": 404, "GET /%00 HTTP/1.1": 404, "GET /²?² HTTP/1.1": 404, "GET * HTTP/1.1": 404,
    "GET / HTTP/1.1": 403, "GET": 400, "GET / x HTTP/1.1": 400, "GET / HTTP/²": 400, "GET / HTTP/1": 400, "GET / HTTP/9.9": 505, "GET / HTTP/1.99999999999": 400,
    "PUT / HTTP/1.1": 501, "BREW / HTTP/1.1": 501, "__class__ / HTTP/1.1": 501, "POST / HTTP/1.1": 411, "/ GET": 400, "\x16\x03\x01": 400,
    f"GET /{'x' * 70_000} HTTP/1.1": 414, f"GET /?token={'x' * 60_000} HTTP/1.1": 403, f"GET /{'x' * 60_000} HTTP/1.1": 404,
    f"GET /{'/' * 60_000} HTTP/1.1": 403, f"GET /changes?{'&' * 60_000} HTTP/1.1": 200, f"GET /changes?{'a=b&' * 15_000}since=0 HTTP/1.1": 200,
}  # fmt: skip


@pytest.mark.parametrize("line", LINES, ids=lambda line: ascii(line[:24]))
def test_odd_request_lines(server: Server, line: str, capfd: pytest.CaptureFixture[str]) -> None:
    status, _ = exchange(server, request(server, line))
    assert status == LINES[line] and capfd.readouterr() == ("", "")


def test_a_request_line_of_http_0_9_gets_a_status(server: Server) -> None:
    assert exchange(server, b"GET /\r\n\r\n")[0] == 403


def test_a_body_by_get_is_no_second_request(server: Server) -> None:
    smuggled = request(server, "GET /favicon.ico HTTP/1.1")
    for header in (f"Content-Length: {len(smuggled)}", "Transfer-Encoding: chunked"):
        sent = request(server, "GET /modes HTTP/1.1", header, body=smuggled)
        status, words = exchange(server, sent.replace(b"Connection: close\r\n", b"", 1))
        assert status == 400 and "HTTP/" not in words


def test_several_requests_on_one_connection(server: Server) -> None:
    length = f"Content-Length: {len(GOOD)}"
    first = request(server, "POST /run HTTP/1.1", length, body=GOOD).replace(b"Connection: close\r\n", b"")
    status, words = exchange(server, first + request(server, "POST /run HTTP/1.1", length, body=GOOD))
    assert status == 200 and words.count('"kind"') == 2


# ---------------------------------------------------------------- time and number


def test_the_token_is_asked_before_the_body(server: Server) -> None:
    """The answer comes although nothing of the body is sent, and no leave to send it."""
    for headers in (
        ["Content-Length: 1000"],
        ["Content-Length: 1000", "Expect: 100-continue"],
        ["Content-Length: ²"],
        ["Transfer-Encoding: chunked"],
    ):
        assert post(server, b"", *headers, token="wrong")[0] == 403


def test_the_leave_to_send_a_body_comes_with_the_token(server: Server) -> None:
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=LONG) as connection:
        connection.sendall(
            request(server, "POST /run HTTP/1.1", f"Content-Length: {len(GOOD)}", "Expect: 100-continue")
        )
        assert connection.recv(1000).startswith(b"HTTP/1.1 100 ")
        connection.sendall(GOOD)
        assert connection.recv(1000).startswith(b"HTTP/1.1 200 ")


HALF: dict[str, Callable[[Server], bytes]] = {
    "a letter": lambda server: b"P",
    "half a line": lambda server: b"GET /?tok",
    "half the headers": lambda server: b"POST /run HTTP/1.1\r\nHost: 127",
    "headers without their end": lambda server: request(server, "GET /changes HTTP/1.1")[:-2],
    "no body": lambda server: request(server, "POST /run HTTP/1.1", "Content-Length: 100"),
    "half a body": lambda server: request(server, "POST /run HTTP/1.1", "Content-Length: 100", body=GOOD[:20]),
}


def test_half_a_request_gets_a_time_limit(server: Server) -> None:
    """All halves at once, so that the test waits for one limit."""
    waiting = {half: socket.create_connection(("127.0.0.1", server.server_port), timeout=LONG) for half in HALF}
    for half, connection in waiting.items():
        connection.sendall(HALF[half](server))
    for half, connection in waiting.items():
        with connection:
            status, words = answer_of(connection)
        assert status == 408 and f"{SHORT.receiving:g} s" in words, half


def test_a_connection_without_a_request_is_closed(server: Server) -> None:
    assert exchange(server, b"") == (0, "")


def test_a_body_that_ends_early_is_told(server: Server) -> None:
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=LONG) as connection:
        connection.sendall(request(server, "POST /run HTTP/1.1", f"Content-Length: {len(GOOD) + 1}", body=GOOD))
        connection.shutdown(socket.SHUT_WR)
        assert connection.recv(1000).startswith(b"HTTP/1.1 400 ")


def test_bytes_that_drip_share_one_time_limit(server: Server) -> None:
    """Each byte comes in time, and the request all the same does not."""
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=LONG) as connection:
        connection.settimeout(0.02)
        answer = b""
        for _ in range(500):  # some 10 s, ten times the limit
            connection.sendall(b"G")
            with suppress(TimeoutError):
                answer = connection.recv(1000)
                break
        assert answer.startswith(b"HTTP/1.1 408 ")


@pytest.mark.parametrize("half", HALF)
def test_half_sent_requests_hold_no_threads(server: Server, half: str) -> None:
    """Of 60 that are half sent at most as many are open as the limit says; a page is answered at once, among them."""
    before = threading.active_count()
    sent = HALF[half](server).replace(server.guard.token.encode(), b"another")
    held = []
    try:
        for _ in range(60):
            connection = socket.create_connection(("127.0.0.1", server.server_port), timeout=LONG)
            held.append(connection)
            connection.sendall(sent)
        assert exchange(server, request(server, f"GET /?token={server.guard.token} HTTP/1.1"))[0] == 200
        assert len(server.connections) <= SHORT.connections
        until(lambda: threading.active_count() <= before + SHORT.connections)
    finally:
        for connection in held:
            connection.close()
    until(lambda: len(server.connections) == 0)


def test_requests_with_the_token_do_not_give_way(server: Server) -> None:
    """As many as the limit says wait for news; one more is refused until they have been answered."""
    until(lambda: len(server.connections) == 0)
    sent = request(server, f"GET /changes?since={server.session.version} HTTP/1.1")
    waiting = []
    for number in range(1, SHORT.connections + 1):
        waiting.append(socket.create_connection(("127.0.0.1", server.server_port), timeout=LONG))
        waiting[-1].sendall(sent)
        until(lambda number=number: server.connections.proven() == number)  # type: ignore[misc]
    assert exchange(server, request(server, "GET /modes HTTP/1.1"))[0] == 503
    server.session.load()  # news
    for connection in waiting:
        assert connection.recv(1000).startswith(b"HTTP/1.1 200 ")
        connection.close()
    until(lambda: len(server.connections) == 0)
    assert exchange(server, request(server, "GET /modes HTTP/1.1"))[0] == 200


def test_a_defect_is_told_without_a_traceback(
    server: Server, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: Any) -> str:
        raise ZeroDivisionError("of a test")

    monkeypatch.setattr(server.session, "run", broken)
    status, words = post(server, GOOD)
    assert status == 500 and "ZeroDivisionError" in words and capfd.readouterr() == ("", "")


def until(holds: Callable[[], bool], patience: float = LONG) -> None:
    end = time.monotonic() + patience
    while not holds():
        assert time.monotonic() < end, "never"
        time.sleep(0.01)


def test_a_defect_while_the_file_is_read_is_told_on_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the file is followed on: the thread that looks at it lives."""
    path = tmp_path / "swing.bg"
    path.write_text(TEXT, encoding="utf-8")
    session = Session(path)
    session.load()
    first = session.loaded
    with monkeypatch.context() as broken:
        for kind in (RecursionError, MemoryError, ZeroDivisionError, AssertionError):
            broken.setattr(session, "_compiled", lambda text, kind=kind: (_ for _ in ()).throw(kind("of a test")))
            session.load()
            assert kind.__name__ in session.shown.problems and session.loaded is first
    session.load()
    assert session.shown.problems == "" and session.loaded is not first


# ---------------------------------------------------------------- addresses

NO_ADDRESSES = [
    "", " ", "[]", "a..b", "a" * 100, "é" * 100, "192.0.2.7", "127.0.0.1:80", "[2001:db8::1]", "a\0b", "\ud800", "²",
]  # fmt: skip


@pytest.mark.parametrize("host", NO_ADDRESSES, ids=lambda host: ascii(host[:16]))
def test_addresses_that_cannot_be(host: str, tmp_path: Path) -> None:
    """An empty one would be all addresses of the machine, which nobody said."""
    with pytest.raises(UsageError, match="--host"):
        Server(Session(tmp_path / "none.bg"), host)


def test_a_port_that_is_taken_is_told(server: Server, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=f"port {server.server_port}: Address already in use; .*--port 0"):
        Server(Session(tmp_path / "none.bg"), port=server.server_port)


@pytest.mark.parametrize("host", ["::1", "[::1]"])
def test_an_address_of_version_6(host: str, tmp_path: Path) -> None:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("this machine has no addresses of version 6")
    listening = Server(Session(tmp_path / "none.bg"), host)
    assert listening.guard.address.startswith(f"http://[::1]:{listening.server_port}/?token=")
    listening.server_close()


# ---------------------------------------------------------------- without a socket


def test_what_is_read_of_a_request() -> None:
    from email.message import Message

    def length(text: str) -> int:
        headers = Message()
        headers["Content-Length"] = text
        return body_length(headers, 10)

    assert (length("0"), length("10"), length("007")) == (0, 10, 7)
    with pytest.raises(RequestRefused) as refused:
        length("11")
    assert refused.value.status == 413
    assert known_version([]) == -1 and known_version(["12"]) == 12
    assert run_request(GOOD) == ("go", {"k": 4.0})
