"""Rules of corrections: each reads the advice of an error, which names what to write, and yields edits that may follow it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

from compiler.api import UNITS, Diagnostic

from .answers import TextEdit, TextPlace
from .libraries import import_edits
from .vocabulary import classes
from .workspace import Workspace, place_of

Candidate = tuple[str, tuple[TextEdit, ...]]
_LANGUAGE = (
    frozenset(word for listed in classes().values() for word in listed if len(word) > 1)
    | {u for u in UNITS if len(u) > 1}
    | {"s", "K", "e", "f", "q", "p"}
)
_QUOTED = re.compile(r"`([^`]+)`")
MEANT = re.compile(r"Did you mean (.+)\?")
_UNIT = re.compile(r"(?:as|several symbols:|number needs its unit,) `2 (\[[^]]+\])`")


class WrongText:
    """An error of a file, as the rules read it: its advice, its place (`first` to `last`, with the text `old` there), and its line (`start` to `end`)."""

    def __init__(self, workspace: Workspace, path: Path, text: str, item: Diagnostic) -> None:
        self.workspace, self.path, self.text, self.item = workspace, path, text, item
        self.code, self.sentence, self.help = item.code, item.sentence, item.help
        self.words, place = item.span.text, place_of(item.span)
        self.first, self.last, self.old = place.start, place.end, text[place.start : place.end]
        self.start, end = text.rfind("\n", 0, place.start) + 1, text.find("\n", place.start)
        self.end = len(text) if end < 0 else end
        self.line = text[self.start : self.end]

    def edit(self, start: int, end: int, new: str) -> TextEdit:
        """Return the replacement of a part of the text."""
        return TextEdit(TextPlace(self.path, start, end), new)

    def replace(self, start: int, end: int, new: str, title: str = "") -> Candidate:
        """Return a candidate that replaces a part of the text."""
        return title or (f"Write `{new.strip()}`" if new else "Remove it"), (self.edit(start, end, new),)

    def replace_match(self, match: re.Match[str], new: str, title: str = "") -> Candidate:
        """Return a candidate that replaces what a pattern has found in the line."""
        return self.replace(self.start + match.start(), self.start + match.end(), new, title)

    def without_line(self) -> TextEdit:
        """Return the edit that takes the whole line away."""
        return self.edit(self.start, min(self.end + 1, len(self.text)), "")


def _meant_words(error: WrongText) -> Iterator[Candidate]:
    """The name that is close to a misspelled one: in the last place of the span that has it."""
    meant = MEANT.search(error.help)
    wrong = _QUOTED.search(error.sentence)
    if meant is None or wrong is None:
        return
    old = getattr(error.item, "name", "") or getattr(error.item, "kind", "") or wrong[1]
    words = dict.fromkeys((old, old.rpartition(".")[2], error.old, wrong[1]))
    for start, end in ((error.first, error.last), (error.start, error.end)):
        uses = [
            u
            for w in words
            for u in [*re.compile(rf"(?<!\w){re.escape(w)}(?!\w)").finditer(error.text, start, end)][-1:]
        ]
        for use in uses:
            yield from (error.replace(*use.span(), new) for new in _QUOTED.findall(meant[1]))
        if uses:
            return


def _units(error: WrongText) -> Iterator[Candidate]:
    """The unit that a number needs, behind each bare number of the span, or in place of its unit."""
    unit = _UNIT.search(error.help)
    if unit is None or error.code != "BG103":
        return
    for match in re.finditer(
        r"(?<![\w.^])\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(\s*\[[^]]*\]|\s*[A-Za-z%]\w*(?:[*/^][\w^]+)*)?",
        error.old,
    ):
        number = match[0][: len(match[0]) - len(match[1] or "")]
        start, symbol = error.first + match.start(), _with_prefixes(unit[1][1:-1], match[1] or "")
        if symbol:
            new = symbol if symbol.isidentifier() else f"[{symbol}]"
            yield error.replace(start, start + len(match[0]), f"{number} {new}")


def _with_prefixes(target: str, written: str) -> str:
    """The wanted unit with the author's symbols of equal dimension: `kN` for N/m gives kN/m. Empty if another prefix would be lost, which changes the value."""
    own = {UNITS[s].dimension: s for s in _TOKEN.findall(written) if s in UNITS}
    used = [own[UNITS[s].dimension] for s in _TOKEN.findall(target) if s in UNITS and UNITS[s].dimension in own]
    lost = [s for s in own.values() if s not in used and (UNITS[s].number != 1 or UNITS[s].offset)]
    if lost:
        return ""
    return _TOKEN.sub(lambda m: own.get(UNITS[m[0]].dimension, m[0]) if m[0] in UNITS else m[0], target)


