"""A word of a text: what it says, of what kind it is, and where it stands."""

from __future__ import annotations


class Word(str):
    """It knows its place by offsets alone: lines are counted when a message needs them."""

    __slots__ = ("end_pos", "start_pos", "type", "value")
    type: str
    value: str
    start_pos: int
    end_pos: int


def word_of(kind: str, text: str, start: int, end: int) -> Word:
    """The word of a kind (a terminal of the grammar) that says `text`."""
    word = str.__new__(Word, text)
    word.type, word.value, word.start_pos, word.end_pos = kind, text, start, end
    return word
