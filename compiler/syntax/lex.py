"""Lexer: one regular expression for all words; the parser's state decides if a word has two meanings.

`_NEXT` must match the shapes of the grammar's terminals. Words with a fixed text are read from the grammar.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from .errors import StrangeCharacter
from .refused import Refused

NEXT = re.compile(
    r"""((?>(?:[ \t\r\n]|\#[^\n]*)*))                      # what stands between words
    (?: ([A-Za-z_][A-Za-z_0-9]*)
      | ([0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)
      | ("[^"\n]*")
      | (->|=>|\.\.|[<>=!]=|[-+*/^=<>,;:.{}])
      | ([()\[\]]) )?""",
    re.VERBOSE,
)
NAMED, NUMBER, STRING, SIGN, BRACKET = 2, 3, 4, 5, 6
# Control characters, and those that turn the direction of writing: in a text they would rewrite the terminal or the reader's eye.
_HIDDEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]")
_GOES_ON = re.compile(r"[-+*/^,=)\]<>:!]|(?:if|else|and|or)\b")  # beginning of a line that continues the one above
_JUNCTION = re.compile(r"[01](?=[ \t]+[A-Za-z_])")
_NEST = re.compile(r"[01]\(")


class Accepted:
    """Terminals that the parser accepts in one of its states. `words` gives the terminal of a word with a fixed text."""

    __slots__ = ("all", "ends", "names", "numbers", "words")

    def __init__(self, actions: Mapping[str, int], fixed: Mapping[str, tuple[str, ...]]) -> None:
        self.all = frozenset(actions)
        self.words = {text: name for text, names in fixed.items() for name in names if name in actions}
        self.names, self.numbers, self.ends = "NAME" in actions, "NUMBER" in actions, "_NL" in actions


def signs_of(fixed: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Words with a fixed text, including the alternatives of terminals."""
    comparing = dict.fromkeys(("<=", ">=", "==", "!=", "<", ">"), ("COMPARE",))
    return {
        **fixed,
        **comparing,
        "-": ("MINUS", "EXPONENT_SIGN"),
        "*": ("STAR", "UNIT_SIGN"),
        "/": ("SLASH", "UNIT_SIGN"),
    }


def goes_on(text: str, end: int) -> bool:
    """Return True if the text here continues the line above."""
    return _GOES_ON.match(text, end) is not None


def refuse_hidden(text: str, start: int, end: int) -> None:
    """Raise `Refused` if a text has an invisible character."""
    found = _HIDDEN.search(text, start, end)
    if found:
        hint = "Texts are made of letters, digits, marks and spaces: what cannot be seen has no place in them."
        raise Refused(StrangeCharacter, found.start(), found.end(), character=f"U+{ord(found[0]):04X}", hint=hint)


def junction(text: str, start: int, end: int, here: Accepted) -> tuple[str, int]:
    """Return the terminal and the end of a digit: 0 and 1 are junctions if the parser's state expects one, else a number."""
    if "NEST" in here.all and _NEST.match(text, start):
        return "NEST", start + 2
    if "JUNCTION" in here.all and _JUNCTION.match(text, start):
        return "JUNCTION", start + 1
    return "NUMBER", end
