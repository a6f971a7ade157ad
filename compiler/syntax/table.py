"""The grammar as a table of plain data: parser actions by state and word, and the shape of each rule's parts.

lark reads `grammar.lark` and makes the table (LALR(1), without conflicts). That takes longer than reading most models, so it is done once
for a grammar. Parsing with the table needs no lark.
"""

from __future__ import annotations

from sys import intern
from typing import Any

from ..fast_dataclass import dataclass

STARTS = ("start", "alone", "alone_law")
END = "$END"  # end of the text


@dataclass(frozen=True, slots=True)
class Rule:
    """`size` parts become one of `origin`. `name` is the builder's method; "" passes the parts on to the enclosing rule."""

    origin: str
    size: int
    name: str
    # place, whether it is a list to be opened, how many None before; None: all
    taken: tuple[tuple[int, bool, int], ...] | None
    after: int  # number of None after them
    single: bool  # a single part is passed on


@dataclass(frozen=True, slots=True)
class ParserTable:
    """`actions` of a state: for each terminal the next state, or ~rule; `follows`: the state after a rule's origin."""

    starts: dict[str, tuple[int, int]]  # the state in which each start begins, and that in which it is complete
    actions: tuple[dict[str, int], ...]
    follows: tuple[dict[str, int], ...]
    rules: tuple[Rule, ...]
    fixed: dict[str, tuple[str, ...]]  # words with a fixed text -> their terminals


def make_table(grammar: str) -> ParserTable:
    """Table of a grammar in lark's notation."""
    import lark
    from lark.lexer import PatternStr
    from lark.parsers.lalr_analysis import Shift

    parser: Any = lark.Lark(grammar, parser="lalr", start=list(STARTS), propagate_positions=False)
    made = parser.parser.parser._parse_table
    numbers = {rule: i for i, rule in enumerate(parser.rules)}
    rules = [_rule(rule) for rule in parser.rules]
    actions, follows = [], []
    for state in range(len(made.states)):
        doing: dict[str, int] = {}
        then: dict[str, int] = {}
        for word, (action, value) in made.states[state].items():
            name = intern(str(word))  # not lark's own kind of text
            if not name.isupper():
                then[name] = value
            elif action is Shift:
                doing[name] = value
            else:
                if value not in numbers:  # lark's own rules of repetitions
                    numbers[value] = len(rules)
                    rules.append(_rule(value))
                doing[name] = ~numbers[value]
        actions.append(doing)
        follows.append(then)
    fixed: dict[str, tuple[str, ...]] = {}
    for terminal in parser.terminals:
        if isinstance(terminal.pattern, PatternStr):
            text = terminal.pattern.value
            fixed[str(text)] = (*fixed.get(text, ()), intern(str(terminal.name)))
    starts = {name: (made.start_states[name], made.end_states[name]) for name in STARTS}
    return ParserTable(starts, tuple(actions), tuple(follows), tuple(rules), fixed)


def _rule(rule: Any) -> Rule:
    """lark's rule: words of fixed text are left out, parts with names in `_` are opened, missing optional parts become None."""
    options, expansion, origin = rule.options, rule.expansion, intern(str(rule.origin.name))
    missing = (
        "".join(str(int(empty)) for empty in options.empty_indices) if options.empty_indices else "0" * len(expansion)
    )
    empty = [len(ones) for ones in missing.split("0")]
    taken: list[tuple[int, bool, int]] = []
    before = 0
    for place, symbol in enumerate(expansion):
        before += empty[place]
        if options.keep_all_tokens or not (symbol.is_term and symbol.filter_out):
            taken.append((place, not symbol.is_term and symbol.name.startswith("_"), before))
            before = 0
    before += empty[len(expansion)]
    whole = not before and len(taken) == len(expansion) and not any(opened or nones for _, opened, nones in taken)
    name = rule.alias or ("" if origin.startswith("_") else origin)
    single = bool(options.expand1 and not rule.alias)
    return Rule(origin, len(expansion), intern(str(name)), None if whole else tuple(taken), before, single)
