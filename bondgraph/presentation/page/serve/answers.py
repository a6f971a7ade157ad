"""Answers of a session to the requests of its pages, whoever brings them: the server, or a worker in the reader's browser."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ....errors import UsageError
from .request import known_version, place_request, run_request, text_request
from .session import Session

NOTHING = "there is nothing here"


def looked_up(session: Session, path: str, query: Mapping[str, Sequence[str]], patience: float) -> tuple[int, str]:
    """Return HTTP status and text of the answer to a request without a body: news within `patience` seconds, or modes. Raises `RequestRefused`."""
    if path == "/changes":
        return 200, session.change(known_version(list(query.get("since", []))), patience)
    return (200, session.modes()) if path == "/modes" else (404, NOTHING)


def answered(session: Session, path: str, body: bytes) -> tuple[int, str]:
    """Return HTTP status and text of the answer to a request with a body. Raises `RequestRefused`."""
    answers: dict[str, Callable[[], str]] = {
        "/stop": session.stop,
        "/run": lambda: session.run(*run_request(body)),
        "/open": lambda: session.open(*text_request(body, "file")),
        "/save": lambda: session.save(*text_request(body, "file", "text", "before")),
        "/check": lambda: session.check(*text_request(body, "text")),
        "/hover": lambda: session.answer("hover", *place_request(body)),
        "/complete": lambda: session.answer("complete", *place_request(body)),
    }
    if path not in answers:
        return 404, NOTHING
    try:
        return 200, answers[path]()
    except UsageError as problem:
        return 400, str(problem)
    except OSError as problem:  # of the file
        return 409, f"not saved: {problem.strerror or problem}"
