"""Text to tree: lark's LALR parser calls the builder node by node; mistakes become diagnostics, all of a file at once."""

from __future__ import annotations

import gc
import re
import threading
from collections.abc import Iterator
from functools import cache
from pathlib import Path as FilePath
from typing import Any

import lark

from ..errors import CompilationFailed, Diagnostic
from ..source import Source, Span
from .build import Builder, Refused
from .errors import ForeignFile, StrangeCharacter, TooDeep, TooLarge, Unexpected
from .tree import Expression, SyntaxTree

MAXIMUM_SIZE = 8_000_000  # characters of one file
MAXIMUM_NESTING = 100  # brackets within brackets
MAXIMUM_MISTAKES = 20  # syntax mistakes told of one file

_parser_lock = threading.Lock()


class _Brackets:
    """Drops line breaks inside ( ) and [ ], where no statement can end, and limits nesting."""

    always_accept = ()

    def process(self, stream: Iterator[lark.Token]) -> Iterator[lark.Token]:
        round_depth = depth = 0
        for token in stream:
            kind = token.type
            if kind == "_NL":
                if round_depth:
                    continue
            elif kind in ("LPAR", "NEST", "LSQB"):
                round_depth += 1
            elif kind in ("RPAR", "RSQB"):
                round_depth = max(0, round_depth - 1)
            elif kind == "LBRACE":
                depth += 1
            elif kind == "RBRACE":
                depth -= 1
            if depth + round_depth > MAXIMUM_NESTING:
                raise Refused(TooDeep, token.start_pos or 0, token.end_pos or 0, limit=MAXIMUM_NESTING)
            yield token


@cache
def _parser() -> tuple[lark.Lark, Builder]:
    builder = Builder()
    grammar = FilePath(__file__).with_name("grammar.lark").read_text(encoding="utf-8")
    # The builder is called while lark parses: no intermediate tree is made (half the time of a large file).
    parser = lark.Lark(
        grammar,
        parser="lalr",
        start=["start", "alone"],
        transformer=builder,
        postlex=_Brackets(),
        propagate_positions=False,
    )
    return parser, builder


def parse(source: Source) -> SyntaxTree:
    """Parse one file. Raises `CompilationFailed` with every syntax mistake that could be told apart."""
    if len(source.text) > MAXIMUM_SIZE:
        raise CompilationFailed([TooLarge(Span(source, 0, 0), len(source.text), MAXIMUM_SIZE)])
    mistakes: list[Diagnostic] = []
    text = source.text
    while True:
        try:
            statements = _parse_text(source, text)
        except Refused as refused:
            mistakes.append(refused.diagnostic(source))
            break  # a limit: what follows could only cost time
        except lark.UnexpectedInput as problem:
            mistake = _explain(source, problem)
            repeated = any(m.span.line == mistake.span.line for m in mistakes)
            if not repeated:
                mistakes.append(mistake)
            text, changed = _blank_statement(text, source, mistake.span)
            if not changed or repeated or len(mistakes) >= MAXIMUM_MISTAKES or len(text) > 200_000:
                break
        else:
            break
    if mistakes:
        if re.search(r"^\s*(components|netlist)\s*:", source.text, re.MULTILINE):
            mistakes = [ForeignFile(Span(source, 0, min(len(source.text), 1)))]
        raise CompilationFailed(mistakes)
    return SyntaxTree(source, statements)


def parse_expression(source: Source) -> Expression:
    """Parse a text that is one expression. Raises `CompilationFailed`."""
    try:
        return _parse_text(source, source.text, "alone")  # type: ignore[no-any-return]
    except Refused as refused:
        raise CompilationFailed([refused.diagnostic(source)]) from None
    except lark.UnexpectedInput as problem:
        raise CompilationFailed([_explain(source, problem)]) from None


def _parse_text(source: Source, text: str, start: str = "start") -> Any:
    with _parser_lock:
        parser, builder = _parser()
        builder.source = source
        collecting = gc.isenabled()
        gc.disable()  # a tree has no cycles: collecting while it grows costs time that is not linear
        try:
            result = parser.parse(text, start=start)
        except lark.exceptions.VisitError as error:
            if isinstance(error.orig_exc, Refused):
                raise error.orig_exc from None
            raise
        finally:
            if collecting:
                gc.enable()
    return result


