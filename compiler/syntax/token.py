"""Words of a text."""

from __future__ import annotations

END = "$END"  # kind of the word at the end of a text


class Token(str):
    """A word with its kind, which is the name of a terminal of the grammar, and its offsets."""

    __slots__ = ("end_pos", "start_pos", "type", "value")
    type: str
    value: str  # the same as a plain text
    start_pos: int
    end_pos: int

    def __new__(cls, kind: str, text: str, start: int, end: int) -> Token:
        token = str.__new__(cls, text)
        token.type, token.value, token.start_pos, token.end_pos = kind, text, start, end
        return token
