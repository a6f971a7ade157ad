"""Grammar rules to nodes of the tree: one method per rule of the grammar, called while the text is parsed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache, partialmethod
from typing import Any

from lark import Token

from ..source import Source, Span
from . import tree
from .errors import NumberTooLarge, WrongUnit
from .operators import Operators, deepened
from .refused import Refused, place_of

MAXIMUM_UNIT_POWER = 20
ONE = Fraction(1)
_NUMBER = re.compile(r"([0-9]+)(?:\.([0-9]+))?(?:[eE]([+-]?[0-9]+))?")


def _text(token: Token | None) -> str | None:
    return None if token is None else str(token)[1:-1]


def _done(part: Any) -> Any:
    return part.finish() if isinstance(part, Operators) else part


@lru_cache(4096)  # a large model says the same few numbers again and again
def _number_of(text: str) -> Fraction | None:
    """Number of a text; None for one beyond the limits of computation."""
    match = _NUMBER.fullmatch(text)
    assert match is not None
    whole, part, exponent = match.group(1), match.group(2) or "", match.group(3) or "0"
    digits = (whole + part).lstrip("0")
    # Bounded before it is built: 1e999999999 must not become a number with a milliard digits.
    if not digits:
        return Fraction(0)
    if len(exponent) > 6 or len(digits) > 400 or abs(int(exponent) - len(part) + len(digits) - 1) > 300:
        return None
    scale = int(exponent) - len(part)
    return Fraction(int(digits) * 10**scale) if scale >= 0 else Fraction(int(digits), 10**-scale)


class Builder:
    """Builder of the nodes. The parser sets `source` before each file."""

    source: Source

    def _span(self, parts: Sequence[Any]) -> Span:
        first, last = parts[0], parts[-1]
        if first is None or last is None:
            known = [p for p in parts if p is not None]
            first, last = known[0], known[-1]
        start = place_of(first)[0] if isinstance(first, Token) else first.span.start
        return Span(self.source, start, place_of(last)[1] if isinstance(last, Token) else last.span.end)

    @staticmethod
    def _number(token: Token) -> Fraction:
        number = _number_of(token.value)
        if number is None:
            raise Refused.at(NumberTooLarge, token, number=token.value[:40])
        return number

    def _all(self, parts: list[Any]) -> tuple[Any, ...]:
        return tuple(parts)

    start = ports = attributes = places = mechanism_block = resets = transitions = transition = _all

    def block(self, parts: list[Any]) -> tuple[tree.SyntaxNode, ...]:
        """Statements; a mode with transitions is several."""
        return tuple(s for part in parts for s in (part if isinstance(part, tuple) else (part,)))

    def _node(self, kind: type[tree.SyntaxNode], parts: list[Any]) -> tree.SyntaxNode:
        """A node whose fields are the parts of its rule."""
        parts = [_done(part) for part in parts]
        return kind(self._span(parts), *(str(part) if isinstance(part, Token) else part for part in parts))

    equation = partialmethod(_node, tree.Equation)
    link = partialmethod(_node, tree.LinkSyntax)
    range = partialmethod(_node, tree.Range)
    setting = partialmethod(_node, tree.SettingSyntax)
    timing = partialmethod(_node, tree.TimingSyntax)
    reset = partialmethod(_node, tree.Reset)
    bandwidth = partialmethod(_node, tree.Bandwidth)
    stop = partialmethod(_node, tree.StopSyntax)

    # ------------------------------------------------------------ files and models
    def alone(self, parts: list[Any]) -> tree.ExpressionSyntax:
        return _done(parts[0])  # type: ignore[no-any-return]

    def alone_law(self, parts: list[Any]) -> tree.LawSyntax:
        return parts[0]  # type: ignore[no-any-return]

    def import_(self, parts: list[Any]) -> tree.Import:
        place = parts[-1]
        names = tuple((str(t), self._span([t])) for t in parts[:-1])
        is_file = place.type == "STRING"
        return tree.Import(self._span(parts), names, str(place)[1:-1] if is_file else str(place), is_file)

    def description(self, parts: list[Any]) -> tree.Description:
        return tree.Description(self._span(parts), str(parts[0])[1:-1])

    def parameter_set(self, parts: list[Any]) -> tree.ParameterSet:
        items = tuple(part for part in parts[1:] if isinstance(part, tree.Item))
        return tree.ParameterSet(self._span(parts[:1]), str(parts[0]), items)

    def model(self, parts: list[Any]) -> tree.ModelSyntax:
        plain = parts[0].type == "PLAIN"
        name = parts[-2]
        return tree.ModelSyntax(self._span(parts[:-1]), str(name), self._span([name]), plain, parts[-1])

    # ------------------------------------------------------------ statements
    def _quantities(self, role: str, parts: list[Any]) -> tree.Quantities:
        return tree.Quantities(self._span(parts), role, tuple(parts))

    parameters = partialmethod(_quantities, "parameter")
    constants = partialmethod(_quantities, "constant")
    inputs = partialmethod(_quantities, "input")
    outputs = partialmethod(_quantities, "output")
    signals = partialmethod(_quantities, "signal")

    def modes_(self, parts: list[Any]) -> tuple[tree.SyntaxNode, ...]:
        """Modes, and a `when` for each transition of the last one."""
        *items, transitions = parts
        start, name = items[-1].span.start, items[-1].name
        span = Span(self.source, start, start + len(name))
        path = tree.PathSyntax(span, 1, name, tuple(filter(None, [items[-1].index])))
        return tree.Quantities(self._span(items), "mode", tuple(items)), *(
            self._when(path, t) for t in transitions or ()
        )

    def _when(self, mode: tree.PathSyntax, parts: tuple[Any, ...]) -> tree.EventSyntax:
        *words, condition, resets = parts
        condition, span = _done(condition), self._span([words[0], _done(condition)])
        *before, after = (tree.PathSyntax(self._span([w]), 1, str(w), ()) for w in words)
        there = [tree.Comparison(word.span, 2, "==", mode, word) for word in before]
        one = there[0] if len(there) == 1 else deepened(tree.Logical, self._span(before), there, "or", tuple(there))
        whole = deepened(tree.Logical, span, (one, condition), "and", (one, condition))
        step = tree.Reset(after.span, mode, after)
        return tree.EventSyntax(span, whole, (*(resets or ()), step), False)

    def solve(self, parts: list[Any]) -> tree.Quantities:
        law, *items = parts
        return tree.Quantities(self._span(parts), "solve", tuple(items), law.equations)

    def item(self, parts: list[Any]) -> tree.Item:
        name, index, unit, value, description = parts
        value = _done(value)
        end = unit if isinstance(unit, tree.Unit) else name
        span = self._span([name, value or end])
        choices, unit = (unit, None) if isinstance(unit, tuple) else ((), unit)
        return tree.Item(span, str(name), _items(index), unit, value, _text(description), choices)

    def choices(self, parts: list[Any]) -> tuple[tuple[str, Span], ...]:
        return tuple((str(t), self._span([t])) for t in parts)

    def function(self, parts: list[Any]) -> tree.FunctionSyntax:
        body = _done(parts[-1])
        return tree.FunctionSyntax(self._span([parts[0], body]), str(parts[0]), tuple(map(str, parts[1:-1])), body)

    def port(self, parts: list[Any]) -> tree.PortsSyntax:
        return tree.PortsSyntax(self._span(parts), tuple(parts))

    def port_item(self, parts: list[Any]) -> tree.PortItem:
        name, index, components, domain, description = parts
        word, width = (None, None) if domain is None else (str(domain[0]), domain[1])
        span, listed = self._span([name]), components or ()
        return tree.PortItem(span, str(name), _items(index), listed, word, _text(description), width)

    def domain(self, parts: list[Any]) -> tuple[Token, tree.Index | None]:
        return parts[0], _items(parts[1])

    def declaration(self, parts: list[Any]) -> tree.Declaration:
        kind, *names, definition, attributes, description = parts
        definition = _done(definition)
        span = self._span([kind, definition if definition is not None else names[-1]])
        return tree.Declaration(span, str(kind), tuple(names), definition, attributes or (), _text(description))

    def declared(self, parts: list[Any]) -> tree.Declared:
        name, index, components = parts
        return tree.Declared(self._span([name]), str(name), _items(index), components or ())

    def index(self, parts: list[Any]) -> tuple[Any, ...]:
        items = tuple(_done(p) for p in parts if not isinstance(p, Token))
        return ("index", tree.Index(items), parts[-1].end_pos)

    def component(self, parts: list[Any]) -> tree.Component:
        name, (domain, width) = parts[0], parts[1] or (None, None)
        span = self._span([name, domain or name])
        return tree.Component(span, str(name), None if domain is None else str(domain), width)

    def law(self, parts: list[Any]) -> tree.LawSyntax:
        return tree.LawSyntax(self._span(parts), tuple(parts))

    def attribute(self, parts: list[Any]) -> tree.Attribute:
        value = _done(parts[-1])
        target = parts[1] if len(parts) == 3 else None
        return tree.Attribute(self._span([parts[0], value]), str(parts[0]), target, value)

    def bonds(self, parts: list[Any]) -> tree.Bonds:
        places, arrows = tuple(parts[0::2]), tuple(parts[1::2])
        return tree.Bonds(self._span([places[0][0], places[-1][-1]]), places, arrows)

    def nest(self, parts: list[Any]) -> tree.Nest:
        return tree.Nest(self._span(parts), str(parts[0])[0], tuple(parts[1:]))

    def arrow(self, parts: list[Any]) -> str:
        return str(parts[0])

    def path(self, parts: list[Any]) -> tree.PathSyntax:
        end = parts[0].end_pos
        steps: list[tree.Member | tree.Index] = []
        if len(parts) == 1:
            return tree.PathSyntax(Span(self.source, parts[0].start_pos, end), 1, parts[0].value, ())
        for _, step, position in parts[1:]:
            steps.append(step)
            end = position
        depth = max((i.depth for s in steps if isinstance(s, tree.Index) for i in s.items), default=0)
        return tree.PathSyntax(Span(self.source, parts[0].start_pos, end), depth + 1, parts[0].value, tuple(steps))

    def member(self, parts: list[Any]) -> tuple[Any, ...]:
        return ("member", tree.Member(str(parts[0])), parts[0].end_pos)

    def mechanism(self, parts: list[Any]) -> tree.MechanismSyntax:
        name, index, space, statements = parts
        space = None if space is None else str(space)
        return tree.MechanismSyntax(self._span([name]), str(name), _items(index), space, statements)

    def mechanism_loop(self, parts: list[Any]) -> tree.LoopSyntax:
        return tree.LoopSyntax(self._span(parts[:2]), str(parts[0]), parts[1], parts[2])

    loop = mechanism_loop

    def conditional(self, parts: list[Any]) -> tree.ConditionalSyntax:
        condition, (_, statements, otherwise) = _done(parts[0]), parts
        if isinstance(otherwise, tree.ConditionalSyntax):  # `else if`
            otherwise = (otherwise,)
        return tree.ConditionalSyntax(condition.span, condition, statements, otherwise or ())

    mechanism_conditional = conditional

    def event(self, parts: list[Any]) -> tree.EventSyntax:
        condition = _done(parts[0])
        return tree.EventSyntax(condition.span, condition, parts[1], False)

    def sampling(self, parts: list[Any]) -> tree.EventSyntax:
        period = _done(parts[0])
        return tree.EventSyntax(period.span, period, parts[-1], True, tuple(parts[1:-1]))

    def requirement(self, parts: list[Any]) -> tree.RequirementSyntax:
        condition = _done(parts[0])
        return tree.RequirementSyntax(condition.span, condition, _text(parts[1]) or "")

    # ------------------------------------------------------------ experiments
    def experiment(self, parts: list[Any]) -> tree.Experiment:
        return tree.Experiment(self._span(parts[:1]), str(parts[0]), tuple(parts[1:]))

    def _set(self, role: str, parts: list[Any]) -> tree.Set:
        value = _done(parts[1])
        return tree.Set(self._span([parts[0], value]), role, parts[0], value)

    set = partialmethod(_set, "set")
    start_value = partialmethod(_set, "start")

    def sweep(self, parts: list[Any]) -> tree.SweepSyntax:
        # commas: lark shares the list's rule
        path, unit, *values = (_done(p) for p in parts if not isinstance(p, Token))
        return tree.SweepSyntax(self._span([path, values[-1]]), path, unit, tuple(values))

    def simulate(self, parts: list[Any]) -> tree.Simulate:
        return tree.Simulate(self._span(parts[:1]), parts[0], parts[1] or ())

    def listed(self, parts: list[Any]) -> tuple[tree.GivenSyntax, ...]:
        return tuple(p for p in parts if not isinstance(p, Token))  # commas: lark shares the list's rule

    one = drives = wishes = chances = unknowns = listed

    def named(self, parts: list[Any]) -> tree.GivenSyntax:
        return tree.GivenSyntax(parts[0].span, parts[0])

    def drive(self, parts: list[Any]) -> tree.GivenSyntax:
        paths = [p for p in parts if isinstance(p, tree.PathSyntax)]
        return tree.GivenSyntax(self._span(paths), paths[0], paths[1] if len(paths) > 1 else None)

    def wish(self, parts: list[Any]) -> tree.GivenSyntax:
        value = _done(parts[1])
        return tree.GivenSyntax(self._span([parts[0], value]), parts[0], value=value)

    def correlation(self, parts: list[Any]) -> tree.GivenSyntax:
        word, first, second, value = (p for p in parts if not isinstance(p, Token) or p.type == "NAME")
        value = _done(value)
        return tree.GivenSyntax(self._span([word, value]), first, second, value, word=str(word))

    def sought(self, parts: list[Any]) -> tree.GivenSyntax:
        return tree.GivenSyntax(self._span(parts), parts[0], range=parts[1])

    def analysis(self, parts: list[Any]) -> tree.Analysis:
        """Any row of `steps.py`: the word, then names, files, a range and attributes."""
        word, *rest = parts
        lists = [p for p in rest if isinstance(p, tuple) and p]
        given, wanted, *_ = (*(p for p in lists if isinstance(p[0], tree.GivenSyntax)), (), ())
        attributes = next((p for p in lists if isinstance(p[0], tree.Attribute)), ())
        files = tuple(p for p in rest if isinstance(p, tree.TextSyntax))
        over = next((p for p in rest if isinstance(p, tree.Range)), None)
        known = [*given, *wanted, *files, *([over] if over is not None else [])] or [word]
        return tree.Analysis(self._span([known[0], known[-1]]), str(word), given, wanted, files, over, attributes)

    def report(self, parts: list[Any]) -> tree.Report:
        return tree.Report(self._span(parts), tuple(parts))

    def reading(self, parts: list[Any]) -> tree.ReadingSyntax:
        value = _done(parts[0])
        return tree.ReadingSyntax(self._span([value]), value, parts[1])

    # ------------------------------------------------------------ expressions
    def joined(self, parts: list[Any]) -> Operators:
        left, operator, right = parts
        if type(left) is not Operators:
            left = Operators([left])
        left.append(operator, right)
        return left

    def prefixed(self, parts: list[Any]) -> Operators:
        operator, operand = parts
        if type(operand) is not Operators:
            operand = Operators([operand])
        operand.prepend(operator)
        return operand

    def bracket(self, parts: list[Any]) -> Any:
        # A bracket ends a chain: a - (b - c) stays what it is.
        return replace(_done(parts[1]), span=self._span(parts))

    def call(self, parts: list[Any]) -> tree.Call:
        arguments = tuple(_done(p) for p in parts[1:] if p is not None and not isinstance(p, Token))
        return deepened(tree.Call, self._span(parts), arguments, str(parts[0]), arguments)  # type: ignore[no-any-return]

    def text(self, parts: list[Any]) -> tree.TextSyntax:
        return tree.TextSyntax(self._span(parts), 1, str(parts[0])[1:-1])

    def vector(self, parts: list[Any]) -> tree.VectorSyntax:
        items = tuple(_done(p) for p in parts if not isinstance(p, Token))
        return deepened(tree.VectorSyntax, self._span(parts), items, items)  # type: ignore[no-any-return]

    def quantity(self, parts: list[Any]) -> tree.Literal:
        unit = parts[len(parts) // 2] if len(parts) > 1 else None  # number; number, name; number, `[`, unit, `]`
        if isinstance(unit, Token):
            span = self._span([unit])
            unit = tree.Unit(span, ((_latin(unit), ONE, span),), ONE)
        return tree.Literal(self._span(parts), 1, self._number(parts[0]), unit)

    # ------------------------------------------------------------ units
    def unit(self, parts: list[Any]) -> tree.Unit:
        if len(parts) == 1 and parts[0].number is ONE:
            return parts[0]  # type: ignore[no-any-return]
        factors: list[tuple[str, Fraction, Span]] = []
        number = ONE
        sign = 1
        for part in parts:
            if isinstance(part, Token):
                sign = 1 if part == "*" else -1
                continue
            factors += part.factors if sign > 0 else [(name, -power, span) for name, power, span in part.factors]
            if part.number is not ONE:
                number *= part.number**sign
        span = Span(self.source, parts[0].span.start, parts[-1].span.end)
        return self._bounded(span, factors, number)

    def _bounded(self, span: Span, factors: Sequence[tuple[str, Fraction, Span]], number: Fraction) -> tree.Unit:
        """A unit within limits, which are checked before a power is formed from it."""
        powers: dict[str, Fraction] = {}
        for name, power, _ in factors:
            powers[name] = powers[name] + power if name in powers else power
        if any(not -MAXIMUM_UNIT_POWER <= p <= MAXIMUM_UNIT_POWER for p in powers.values()):
            raise Refused(WrongUnit, span.start, span.end, what="The exponent of a unit lies between -20 and 20")
        if (number is not ONE and not Fraction(1, 10**40) < number < 10**40) or len(factors) > 100:
            raise Refused(
                WrongUnit, span.start, span.end, what="A unit has at most 100 factors, and numbers up to 1e40 in it"
            )
        return tree.Unit(span, tuple(factors), number)

    def unit_power(self, parts: list[Any]) -> tree.Unit:
        power, last = parts[-1] if isinstance(parts[-1], tuple) else (ONE, parts[-1])
        span = self._span([parts[0], last])
        if parts[0] != "(":
            return tree.Unit(span, ((_latin(parts[0]), power, self._span(parts[:1])),), ONE)
        base = parts[1]
        factors = [(name, p * power, place) for name, p, place in base.factors]
        if power.denominator != 1 and base.number != 1:
            raise Refused(WrongUnit, span.start, span.end, what="A number in a unit has no root")
        return self._bounded(span, factors, Fraction(base.number ** int(power)))

    def unit_number(self, parts: list[Any]) -> tree.Unit:
        number = self._number(parts[0])
        if number == 0:
            raise Refused.at(WrongUnit, parts[0], what="A unit cannot contain 0")
        return tree.Unit(self._span(parts), (), number)

    def exponent(self, parts: list[Any]) -> tuple[Fraction, Token]:
        """Read the exponent of a unit; its last token is returned too."""
        sign = -1 if any(p == "-" for p in parts) else 1
        numbers = [self._number(p) for p in parts if p.type == "NUMBER"]
        bottom = numbers[1] if len(numbers) > 1 else ONE
        if bottom == 0 or abs(numbers[0]) > 20 or bottom > 20:
            raise Refused(
                WrongUnit, parts[0].start_pos, parts[-1].end_pos, what="The exponent of a unit lies between -20 and 20"
            )
        return (-numbers[0] if sign < 0 else numbers[0]) if bottom is ONE else sign * numbers[0] / bottom, parts[-1]


_GREEK = str.maketrans({"\u00b5": "u", "\u03bc": "u", "\u03a9": "ohm", "\u2126": "ohm"})


def _latin(symbol: Token) -> str:
    """Symbol of a unit without Greek letters."""
    text = str(symbol)
    return text if text.isascii() else text.translate(_GREEK)


def _items(index: tuple[Any, ...] | None) -> tree.Index | None:
    return None if index is None else index[1]