_TO_WRITE = re.compile(
    r"(?:[Ww]rite|[Uu]se|Set|Put|as|or|and|is|meant|mean|written|variables:|ports:|letters:|unit:|components:|alone:"
    r"|number:|equation:|separators:|plane:|,) `([^`]+)`"
)
_TOKEN = re.compile(r"[A-Za-z_]\w*", re.ASCII)


def _quoted_words(error: WrongText) -> Iterator[Candidate]:
    """Words that the advice says to write: in place of the span, of the same word in other letters, or of the statement."""
    if MEANT.search(error.help):
        return
    statement = error.line.partition("#")[0]
    first = error.start + len(statement) - len(statement.lstrip())
    last = error.start + len(statement.rstrip())
    written = _TO_WRITE.findall(error.help) if error.code != "BG134" else []
    for new in dict.fromkeys([*written, *(q for q in _QUOTED.findall(error.help) if error.code < "BG1")]):
        if not _is_made_of(new, statement, error.old) or (error.code > "BG103" and _numbers_change(new, statement)):
            continue
        is_word, was_word = (_TOKEN.fullmatch(w) is not None for w in (new, error.old))
        is_language = was_word and _LANGUAGE.issuperset(_TOKEN.findall(new))
        if (is_word == was_word and (is_word or error.code > "BG1")) or new.startswith(f"{error.old}.") or is_language:
            yield error.replace(error.first, error.last, new)
        if " " in new:
            if error.code < "BG1" or set(_TOKEN.findall(statement)) <= set(_TOKEN.findall(new)):
                yield error.replace(first, last, new)
            continue
        word = re.compile(rf"\b{re.escape(new)}\b", re.IGNORECASE).search(error.text, error.start, error.end)
        if word is not None:
            yield error.replace(*word.span(), new)


def _numbers_change(new: str, statement: str) -> bool:
    """Return True if a number of the statement would have another unit."""
    quantities = re.findall(r"\d[\w.]*\s*[A-Za-z\[][^\s,;)}]*", new)
    return any(q not in statement for q in quantities)


def _is_made_of(new: str, statement: str, old: str) -> bool:
    """Return True if a text has no number and no name but those of the statement that it replaces, and words of the language.

    An example in an advice has others: it says how to write something, not what the author meant.
    """
    if "…" in new or new.startswith(".") or not re.search(r"\w|->|=>", new):
        return False
    digits = "".join(re.findall(r"\d", statement))
    if "".join(re.findall(r"\d", new)) not in digits:
        return False
    if new.startswith(f"{old}."):
        return True
    own = {*_TOKEN.findall(statement)}
    small = {word.lower() for word in own}
    return all(w in own or w in _LANGUAGE or w.lower() in small for w in _TOKEN.findall(new))


