"""Expressions as text of the language, each in the dimension that its place needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from compiler.api import Dimension, number_text

from .functions import BARE, WRITTEN
from .tree import Term
from .units import ONE, Dimensions, is_alike

CHOICE, OR, AND, NOT, COMPARE, SUM, PRODUCT, POWER, ATOM = range(9)  # what binds ever closer


@dataclass(frozen=True, slots=True)
class ExpressionWriter:
    """Writer of terms. `names`: the words of the language for names."""

    names: Mapping[str, str]
    dimensions: Dimensions

    def text(self, term: Term, dimension: Dimension | None = None, level: int = CHOICE) -> str:
        """Return the text of a term, in a dimension (None: its own), in brackets where it binds less than `level`."""
        written, own_level = self._fitted(term, dimension)
        return f"({written})" if own_level < level else written

    def quantity(self, term: Term, dimension: Dimension) -> str:
        """Return the text of a value that tells its unit itself, zero too."""
        is_zero = term.kind == "number" and float(term.word) == 0
        return f"0{self._unit(dimension)}" if is_zero else self.text(term, dimension)

    def _unit(self, dimension: Dimension) -> str:
        return "" if self.dimensions.is_plain or dimension == ONE else f" [{dimension}]"

    def _fitted(self, term: Term, dimension: Dimension | None) -> tuple[str, int]:
        own = self.dimensions.dimension(term) or ONE
        if term.kind == "number" or is_alike(term):  # their parts take the unit
            return self._own(term, dimension or own)
        if dimension is None or own == dimension or self.dimensions.is_plain:
            return self._own(term, own)
        if term.kind == "product":  # its first number takes the unit
            for i, (sign, part) in enumerate(zip(term.word, term.parts, strict=True)):
                if sign == "*" and part.kind == "number":
                    return self._product(term, {i: dimension / own}), PRODUCT
        return f"1{self._unit(dimension / own)}*{self.text(term, None, PRODUCT)}", PRODUCT

    def _own(self, term: Term, dimension: Dimension) -> tuple[str, int]:
        """Text, in the term's own dimension, or that of its parts."""
        parts = term.parts
        if term.kind == "number":
            number, unit = number_text(float(term.word)), self._unit(dimension)
            if number == "0" or not unit:
                return number, ATOM if number.replace(".", "").isalnum() else PRODUCT
            return (f"({number})*1{unit}", PRODUCT) if "^" in number else (f"{number}{unit}", POWER)
        if term.kind == "sum":
            items = [f"{s} {self.text(p, dimension, PRODUCT)}" for s, p in zip(term.word, parts, strict=True)]
            return " ".join(items).removeprefix("+ ").replace("- ", "-", term.word[0] == "-"), SUM
        if term.kind == "choice":
            text, last = self.text(parts[-1], dimension, OR), ""
            for condition, value in zip(parts[-3::-2], parts[-2::-2], strict=True):
                last = f"({last})" if last else text
                last = f"{self.text(value, dimension, OR)} if {self.text(condition, None, OR)} else {last}"
            return last, CHOICE
        if term.kind == "product":
            return self._product(term, {}), PRODUCT
        if term.kind == "power":
            base = ONE if self.dimensions.dimension(term) == ONE else self.dimensions.dimension(parts[0])
            return f"{self.text(parts[0], base, ATOM)}^{self.text(parts[1], ONE, ATOM)}", POWER
        if term.kind == "compare":
            left, right = (self.text(p, self._common(parts), SUM) for p in parts)
            return f"{left} {'!=' if term.word == '<>' else term.word} {right}", COMPARE
        if term.kind in ("and", "or"):
            level = AND if term.kind == "and" else OR
            return f" {term.kind} ".join(self.text(p, None, level + 1) for p in parts), level
        if term.kind == "not":
            return f"not {self.text(parts[0], None, COMPARE)}", NOT
        if term.kind == "call":
            return f"{WRITTEN[term.word][0]}({', '.join(self._arguments(term, dimension))})", ATOM
        return self.names[term.word] if term.kind == "name" else term.word, ATOM

    def _product(self, term: Term, units: Mapping[int, Dimension]) -> str:
        text = self.text(term.parts[0], units.get(0), PRODUCT)
        for i, (sign, part) in enumerate(zip(term.word, term.parts, strict=True)):
            text += f"{sign}{self.text(part, units.get(i), POWER)}" if i else ""
        return text

    def _common(self, parts: tuple[Term, ...]) -> Dimension:
        return next(filter(None, map(self.dimensions.dimension, parts)), ONE)

    def _arguments(self, term: Term, dimension: Dimension) -> list[str]:
        if term.word == "delay":
            return [self.text(term.parts[0]), self.text(term.parts[1], self.dimensions.of["time"])]
        dimension = ONE if term.word in BARE else dimension if is_alike(term) else self._common(term.parts)
        return [self.text(p, dimension) for p in term.parts]
