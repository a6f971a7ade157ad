"""Parser: words and rules call the builder node by node; errors become diagnostics, all of a file at once.

Invisible characters are errors: anywhere in a text, comments included, they could change a terminal's output or disguise the text.
"""

from __future__ import annotations

import re
import threading
from functools import cache
from typing import TYPE_CHECKING, Any

from ..errors import CompilationFailed, Diagnostic
from ..garbage_collection import uncollected
from ..source import Source, Span
from .errors import ForeignFile, StrangeCharacter, TooLarge
from .explain import explain, missing_brace
from .refused import Refused, Unreadable
from .tree import ExpressionSyntax, LawSyntax, SyntaxTree

if TYPE_CHECKING:
    from lark import Token

    from .grammar import Parser

MAXIMUM_SIZE = 8_000_000  # characters of one file
MAXIMUM_MISTAKES = 20  # syntax errors reported for one file

_parser_lock = threading.Lock()
MAXIMUM_LINES = 20  # with such characters, reported for one file
# Control characters, and those that turn the direction of writing (Boucher and Anderson, Trojan Source, 2021).
HIDDEN = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]")
HINT = "It cannot be seen, and may make the text look other than it is: remove it."


@cache
def _parser() -> Parser:
    from .grammar import Parser  # lark: who runs a model seen before parses nothing

    return Parser()


def parse(source: Source, part: str | None = None) -> SyntaxTree:
    """Parse one file. Raises `CompilationFailed` with all syntax errors that could be separated. `part`: its text with spaces for what is left out."""
    tree, mistakes = parse_what_can_be_read(source, part)
    if tree is None or mistakes:
        raise CompilationFailed(mistakes)
    return tree


def parse_what_can_be_read(source: Source, part: str | None = None) -> tuple[SyntaxTree | None, list[Diagnostic]]:
    """Return the tree without the lines that have errors, and the errors; no tree if the rest cannot be parsed either."""
    if len(source.text) > MAXIMUM_SIZE:
        return None, [TooLarge(Span(source, 0, 0), len(source.text), MAXIMUM_SIZE)]
    statements = None
    mistakes: list[Diagnostic] = []
    text, hidden = without_hidden(source)
    if part is not None and not hidden:
        text = part
    while True:
        try:
            statements = read_words(source, text)
        except (Refused, Unreadable) as problem:
            if isinstance(problem, Refused):
                mistake = problem.diagnostic(source)
            else:
                mistake = explain(source, problem)
            if isinstance(problem, Refused) and problem.is_limit:
                mistakes.append(mistake)
                break  # the rest would only cost time
            repeated = any(m.span.line == mistake.span.line for m in mistakes)
            if not repeated:
                mistakes.append(mistake)
            if isinstance(problem, Unreadable) and missing_brace(source, problem) is not None:
                break  # what is in the block, and what behind it, is not known
            text, changed = _blank_statement(text, source, mistake.span)
            if not changed or repeated or len(mistakes) >= MAXIMUM_MISTAKES or len(text) > 200_000:
                break
        else:
            break
    if mistakes and re.search(r"^\s*(components|netlist)\s*:", source.text, re.MULTILINE):
        return None, [ForeignFile(Span(source, 0, min(len(source.text), 1)))]
    return None if statements is None else SyntaxTree(source, statements), [*hidden, *mistakes]


def parse_expression(source: Source) -> ExpressionSyntax:
    """Parse a text that is one expression. Raises `CompilationFailed`."""
    return _parse_alone(source, "alone")  # type: ignore[no-any-return]


def parse_law(source: Source) -> LawSyntax:
    """Parse a text that is one law: equations with commas between. Raises `CompilationFailed`."""
    return _parse_alone(source, "alone_law")  # type: ignore[no-any-return]


def _parse_alone(source: Source, start: str) -> Any:
    try:
        return read_words(source, source.text, start)
    except Refused as refused:
        raise CompilationFailed([refused.diagnostic(source)]) from None
    except Unreadable as problem:
        raise CompilationFailed([explain(source, problem)]) from None


def read_words(source: Source, text: str, start: str = "start", words: list[Token] | None = None) -> Any:
    """Return the result of rule `start` for a text. `words` collects its words. Raises `Unreadable` and `Refused`."""
    with _parser_lock, uncollected():
        parser = _parser()
        parser.builder.source = source
        return parser.parse(text, start, words)


def _blank_statement(text: str, source: Source, span: Span) -> tuple[str, bool]:
    """Blank the line of an error, keeping its braces, so that the rest of the file can be parsed."""
    line = span.line
    start = source.line_starts[line - 1]
    end = source.line_starts[line] - 1 if line < len(source.line_starts) else len(text)
    old = text[start:end]
    if not old.strip():
        return text, False
    opening, closing = old.count("{"), old.count("}")
    kept = "{" * max(0, opening - closing) + "}" * max(0, closing - opening)
    if kept.startswith("{"):  # a block cannot be kept without its head
        return text, False
    return text[:start] + kept.ljust(len(old)) + text[end:], old.strip() != kept


def without_hidden(source: Source) -> tuple[str, list[Diagnostic]]:
    """Return the text with spaces in place of such characters, and a diagnostic for each line that has one."""
    found: dict[int, Diagnostic] = {}
    for match in HIDDEN.finditer(source.text):
        span = Span(source, match.start(), match.end())
        hint = "No text has it: is this a text in UTF-8?" if match[0] == "\0" else HINT
        found.setdefault(span.line, StrangeCharacter(span, f"U+{ord(match[0]):04X}", hint))
        if len(found) >= MAXIMUM_LINES:
            break
    return HIDDEN.sub(" ", source.text) if found else source.text, list(found.values())
