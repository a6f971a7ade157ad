"""Invisible characters: anywhere in a text, comments included, they could change a terminal's output or disguise the text."""

from __future__ import annotations

import re

from ..errors import Diagnostic
from ..source import Source, Span
from .errors import StrangeCharacter

MAXIMUM_LINES = 20  # with such characters, reported for one file
# Control characters, and those that turn the direction of writing (Boucher and Anderson, Trojan Source, 2021).
HIDDEN = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]")
HINT = "It cannot be seen, and may make the text look other than it is: remove it."


def without_hidden(source: Source) -> tuple[str, list[Diagnostic]]:
    """Return the text with spaces in place of such characters, and a diagnostic for each line that has one."""
    found: dict[int, Diagnostic] = {}
    for match in HIDDEN.finditer(source.text):
        span = Span(source, match.start(), match.end())
        hint = "No text has it: is this a text in UTF-8?" if match[0] == "\0" else HINT
        found.setdefault(span.line, StrangeCharacter(span, f"U+{ord(match[0]):04X}", hint))
        if len(found) >= MAXIMUM_LINES:
            break
    return HIDDEN.sub(" ", source.text) if found else source.text, list(found.values())
