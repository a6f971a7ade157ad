"""Expressions as MathML, typeset by browsers: fractions, roots and powers, names with their owners as subscripts."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from compiler.api import Apply, Expression, Number, Symbol

from .markup import Html, tag

SUM, PRODUCT, SIGN, POWER, ATOM = range(5)  # precedence of the written expression
GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ", "kappa": "κ",
    "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ", "phi": "φ", "chi": "χ", "psi": "ψ",
    "omega": "ω", "Gamma": "Γ", "Delta": "Δ", "Theta": "Θ", "Lambda": "Λ", "Sigma": "Σ", "Phi": "Φ", "Psi": "Ψ", "Omega": "Ω",
}  # fmt: skip
SIGNS = {"less": "<", "less_equal": "≤", "equal": "=", "and": "∧", "or": "∨"}
MOST = 40  # most operands of a sum or product, and most nested levels; the rest is shown as dots
THIN = tag("mspace", width="0.17em")
Written = tuple[Html, int]


def math(*inside: Html) -> Html:
    """Return a formula on a separate line."""
    return tag("math", line(*inside), display="block")


def line(*inside: Html) -> Html:
    """Return parts of a formula side by side, between which a line may end."""
    return tag("mrow", *inside, class_="row")


def row(*inside: Html) -> Html:
    """Return parts of a formula side by side."""
    return inside[0] if len(inside) == 1 else tag("mrow", *inside)


def sign(mark: str) -> Html:
    """Return an operator."""
    return tag("mo", mark)


def name(words: str) -> Html:
    """Return a name: the last part is the letter, the part before it the subscript. `mass.p` gives p with the subscript mass."""
    owner, _, letter = words.rpartition(".")
    if re.search(r"[ /]", words.replace(" at.", ".")) or not re.fullmatch(r"[^\W\d]\w*(\[[\d, ]+\])?", letter):
        return tag("mtext", words)
    stem, _, index = letter.partition("[")
    stem, under, rest = stem.partition("_")
    if not stem:
        stem, under, rest = letter, "", ""
    digits = re.fullmatch(r"([^\W\d]+)(\d+)", stem)
    if digits:
        stem, rest = digits[1], f"{digits[2]}{under}{rest}"
    below = ", ".join(p for p in (rest, index.rstrip("]"), owner) if p)
    shown = GREEK.get(stem, stem)
    symbol = tag("mi", shown) if len(shown) < 3 else tag("mtext", shown)
    return tag("msub", symbol, tag("mtext", below)) if below else symbol


def number(value: float) -> Html:
    """Return a number; one with an exponent as a power of ten."""
    digits, _, exponent = f"{value:.7g}".replace("inf", "∞").partition("e")
    if not exponent:
        return tag("mn", digits)
    power = tag("msup", tag("mn", "10"), tag("mn", str(int(exponent))))
    return power if digits == "1" else tag("mrow", tag("mn", digits), sign("·"), power)


def formula(expression: Expression, named: Callable[[object], Html]) -> Html:
    """Return an expression; `named` writes the name of a symbol."""
    return _write(expression, named, 0)[0]


def _write(x: Expression, named: Callable[[object], Html], depth: int) -> Written:
    if isinstance(x, Number):
        return number(x.value), SIGN if x.value < 0 else PRODUCT if "e" in f"{x.value:.7g}" else ATOM
    if isinstance(x, Symbol):
        return named(x.key), ATOM
    assert isinstance(x, Apply)
    if depth > MOST:
        return sign("…"), ATOM

    def at(operand: Expression, least: int = SUM) -> Html:
        written, strength = _write(operand, named, depth + 1)
        return written if strength >= least else _bracketed(written)

    operands = x.operands
    match x.operator:
        case "add":
            return line(*_terms(operands, at)), SUM
        case "multiply" | "divide" if (signed := _signed(x)) != (False, x):
            minus, positive = signed
            return (line(sign("−"), at(positive, PRODUCT)), SIGN) if minus else _write(positive, named, depth + 1)
        case "multiply":
            return _product(operands, at)
        case "divide":
            return tag("mfrac", at(operands[0]), at(operands[1])), ATOM
        case "power":
            return tag("msup", at(operands[0], ATOM), at(operands[1])), POWER
        case "sqrt":
            return tag("msqrt", at(operands[0])), ATOM
        case "root":
            return tag("mroot", at(operands[0]), at(operands[1])), ATOM
        case "abs":
            return tag("mrow", sign("|"), at(operands[0]), sign("|")), ATOM
        case "not":
            return tag("mrow", sign("¬"), at(operands[0], ATOM)), SIGN
        case "less" | "less_equal" | "equal" | "and" | "or":
            return row(at(operands[0], SIGN), sign(SIGNS[x.operator]), at(operands[1], SIGN)), SUM
        case "select":
            return _cases(at(operands[1]), at(operands[0]), at(operands[2])), ATOM
    function = tag("mi", {"log": "ln", "log10": "lg"}.get(x.operator, x.operator))
    return tag("mrow", function, _bracketed(row(*_listed(operands, at)))), ATOM


def _bracketed(inside: Html) -> Html:
    return tag("mrow", sign("("), inside, sign(")"))


def _listed(operands: Sequence[Expression], at: Callable[..., Html]) -> Iterator[Html]:
    for place, operand in enumerate(operands[:MOST]):
        if place:
            yield sign(",")
        yield at(operand)
    if len(operands) > MOST:
        yield sign("…")


def _signed(x: Expression) -> tuple[bool, Expression]:
    """Return True if a minus sign precedes an expression, and the rest: signs of factors are collected in front."""
    if isinstance(x, Number):
        return x.value < 0, Number(abs(x.value))
    if isinstance(x, Apply) and x.operator in ("multiply", "divide"):
        parts = [_signed(o) for o in x.operands]
        minus = sum(sign for sign, _ in parts) % 2 == 1
        rest = tuple(p for _, p in parts)
        if x.operator == "divide":
            return minus, Apply("divide", rest)
        factors = tuple(p for p in rest if p != Number(1.0)) or (Number(1.0),)
        return minus, factors[0] if len(factors) == 1 else Apply("multiply", factors)
    return False, x


def _terms(operands: Sequence[Expression], at: Callable[..., Html]) -> Iterator[Html]:
    """Yield the terms of a sum, positive ones first."""
    for place, (minus, term) in enumerate(sorted(map(_signed, operands[:MOST]), key=lambda part: part[0])):
        if minus or place:
            yield sign("−" if minus else "+")
        yield at(term, PRODUCT)
    if len(operands) > MOST:
        yield from (sign("+"), sign("…"))


def _product(operands: Sequence[Expression], at: Callable[..., Html]) -> Written:
    """Return a product; equal factors as a power."""
    parts: list[Html] = []
    factors = Counter(operands[:MOST])
    for factor, often in factors.items():
        if parts:
            parts.append(sign("·") if isinstance(factor, Number) else THIN)
        parts.append(at(factor, POWER) if often == 1 else tag("msup", at(factor, ATOM), tag("mn", str(often))))
    if len(operands) > MOST:
        parts.append(sign("…"))
    return (line(*parts), PRODUCT) if len(factors) > 1 else (parts[0], POWER)


def _cases(then: Html, condition: Html, otherwise: Html) -> Html:
    rows = (
        tag("mtr", tag("mtd", then), tag("mtd", tag("mtext", "if "), condition)),
        tag("mtr", tag("mtd", otherwise), tag("mtd", tag("mtext", "else"))),
    )
    return tag("mrow", sign("{"), tag("mtable", *rows, columnalign="left left"))
