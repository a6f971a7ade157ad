"""A word of a text: its text, its terminal, and its place."""

from __future__ import annotations


class Word(str):
    """A token. Its place is stored as offsets alone; lines are counted only for messages."""

    __slots__ = ("end_pos", "start_pos", "type", "value")
    type: str
    value: str
    start_pos: int
    end_pos: int


def word_of(kind: str, text: str, start: int, end: int) -> Word:
    """Word of a kind (a terminal of the grammar) with this text."""
    word = str.__new__(Word, text)
    word.type, word.value, word.start_pos, word.end_pos = kind, text, start, end
    return word
