"""Server of the protocol: each request is one call of the language service. `pygls` reads and writes the messages."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from cattrs import transform_error
from lsprotocol import types
from pygls.exceptions import JsonRpcException, JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer
from pygls.protocol import LanguageServerProtocol
from pygls.uris import to_fs_path

from ..language_service.colours import marked_words
from ..language_service.completion import completion
from ..language_service.corrections import corrections
from ..language_service.diagram import diagram
from ..language_service.hints import inline_hints
from ..language_service.hover import call_usage, hover
from ..language_service.navigation import definition, references, rename, rename_place, workspace_symbols
from ..language_service.outline import folds, lenses, outline
from ..language_service.workspace import Workspace, formatted, problems
from ..version import VERSION
from .conversions import TOKEN_MODIFIERS, TOKEN_TYPES, Converter, signature

PAUSE = 0.3  # s without a key press after which large models are looked at


class AnsweringProtocol(LanguageServerProtocol):  # type: ignore[misc]
    """Protocol in which each request has an answer; the error is also told to the reader of the log."""

    def structure_message(self, data: dict[str, Any]) -> Any:
        """Return a message as an object. `json` calls this for each object within it too, which have no `id` and `method`."""
        try:
            return super().structure_message(data)
        except JsonRpcException as problem:
            if "id" in data and "method" in data:
                why = "; ".join(transform_error(problem.__cause__)) if problem.__cause__ is not None else str(problem)
                refused = JsonRpcInvalidParams(f"The parameters of {data['method']} cannot be read: {why}")
                self._send_response(data["id"], error=refused.to_response_error())
            raise


class EditorSession:
    """One editor: its files, and the diagnostics that it shows."""

    def __init__(self) -> None:
        self.server = LanguageServer(
            "bondgraph",
            VERSION,
            text_document_sync_kind=types.TextDocumentSyncKind.Incremental,
            protocol_cls=AnsweringProtocol,
        )
        self.workspace = Workspace()
        self.convert = Converter(self.workspace, "utf-16")
        self.changes = 0
        self.refreshes_hints = False
        self.shown: dict[Path, set[str]] = {}  # addresses at which errors of a file are shown
        for name, (handler, options) in _features(self).items():
            self.server.feature(name, options)(partial(handler))  # it marks what it is given, which a method forbids

    def path(self, address: str) -> Path:
        """File of an address; of a text that has no file yet, one of its name in the current folder."""
        path = Path(to_fs_path(address) or address.rpartition(":")[2]).resolve()
        self.convert.addresses[path] = address
        return path

    # ------------------------------------------------------------ texts
    def begin(self, parameters: types.InitializedParams) -> None:
        """Take the folders of the editor, and the unit in which it counts columns."""
        paths = [to_fs_path(folder) for folder in self.server.workspace.folders]
        self.workspace.folders += [Path(p).resolve() for p in paths if p]
        encoding = self.server.server_capabilities.position_encoding
        self.convert.encoding = str(getattr(encoding, "value", encoding) or "utf-16")
        offered = self.server.client_capabilities.workspace
        hints = None if offered is None else offered.inlay_hint
        self.refreshes_hints = hints is not None and bool(hints.refresh_support)

    async def opened(self, parameters: types.DidOpenTextDocumentParams) -> None:
        await self._changed(parameters.text_document.uri)

    async def changed(self, parameters: types.DidChangeTextDocumentParams) -> None:
        await self._changed(parameters.text_document.uri)

    async def _changed(self, address: str) -> None:
        """Tell the errors that are answer at once; after a pause those of large models, and of files that import this one."""
        self.changes += 1
        change, path = self.changes, self.path(address)
        self.workspace.open(path, self.server.workspace.get_text_document(address).source)
        if not self.publish(path, complete=False) or len(self.workspace.project.open_texts) > 1:
            await asyncio.sleep(PAUSE)
            if change == self.changes:
                self.publish_all()
                if self.refreshes_hints:  # strokes are known now
                    self.server.workspace_inlay_hint_refresh(None)

    def publish_all(self) -> None:
        for path in list(self.workspace.project.open_texts):
            self.publish(path, complete=True)

    def publish(self, path: Path, complete: bool) -> bool:
        """Show the errors of a file where they are; return whether these are all."""
        answer, is_complete = problems(self.workspace, path, complete)
        by_address: dict[str, list[types.Diagnostic]] = {self.convert.address(path): []}
        for problem in answer:
            by_address.setdefault(self.convert.address(problem.place.path), []).append(self.convert.diagnostic(problem))
        for address in self.shown.get(path, set()) - by_address.keys():
            by_address[address] = []
        self.shown[path] = {address for address, listed in by_address.items() if listed}
        for address, listed in by_address.items():
            self.server.text_document_publish_diagnostics(types.PublishDiagnosticsParams(address, listed))
        return is_complete

    def saved(self, parameters: types.DidSaveTextDocumentParams) -> None:
        self.publish_all()

    def closed(self, parameters: types.DidCloseTextDocumentParams) -> None:
        path = self.path(parameters.text_document.uri)
        self.workspace.close(path)
        for address in self.shown.pop(path, set()):
            self.server.text_document_publish_diagnostics(types.PublishDiagnosticsParams(address, []))

    # ------------------------------------------------------------ requests
    def at(self, parameters: Any) -> tuple[Workspace, Path, int]:
        """The workspace, the file and the character of a request."""
        path = self.path(parameters.text_document.uri)
        return self.workspace, path, self.convert.offset(path, parameters.position)

    def hover(self, parameters: types.HoverParams) -> types.Hover | None:
        answer = hover(*self.at(parameters))
        if answer is None:
            return None
        content = types.MarkupContent(types.MarkupKind.Markdown, answer.text)
        return types.Hover(content, self.convert.range(answer.place))

    def definition(self, parameters: types.DefinitionParams) -> types.Location | None:
        place = definition(*self.at(parameters))
        return None if place is None else self.convert.location(place)

    def references(self, parameters: types.ReferenceParams) -> list[types.Location]:
        places = references(*self.at(parameters), parameters.context.include_declaration)
        return [self.convert.location(p) for p in places]

    def highlights(self, parameters: types.DocumentHighlightParams) -> list[types.DocumentHighlight]:
        workspace, path, at = self.at(parameters)
        return [
            types.DocumentHighlight(self.convert.range(p)) for p in references(workspace, path, at) if p.path == path
        ]

    def prepare_rename(self, parameters: types.PrepareRenameParams) -> types.Range | None:
        place = rename_place(*self.at(parameters))
        return None if place is None else self.convert.range(place)

    def rename(self, parameters: types.RenameParams) -> types.WorkspaceEdit | None:
        edits = rename(*self.at(parameters), parameters.new_name)
        if isinstance(edits, str):
            self.server.window_show_message(types.ShowMessageParams(types.MessageType.Error, edits))
            return None
        return self.convert.changes(edits)

    def completion(self, parameters: types.CompletionParams) -> types.CompletionList:
        items = completion(*self.at(parameters))
        return types.CompletionList(False, [self.convert.item(item, rank) for rank, item in enumerate(items)])

    def signature(self, parameters: types.SignatureHelpParams) -> types.SignatureHelp | None:
        usage = call_usage(*self.at(parameters))
        return None if usage is None else signature(usage)

    def symbols(self, parameters: types.DocumentSymbolParams) -> list[types.DocumentSymbol]:
        return [self.convert.symbol(n) for n in outline(self.workspace, self.path(parameters.text_document.uri))]

    def workspace_symbols(self, parameters: types.WorkspaceSymbolParams) -> list[types.WorkspaceSymbol]:
        return [self.convert.workspace_symbol(n) for n in workspace_symbols(self.workspace, parameters.query)]

    def folds(self, parameters: types.FoldingRangeParams) -> list[types.FoldingRange]:
        document = self.workspace.project.document(self.path(parameters.text_document.uri))
        return [types.FoldingRange(first, last) for first, last in folds(document)]

    def tokens(self, parameters: types.SemanticTokensParams) -> types.SemanticTokens:
        path = self.path(parameters.text_document.uri)
        return self.convert.tokens(marked_words(self.workspace, path), path)

    def hints(self, parameters: types.InlayHintParams) -> list[types.InlayHint]:
        path = self.path(parameters.text_document.uri)
        start, end = (self.convert.offset(path, p) for p in (parameters.range.start, parameters.range.end))
        return [self.convert.hint(h, path) for h in inline_hints(self.workspace, path, start, end)]

    def formatting(self, parameters: types.DocumentFormattingParams) -> list[types.TextEdit] | None:
        path = self.path(parameters.text_document.uri)
        text, lines = formatted(self.workspace, path), self.convert.lines(path)
        if text is None or text == lines.text:
            return None
        whole = types.Range(types.Position(0, 0), types.Position(*lines.position(len(lines.text))))
        return [types.TextEdit(whole, text)]

    def actions(self, parameters: types.CodeActionParams) -> list[types.CodeAction]:
        path = self.path(parameters.text_document.uri)
        start, end = (self.convert.offset(path, p) for p in (parameters.range.start, parameters.range.end))
        answer = corrections(self.workspace, path, start, end)
        return [self.convert.correction(c, parameters.context.diagnostics) for c in answer]

    def lenses(self, parameters: types.CodeLensParams) -> list[types.CodeLens]:
        return [self.convert.lens(lens) for lens in lenses(self.workspace, self.path(parameters.text_document.uri))]

    def diagram(self, parameters: Any) -> dict[str, Any] | None:
        """Answer `bondgraph/diagram`, a request of our own: `{textDocument}` -> `{model, svg, parts}`, null for a file with errors."""
        address = getattr(getattr(parameters, "textDocument", None), "uri", None)
        if not isinstance(address, str):
            raise JsonRpcInvalidParams("bondgraph/diagram takes {textDocument: {uri}}")
        drawn = diagram(self.workspace, self.path(address))
        return None if drawn is None else self.convert.diagram(drawn)


def _features(session: EditorSession) -> dict[str, tuple[Callable[..., Any], Any]]:
    """Table of the features: what answers each of them, and its options."""
    legend = types.SemanticTokensLegend(TOKEN_TYPES, TOKEN_MODIFIERS)
    return {
        types.INITIALIZED: (session.begin, None),
        types.TEXT_DOCUMENT_DID_OPEN: (session.opened, None),
        types.TEXT_DOCUMENT_DID_CHANGE: (session.changed, None),
        types.TEXT_DOCUMENT_DID_SAVE: (session.saved, None),
        types.TEXT_DOCUMENT_DID_CLOSE: (session.closed, None),
        types.TEXT_DOCUMENT_HOVER: (session.hover, None),
        types.TEXT_DOCUMENT_DEFINITION: (session.definition, None),
        types.TEXT_DOCUMENT_REFERENCES: (session.references, None),
        types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT: (session.highlights, None),
        types.TEXT_DOCUMENT_PREPARE_RENAME: (session.prepare_rename, None),
        types.TEXT_DOCUMENT_RENAME: (session.rename, types.RenameOptions(prepare_provider=True)),
        types.TEXT_DOCUMENT_COMPLETION: (
            session.completion,
            types.CompletionOptions(trigger_characters=[".", ":", "[", '"']),
        ),
        types.TEXT_DOCUMENT_SIGNATURE_HELP: (
            session.signature,
            types.SignatureHelpOptions(trigger_characters=["(", ","]),
        ),
        types.TEXT_DOCUMENT_DOCUMENT_SYMBOL: (session.symbols, None),
        types.WORKSPACE_SYMBOL: (session.workspace_symbols, None),
        types.TEXT_DOCUMENT_FOLDING_RANGE: (session.folds, None),
        types.TEXT_DOCUMENT_SEMANTIC_TOKENS_FULL: (session.tokens, legend),
        types.TEXT_DOCUMENT_INLAY_HINT: (session.hints, None),
        types.TEXT_DOCUMENT_FORMATTING: (session.formatting, None),
        types.TEXT_DOCUMENT_CODE_LENS: (session.lenses, None),
        "bondgraph/diagram": (session.diagram, None),
        types.TEXT_DOCUMENT_CODE_ACTION: (session.actions, types.CodeActionOptions([types.CodeActionKind.QuickFix])),
    }


def serve() -> None:
    """Serve one editor over standard input and output until it ends the session."""
    # Streams of its own, as the protocol closes them at its end.
    with open(os.dup(0), "rb") as requests, open(os.dup(1), "wb") as answers:
        EditorSession().server.start_io(requests, answers)