def _explain(source: Source, problem: lark.UnexpectedInput) -> Diagnostic:
    start = (
        problem.pos_in_stream if problem.pos_in_stream is not None and problem.pos_in_stream >= 0 else len(source.text)
    )
    if isinstance(problem, lark.UnexpectedCharacters):
        character = source.text[start] if start < len(source.text) else ""
        span = Span(source, start, start + 1)
        hints = {
            '"': "A text ends on the line where it begins: close it with a second quotation mark.",
            "=": "An equation has one `=`; a comparison is `==`.",
            "'": 'Texts stand between double quotation marks: "like this".',
            "!": "`!=` compares; a negation is the word `not`.",
        }
        if character in hints or character.isalnum() or character in "()[]{},;:.+-*/^<>_":
            return Unexpected(span, f"`{character}`", hints.get(character, _hint(problem, source)))
        shown = f"U+{ord(character):04X}" if not character.isprintable() else f"`{character}`"
        advice = (
            "Powers are written with `^`."
            if character in "²³"
            else "Names are made of the letters a to z, A to Z, digits and `_`."
        )
        return StrangeCharacter(span, shown, advice)
    token = getattr(problem, "token", None)
    if token is None or token.type == "$END":
        end = len(source.text.rstrip())
        return Unexpected(
            Span(source, max(0, end - 1), max(1, end)), "The end of the file", "A `{`, `(` or `[` is still open."
        )
    start = token.start_pos if token.start_pos is not None else start
    text = "The end of the line" if token.type == "_NL" else f"`{str(token).strip()}`"
    end = start + 1 if token.type == "_NL" else start + len(token)
    return Unexpected(Span(source, start, end), text, _hint(problem, source))


_WORDS = {
    "NAME": "a name", "NUMBER": "a number", "STRING": 'a text in ""', "_NL": "the end of the line", "RBRACE": "`}`", "LBRACE": "`{`",
    "RPAR": "`)`", "LPAR": "`(`", "RSQB": "`]`", "LSQB": "`[`", "COLON": "`:`", "EQUAL": "`=`", "COMMA": "`,`", "SEMICOLON": "`;`",
    "DOT": "`.`", "JUNCTION": "`0`", "NEST": "`0(`", "__ANON_0": "`->`", "__ANON_1": "`=>`", "__ANON_2": "`..`", "COMPARE": "`<`",
}  # fmt: skip


def _hint(problem: lark.UnexpectedInput, source: Source) -> str:
    expected = set(
        getattr(problem, "accepts", None)
        or getattr(problem, "expected", None)
        or getattr(problem, "allowed", None)
        or ()
    )
    token = getattr(problem, "token", None)
    if token is not None and token.type in ("NAME", "NUMBER") and {"RPAR", "_NL"} & expected and "NAME" not in expected:
        before = source.text[: token.start_pos].rstrip(" \t")
        if (
            re.search(r"(?<![A-Za-z_])[0-9.eE+-]+$", before) is None
            and token.type == "NAME"
            and before.endswith(("]", ")"))
        ):
            return "Is an operator missing? A unit follows its number directly: `2 um`, or in brackets: `2 [N/m]`."
        return "Is an operator, a comma or a line break missing before it?"
    if token is not None and str(token) == "=" and "COMPARE" in expected:
        return "A comparison is written `==`; one statement has one `=`."
    words = sorted({_WORDS.get(e, f"`{e.lower()}`" if e.isalpha() else "an operator") for e in expected})
    if not words:
        return "See the language reference for what may stand here."
    return "What may stand here: " + ", ".join(words[:12]) + ("…" if len(words) > 12 else "") + "."


def _blank_statement(text: str, source: Source, span: Span) -> tuple[str, bool]:
    """Blank the line of a mistake, keeping its braces, so that the rest of the file can be read too."""
    line = span.line
    start = source.line_starts[line - 1]
    end = source.line_starts[line] - 1 if line < len(source.line_starts) else len(text)
    old = text[start:end]
    if not old.strip():
        return text, False
    opening, closing = old.count("{"), old.count("}")
    kept = "{" * max(0, opening - closing) + "}" * max(0, closing - opening)
    if kept.startswith("{"):  # a block whose head is wrong cannot be kept without its head
        return text, False
    return text[:start] + kept.ljust(len(old)) + text[end:], old.strip() != kept