# Signs of other languages on the line of an error: pattern, what stands for it, and words of the advice that it follows.
_SIGNS: tuple[tuple[str, str, str], ...] = (
    (r"\*\*", "^", "A power is written"),
    (r"²", "^2", "A power is written"),
    (r"³", "^3", "A power is written"),
    (r":=", "=", "is written `=`"),
    (r"(?<![=<>!])=(?![=])", "==", "A comparison is written"),
    (r"&&", " and ", "`and`"),
    (r"\|\|", " or ", "`or`"),
    (r"\s*°\s*C\b", " degC", "`deg"),
    (r"\s*°", " deg", "`deg`"),
    (r"//|%|/\*", "#", "`#`"),
    (r"(?<![\w.])\.(?=\d)", "0.", "digits on both sides"),
    (r"(?<=\d)\.(?!\d)(?!\.)", ".0", "digits on both sides"),
    (r"(?<=\d),(?=\d)", ".", "`1.5`"),
    (r"(?<=\d)_(?=\d)", "", "without separators"),
    (r"'([^']*)'", r'"\1"', "double quotation marks"),
    (r'"([^"\n]*)$', r'"\1"', "second quotation mark"),
    (r"(?<=\d)(?=[A-Za-z_(])", "*", "*"),
    (r"(?<=[\w)]) *(?=\()", "*", "A product is written"),
    (
        r"([^\s<>=]+) *([<>]=?) *([^\s<>=]+|[^\s<>=(]+\([^()]*\)) *([<>]=?) *([^\s<>=]+)",
        r"\1 \2 \3 and \3 \4 \5",
        "joined by `and`",
    ),
    (r"\bplain (?=model)", "", "Drop the word `plain`"),
    (r"(?<=[01])\s+(?=\()", "", "no blank before"),
    (r"\s+in\s+(?=[^=]*=)", ": ", "stands behind a colon"),
    (r"\bto\b", "..", ".."),
    (r"\bplot\b", "report", "`report"),
    (r"\brun\b", "simulate", "`simulate"),
    (r"\bas\b", "in", "in "),
    (r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]", "", "It cannot be seen"),
)


def _signs(error: WrongText) -> Iterator[Candidate]:
    for pattern, new, advice in _SIGNS:
        if advice in error.help and error.code < "BG110":
            uses = list(re.finditer(pattern, error.line))
            for match in uses:
                yield error.replace_match(match, match.expand(new))
            if len(uses) > 1:
                yield error.replace(
                    error.start, error.end, re.sub(pattern, new, error.line), f"Write `{new}` throughout"
                )


_SEVERAL = re.compile(r"(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)\s+([A-Za-z]\w*(?:\^-?\d+)?)((?:\s+[A-Za-z]\w*(?:\^-?\d+)?)+)")


def _brackets(error: WrongText) -> Iterator[Candidate]:
    """A unit of several symbols in brackets; a bracket that is never closed; a unit that is a product."""
    if "stands in brackets" in error.help:
        for match in _SEVERAL.finditer(error.text, error.start, error.end):
            unit = "*".join([match[2], *match[3].split()])
            yield error.replace(*match.span(), f"{match[1]} [{unit}]")
    if error.code == "BG102" and "in brackets: `[" in error.help:
        yield error.replace(error.first, error.last, error.help.partition("`")[2].partition("`")[0])
    if error.code == "BG007":
        partner = error.help.partition("`")[2][:1]
        if partner == "}":
            at = _end_of_block(error.text, error.start)
            indent = re.match(r"[ \t]*", error.line)
            line_break = "" if error.text[:at].endswith("\n") else "\n"
            yield error.replace(at, at, f"{line_break}{indent[0] if indent else ''}}}\n", "Close it with `}`")
        last = error.start + len(error.line.partition("#")[0].rstrip())
        yield error.replace(last, last, partner, f"Close it with `{partner}`")


def _end_of_block(text: str, start: int) -> int:
    """The line behind a block, by its indentation."""
    lines = text[start:].splitlines(keepends=True)
    own = len(lines[0]) - len(lines[0].lstrip())
    at = start + len(lines[0])
    for line in lines[1:]:
        if line.strip() and len(line) - len(line.lstrip()) <= own:
            break
        at += len(line)
    return at


