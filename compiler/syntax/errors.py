"""Errors in the text before any name is looked up: BG0xx."""

from __future__ import annotations

from ..errors import Diagnostic


class Unexpected(Diagnostic):
    """BG001: the text does not follow the grammar."""

    code = "BG001"
    title = "{found} is not expected here"
    advice = "{hint}"
    found: str
    hint: str


class StrangeCharacter(Diagnostic):
    """BG002: a character that the language does not use."""

    code = "BG002"
    title = "The language has no use for the character {character}"
    advice = "{hint}"
    character: str
    hint: str


class NumberTooLarge(Diagnostic):
    """BG003: a literal beyond the limits, which keep a margin to those of double precision."""

    code = "BG003"
    title = "The number {number} is beyond the limits of the language, 1e-300 to 1e300 in magnitude"
    advice = "Check its exponent and its unit; the limits hold for the value in SI units, too."
    number: str


class TooDeep(Diagnostic):
    """BG004: nesting beyond the limit."""

    code = "BG004"
    title = "This is nested more than {limit} deep"
    advice = "Name a part of it with `signal` or `constant` and use the name."
    limit: int


class TooLarge(Diagnostic):
    """BG005: a file beyond the limit."""

    code = "BG005"
    title = "The file has {size} characters; the limit is {limit}"
    advice = "Use `for` and models for what repeats, or split the file and import its parts."
    size: int
    limit: int


class Unclosed(Diagnostic):
    """BG007: a bracket without its partner."""

    code = "BG007"
    title = "This `{bracket}` is never closed"
    advice = "Close it with `{partner}`; what follows was read as part of it."
    bracket: str
    partner: str


class WrongUnit(Diagnostic):
    """BG008: an impossible unit."""

    code = "BG008"
    title = "{what}"
    advice = "Check the powers and numbers in the brackets; physical units need neither."
    what: str


class ForeignFile(Diagnostic):
    """BG006: a BondGraphTools file, which uses the same ending."""

    code = "BG006"
    title = "This is a BondGraphTools model (YAML), not the language of this compiler"
    advice = "Both use the ending .bg. Write the elements as declarations (`C c : e = q/C`) and the bonds as arrows (`a -> b`)."


class NotUtf8(Diagnostic):
    """BG009: bytes that are not valid UTF-8."""

    code = "BG009"
    title = "The file is not a text in UTF-8: {what}"
    advice = "{hint}"
    what: str
    hint: str
