"""Answers of the service in the protocol's types."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from lsprotocol import types

from ..language_service.answers import (
    CallUsage,
    Correction,
    InlineHint,
    Lens,
    LinkedDiagram,
    MarkedWord,
    OutlineNode,
    Suggestion,
    TextEdit,
    TextPlace,
    TextProblem,
)
from ..language_service.colours import CLASSES
from ..language_service.workspace import Workspace

SYMBOLS = {
    "model": types.SymbolKind.Class, "parameter": types.SymbolKind.Property, "constant": types.SymbolKind.Constant, "input": types.SymbolKind.Event,
    "output": types.SymbolKind.Field, "signal": types.SymbolKind.Variable, "mode": types.SymbolKind.Boolean, "port": types.SymbolKind.Interface,
    "element": types.SymbolKind.Struct, "junction": types.SymbolKind.Operator, "instance": types.SymbolKind.Object, "mechanism": types.SymbolKind.Namespace,
    "part": types.SymbolKind.Struct, "function": types.SymbolKind.Function, "experiment": types.SymbolKind.Method, "index": types.SymbolKind.Number,
    "solve": types.SymbolKind.Variable,
}  # fmt: skip
ITEMS = {
    "keyword": types.CompletionItemKind.Keyword, "kind": types.CompletionItemKind.Class, "domain": types.CompletionItemKind.Enum,
    "function": types.CompletionItemKind.Function, "unit": types.CompletionItemKind.Unit, "model": types.CompletionItemKind.Module,
    "parameter": types.CompletionItemKind.Property, "constant": types.CompletionItemKind.Constant, "port": types.CompletionItemKind.Interface,
    "element": types.CompletionItemKind.Struct, "junction": types.CompletionItemKind.Struct, "instance": types.CompletionItemKind.Struct,
    "file": types.CompletionItemKind.File, "library": types.CompletionItemKind.Module, "attribute": types.CompletionItemKind.Field,
}  # fmt: skip
TOKENS = {
    "kind": "class", "domain": "enum", "value": "keyword", "attribute": "property", "unit": "enumMember", "model": "class", "constant": "variable",
    "element": "variable", "instance": "variable", "port": "property", "text": "string",
}  # fmt: skip
TOKEN_TYPES = list(dict.fromkeys(TOKENS.get(kind, kind) for kind in CLASSES))
TOKEN_MODIFIERS = ["declaration", "readonly"]
UTF8, UTF16, UTF32 = "utf-8", "utf-16", "utf-32"


@dataclass(frozen=True, slots=True)
class Lines:
    """A text by lines; `encoding` is that in whose code units an editor counts columns."""

    text: str
    starts: tuple[int, ...]
    encoding: str

    def position(self, offset: int) -> tuple[int, int]:
        """Line and column, from 0, of a character."""
        offset = max(0, min(offset, len(self.text)))
        line = bisect_right(self.starts, offset) - 1
        return line, self._units(self.text[self.starts[line] : offset])

    def offset(self, line: int, column: int) -> int:
        """Character of a line and a column; the end of the line, or of the text, for one behind it."""
        if line >= len(self.starts):
            return len(self.text)
        start = self.starts[line]
        end = self.starts[line + 1] - 1 if line + 1 < len(self.starts) else len(self.text)
        if self.text[start:end].isascii() or self.encoding == UTF32:
            return min(start + column, end)
        at, units = start, 0
        while at < end and units < column:
            units += self._units(self.text[at])
            at += 1
        return at

    def _units(self, text: str) -> int:
        if text.isascii() or self.encoding == UTF32:
            return len(text)
        return len(text.encode("utf-8" if self.encoding == UTF8 else "utf-16-le")) // (
            1 if self.encoding == UTF8 else 2
        )


@lru_cache(64)
def lines_of(text: str, encoding: str) -> Lines:
    starts = [0]
    at = text.find("\n")
    while at >= 0:
        starts.append(at + 1)
        at = text.find("\n", at + 1)
    return Lines(text, tuple(starts), encoding)


class Converter:
    """Conversion of the answers on the files of a workspace; `encoding` is the editor's. `addresses`: of files as the editor writes them."""

    def __init__(self, workspace: Workspace, encoding: str) -> None:
        self.workspace, self.encoding = workspace, encoding
        self.addresses: dict[Path, str] = {}

    def lines(self, path: Path) -> Lines:
        """Lines of a file as it is now; of one that cannot be read, none."""
        try:
            return lines_of(self.workspace.project.document(path).text, self.encoding)
        except (OSError, UnicodeDecodeError):
            return lines_of("", self.encoding)

    def address(self, path: Path) -> str:
        return self.addresses.get(path.resolve()) or path.resolve().as_uri()

    def range(self, place: TextPlace) -> types.Range:
        lines = self.lines(place.path)
        return types.Range(types.Position(*lines.position(place.start)), types.Position(*lines.position(place.end)))

    def location(self, place: TextPlace) -> types.Location:
        return types.Location(self.address(place.path), self.range(place))

    def offset(self, path: Path, position: types.Position) -> int:
        return self.lines(path).offset(position.line, position.character)

    def diagnostic(self, problem: TextProblem) -> types.Diagnostic:
        """A problem with its advice in its message, and the related places."""
        related = [types.DiagnosticRelatedInformation(self.location(p), why) for p, why in problem.related]
        message = f"{problem.sentence}\n{problem.advice}" if problem.advice else problem.sentence
        severity = types.DiagnosticSeverity.Error
        return types.Diagnostic(
            self.range(problem.place), message, severity, problem.code, source="bondgraph", related_information=related
        )

    def edit(self, edit: TextEdit) -> types.TextEdit:
        return types.TextEdit(self.range(edit.place), edit.text)

    def changes(self, edits: Iterable[TextEdit]) -> types.WorkspaceEdit:
        by_address: dict[str, list[types.TextEdit]] = {}
        for edit in edits:
            by_address.setdefault(self.address(edit.place.path), []).append(self.edit(edit))
        return types.WorkspaceEdit(changes=by_address)

    def correction(self, correction: Correction, diagnostics: Sequence[types.Diagnostic]) -> types.CodeAction:
        mended = [d for d in diagnostics if d.code == correction.code]
        return types.CodeAction(
            correction.title, types.CodeActionKind.QuickFix, mended, edit=self.changes(correction.edits)
        )

    def item(self, suggestion: Suggestion, rank: int) -> types.CompletionItem:
        form = types.InsertTextFormat.Snippet if suggestion.is_snippet else types.InsertTextFormat.PlainText
        text = suggestion.documentation
        return types.CompletionItem(
            suggestion.label,
            kind=ITEMS.get(suggestion.kind, types.CompletionItemKind.Variable),
            detail=suggestion.detail or None,
            documentation=types.MarkupContent(types.MarkupKind.Markdown, text) if text else None,
            insert_text=suggestion.insert or None,
            insert_text_format=form,
            sort_text=f"{rank:05}",
            additional_text_edits=[self.edit(e) for e in suggestion.edits] or None,
        )

    def symbol(self, node: OutlineNode) -> types.DocumentSymbol:
        kind = SYMBOLS.get(node.kind, types.SymbolKind.Variable)
        children = [self.symbol(child) for child in node.children]
        place, name = self.range(node.place), self.range(node.name_place)
        return types.DocumentSymbol(node.name, kind, place, name, detail=node.detail or None, children=children)

    def workspace_symbol(self, node: OutlineNode) -> types.WorkspaceSymbol:
        kind = SYMBOLS.get(node.kind, types.SymbolKind.Variable)
        return types.WorkspaceSymbol(
            self.location(node.name_place), node.name, kind, container_name=node.place.path.name
        )

    def hint(self, hint: InlineHint, path: Path) -> types.InlayHint:
        line, column = self.lines(path).position(hint.at)
        kind = types.InlayHintKind.Parameter if hint.is_unit else types.InlayHintKind.Type
        return types.InlayHint(
            types.Position(line, column), hint.text, kind, tooltip=hint.why or None, padding_right=not hint.is_unit
        )

    def lens(self, lens: Lens) -> types.CodeLens:
        """A lens; `bondgraph.terminal` takes words of the command line, `bondgraph.diagram` the file."""
        name, arguments = ("terminal", lens.words) if lens.words else ("diagram", (self.address(lens.place.path),))
        command = types.Command(lens.title, f"bondgraph.{name}", arguments=list(arguments))
        return types.CodeLens(self.range(lens.place), command)

    def diagram(self, drawn: LinkedDiagram) -> dict[str, Any]:
        """A diagram as `bondgraph/diagram` answers it."""
        parts = [{"id": i, "locations": [self.location(p) for p in places]} for i, places in drawn.parts.items()]
        return {"model": drawn.model, "svg": drawn.svg, "parts": parts}

    def tokens(self, words: Iterable[MarkedWord], path: Path) -> types.SemanticTokens:
        """Words as differences of lines and columns, five numbers for each."""
        lines = self.lines(path)
        data, last_line, last_column = list[int](), 0, 0
        for word in words:
            line, column = lines.position(word.start)
            length = lines.position(word.end)[1] - column
            kind = TOKEN_TYPES.index(TOKENS.get(word.kind, word.kind))
            modifiers = int(word.is_definition) + 2 * (word.kind in ("constant", "parameter"))
            data += [line - last_line, column - last_column * (line == last_line), length, kind, modifiers]
            last_line, last_column = line, column
        return types.SemanticTokens(data)


def signature(usage: CallUsage) -> types.SignatureHelp:
    """The usage of a call with the argument at the cursor."""
    arguments = [types.ParameterInformation(a) for a in usage.arguments]
    information = types.SignatureInformation(usage.label, usage.documentation or None, arguments)
    return types.SignatureHelp([information], 0, min(usage.active, max(0, len(arguments) - 1)))
