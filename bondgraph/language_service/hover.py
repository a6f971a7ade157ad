"""Texts about the word at a place: what it is, its unit and value, its law, its strokes and why; and the usage of a function."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

from compiler import api
from compiler.api import file_names, tree

from .answers import CallUsage, HoverText
from .completion import place_at
from .context import WORD
from .facts import author_unit, domain_line, number, ports, quantity_line, stroke_lines
from .vocabulary import FUNCTION_TEXTS, JUNCTIONS, KEYWORDS, USAGES, kind_text
from .workspace import Workspace, place_of

QUANTITIES = frozenset({"parameter", "constant", "input", "output", "signal", "mode", "solve"})
MOST_PARAMETERS = 16
_ARGUMENT = re.compile(r"(?:[^,()]|\([^()]*\))+")


def hover(workspace: Workspace, path: Path, at: int) -> HoverText | None:
    """Return a text about the word at a character; None where there is nothing to say."""
    document, survey = workspace.names(path, complete=True)
    occurrence = workspace.occurrence_at(path, at)
    if occurrence is not None:
        lines = list(_lines(workspace, path, occurrence, survey))
        if lines:
            return HoverText(place_of(occurrence.span), "\n\n".join(lines))
    for match in WORD.finditer(document.text, document.text.rfind("\n", 0, at) + 1):
        if match.start() > at:
            break
        text = _word_text(match[0]) if at <= match.end() and match.lastgroup in ("name", "number") else ""
        if text:
            place = place_of(api.Span(document.tree.source, match.start(), match.end()))
            return HoverText(place, text)
    return None


def _word_text(word: str) -> str:
    """A sentence on a word of the language."""
    keyword = next((k for k in KEYWORDS if k.word == word), None)
    if keyword is not None:
        return f"**{word}**\n\n{keyword.text}"
    text = kind_text(word)
    if text:
        return f"**{word}**\n\n{text}"
    return _domain_text(word)


def _domain_text(word: str) -> str:
    domain = api.DOMAINS.get(word)
    if domain is None:
        return ""
    return f"**{word}**, a domain\n\n{domain_line(domain, 'efqp' if domain.letters[3] else 'efq')}"


def _lines(workspace: Workspace, path: Path, occurrence: api.NameUse, survey: api.FileSurvey) -> Iterator[str]:
    name = occurrence.name
    if name is None:
        yield from filter(None, [_builtin(occurrence, survey)])
    elif name.kind in QUANTITIES:
        yield from _quantity(name, occurrence, survey)
    elif name.kind in ("element", "junction", "part"):
        yield from _element(workspace, path, name, occurrence, survey)
    elif name.kind == "instance":
        model = api.model_of(name, survey.file)
        yield f"**{name.type} {name.name}**{_described(name)}"
        if model is not None:
            yield from _model_lines(model.model)
    elif name.kind == "model" and isinstance(name.node, tree.ModelSyntax):
        yield f"**model {name.name}**"
        yield from _model_lines(name.node)
    elif name.kind == "function" and isinstance(name.node, tree.FunctionSyntax):
        yield f"`{name.name}({', '.join(name.node.parameters)}) = {name.node.body.span.words}`"
    else:
        yield f"**{name.kind} {name.name}**{f' : {name.type}' if name.type else ''}{_described(name)}"


def _described(name: api.DeclaredName) -> str:
    return f" — {name.description}" if name.description else ""


def _quantity(name: api.DeclaredName, occurrence: api.NameUse, survey: api.FileSurvey) -> Iterator[str]:
    yield f"**{name.kind} {name.name}**{_described(name)}"
    reading = occurrence.reading or name.name
    value = quantity_line(name, survey, occurrence.home, reading)
    own = name.owner[0] if name.owner else ""
    if not value and own in survey.models:
        value = quantity_line(name, survey, own, name.name)
    if value:
        yield value
    elif (unit := author_unit(name.node)) is not None:
        yield "a text" if unit.span.words == "text" else f"in {unit.span.words}"
    if isinstance(name.node, tree.Item) and name.node.value is not None:
        yield f"`{name.name} = {name.node.value.span.words}`"


def _element(
    workspace: Workspace, path: Path, name: api.DeclaredName, occurrence: api.NameUse, survey: api.FileSurvey
) -> Iterator[str]:
    node = name.node
    assert isinstance(node, tree.Declaration)
    yield f"**{name.type} {name.name}**{_described(name)}"
    own = name.owner[0] if name.owner else occurrence.home
    domains = ports(survey, own, name.name)
    for port, domain in domains.items():
        row = api.ELEMENTS.get(name.type)
        letters = row.readable if row is not None and len(domains) == 1 else {"0": "e", "1": "f"}.get(name.type, "ef")
        yield f"{f'port `{port}`, ' if port else ''}{domain.name}: {domain_line(domain, letters)}"
    if isinstance(node.definition, tree.LawSyntax) or (node.definition is not None and name.kind == "part"):
        yield f"`{node.definition.span.words}`"
    if name.kind == "junction" and name.type in JUNCTIONS:
        yield JUNCTIONS[name.type]
    yield from stroke_lines(name, survey.main, workspace.strokes(path))


def _model_lines(model: tree.ModelSyntax) -> Iterator[str]:
    if text := api.first_text(model.statements):
        yield text
    names = list(api.table_of(model).values())
    listed = [n for n in names if n.kind in ("port", "parameter", "input", "output")]
    rows = []
    for one in listed[:MOST_PARAMETERS]:
        value = one.node.value if isinstance(one.node, tree.Item) else None
        shown = f" = {value.span.words}" if value is not None and one.kind in ("parameter", "input") else ""
        rows.append(f"- {one.kind} `{one.name}{f': {one.type}' if one.type else ''}{shown}`{_described(one)}")
    if rows:
        yield "\n".join(rows)


def _builtin(occurrence: api.NameUse, survey: api.FileSurvey) -> str:
    """A text on a word that no one declares: a unit, a function, a letter of a law."""
    word = occurrence.span.text
    if occurrence.kind == "unit" and word in api.UNITS:
        unit = api.UNITS[word]
        si = "1" if str(unit.dimension) == "1" else str(unit.dimension)
        zero = f", zero at {number(float(unit.offset))} K" if unit.offset else ""
        return f"**{word}** = {number(unit.to_si(Fraction(1)) - float(unit.offset))} {si}{zero}"
    if occurrence.kind == "function" and word in USAGES:
        text = FUNCTION_TEXTS.get(word, "")
        return f"`{USAGES[word]}`" + (f"\n\n{text}" if text else "")
    if occurrence.kind == "variable":
        return _variable(occurrence, survey)
    return _word_text(word)


def _variable(occurrence: api.NameUse, survey: api.FileSurvey) -> str:
    """A text on a letter that is read of an element, `spring.x`."""
    owner, _, letter = occurrence.reading.rpartition(".")
    domains = ports(survey, occurrence.home, owner) if owner else {}
    words = {"e": "effort", "f": "flow", "q": "displacement", "p": "momentum"}
    for domain in domains.values():
        variable = domain.variable(letter)
        if variable is not None:
            return f"**{occurrence.reading}**, the {words[variable]} in {domain.dimension(variable)}"
    return ""


def call_usage(workspace: Workspace, path: Path, at: int) -> CallUsage | None:
    """Return the call around a character, with the argument that is written there; None outside of calls."""
    place = place_at(workspace, path, at)
    words = place.context.statement
    for opening in reversed(place.context.brackets):
        name = words[opening - 1].text if opening else ""
        function = place.names.get(name) or file_names(place.file).get(name)
        usage = USAGES.get(name, "")
        if function is not None and isinstance(function.node, tree.FunctionSyntax):
            usage = f"{name}({', '.join(function.node.parameters)})"
        if words[opening].text == "(" and usage:
            inside = usage[len(name) + 1 : -1]
            arguments = tuple(a.strip() for a in _ARGUMENT.findall(inside))
            return CallUsage(
                usage, arguments, _commas(place.context.statement[opening + 1 :]), FUNCTION_TEXTS.get(name, "")
            )
    return None


def _commas(words: tuple[object, ...]) -> int:
    """Commas that are in no inner brackets."""
    depth = count = 0
    for word in words:
        sign = getattr(word, "text", "")
        depth += (sign in ("(", "[")) - (sign in (")", "]"))
        count += sign == "," and not depth
    return count
