"""Nouns of a flat Modelica text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace


@dataclass(frozen=True, slots=True)
class Term:
    """A part of the text by the grammar's rule for it, `kind`: an expression, an equation, a declaration.

    `word`: its own word; of a call the function, of a sum or product the sign of each part, of a comparison its sign.
    """

    kind: str
    word: str = ""
    parts: tuple[Term, ...] = ()
    place: tuple[int, int] = field(default=(0, 0), compare=False)
    height: int = field(default=1, compare=False)

    def of(self, kind: str) -> Term | None:
        """Return the first part of a kind."""
        return next((p for p in self.parts if p.kind == kind), None)


@dataclass(frozen=True, slots=True)
class ComponentDeclaration:
    """A component. `kind`: Real, Integer or Boolean; `prefixes`: `parameter`, `input`, …"""

    name: str
    kind: str
    prefixes: frozenset[str]
    attributes: dict[str, Term]
    value: Term | None
    text: str
    place: tuple[int, int]

    @property
    def is_given(self) -> bool:
        """True for a parameter, a constant or an input."""
        return bool(self.prefixes & {"parameter", "constant", "input"})

    @property
    def is_fixed(self) -> bool:
        """True for a parameter or a constant."""
        return bool(self.prefixes & {"parameter", "constant"})


TRUE, FALSE, ZERO = Term("truth", "true"), Term("truth", "false"), Term("number", "0")


def named(name: str) -> Term:
    """Return a reference."""
    return Term("name", name)


def is_call(term: Term, *functions: str) -> bool:
    """Return True for a call of one of some functions."""
    return term.kind == "call" and term.word in functions


def walk(term: Term) -> Iterator[Term]:
    stack = [term]
    while stack:
        item = stack.pop()
        yield item
        stack.extend(reversed(item.parts))


def names_in(*terms: Term) -> set[str]:
    """Return the names that terms read."""
    return {t.word for term in terms for t in walk(term) if t.kind == "name"}


def rebuilt(term: Term, change: Callable[[Term], Term]) -> Term:
    """Return a term with changed parts; itself if none changes."""
    parts = tuple(map(change, term.parts))
    return term if all(a is b for a, b in zip(parts, term.parts, strict=True)) else replace(term, parts=parts)


def negated(term: Term) -> Term:
    """Return the truth that holds where another one fails."""
    return term.parts[0] if term.kind == "not" else Term("not", "", (term,))


def joined(kind: str, *terms: Term) -> Term:
    """Return several truths as one, by `and` or `or`."""
    return terms[0] if len(terms) == 1 else Term(kind, "", terms)
