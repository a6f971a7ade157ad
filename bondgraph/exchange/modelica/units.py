"""Dimensions of quantities: those that the file declares, and others as far as equations tell them.

Numbers of Modelica have no units, and its equations are between numbers in SI. So where a file leaves a dimension open, whatever is chosen is right
as long as each place that mixes dimensions is written with a factor `1 [unit]`; equations only help to choose what needs few of them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from fractions import Fraction

from compiler.api import CompilationFailed, Dimension, Source, read_unit

from .functions import ALIKE, BARE
from .tree import ComponentDeclaration, Term, is_call, names_in, walk

ONE, SECOND = (Dimension(tuple(Fraction(int(i == base)) for i in range(7))) for base in (-1, 2))
ROUNDS = 30  # through all equations
LARGEST = 4  # exponent of a unit that is taken
LONGEST_UNIT = 100  # characters


def declared_dimension(item: ComponentDeclaration) -> Dimension | None:
    """Return the dimension that a declaration names, None if it names none; a number in a unit that is not coherent in SI stays a bare number."""
    unit = item.attributes.get("unit")
    if item.kind == "Real" and (unit is None or unit.kind != "text" or unit.word == '""'):
        return None
    return ONE if item.kind != "Real" or unit is None else unit_dimension(unit.word[1:-1]) or ONE


def unit_dimension(text: str) -> Dimension | None:
    """Return the dimension of a unit as Modelica writes it, `kg.m2/(s3.A)`; None for one that is not coherent in SI."""
    words = re.sub(r"\bHz\b", "1/s", re.sub(r"\bOhm\b", "ohm", text)).replace(".", "*")
    words = re.sub(r"(?<=[A-Za-z])\+?(-?\d+)", r"^\1", words)
    try:
        scale = read_unit(Source("unit", words[:LONGEST_UNIT]))
    except CompilationFailed:
        return None
    is_coherent = scale.number == 1 and scale.pi_power == 0 and scale.offset == 0
    return scale.dimension if is_coherent and all(abs(e) <= 20 for e in scale.dimension.exponents) else None


class Dimensions:
    """Dimension of each name, and of terms."""

    def __init__(self, is_plain: bool) -> None:
        self.of: dict[str, Dimension] = {"time": ONE if is_plain else SECOND}
        self.is_plain = is_plain

    def dimension(self, term: Term) -> Dimension | None:
        """Return the dimension of a term; None for a number, and for what is not known yet."""
        if term.kind == "name":
            return self.of.get(term.word)
        if is_alike(term):
            return next(filter(None, map(self.dimension, alike_parts(term))), None)
        if term.kind == "product":
            own = [self.dimension(p) for p in term.parts]
            if not any(own) or any(map(self.is_open, term.parts)):
                return None
            result = ONE
            for sign, dimension in zip(term.word, own, strict=True):
                result = result / (dimension or ONE) if sign == "/" else result * (dimension or ONE)
            return result
        if term.kind == "power":
            base, exponent = self.dimension(term.parts[0]), constant(term.parts[1])
            return ONE if base is None or exponent is None else base**exponent
        if term.kind == "call" and term.word in ("sqrt", "delay"):
            base = self.dimension(term.parts[0])
            return base and base ** Fraction(1, 2 if term.word == "sqrt" else 1)
        return None if term.kind == "number" else ONE

    def is_open(self, term: Term) -> bool:
        """Return True if a name that has no dimension yet decides that of a term."""
        if term.kind == "name":
            return term.word not in self.of
        parts = alike_parts(term) if is_alike(term) else term.parts[: 1 if term.kind in ("power", "call") else None]
        decides = is_alike(term) or term.kind in ("product", "power") or is_call(term, "sqrt", "delay")
        return decides and any(map(self.is_open, parts))

    def infer(self, equations: Sequence[tuple[Term, Term]]) -> None:
        """Find dimensions of names by equations between terms that have one dimension."""
        for turn in range(ROUNDS):
            before = len(self.of)
            for sides in equations[:: 1 - turn % 2 * 2]:
                if names_in(*sides) - self.of.keys():
                    self._suggest(sides[0], self.dimension(sides[1]))
                    self._suggest(sides[1], self.dimension(sides[0]))
                    for part in (t for side in sides for t in walk(side)):
                        if part.kind == "compare":
                            self._suggest(part.parts[0], self.dimension(part.parts[1]))
                            self._suggest(part.parts[1], self.dimension(part.parts[0]))
                        elif is_alike(part):
                            self._suggest(part, self.dimension(part))
                        elif part.kind == "call" and part.word in BARE:
                            self._suggest(part.parts[0], ONE)
            if len(self.of) == before:
                return

    def _suggest(self, term: Term, dimension: Dimension | None) -> None:
        """Take a dimension for what is open in a term."""
        if dimension is None or not self.is_open(term):
            return
        if term.kind == "name" and all(abs(e) <= LARGEST and e.denominator <= 2 for e in dimension.exponents):
            self.set(term.word, dimension)
        elif is_alike(term):
            for part in alike_parts(term):
                self._suggest(part, dimension)
        elif term.kind == "product":
            left = [p for p in term.parts if self.is_open(p)]
            if len(left) == 1:
                for sign, part in zip(term.word, term.parts, strict=True):
                    own = self.dimension(part) or ONE
                    dimension = dimension / own if sign == "*" else dimension * own
                self._suggest(left[0], ONE / dimension if term.word[term.parts.index(left[0])] == "/" else dimension)
        elif term.kind == "power":
            exponent = constant(term.parts[1])
            self._suggest(term.parts[0], dimension ** (1 / exponent) if exponent else ONE)

    def set(self, name: str, dimension: Dimension) -> None:
        """Set the dimension of a name that has none, and that of its derivative or integral."""
        self.of.setdefault(name, dimension)
        if name.startswith("der("):
            self.of.setdefault(name[4:-1], dimension * self.of["time"])
        else:
            self.of.setdefault(f"der({name})", dimension / self.of["time"])


def is_alike(term: Term) -> bool:
    """Return True for a term whose values have its dimension."""
    return term.kind in ("sum", "choice") or (term.kind == "call" and term.word in ALIKE)


def alike_parts(term: Term) -> tuple[Term, ...]:
    """Return these values."""
    return (*term.parts[1:-1:2], term.parts[-1]) if term.kind == "choice" else term.parts


def constant(term: Term) -> Fraction | None:
    """Return the number that an exponent is, if it is one that a unit can have."""
    if term.kind == "sum" and len(term.parts) == 1:
        inner = constant(term.parts[0])
        return -inner if inner is not None and term.word == "-" else inner
    if term.kind != "number" or not re.fullmatch(r"\d{1,2}(\.\d{0,3})?", term.word):
        return None
    value = Fraction(term.word.rstrip("."))
    return value if value <= 20 and value.denominator <= 20 else None
