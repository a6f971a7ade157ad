"""Parser of flat Modelica: lark reads; text that cannot be read, and classes that are no model, are refused with their places."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import lark
from lark.tree import Meta
from lark.visitors import Transformer_NonRecursive

from compiler.api import CompilationFailed, Diagnostic, Source, Span, printable

from .functions import ERRORS, number_of
from .tree import ComponentDeclaration, Term

MAXIMUM_SIZE = 4_000_000  # characters of one file
MAXIMUM_HEIGHT = 100  # of an expression, which the language bounds, too
FLATTEN = "Import takes flat models, as `instantiateModel` of OpenModelica or rumoca write them."
SCALARS = "Have arrays written item by item (`--baseModelicaOptions=scalarize`)."
_lock = threading.Lock()


class NotImported(Diagnostic):
    """BG801: Modelica that has no equal here."""

    code = "BG801"
    title = "{what}"
    advice = "{hint}"
    what: str
    hint: str


@dataclass(frozen=True, slots=True)
class OwnFunction:
    """A function of the file: what it takes and gives, and what its lines set, one after the other; first the defaults."""

    takes: list[str]
    gives: str
    lines: list[tuple[str, Term]]


@dataclass(slots=True)
class FlatModel:
    """A model as it was read, and what of it is refused so far. `equations`, `initial`: as the grammar has them; `experiment`: `StopTime`, …"""

    source: Source
    name: str = ""
    text: str = ""
    declared: dict[str, ComponentDeclaration] = field(default_factory=dict)
    equations: list[Term] = field(default_factory=list)
    initial: list[Term] = field(default_factory=list)
    experiment: dict[str, float] = field(default_factory=dict)
    functions: dict[str, OwnFunction] = field(default_factory=dict)
    problems: list[Diagnostic] = field(default_factory=list)

    def refuse(self, place: Term | tuple[int, int], what: str, hint: str = FLATTEN) -> None:
        """Note what cannot be imported."""
        start, end = place.place if isinstance(place, Term) else place
        self.problems.append(NotImported(Span(self.source, start, end), what, hint))

    def stop(self) -> None:
        """Raise `CompilationFailed` if something was refused."""
        if self.problems:
            raise CompilationFailed(self.problems)


class TooHigh(Exception):
    """An expression that is too high; its place."""


class TreeBuilder(Transformer_NonRecursive[lark.Token, Term]):  # brackets may be nested deep
    """Terms, rule by rule."""

    def __default__(self, data: str, children: list[Any], meta: Meta) -> Term:
        kind, words = str(data), [str(c) for c in children if isinstance(c, lark.Token)]
        parts = tuple(c for c in children if isinstance(c, Term))
        word = " ".join(words)
        if kind in ("sum", "product"):
            first = "" if len(words) == len(parts) else "+" if kind == "sum" else "*"
            word = first + "".join(words)
        elif kind == "call" and not words:
            word, parts = parts[0].word, parts[1:]
        elif kind == "name":
            word = "".join(c.word if isinstance(c, Term) else f".{_plain(c)}" for c in children)[1:]
        elif kind == "description":
            word = f'"{"".join(w[1:-1] for w in words[::2])}"'
        elif kind == "subscripts":
            word = f"[{','.join(p.word if p.kind == 'number' else ':' for p in parts)}]"
        if "." in word and kind in ("sum", "product", "power"):
            kind = "array"
        place = (0, 0) if meta.empty else (meta.start_pos, meta.end_pos)
        height = 1 + max((p.height for p in parts), default=0)
        if height > MAXIMUM_HEIGHT:
            raise TooHigh(place)
        return Term(kind, word, () if kind == "name" else parts, place, height)


def _plain(token: str) -> str:
    """An identifier without its quotation marks."""
    return re.sub(r"\\(.)", r"\1", token[1:-1]) if token[0] == "'" else token


def text_of(literal: str) -> str:
    """Return a text of Modelica as a description of the language."""
    plain = re.sub(r"\\(.)", r"\1", literal[1:-1], flags=re.DOTALL)
    return printable(" ".join(plain.split())).replace('"', "'").replace("\\", "/")


@cache
def _parser() -> lark.Lark:
    grammar = Path(__file__).with_name("flat_modelica.lark").read_text(encoding="utf-8")
    return lark.Lark(grammar, parser="lalr", lexer="basic", propagate_positions=True)


def parse(source: Source) -> FlatModel:
    """Return the model of a text. Raises `CompilationFailed` if it cannot be read."""
    model, text = FlatModel(source), source.text
    if len(text) > MAXIMUM_SIZE:
        model.refuse((0, 0), f"the file has {len(text)} characters; the limit is {MAXIMUM_SIZE}")
        model.stop()
    try:
        with _lock:
            root = TreeBuilder().transform(_parser().parse(text))
    except lark.exceptions.UnexpectedInput as problem:
        token = getattr(problem, "token", None)
        start = len(text) if token is not None and token.type == "$END" else problem.pos_in_stream or 0
        word = text[start : start + 1] if token is None else str(token)
        what = f"`{printable(word)[:40]}` is not expected here" if start < len(text) else "the text ends too early"
        model.refuse((start, start + len(word)), what)
    except TooHigh as problem:
        what = f"an expression is nested deeper than {MAXIMUM_HEIGHT}"
        model.refuse(problem.args[0], what, "Name its parts.")
    model.stop()
    _ModelReader(model).read_file(root.parts)
    return model


class _ModelReader:
    """Reader of the one model among classes."""

    def __init__(self, model: FlatModel) -> None:
        self.model = model
        self.aliases: dict[str, tuple[str, dict[str, Term]]] = {}

    def read_file(self, classes: Sequence[Term]) -> None:
        models = list(self._models(classes))
        for other in models[1:]:
            self.model.refuse(other.parts[0], "the file has another model")
        if not models:
            self.model.refuse((0, 0), "the file has no model")
            self.model.stop()
        name, *items, end = models[0].parts
        if end.word != name.word:
            self.model.refuse(end, f"`{printable(name.word)}` ends as `{printable(end.word)}`", "Write its name.")
        self.model.name = name.word
        self._read(items, frozenset())

    def _models(self, items: Iterable[Term]) -> Iterator[Term]:
        for item in items:
            if item.kind == "class" and item.word in ("model", "class", "block"):
                yield item
            elif item.kind == "class" and item.word == "package":
                yield from self._models(item.parts[1:-1])
            elif item.kind != "annotation":
                self._read([item], frozenset())

    def _is_function(self, item: Term) -> bool:
        """Read a function with one result whose lines set names; return False for another class."""
        parts = [p for part in item.parts[1:-1] for p in (part.parts if part.kind in ("protected", "public") else (part,))]  # fmt: skip
        declared = [(p.word, c) for p in parts if p.kind == "declared" for c in p.parts[1:]]
        lines = [(c.parts[0], c.of("value")) for _, c in declared]
        rows = [(name, value.parts[0]) for name, value in lines if value]
        statements = [s for p in parts if p.kind == "algorithm" for s in p.parts if s.kind != "annotation"]
        takes, gives = (
            [c.parts[0].word for word, c in declared if kind in word.split()] for kind in ("input", "output")
        )
        kinds = {p.kind for p in parts} | {s.kind for s in statements}
        if "function" not in item.word.split() or len(gives) != 1 or kinds - {"declared", "description", "annotation", "algorithm", "equal"}:  # fmt: skip
            return False
        rows += [(s.parts[0], s.parts[1]) for s in statements]
        if all(n.kind == "name" for n, _ in rows) and not any(s.parts[0].word in takes for s in statements):
            self.model.functions[item.parts[0].word] = OwnFunction(takes, gives[0], [(n.word, t) for n, t in rows])
            return True
        return False

    def _read(self, items: Iterable[Term], prefixes: frozenset[str]) -> None:
        model = self.model
        for item in items:
            if item.kind in ("public", "protected"):
                self._read(item.parts, frozenset({item.kind}))
            elif item.kind == "description":
                model.text = text_of(item.word)
            elif item.kind == "declared":
                for component in item.parts[1:]:
                    self._declare(frozenset(item.word.split()) | prefixes, item.parts[0], component)
            elif item.kind == "alias":
                self.aliases[item.parts[0].word] = self._type(item.parts[1], item.of("modifiers"))
            elif item.kind == "equations":
                equations = model.initial if item.word.startswith("initial") else model.equations
                equations += [e for e in item.parts if e.kind != "annotation"]
                self._read([e for e in item.parts if e.kind == "annotation"], prefixes)
            elif item.kind == "annotation":
                facts = _attributes(_attributes(item.parts[0]).get("experiment", Term("modifiers")))
                for name in facts.keys() & {"StartTime", "StopTime", "Tolerance"}:
                    try:
                        model.experiment[name] = number_of(facts[name])
                    except ERRORS:
                        model.refuse(facts[name], f"`{name}` is not a number here", "Write its value.")
            elif item.kind != "class" or not self._is_function(item):
                what = (
                    f"the {item.word} `{printable(item.parts[0].word)}`" if item.kind == "class" else f"`{item.kind}`"
                )
                model.refuse(item.parts[0] if item.parts else item, f"{what.replace('extended', 'import')} cannot be imported")  # fmt: skip

    def _type(self, reference: Term, modifiers: Term | None) -> tuple[str, dict[str, Term]]:
        kind, attributes = self.aliases.get(reference.word.partition("[")[0], (reference.word.partition("[")[0], {}))
        return kind, {**attributes, **(_attributes(modifiers) if modifiers else {})}

    def _declare(self, prefixes: frozenset[str], kind: Term, component: Term) -> None:
        model, reference, value = self.model, component.parts[0], component.of("value")
        name, shown = reference.word, printable(reference.word)
        basic, attributes = self._type(kind, component.of("modifiers"))
        if basic not in ("Real", "Integer", "Boolean"):
            model.refuse(
                kind, f"the type `{printable(kind.word)}` cannot be imported", "Real, Integer and Boolean can."
            )
        elif "[" in kind.word or ":" in name:
            model.refuse(component, f"the array `{shown}` is not flattened", SCALARS)
        if component.of("condition") or prefixes & {"inner", "outer", "stream"}:
            model.refuse(component, f"`{shown}` is conditional, `inner`, `outer` or a stream")
        if name in model.declared or name.startswith("der(") or name == "time":
            model.refuse(reference, f"`{shown}` is declared twice, or a name of another thing", "Give it another name.")
        text = component.of("description")
        model.declared[name] = ComponentDeclaration(
            name, basic, prefixes, attributes, value and value.parts[0], text_of(text.word) if text else "", reference.place
        )  # fmt: skip


def _attributes(modifiers: Term) -> dict[str, Term]:
    """Values by names; of what has modifiers these."""
    pairs = ((m.parts[0].word, m.of("value"), m.of("modifiers")) for m in modifiers.parts)
    return {name: value.parts[0] if value else inner for name, value, inner in pairs if value or inner}  # type: ignore[misc]
