"""Errors of graphs that cannot be written as text: BG7xx."""

from __future__ import annotations

from ..errors import Diagnostic


class UnwrittenUnit(Diagnostic):
    code = "BG701"
    title = "`{name}` cannot be written as text: the language has no unit for {unit}"
    advice = "Use exponents up to 20, and fractions with denominators up to 20; or divide by a constant so that it has no unit."
    name: str
    unit: str


class UnwrittenSize(Diagnostic):
    code = "BG702"
    title = "`{name}` cannot be written as text: its expression has {what}"
    advice = "Give its parts names of their own, as signals or constants."
    name: str
    what: str


class UnwrittenFile(Diagnostic):
    code = "BG706"
    title = "`{name}` cannot be written as text: it is an imported unit ({file})"
    advice = "A flat text has no instances, and so no unit either: print the model without it."
    name: str
    file: str


class UnwrittenDomain(Diagnostic):
    code = "BG703"
    title = "The bond from `{tail}` to `{name}` cannot be written as text: nothing tells its domain"
    advice = "Put a junction between them; a junction says its domain."
    name: str
    tail: str


class UnwrittenNumber(Diagnostic):
    code = "BG704"
    title = "`{name}` cannot be written as text: it contains the number {number}"
    advice = "Keep numbers finite."
    name: str
    number: float


class UnwrittenPort(Diagnostic):
    code = "BG705"
    title = "`{name}` cannot be written as text: in a flat text nothing shows `{words}`, which it reads"
    advice = "Put an element or a junction that has this variable at the end of the bond."
    name: str
    words: str
