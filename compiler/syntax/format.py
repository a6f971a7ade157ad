"""Formatter: indentation and the space between words. Line breaks, comments and tables stay as the author wrote them.

The words are the tokens of the parser. Each has a usual distance from the word before it (`_distance`). A word further to the right
keeps its place if it is part of a table: words of one sort that begin in one column of neighbouring lines begin in one column
afterwards too, with the same distance to the words before them.

Every choice depends on the words, on equal columns and on distances beyond the usual ones. All three are the same in the result, so
formatting it again changes nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field, fields
from itertools import pairwise
from typing import TYPE_CHECKING

from ..errors import CompilationFailed, InternalError
from ..fast_dataclass import dataclass
from ..garbage_collection import uncollected
from ..source import Source, Span
from .parse import MAXIMUM_SIZE, parse, read_words, without_hidden
from .refused import Refused, Unreadable, place_of
from .tree import Index, Member, SyntaxNode

if TYPE_CHECKING:
    from lark import Token

INDENT = 2  # columns for each open brace
COMMENT = 2  # columns before a comment at the end of a line
TABLE = 4  # two rows of a table lie at most so many lines apart
TAB = 8  # columns from one tab stop to the next, where there are tabs

_INTRODUCES_NAMES = frozenset(["parameter", "constant", "input", "output", "signal", "mode", "solve", "port", "sweep"])
_HAS_BLOCK = frozenset(["model", "plain", "parameters", "multibody", "for", "if", "when", "every", "experiment"])
_SPACED = frozenset(["=", "->", "=>", "<", "<=", ">", ">=", "==", "!="])
_CLOSE = frozenset("*/^")
_OPERAND_ENDS = frozenset(["NAME", "NUMBER", "RPAR", "RSQB"])
_SORTS = {
    "STRING": "text", "COMMENT": "text", "COMPARE": "compare", "PLUS": "sign", "MINUS": "sign", "NUMBER": "operand",
    "JUNCTION": "operand", "LPAR": "operand", "LSQB": "operand", "NEST": "operand", "RPAR": "", "RSQB": "", "COMMA": "", "SEMICOLON": "", "DOT": "",
}  # fmt: skip
_GAP = re.compile(r"#[^\n]*|\n|[^\n#]+")


def format_text(source: Source) -> str:
    """Return the text of a file, formatted. Linear in its length.

    Raises `CompilationFailed` if it has syntax errors, and `InternalError` if the result would mean something else.
    """
    with uncollected():
        statements, tokens = _parse_with_tokens(source)
        lines = _Reader().read(source.text, tokens)
        _judge(lines)
        _place(lines)
        text = _write(lines)
        if "\r\n" in source.text:
            text = text.replace("\n", "\r\n")
        _check(source, statements, text)
    return text


# ---------------------------------------------------------------- words and lines


@dataclass(slots=True, eq=False)
class _Word:
    """A token or a comment, with its old and its new place."""

    kind: str  # lark's name of the terminal, or COMMENT
    text: str
    line: int
    column: int  # in the text as it was; a tab reaches to the next stop
    before: _Word | None  # the word before it in its line
    begins: bool  # True if a statement ends or a block begins before it
    unary: bool = False  # a sign, no operator between two
    index: bool = False  # a bracket behind a name or a number: no list
    usual: int = 0  # the usual distance from the word before it
    free: bool = False  # at the end of a line, where the author decides how far
    depth: int = 0  # indentation of the first word of a line, unless it is aligned
    below: _Word | None = None  # word under which it is aligned
    brace: _Word | None = None  # of a brace that closes attributes: the one that opens them
    new: int = -1  # new column

    @property
    def extra(self) -> int:
        """Distance from the word before, beyond the usual one, in the old text."""
        if self.before is None:
            return 0
        return max(0, self.column - self.before.column - len(self.before.text) - self.usual)

    @property
    def natural(self) -> int:
        """Column at the usual distance."""
        assert self.before is not None
        return self.before.new + len(self.before.text) + self.usual

    @property
    def sort(self) -> str:
        """Key of the words that may share a column with it, "" for none: operands and signs with those after the same word."""
        if self.index:
            return "unit" if self.usual else ""
        sort = _SORTS.get(self.kind, "operand" if _is_name(self.text) else self.text)
        if sort not in ("operand", "sign"):
            return "arrow" if sort in ("->", "=>") else sort
        last = self.before
        while last is not None and last.unary:  # `( x` above `(-x`
            last = last.before
        if last is None or not (_is_name(last.text) or last.kind in ("NUMBER", "JUNCTION")):
            return sort + (last.text[-1] if last is not None else "")
        return f"{sort} second" if last.before is None else sort


def _is_name(text: str) -> bool:
    return text[0].isalpha() or text[0] == "_"


@dataclass(slots=True)
class _Line:
    """Words of one line. `paragraph` is the number of blank lines before it."""

    paragraph: int
    words: list[_Word] = field(default_factory=list)


def _parse_with_tokens(source: Source) -> tuple[object, list[Token]]:
    """Statements of a file and its tokens, with `_NL` where a line break ends a statement."""
    tokens: list[Token] = []
    try:
        if len(source.text) <= MAXIMUM_SIZE and not without_hidden(source)[1]:
            return read_words(source, source.text, words=tokens), tokens
    except (Unreadable, Refused):
        pass
    parse(source)  # reports all syntax errors
    raise InternalError(f"{source.name} is read in one way and not in another")


class _Reader:
    """Collection of words in lines. Spaces become columns, blank lines are counted."""

    def __init__(self) -> None:
        self.lines = [_Line(0)]
        self.column = 0
        self.ended = True  # True if a statement can begin at the next word

    def read(self, text: str, tokens: Iterable[Token]) -> list[_Line]:
        position = 0
        for token in tokens:
            if token.type == "_NL":  # its text is read with the gap before the next token
                self.ended = True
                continue
            self.gap(text[position : token.start_pos])
            self.word(token.type, str(token))
            self.ended = token.type in ("LBRACE", "SEMICOLON")
            _, position = place_of(token)
        self.ended = True
        self.gap(text[position:])
        return [line for line in self.lines if line.words]

    def word(self, kind: str, text: str) -> None:
        words = self.lines[-1].words
        words.append(_Word(kind, text, len(self.lines), self.column, words[-1] if words else None, self.ended))
        self.column += len(text)

    def gap(self, text: str) -> None:
        """Read the text between two tokens: spaces, line breaks, comments."""
        for piece in _GAP.findall(text):
            if piece == "\n":
                self.column = 0
                if self.lines[-1].words:
                    self.lines.append(_Line(self.lines[-1].paragraph))
                else:
                    self.lines[-1].paragraph += 1
            elif piece[0] == "#":
                self.word("COMMENT", piece.rstrip(" \t\r"))
            elif "\t" not in piece:
                self.column += len(piece) - piece.count("\r")
            else:
                for character in piece:
                    self.column += TAB - self.column % TAB if character == "\t" else character != "\r"


# ---------------------------------------------------------------- usual distances and depths


@dataclass(slots=True)
class _Block:
    """A file, a block, or attributes in braces, with the statement in it that is being read."""

    depth: int = 0  # of a line that begins with one of its statements
    brace: _Word | None = None  # the brace that opened it
    beside: _Word | None = None  # the word that follows that brace in the same line
    first: str = ""
    introduces: bool = False  # its statements are names with values, as in a set of parameters
    by_column: dict[int, _Word] = field(default_factory=dict)  # its words, except punctuation and the first of a line
    brackets: list[_Word] = field(default_factory=list)  # those that are open in it


def _judge(lines: Sequence[_Line]) -> None:
    """Set the usual distance of every word. For the first word of a line, set its depth and the word under which it is aligned."""
    blocks = [_Block()]  # one more for every open brace
    last: _Word | None = None  # the last token
    above = _Line(-1)
    for line in lines:
        for word in line.words:
            block = blocks[-1]
            if word.before is None:
                _indent(word, blocks)
            if word.kind == "COMMENT":
                word.usual, word.free = COMMENT, True
                if word.before is None and above.paragraph == line.paragraph:
                    _continue_comment(word, above.words[-1])
                continue
            if word.begins:
                block.first, block.by_column, block.brackets = word.text, {}, []
            elif word.before is not None and _SORTS.get(word.kind) != "":
                block.by_column[word.column] = word
            word.index = word.kind == "LSQB" and last is not None and last.kind in _OPERAND_ENDS
            word.unary = word.text in ("+", "-") and (last is None or last.kind not in _OPERAND_ENDS)
            if word.before is not None:
                word.usual = _distance(word.before, word, block)
                if word.before.kind == "LBRACE":
                    block.beside = word
            _open_or_close(word, line.words[0], blocks)
            last = word
        _free_the_end(line)
        above = line


def _indent(word: _Word, blocks: Sequence[_Block]) -> None:
    """Set the depth of the first word of a line, and the word under which it is aligned if it began in the same column."""
    block = blocks[-1]
    word.depth = block.depth
    candidate: _Word | None
    if word.kind == "RBRACE":
        word.depth -= 1
        candidate = block.brace if block.beside is not None else None
    elif word.begins:
        candidate = block.beside
    elif block.first == "if" and not block.brackets and (word.text == "else" or word.kind == "COMMENT"):
        return  # below the brace that ends the other branch
    else:
        closes = word.kind in ("RPAR", "RSQB")
        word.depth += len(block.brackets) - 1 if closes else max(1, len(block.brackets))
        candidate = block.by_column.get(word.column)
    if candidate is not None and candidate.column == word.column:
        word.below = candidate


def _continue_comment(word: _Word, last: _Word) -> None:
    """Align a comment on its own line with the one at the end of the line above, if it may continue it."""
    continues = last.before is not None or (last.below is not None and last.below.kind == "COMMENT")
    if last.kind == "COMMENT" and continues and last.column == word.column:
        word.below = last


def _open_or_close(word: _Word, first: _Word, blocks: list[_Block]) -> None:
    block = blocks[-1]
    match word.kind:
        case "LPAR" | "NEST" | "LSQB":
            block.brackets.append(word)
        case "RPAR" | "RSQB":
            block.brackets.pop()
        case "LBRACE":
            blocks.append(_Block(first.depth + 1, word, introduces=block.first == "parameters"))
        case "RBRACE":
            brace = blocks.pop().brace
            word.brace = None if blocks[-1].first in _HAS_BLOCK else brace


def _free_the_end(line: _Line) -> None:
    """Leave the distance of comments, descriptions and attributes in braces at the end of a line to the author."""
    for word in reversed(line.words):
        if word.kind in ("COMMENT", "STRING"):
            word.free = True
        elif word.brace is not None and word.brace.line == word.line:
            word.brace.free = True
            return
        elif word.kind not in ("COMMA", "SEMICOLON"):
            return


def _distance(before: _Word, word: _Word, block: _Block) -> int:
    """Usual number of columns between two neighbours in a line."""
    bracket = block.brackets[-1] if block.brackets else None
    in_index = bracket is not None and bracket.index
    match word.kind:
        case "COMMA" | "SEMICOLON" | "DOT" | "RPAR" | "RSQB":
            return 0
        case "LSQB" if before.kind in _OPERAND_ENDS:
            return int(before.kind == "NUMBER")  # a unit; else an index
        case "COLON":
            return int(bracket is None and block.first not in _INTRODUCES_NAMES and not block.introduces)
        case "RBRACE":
            return int(before.kind != "LBRACE")
    match before.kind:
        case "LPAR" | "NEST" | "LSQB" | "DOT":
            return 0
        case "SEMICOLON":  # one, or two where a line holds several statements of one sort
            return 2 if word.column - before.column > 2 else 1
        case "COLON" | "COMMA" | "LBRACE" | "RBRACE":
            return 1
    if word.text in _CLOSE or before.text in _CLOSE or before.unary:
        return 0
    if word.text in _SPACED or before.text in _SPACED:
        return 1
    if "+" in (word.text, before.text) or "-" in (word.text, before.text) or ".." in (word.text, before.text):
        return int(word.unary or not (in_index or (block.first == "for" and bracket is None)))
    if word.kind == "LPAR":
        return int(before.kind not in ("NAME", "RSQB"))  # a call; `x[2](a, b)`
    return 1


# ---------------------------------------------------------------- columns


def _place(lines: Sequence[_Line]) -> None:
    """Give every word its new column, from left to right, so that the words it depends on have theirs before."""
    tables = _tables(lines)
    columns: dict[int, list[_Word]] = {}
    for line in lines:
        for word in line.words:
            columns.setdefault(word.column, []).append(word)
    for _, words in sorted(columns.items()):
        for word in words:
            if word.before is None or word.new >= 0:
                continue
            table = tables.get(word)
            if table is not None:
                place = max(w.natural for w in table) + min(w.extra for w in table)
                for other in table:
                    other.new = place
            else:
                word.new = word.natural + (word.extra if word.free else 0)
        for word in words:  # in the order of lines: a word's alignment has its place already
            if word.before is None:
                word.new = INDENT * word.depth if word.below is None else word.below.new


def _tables(lines: Sequence[_Line]) -> dict[_Word, list[_Word]]:
    """Map from each word to all words that share its column in one table."""
    by_place: dict[tuple[int, int, str], list[_Word]] = {}
    for line in lines:
        for word in line.words:
            if word.before is not None and word.sort:
                by_place.setdefault((line.paragraph, word.column, word.sort), []).append(word)
    result: dict[_Word, list[_Word]] = {}
    for words in by_place.values():
        for table in _runs(words):
            slack = min(w.extra for w in table)
            if any(w.extra for w in table) and not (slack and any(not w.usual for w in table)):
                result.update((w, table) for w in table)
    return result


def _runs(words: Sequence[_Word]) -> Iterator[list[_Word]]:
    """Split the words where two are too many lines apart. A single word is no table."""
    run = [words[0]]
    for previous, word in pairwise(words):
        if word.line - previous.line > TABLE:
            if len(run) > 1:
                yield run
            run = []
        run.append(word)
    if len(run) > 1:
        yield run


def _write(lines: Sequence[_Line]) -> str:
    parts: list[str] = []
    for number, line in enumerate(lines):
        if number and line.paragraph != lines[number - 1].paragraph:
            parts.append("\n")
        end = 0
        for word in line.words:
            parts += (" " * (word.new - end), word.text)
            end = word.new + len(word.text)
        parts.append("\n")
    return "".join(parts)


# ---------------------------------------------------------------- the check


def _check(source: Source, statements: object, text: str) -> None:
    """Raise `InternalError` unless the formatted text has the same statements."""
    try:
        again = parse(Source(source.name, text, source.path))
    except CompilationFailed as failed:
        raise InternalError(f"formatted, {source.name} would no longer be read: {failed}") from failed
    if not _equal(statements, again.statements):
        raise InternalError(f"formatted, {source.name} would mean something else")


def _equal(first: object, second: object) -> bool:
    """Return True if two trees are equal except for their places in the text."""
    names: dict[type[object], tuple[str, ...]] = {}
    pairs = [(first, second)]
    while pairs:
        a, b = pairs.pop()
        if type(a) is not type(b):
            return False
        if isinstance(a, tuple) and isinstance(b, tuple):
            if len(a) != len(b):
                return False
            pairs += zip(a, b, strict=True)
        elif isinstance(a, SyntaxNode | Member | Index):
            if type(a) not in names:
                names[type(a)] = tuple(f.name for f in fields(a))
            pairs += ((getattr(a, name), getattr(b, name)) for name in names[type(a)])
        elif not isinstance(a, Span) and a != b:
            return False
    return True