def _imports(error: WrongText) -> Iterator[Candidate]:
    """The import of a part of the library that the advice names, or of one that has the name of an unknown kind."""
    named = re.search(r"import (\w+) from (\w+)", error.help)
    if named is not None:
        edits = import_edits(error.workspace.project.document(error.path), named[1], named[2])
        yield f"Import `{named[1]}` from {named[2]}", edits
        word = re.match(r"\w+", error.text[error.first :])
        if word is not None and word[0] != named[1]:
            spelled = error.edit(error.first, error.first + len(word[0]), named[1])
            yield f"Import `{named[1]}` from {named[2]}", (*edits, spelled)
    if "outside of models" in error.help and error.line.lstrip().startswith("import"):
        moved = error.edit(0, 0, error.line.strip() + "\n")
        yield "Move the import to the top of the file", (moved, error.without_line())


def _names(error: WrongText) -> Iterator[Candidate]:
    """Another name where one is taken or reserved; a kind without its M; an attribute that is left out."""
    word = re.match(r"[A-Za-z_]\w*", error.old)
    if error.code in ("BG104", "BG134") and word is not None:
        new = f"{word[0]}_2"
        yield error.replace(error.first, error.first + len(word[0]), new, f"Rename it to `{new}`")
    if error.code in ("BG117", "BG118") and word is not None:
        kinds = re.findall(r"`(M?[A-Z][A-Za-z]*)\b", error.help)
        if (first := re.compile(r"\s*([A-Za-z]+)\b").match(error.text, error.start)) is not None:
            yield from (error.replace(*first.span(1), new) for new in kinds)
    required = re.search(
        r"[Ll]eave out (?:the|its) `(require|prefer)` of `([\w.]+)`|remove its `(require)`", error.help
    )
    if required is not None:
        attribute, owner = required[1] or required[3], (required[2] or "").rpartition(".")[2]
        for match in re.finditer(
            rf"\s*\{{\s*{attribute}\s*=\s*\w+\s*\}}|,\s*{attribute}\s*=\s*\w+|{attribute}\s*=\s*\w+\s*,\s*", error.text
        ):
            start = error.text.rfind("\n", 0, match.end()) + 1
            if not owner or re.search(rf"\b{owner}\b", error.text[start : match.start()]):
                yield error.replace(*match.span(), "", f"Leave out `{attribute}`")


def _arrows(error: WrongText) -> Iterator[Candidate]:
    """A bond with its ends exchanged; a multibond's arrow."""
    if error.code != "BG121" or not re.search(r"\b(?:[Tt]urn|[Aa]rrow|=>|multibond)", f"{error.sentence} {error.help}"):
        return
    for match in re.finditer(r"([\w.\[\]]+)(\s*->\s*)([\w.\[\]]+)", error.line):
        yield error.replace_match(match, f"{match[3]}{match[2]}{match[1]}", "Turn the arrow")
    if "`=>`" in error.help or "`->`" in error.help:
        for old, new in (("->", "=>"), ("=>", "->")):
            if old in error.line:
                yield error.replace(error.start, error.end, error.line.replace(old, new), f"Write `{new}`")


_GIVES_NAMES = re.compile(
    r"\b(?:It has|Its [a-z ]+|[A-Za-z ]+:|can name:) ?((?:[a-z_]\w*(?:, )?)+)[.;:]", re.IGNORECASE
)
MOST_NAMES = 6  # of a list in an advice that are tried


def _listed_names(error: WrongText) -> Iterator[Candidate]:
    """One of the few names that the advice lists, in place of the last word of the span that the sentence has."""
    listed = _GIVES_NAMES.search(error.help)
    names = listed[1].split(", ") if listed is not None and error.code == "BG101" else []
    wrong = [word.rpartition(".")[2] for word in _QUOTED.findall(error.sentence)]
    uses = [m for m in _TOKEN.finditer(error.text, error.first, error.last) if m[0] in wrong]
    for name in names if uses and len(names) <= MOST_NAMES else ():
        yield error.replace(*uses[-1].span(), name)


_OMISSION = re.compile(
    r"\b[Ll]eave (?:it|the others|one|one of the two|one bond of the ring) out\b|\bleave it out|[Ll]eave out one|\bRemove it\b|Set it once|Write one,"
    r"|Put all that|[A-Za-z`]+ has:|has `active`, once|needs no name|are set once|not needed is left out"
)


