"""Tables of a grammar, made by lark: its LALR(1) states and the patterns of its contextual lexer, as plain data. Nothing else imports lark."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from ..fast_dataclass import dataclass

STARTS = ["start", "alone", "alone_law"]
OPENING, CLOSING = frozenset({"LPAR", "LSQB", "NEST", "LBRACE"}), frozenset({"RPAR", "RSQB", "RBRACE"})
# Read in every state, so that `orange` is never `or` and `ange`, nor `==` two signs.
ALWAYS = "NAME", "NUMBER", "STRING", "COMPARE", "__ANON_0", "__ANON_1", "__ANON_2", *CLOSING, *OPENING - {"NEST"}


@dataclass(frozen=True, slots=True)
class ParserTable:
    """lark's parser as plain data.

    A rule has its name, the builder's method ("" if its parts become those of another rule), the number of its parts, which of them it keeps (None: all; else
    places, each with True for parts of such a rule and the number of absent parts before it), the number of absent parts at its end, and True if a single
    part takes its place.
    """

    states: dict[
        int, dict[str, int]
    ]  # by kind of word, or by rule: the next state, or ~ the number of the complete rule
    rules: list[tuple[Any, ...]]
    starts: dict[str, int]
    ends: dict[str, int]
    patterns: list[tuple[str, tuple[tuple[str, str], ...]]]  # regular expressions, each with keywords and their kinds
    contexts: dict[int, int]  # number of the pattern, by state
    everywhere: int  # number of the pattern of all words


def make_table(grammar: str) -> ParserTable:
    """Return the tables of a grammar in lark's notation."""
    import lark
    from lark.parsers.lalr_analysis import Shift

    words: Any = SimpleNamespace(always_accept=ALWAYS, process=None)
    parser: Any = lark.Lark(grammar, parser="lalr", start=STARTS, postlex=words)
    machine, lexers = parser.parser.parser.parser, parser.parser.lexer.lexer
    table = machine.parse_table
    numbers = {rule: number for number, rule in enumerate(machine.callbacks)}
    states = {
        state: {str(word): to if action is Shift else ~numbers[to] for word, (action, to) in row.items()}
        for state, row in table.states.items()
    }
    patterns: dict[Any, int] = {}
    contexts = {state: patterns.setdefault(_pattern(each), len(patterns)) for state, each in lexers.lexers.items()}
    everywhere = patterns.setdefault(_pattern(lexers.root_lexer), len(patterns))
    starts, ends = ({str(n): state for n, state in each.items()} for each in (table.start_states, table.end_states))
    return ParserTable(states, [*map(_rule, numbers)], starts, ends, [*patterns], contexts, everywhere)


def _pattern(lexer: Any) -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the pattern of all words that can be at a place; it reads keywords as names."""
    (pattern,) = lexer.scanner._mres
    kinds = {str(t.pattern.value): str(t.name) for t in lexer.terminals if t.pattern.type == "str"}
    return pattern.pattern, tuple(sorted((word, kind) for word, kind in kinds.items() if word.isidentifier()))


def _rule(rule: Any) -> tuple[Any, ...]:
    """Return a rule as in `ParserTable`."""
    from lark.parse_tree_builder import maybe_create_child_filter

    name, options = str(rule.origin.name), rule.options
    build = "" if name.startswith("_") else str(rule.alias or options.template_source or name)
    chosen = maybe_create_child_filter(rule.expansion, options.keep_all_tokens, False, options.empty_indices)
    places, absent = (None, 0) if chosen is None else (*chosen.args, 0)[:2]
    places = None if places is None else tuple((*row, 0)[:3] for row in places)
    return name, build, len(rule.expansion), places, absent, options.expand1 and not rule.alias
