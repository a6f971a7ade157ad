"""Request as data: length of its body, version of the page, requested run; and the reasons for refusing a request."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from email.message import Message
from typing import Any

ONCE = ("Host", "Origin", "Sec-Fetch-Site", "X-Bondgraph-Token", "Content-Length", "Transfer-Encoding")
MOST_DIGITS = 15  # most digits of an integer; a longer one is no version
NO_RUN = "a question is an experiment and numbers by name, in JSON"


class RequestRefused(Exception):
    """Raised for a request that is answered with an HTTP status and a sentence only."""

    def __init__(self, status: int, words: str) -> None:
        super().__init__(words)
        self.status = status


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits on the resources of clients: sizes in bytes, times in s."""

    body: int = 65_536
    text: int = 4_194_304  # of a body with the text of a file
    head: int = 131_072  # request line and headers
    receiving: float = 20.0  # from the first wait for a request to the end of its body
    sending: float = 60.0  # for an answer
    draining: float = 0.5  # for further data of a refused client, so that it can read the reason
    connections: int = 32


def check_headers(headers: Message) -> None:
    """Raise `RequestRefused` if a line of the headers is invalid, or if an essential header occurs twice."""
    if headers.defects or headers.get_payload():
        raise RequestRefused(400, "a header is a name, a colon and a value")
    for name in ONCE:
        if len(headers.get_all(name, [])) > 1:
            raise RequestRefused(400, f"the header {name} is there more than once")


def body_length(headers: Message, longest: int) -> int:
    """Return the length of a request's body in bytes, at most `longest`. Raises `RequestRefused`."""
    if headers.get("Transfer-Encoding") is not None:
        raise RequestRefused(411, "a question comes in one piece, with its Content-Length")
    length = headers.get("Content-Length")
    if length is None:
        raise RequestRefused(411, "a question says how long it is: Content-Length is missing")
    digits = length.strip(" \t")
    if not _is_whole(digits):
        raise RequestRefused(400, "Content-Length is a whole number, in decimal digits")
    digits = digits.lstrip("0") or "0"
    if len(digits) > MOST_DIGITS or int(digits) > longest:
        raise RequestRefused(413, f"a question has at most {longest} bytes")
    return int(digits)


def known_version(values: list[str]) -> int:
    """Return the version of a page, from the values of `since`; -1 without one. Raises `RequestRefused`."""
    if not values:
        return -1
    if len(values) > 1 or not _is_whole(values[0]) or len(values[0]) > MOST_DIGITS:
        raise RequestRefused(400, "`since` is the number of a version, in decimal digits")
    return int(values[0])


def run_request(body: bytes) -> tuple[str, dict[str, str | float]]:
    """Return the experiment and the values by name, numbers in SI or texts with units, of a body in JSON. Raises `RequestRefused`."""
    try:
        fields = json.loads(body.decode("utf-8"), object_pairs_hook=_without_doubles)
        experiment, settings = fields["experiment"], fields["settings"]
        values = {name: _number(value) for name, value in settings.items()}
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise RequestRefused(400, NO_RUN) from None
    except OverflowError:
        raise RequestRefused(400, "a value is at most 1.8e308 in size") from None
    if not isinstance(experiment, str) or not all(isinstance(v, str) or math.isfinite(v) for v in values.values()):
        raise RequestRefused(400, "an experiment has a name, and a value is a finite number")
    return experiment, values


def text_request(body: bytes, *names: str) -> tuple[str, ...]:
    """Return the texts of these names in a body in JSON. Raises `RequestRefused`."""
    try:
        fields = json.loads(body.decode("utf-8"), object_pairs_hook=_without_doubles)
        texts = tuple(str.encode(fields[name]).decode() for name in names)  # no half of a character
    except (ValueError, TypeError, KeyError, RecursionError):
        raise RequestRefused(400, f"a question has {', '.join(names)}, in JSON") from None
    return texts


def place_request(body: bytes) -> tuple[str, int]:
    """Return the text, and the number of a character of it, of a body in JSON. Raises `RequestRefused`."""
    text, at = text_request(body, "text", "at")
    if not _is_whole(at) or len(at) > MOST_DIGITS:
        raise RequestRefused(400, "`at` is the number of a character, in decimal digits")
    return text, int(at)


def _is_whole(digits: str) -> bool:
    """Return True if a text has only digits 0 to 9: `str.isdigit` also accepts `²`, which is no number."""
    return digits.isascii() and digits.isdigit()


def _number(value: object) -> str | float:
    if isinstance(value, str):
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(value)
    return float(value)


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the pairs of an object as a dictionary. Raises `ValueError` for a repeated name, which is ambiguous."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a name is there twice")
    return found