def _omissions(error: WrongText) -> Iterator[Candidate]:
    """The text without what should not be there: an attribute, alone with its braces, a statement or the line. The smallest that mends is offered."""
    if _OMISSION.search(error.help) is None:
        return
    if "the others" in error.help:
        for comma in re.finditer(r", *", error.old):
            yield error.replace(error.first + comma.start(), error.last, "", "Leave out the rest")
            yield error.replace(error.first, error.first + comma.end(), "", "Leave out the first")
        return
    behind = re.compile(r" *[;,] *").match(error.text, error.last)
    if behind is not None:
        yield error.replace(error.first, behind.end(), "", "Leave it out")
    before = re.compile(r"(?:[;,]| *\{(?= *[^{}]*\})) *$|\s+$").search(error.text, error.start, error.first)
    first = before.start() if before is not None else error.first
    closed = re.compile(r" *\}").match(error.text, error.last)
    opens = before is not None and "{" in before[0]
    last = closed.end() if opens and closed is not None else error.last
    if error.text[error.start : first].strip() or error.text[last : error.end].strip():
        yield error.replace(first, last, "", "Leave it out")
    statement = max(error.text.rfind(";", error.start, error.first) + 1, error.start)
    ends = [at for at in (error.text.find(";", error.last, error.end), error.end) if at >= 0]
    if (statement, min(ends)) != (error.start, error.end):
        yield error.replace(statement, min(ends), "", "Leave it out")
    yield "Leave it out", (error.without_line(),)


def _same_name(error: WrongText) -> Iterator[Candidate]:
    """A name that the error quotes, in place of the same one in other letters."""
    for word in _TOKEN.finditer(error.text, error.first, error.last):
        for new in _QUOTED.findall(f"{error.sentence} {error.help}"):
            if new != word[0] and new.lower() == word[0].lower():
                yield error.replace(*word.span(), new)


def _left_sides(error: WrongText) -> Iterator[Candidate]:
    """`name = …` of the advice, with what the author has behind `=`."""
    for new in re.findall(r"`([^`=]+= )…`", error.help):
        first = new.split()[0]
        old = re.compile(rf"(?:\b{first}\s+)?{re.escape(error.old.partition('=')[0].strip())}\s*= ?")
        for match in old.finditer(error.text, error.start, error.end):
            yield error.replace(*match.span(), new, f"Write `{new}…`")


def _roles(error: WrongText) -> Iterator[Candidate]:
    """Another first word of the statement that declares a name: `declared as `signal``. It holds for all names of a statement, so it has one."""
    role = re.search(r"declared? (?:it )?as `(signal|parameter|input)`", error.help)
    if role is None:
        return
    own = _TOKEN.findall(error.words)[:1]
    names = [*own, *(word for word in _QUOTED.findall(error.sentence) if _TOKEN.fullmatch(word))]
    for name in dict.fromkeys(names):
        for match in re.finditer(rf"^ *(parameter|constant) +{name}\b[^,\n]*$", error.text, re.MULTILINE):
            yield error.replace(*match.span(1), role[1], f"Declare `{name}` as `{role[1]}`")


def _into_the_model(error: WrongText) -> Iterator[Candidate]:
    """A statement that belongs into a model, at the beginning of the next one, or of the one before."""
    if "belongs into a model" not in error.help:
        return
    models = list(re.finditer(r"^(?:plain +)?model +\w+ *\{ *\n", error.text, re.MULTILINE))
    after = [m for m in models if m.start() >= error.end]
    for model in (after[:1] or models[-1:]) if error.line.count("{") == error.line.count("}") else []:
        moved = error.edit(model.end(), model.end(), f"  {error.line.strip()}\n")
        yield "Move it into the model", (moved, error.without_line())


def _missing_signs(error: WrongText) -> Iterator[Candidate]:
    """The operator or the comma that is missing before a word."""
    if error.help.startswith("Is an operator, a comma"):
        first = len(error.text[: error.first].rstrip(" "))
        yield error.replace(first, error.first, "*", "Write `*` between them")
        yield error.replace(first, error.first, ", ", "Write `,` between them")


