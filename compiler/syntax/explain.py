"""Syntax errors in the author's words: the unexpected text, and the probable intention."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..errors import Diagnostic
from ..source import Source, Span
from .errors import StrangeCharacter, Unclosed, Unexpected
from .foreign_lines import advice_on
from .refused import Unreadable, place_of

if TYPE_CHECKING:
    from lark import Token

END = "$END"  # lark's word at the end of the text
_WORDS = {
    "NAME": "a name", "NUMBER": "a number", "STRING": 'a text in ""', "_NL": "the end of the line", "RBRACE": "`}`", "LBRACE": "`{`",
    "RPAR": "`)`", "LPAR": "`(`", "RSQB": "`]`", "LSQB": "`[`", "COLON": "`:`", "EQUAL": "`=`", "COMMA": "`,`", "SEMICOLON": "`;`",
    "DOT": "`.`", "JUNCTION": "`0`", "NEST": "`0(`", "__ANON_0": "`->`", "__ANON_1": "`=>`", "__ANON_2": "`..`", "COMPARE": "`<`",
}  # fmt: skip
_OPERATORS = frozenset({"NOT", "PLUS", "MINUS", "STAR", "SLASH", "CIRCUMFLEX", "UNIT_SIGN", "EXPONENT_SIGN"})
_CHARACTERS = {
    '"': "A text ends on the line where it begins: close it with a second quotation mark.",
    "=": "An equation has one `=`; a comparison is `==`.",
    "'": 'Texts stand between double quotation marks: "like this".',
    "!": "`!=` compares; a negation is the word `not`.",
    ".": "A number has digits on both sides of its point: `0.5`, `5.0`.",
}
_FOREIGN = {
    "²": "A power is written with `^`: `[m^2]`.",
    "³": "A power is written with `^`: `[m^3]`.",
    "°": "It is written `deg` for an angle, `degC` and `degF` for a temperature.",
    "µ": "It is read in a unit behind a number, `3 µm`, and in brackets, `5 [N/µm]`.",
    "μ": "It is read in a unit behind a number, `3 μm`, and in brackets, `5 [N/μm]`.",
    "Ω": "It is read in a unit behind a number, `3 kΩ`, and in brackets, `5 [kΩ*m]`.",
}


def explain(source: Source, problem: Unreadable) -> Diagnostic:
    """Diagnostic for a word or a character that cannot be parsed."""
    word = problem.word
    if word is None:
        return _character(source, problem.position, problem)
    unclosed = _unclosed(source, word, problem.open_brackets)
    if unclosed is not None:
        return unclosed
    end = missing_brace(source, problem)
    if end is not None:
        head = source.line(Span(source, end, end).line).split("#")[0].split("//")[0].strip()
        hint = f"What belongs to it stands in braces: `{head} {{ … }}`."
        return Unexpected(Span(source, end, end + 1), "The end of the line", hint)
    if word.type == END:
        end = len(source.text.rstrip())
        return Unexpected(Span(source, max(0, end - 1), max(1, end)), "The end of the file", _hint(problem, source))
    start, _ = place_of(word)
    if word.type == "UNIT_SYMBOL":
        strange = next((k for k, character in enumerate(str(word)) if not character.isascii()), 0)
        return _character(source, start + strange, problem)
    text = "The end of the line" if word.type == "_NL" else f"`{str(word).strip()}`"
    end = start + 1 if word.type == "_NL" else start + len(word)
    return Unexpected(Span(source, start, end), text, _hint(problem, source))


def missing_brace(source: Source, problem: Unreadable) -> int | None:
    """Return the end of the line in which the brace of a block is missing; None if that is not what is wrong."""
    if problem.word is None or "LBRACE" not in problem.expected or "_NL" in problem.expected:
        return None
    start, _ = place_of(problem.word)
    head = source.text[:start].rstrip()
    return source.text.find("\n", len(head)) if head and "\n" in source.text[len(head) : start] else None


def _character(source: Source, start: int, problem: Unreadable) -> Diagnostic:
    character = source.text[start] if start < len(source.text) else ""
    span = Span(source, start, start + 1)
    if character.isascii() and character.isprintable():
        return Unexpected(span, f"`{character}`", _hint(problem, source, _CHARACTERS.get(character, "")))
    shown = f"`{character}`" if character.isprintable() else f"U+{ord(character):04X}"
    advice = _FOREIGN.get(character, "Names are made of the letters a to z, A to Z, digits and `_`.")
    return StrangeCharacter(span, shown, advice)


def _unclosed(source: Source, word: Token, open_brackets: Sequence[Token]) -> Diagnostic | None:
    """Diagnostic for an open bracket, the cause of errors some lines later or at the end of the file."""
    if not open_brackets:
        return None
    last = open_brackets[-1]
    round_bracket = last.type != "LBRACE"
    start, _ = place_of(last)
    if word.type == END or (round_bracket and "\n" in source.text[start : word.start_pos]):
        if last.type == "LBRACE":
            start = _open_brace(source.text, start)
        bracket = source.text[start + len(last) - 1]
        return Unclosed(Span(source, start, start + len(last)), bracket, {"(": ")", "[": "]", "{": "}"}[bracket])
    return None


def _open_brace(text: str, outermost: int) -> int:
    """Offset of the open brace, according to the author's indentation.

    A `}` that begins a line with less indentation than the brace it would close belongs to an outer one.
    """
    open_braces: list[tuple[int, int]] = []  # offset, indentation of its line
    for found in _BRACES.finditer(text):
        brace = found[1]
        if brace is None:
            continue
        line = text.rfind("\n", 0, found.start(1)) + 1
        indent = _INDENT.match(text, line).end() - line  # type: ignore[union-attr]
        if brace == "{":
            open_braces.append((found.start(1), indent))
        elif open_braces:
            offset, own = open_braces.pop()
            if own > indent and not text[line : found.start(1)].strip():
                return offset
    return open_braces[-1][0] if open_braces else outermost


_INDENT = re.compile(r"[ \t]*")
_BRACES = re.compile(r'#[^\n]*|"[^"\n]*"|([{}])')
_IN_A_MODEL = frozenset(
    ["parameter", "input", "output", "signal", "port", "multibody", "for", "if", "when", "every", "experiment"]
)


def _hint(problem: Unreadable, source: Source, otherwise: str = "") -> str:
    expected, word = problem.expected, problem.word
    start = problem.position if word is None else place_of(word)[0]
    line = Span(source, start, start).line
    begin = source.line_starts[line - 1]
    before = source.text[begin:start].rstrip()
    special = "" if word is None else _special(word, expected, before)
    inside = _in_experiment(source.text, start)
    special = special or advice_on(source.line(line), start - begin, inside) or otherwise
    if not special and line > 1 and not before:  # what the line before began
        special = advice_on(source.line(line - 1), len(source.line(line - 1)), inside)
    special = special or ("" if word is None else _missing(word, expected, before, source.text[start:]))
    if special:
        return special
    hidden = {"UNIT_SYMBOL", "STRING"} if "NUMBER" in expected else {"UNIT_SYMBOL"}  # few numbers are meant as texts
    words = sorted(
        {
            "an operator" if e in _OPERATORS else _WORDS.get(e, f"`{e.lower()}`")
            for e in expected
            if not e.startswith("$") and e not in hidden
        }
    )
    if not words:
        return "See the language reference for what may stand here."
    return "What may stand here: " + ", ".join(words[:12]) + ("…" if len(words) > 12 else "") + "."


def _in_experiment(text: str, start: int) -> bool:
    """Return True if a place lies between the braces of an experiment."""
    head = text.rfind("experiment", 0, start)
    braces = [brace[1] for brace in _BRACES.finditer(text, head, start)] if head >= 0 else []
    return braces.count("{") > braces.count("}")


def _special(token: Token, expected: set[str], before: str) -> str:
    """Advice on the probable intention, from the token and the line before it."""
    text = str(token)
    if text == "import" and "MODEL" not in expected:
        return "An import stands at the top of the file, outside of models."
    if "LBRACE" in expected and (head := re.fullmatch(r"\s*((?:plain\s+)?model\s+\w+)", before)):
        return f"What belongs to it stands in braces: `{head[1]} {{ … }}`."
    if text in _IN_A_MODEL and "MODEL" in expected:
        return f"It belongs into a model: `model Name {{ {text} … }}`; outside of models stand imports, constants and functions."
    if re.search(r"(?<![A-Za-z0-9_])[0-9]+_[0-9_]+$", before):
        return "Digits stand without separators: `1000`."
    if text == "*" and before.endswith("*"):
        return "A power is written `^`: `a^2`."
    if text == "=" and "=" in before.rsplit(";", 1)[-1]:
        return "A comparison is written `==`; a statement has one `=`."
    if text == "." and re.search(r"[0-9]$|[^A-Za-z0-9_\])]$", before):
        return "A number has digits on both sides of its point: `0.5`, `5.0`."
    conditional = _conditional(text, expected, before)
    if conditional:
        return conditional
    if re.match(r"\s*import\b", before + " "):
        if text == ".":
            return 'An import names parts and a file: `import Resistor from electric`, `import Motor from "parts.bg"`.'
        return "An import stands at the top of the file, outside of models."
    alone = re.fullmatch(r"\s*[01]\(([^()]+)\)", before)
    if alone and token.type != "NAME" and len(inside := alone[1].rsplit(",", 1)) == 2:
        first, last = (part.strip() for part in inside)
        return f"A junction in place is one end of a bond: `{before.strip()[:2]}{first}) -> {last}`."
    return ""


def _conditional(text: str, expected: set[str], before: str) -> str:
    """Advice at a conditional part, `if n > 1 { … } else { … }`."""
    if "ELSE" in expected and before.endswith("}"):
        return "It is written `else if`." if text in ("elif", "elseif", "elsif") else ""
    if re.fullmatch(r"\s*(if|else)\b.*", before) and text.strip() in (":", "=", "{", "then", ""):
        if text == "=":
            return "A comparison is written `==`."
        if re.search(r"\belse\b.*\S", before):
            return "A condition with an `else` in it gets a name: `constant on = …`, then `if on { … }`."
        return "Conditional parts stand in braces, the first one in the line of its word: `if n > 1 { … } else { … }`."
    return ""


def _missing(token: Token, expected: set[str], before: str, after: str) -> str:
    """Advice where two words follow each other that cannot."""
    if token.type not in ("NAME", "NUMBER") or "NAME" in expected:
        return ""
    number_with_unit = re.search(r"(?<![A-Za-z0-9_.])([0-9][0-9.]*(?:[eE][+-]?[0-9]+)?)[ \t]+([A-Za-z_]\w*)$", before)
    factor = re.match(r"[A-Za-z_]\w*(?:\^-?[0-9]+)?(?:/(?:m|s|rad|kg|A|V|K)\b(?:\^[0-9])?)?", after)
    if number_with_unit and factor:
        return f"A unit of several symbols stands in brackets: `{number_with_unit[1]} [{number_with_unit[2]}*{factor[0]}]`."
    if "MODEL" in expected:
        return "Outside of models stand imports, constants, functions and sets of parameters; all else stands in `model Name { … }`."
    if token.type == "NAME" and re.search(r"[A-Za-z_\])]\w*$", before):
        return "Is an operator, a comma or a line break missing before it? A unit follows a number only; a name has its own."
    return "Is an operator, a comma or a line break missing before it?"
