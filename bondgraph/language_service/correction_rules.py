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


def _line(text: str, at: int) -> tuple[int, int]:
    """First character of the line at a place, and the one behind its last."""
    start = text.rfind("\n", 0, at) + 1
    end = text.find("\n", at)
    return start, len(text) if end < 0 else end


def _replace(path: Path, start: int, end: int, new: str, title: str = "") -> Candidate:
    return title or (f"Write `{new.strip()}`" if new else "Remove it"), (TextEdit(TextPlace(path, start, end), new),)


def _meant_words(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """The name that is close to a misspelled one: in the last place of the span that has it."""
    meant = MEANT.search(item.help)
    wrong = _QUOTED.search(item.sentence)
    if meant is None or wrong is None:
        return
    place = place_of(item.span)
    old = getattr(item, "name", "") or getattr(item, "kind", "") or wrong[1]
    for word in dict.fromkeys((old, old.rpartition(".")[2], text[place.start : place.end], wrong[1])):
        use = re.compile(rf"(?<![\w]){re.escape(word)}(?![\w])")
        uses = list(use.finditer(text, place.start, place.end)) or list(use.finditer(text, *_line(text, place.start)))
        for new in _QUOTED.findall(meant[1]) if uses else ():
            yield _replace(path, *uses[-1].span(), new)


def _units(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """The unit that a number needs, behind each bare number of the span, or in place of its unit."""
    unit = _UNIT.search(item.help)
    if unit is None or item.code != "BG103":
        return
    place = place_of(item.span)
    for match in re.finditer(
        r"(?<![\w.^])\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(\s*\[[^]]*\]|\s*[A-Za-z%]\w*(?:[*/^][\w^]+)*)?",
        text[place.start : place.end],
    ):
        number = match[0][: len(match[0]) - len(match[1] or "")]
        start, symbol = place.start + match.start(), _with_prefixes(unit[1][1:-1], match[1] or "")
        if symbol:
            new = symbol if symbol.isidentifier() else f"[{symbol}]"
            yield _replace(path, start, start + len(match[0]), f"{number} {new}")


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


def _quoted_words(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """Words that the advice says to write: in place of the span, of the same word in other letters, or of the statement."""
    if MEANT.search(item.help):
        return
    place = place_of(item.span)
    start, end = _line(text, place.start)
    statement = text[start:end].partition("#")[0]
    first = start + len(statement) - len(statement.lstrip())
    last = start + len(statement.rstrip())
    old = text[place.start : place.end]
    written = _TO_WRITE.findall(item.help) if item.code != "BG134" else []
    for new in dict.fromkeys([*written, *(q for q in _QUOTED.findall(item.help) if item.code < "BG1")]):
        if not _is_made_of(new, statement, old) or (item.code > "BG103" and _numbers_change(new, statement)):
            continue
        is_word, was_word = (_TOKEN.fullmatch(w) is not None for w in (new, old))
        is_language = was_word and _LANGUAGE.issuperset(_TOKEN.findall(new))
        if (is_word == was_word and (is_word or item.code > "BG1")) or new.startswith(f"{old}.") or is_language:
            yield _replace(path, place.start, place.end, new)
        if " " in new:
            if item.code < "BG1" or set(_TOKEN.findall(statement)) <= set(_TOKEN.findall(new)):
                yield _replace(path, first, last, new)
            continue
        word = re.compile(rf"\b{re.escape(new)}\b", re.IGNORECASE).search(text, start, end)
        if word is not None:
            yield _replace(path, *word.span(), new)


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
    (r"\bto\b", "..", ".."),
    (r"\bplot\b", "report", "`report"),
    (r"\brun\b", "simulate", "`simulate"),
    (r"\bas\b", "in", "in "),
    (r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]", "", "It cannot be seen"),
)


def _signs(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    start, end = _line(text, place_of(item.span).start)
    line = text[start:end]
    for pattern, new, advice in _SIGNS:
        if advice in item.help and item.code < "BG110":
            uses = list(re.finditer(pattern, line))
            for match in uses:
                yield _replace(path, start + match.start(), start + match.end(), match.expand(new))
            if len(uses) > 1:
                yield _replace(path, start, end, re.sub(pattern, new, line), f"Write `{new}` throughout")


_SEVERAL = re.compile(r"(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)\s+([A-Za-z]\w*)((?:\s+[A-Za-z]\w*)+)")


def _brackets(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """A unit of several symbols in brackets; a bracket that is never closed; a unit that is a product."""
    place = place_of(item.span)
    start, end = _line(text, place.start)
    if "stands in brackets" in item.help:
        for match in _SEVERAL.finditer(text, start, end):
            unit = "*".join([match[2], *match[3].split()])
            yield _replace(path, *match.span(), f"{match[1]} [{unit}]")
    if item.code == "BG102" and "in brackets: `[" in item.help:
        yield _replace(path, place.start, place.end, item.help.partition("`")[2].partition("`")[0])
    if item.code == "BG007":
        partner = item.help.partition("`")[2][:1]
        if partner == "}":
            at = _end_of_block(text, start)
            indent = re.match(r"[ \t]*", text[start:end])
            line_break = "" if text[:at].endswith("\n") else "\n"
            yield _replace(path, at, at, f"{line_break}{indent[0] if indent else ''}}}\n", "Close it with `}`")
        last = start + len(text[start:end].partition("#")[0].rstrip())
        yield _replace(path, last, last, partner, f"Close it with `{partner}`")


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


def _imports(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """The import of a part of the library that the advice names, or of one that has the name of an unknown kind."""
    named = re.search(r"import (\w+) from (\w+)", item.help)
    document = workspace.project.document(path)
    place = place_of(item.span)
    if named is not None:
        edits = import_edits(document, named[1], named[2])
        yield f"Import `{named[1]}` from {named[2]}", edits
        word = re.match(r"\w+", text[place.start :])
        if word is not None and word[0] != named[1]:
            spelled = TextEdit(TextPlace(path, place.start, place.start + len(word[0])), named[1])
            yield f"Import `{named[1]}` from {named[2]}", (*edits, spelled)
    if "outside of models" in item.help and text[_line(text, place.start)[0] :].lstrip().startswith("import"):
        start, end = _line(text, place.start)
        moved = TextEdit(TextPlace(path, 0, 0), text[start:end].strip() + "\n")
        yield (
            "Move the import to the top of the file",
            (moved, TextEdit(TextPlace(path, start, min(end + 1, len(text))), "")),
        )


def _names(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """Another name where one is taken or reserved; a kind without its M; an attribute that is left out."""
    place = place_of(item.span)
    word = re.match(r"[A-Za-z_]\w*", text[place.start : place.end])
    if item.code in ("BG104", "BG134") and word is not None:
        new = f"{word[0]}_2"
        yield _replace(path, place.start, place.start + len(word[0]), new, f"Rename it to `{new}`")
    if item.code in ("BG117", "BG118") and word is not None:
        kinds = re.findall(r"`(M?[A-Z][A-Za-z]*)\b", item.help)
        statement = _line(text, place.start)[0]
        first = re.compile(r"\s*([A-Za-z]+)\b").match(text, statement)
        for new in kinds if first is not None else ():
            assert first is not None
            yield _replace(path, *first.span(1), new)
    required = re.search(r"[Ll]eave out (?:the|its) `(require|prefer)` of `([\w.]+)`|remove its `(require)`", item.help)
    if required is not None:
        attribute, owner = required[1] or required[3], (required[2] or "").rpartition(".")[2]
        for match in re.finditer(
            rf"\s*\{{\s*{attribute}\s*=\s*\w+\s*\}}|,\s*{attribute}\s*=\s*\w+|{attribute}\s*=\s*\w+\s*,\s*", text
        ):
            start, _ = _line(text, match.end())
            if not owner or re.search(rf"\b{owner}\b", text[start : match.start()]):
                yield _replace(path, *match.span(), "", f"Leave out `{attribute}`")


def _arrows(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """A bond with its ends exchanged; a multibond's arrow."""
    if item.code != "BG121" or not re.search(r"\b(?:[Tt]urn|[Aa]rrow|=>|multibond)", f"{item.sentence} {item.help}"):
        return
    start, end = _line(text, place_of(item.span).start)
    line = text[start:end]
    for match in re.finditer(r"([\w.\[\]]+)(\s*->\s*)([\w.\[\]]+)", line):
        yield _replace(
            path, start + match.start(), start + match.end(), f"{match[3]}{match[2]}{match[1]}", "Turn the arrow"
        )
    if "`=>`" in item.help or "`->`" in item.help:
        for old, new in (("->", "=>"), ("=>", "->")):
            if old in line:
                yield _replace(path, start, end, line.replace(old, new), f"Write `{new}`")


_GIVES_NAMES = re.compile(
    r"\b(?:It has|Its [a-z ]+|[A-Za-z ]+:|can name:) ?((?:[a-z_]\w*(?:, )?)+)[.;:]", re.IGNORECASE
)
MOST_NAMES = 6  # of a list in an advice that are tried


def _listed_names(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """One of the few names that the advice lists, in place of the last word of the span that the sentence has."""
    listed = _GIVES_NAMES.search(item.help)
    names = listed[1].split(", ") if listed is not None and item.code == "BG101" else []
    wrong = [word.rpartition(".")[2] for word in _QUOTED.findall(item.sentence)]
    place = place_of(item.span)
    uses = [m for m in _TOKEN.finditer(text, place.start, place.end) if m[0] in wrong]
    for name in names if uses and len(names) <= MOST_NAMES else ():
        yield _replace(path, *uses[-1].span(), name)


_OMISSION = re.compile(
    r"\b[Ll]eave (?:it|the others|one|one of the two|one bond of the ring) out\b|\bleave it out|[Ll]eave out one|\bRemove it\b|Set it once|Write one,"
    r"|Put all that|[A-Za-z`]+ has:|has `active`, once|needs no name|are set once|not needed is left out"
)


def _omissions(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """The text without what should not be there: an attribute, alone with its braces, a statement or the line. The smallest that mends is offered."""
    if _OMISSION.search(item.help) is None:
        return
    place = place_of(item.span)
    start, end = _line(text, place.start)
    if "the others" in item.help:
        for comma in re.finditer(r", *", text[place.start : place.end]):
            yield _replace(path, place.start + comma.start(), place.end, "", "Leave out the rest")
            yield _replace(path, place.start, place.start + comma.end(), "", "Leave out the first")
        return
    behind = re.compile(r" *[;,] *").match(text, place.end)
    if behind is not None:
        yield _replace(path, place.start, behind.end(), "", "Leave it out")
    before = re.compile(r"(?:[;,]| *\{(?= *[^{}]*\})) *$|\s+$").search(text, start, place.start)
    first = before.start() if before is not None else place.start
    closed = re.compile(r" *\}").match(text, place.end)
    opens = before is not None and "{" in before[0]
    last = closed.end() if opens and closed is not None else place.end
    if text[start:first].strip() or text[last:end].strip():
        yield _replace(path, first, last, "", "Leave it out")
    statement = max(text.rfind(";", start, place.start) + 1, start)
    ends = [at for at in (text.find(";", place.end, end), end) if at >= 0]
    if (statement, min(ends)) != (start, end):
        yield _replace(path, statement, min(ends), "", "Leave it out")
    yield _replace(path, start, min(end + 1, len(text)), "", "Leave it out")


def _same_name(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """A name that the error quotes, in place of the same one in other letters."""
    place = place_of(item.span)
    for word in _TOKEN.finditer(text, place.start, place.end):
        for new in _QUOTED.findall(f"{item.sentence} {item.help}"):
            if new != word[0] and new.lower() == word[0].lower():
                yield _replace(path, *word.span(), new)


def _left_sides(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """`name = …` of the advice, with what the author has behind `=`."""
    place = place_of(item.span)
    start, end = _line(text, place.start)
    for new in re.findall(r"`([^`=]+= )…`", item.help):
        first = new.split()[0]
        old = re.compile(
            rf"(?:\b{first}\s+)?{re.escape(text[place.start : place.end].partition('=')[0].strip())}\s*= ?"
        )
        for match in old.finditer(text, start, end):
            yield _replace(path, *match.span(), new, f"Write `{new}…`")


def _roles(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """Another first word of the statement that declares a name: `declared as `signal``. It holds for all names of a statement, so it has one."""
    role = re.search(r"declared? (?:it )?as `(signal|parameter|input)`", item.help)
    if role is None:
        return
    own = _TOKEN.findall(item.span.text)[:1]
    names = [*own, *(word for word in _QUOTED.findall(item.sentence) if _TOKEN.fullmatch(word))]
    for name in dict.fromkeys(names):
        for match in re.finditer(rf"^ *(parameter|constant) +{name}\b[^,\n]*$", text, re.MULTILINE):
            yield _replace(path, *match.span(1), role[1], f"Declare `{name}` as `{role[1]}`")


def _into_the_model(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """A statement that belongs into a model, at the beginning of the next one, or of the one before."""
    if "belongs into a model" not in item.help:
        return
    start, end = _line(text, place_of(item.span).start)
    models = list(re.finditer(r"^(?:plain +)?model +\w+ *\{ *\n", text, re.MULTILINE))
    after = [m for m in models if m.start() >= end]
    for model in (after[:1] or models[-1:]) if text[start:end].count("{") == text[start:end].count("}") else []:
        moved = TextEdit(TextPlace(path, model.end(), model.end()), f"  {text[start:end].strip()}\n")
        yield "Move it into the model", (moved, TextEdit(TextPlace(path, start, min(end + 1, len(text))), ""))


def _missing_signs(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """The operator or the comma that is missing before a word."""
    if item.help.startswith("Is an operator, a comma"):
        at = place_of(item.span).start
        first = at - (len(text[:at]) - len(text[:at].rstrip(" ")))
        yield _replace(path, first, at, "*", "Write `*` between them")
        yield _replace(path, first, at, ", ", "Write `,` between them")


def _sorted_points(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """The points of a table in the order of their places, where all are written out and no place stands twice."""
    place = place_of(item.span)
    lists = re.compile(r"\(([^()]+)\), *\(([^()]+)\)").match(text, place.start)
    if lists is None or "Sort the points" not in item.help:
        return
    places, values = ([cell.strip() for cell in lists[k].split(",")] for k in (1, 2))
    numbers = [re.fullmatch(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)(.*)", one) for one in places]
    keys = [(float(match[1]), match[2].strip()) for match in numbers if match is not None]
    if len(keys) == len(places) == len(values) and len({unit for value, unit in keys if value}) == 1:
        order = sorted(range(len(places)), key=lambda i: keys[i][0])
        edits = ((1, places), (2, values))
        yield (
            "Sort the points",
            tuple(TextEdit(TextPlace(path, *lists.span(k)), ", ".join(cells[i] for i in order)) for k, cells in edits),
        )


def _branches_of_a_rate(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """`der(a if on else b)` as the choice of two rates; the rate of what is delayed as the delayed rate."""
    if item.code != "BG506":
        return
    place = place_of(item.span)
    choice = re.fullmatch(r"der\(([^()]+) if ([^()]+) else ([^()]+)\)", item.span.text)
    if choice is not None:
        yield _replace(path, place.start, place.end, f"(der({choice[1]}) if {choice[2]} else der({choice[3]}))")
    name = re.fullmatch(r"der\((\w+)\)", item.span.text)
    late = re.search(rf"\b{name[1]} *= *delay\(([^,()]+), *([^,()]+)\)", text) if name is not None else None
    if late is not None:
        yield _replace(path, place.start, place.end, f"delay(der({late[1]}), {late[2]})")


def _own_sampling(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """An `every` of its own, with the same period and without the delay, for what cannot be set late."""
    place = place_of(item.span)
    start, end = _line(text, place.start)
    head = re.match(r"\s*every +(.+?) +(?:offset|delay|jitter|seed)\b", text[start:end])
    own = re.compile(rf"{re.escape(item.span.text)} *=[^;{{}}]*").search(text, start, end)
    if item.code != "BG177" or head is None or own is None:
        return
    behind = re.compile(r" *; *").match(text, own.end())
    indent = text[start : start + len(text[start:end]) - len(text[start:end].lstrip())]
    offset = re.search(r"\boffset +\S+(?: +[A-Za-z]\w*)?", text[start : text.find("{", start)])
    words = f"every {head[1]}{f' {offset[0]}' if offset is not None else ''}"
    if text[text.find("{", start) + 1 : end].strip(" }") == own[0].strip():  # nothing else is set there
        yield _replace(
            path, start, end, f"{indent}{words} {{ {own[0].strip()} }}", f"Set `{item.span.text}` without delay"
        )
        return
    kept = TextEdit(TextPlace(path, own.start(), behind.end() if behind is not None else own.end()), "")
    added = TextEdit(TextPlace(path, end, end), f"\n{indent}{words} {{ {own[0].strip()} }}")
    yield f"Set `{item.span.text}` without delay", (kept, added)


def _lock_or_start(workspace: Workspace, path: Path, text: str, item: Diagnostic) -> Iterator[Candidate]:
    """A joint that is locked away from where it was drawn, without its start, or not locked."""
    if item.code == "BG201":
        start, end = _line(text, place_of(item.span).start)
        for title, attribute in (("Leave out its `start`", r"start\b[^,{}]*?"), ("Unlock it", r"locked *=[^,{}]*?")):
            for match in re.finditer(rf", *{attribute}(?= *[,}}])|{attribute},\s*", text[start:end]):
                yield _replace(path, start + match.start(), start + match.end(), "", title)


RULES: tuple[Callable[[Workspace, Path, str, Diagnostic], Iterator[Candidate]], ...] = (
    _meant_words, _units, _signs, _brackets, _imports, _names, _arrows, _quoted_words, _same_name, _left_sides, _roles,
    _into_the_model, _missing_signs, _listed_names, _omissions, _sorted_points, _branches_of_a_rate, _own_sampling, _lock_or_start,
)  # fmt: skip