def _sorted_points(error: WrongText) -> Iterator[Candidate]:
    """The points of a table in the order of their places, where all are written out and no place stands twice."""
    lists = re.compile(r"\(([^()]+)\), *\(([^()]+)\)").match(error.text, error.first)
    if lists is None or "Sort the points" not in error.help:
        return
    places, values = ([cell.strip() for cell in lists[k].split(",")] for k in (1, 2))
    numbers = [re.fullmatch(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)(.*)", one) for one in places]
    keys = [(float(match[1]), match[2].strip()) for match in numbers if match is not None]
    if len(keys) == len(places) == len(values) and len({unit for value, unit in keys if value}) == 1:
        order = sorted(range(len(places)), key=lambda i: keys[i][0])
        edits = (
            error.edit(*lists.span(k), ", ".join(cells[i] for i in order)) for k, cells in ((1, places), (2, values))
        )
        yield "Sort the points", tuple(edits)


def _branches_of_a_rate(error: WrongText) -> Iterator[Candidate]:
    """`der(a if on else b)` as the choice of two rates; the rate of what is delayed as the delayed rate."""
    if error.code != "BG506":
        return
    choice = re.fullmatch(r"der\(([^()]+) if ([^()]+) else ([^()]+)\)", error.words)
    if choice is not None:
        yield error.replace(error.first, error.last, f"(der({choice[1]}) if {choice[2]} else der({choice[3]}))")
    name = re.fullmatch(r"der\((\w+)\)", error.words)
    late = re.search(rf"\b{name[1]} *= *delay\(([^,()]+), *([^,()]+)\)", error.text) if name is not None else None
    if late is not None:
        yield error.replace(error.first, error.last, f"delay(der({late[1]}), {late[2]})")


def _own_sampling(error: WrongText) -> Iterator[Candidate]:
    """An `every` of its own, with the same period and without the delay, for what cannot be set late."""
    head = re.match(r"\s*every +(.+?) +(?:offset|delay|jitter|seed)\b", error.line)
    own = re.compile(rf"{re.escape(error.words)} *=[^;{{}}]*").search(error.text, error.start, error.end)
    if error.code != "BG177" or head is None or own is None:
        return
    behind = re.compile(r" *; *").match(error.text, own.end())
    indent = error.text[error.start : error.start + len(error.line) - len(error.line.lstrip())]
    offset = re.search(r"\boffset +\S+(?: +[A-Za-z]\w*)?", error.text[error.start : error.text.find("{", error.start)])
    words = f"every {head[1]}{f' {offset[0]}' if offset is not None else ''}"
    alone, title = f"{indent}{words} {{ {own[0].strip()} }}", f"Set `{error.words}` without delay"
    if (
        error.text[error.text.find("{", error.start) + 1 : error.end].strip(" }") == own[0].strip()
    ):  # nothing else is set there
        yield error.replace(error.start, error.end, alone, title)
        return
    kept = error.edit(own.start(), behind.end() if behind is not None else own.end(), "")
    yield title, (kept, error.edit(error.end, error.end, f"\n{alone}"))


def _lock_or_start(error: WrongText) -> Iterator[Candidate]:
    """A joint that is locked away from where it was drawn, without its `start`, or not locked."""
    if error.code == "BG201":
        for title, attribute in (("Leave out its `start`", r"start\b[^,{}]*?"), ("Unlock it", r"locked *=[^,{}]*?")):
            for match in re.finditer(rf", *{attribute}(?= *[,}}])|{attribute},\s*", error.line):
                yield error.replace_match(match, "", title)


RULES: tuple[Callable[[WrongText], Iterator[Candidate]], ...] = (
    _meant_words, _units, _signs, _brackets, _imports, _names, _arrows, _quoted_words, _same_name, _left_sides, _roles,
    _into_the_model, _missing_signs, _listed_names, _omissions, _sorted_points, _branches_of_a_rate, _own_sampling, _lock_or_start,
)  # fmt: skip
