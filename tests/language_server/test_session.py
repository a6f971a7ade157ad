"""A session of an editor with the server, as a process, over its streams."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Timer
from typing import Any

import pytest

from bondgraph.language_server.conversions import lines_of
from tests.compiling import ROOT

pytest.importorskip("pygls")

LIMIT = 60  # s for a session
TEXT = """model QuarterCar {
  "µ: a letter of two bytes"
  parameter k: N/m = 16e3
  Se road : F = 1 kN*step(time)
   1   wheel
  I mass : p = 250 kg*v
  C spring : F = k*x
  road -> wheel -> mass, sprin
  output travel = spring.x
  experiment bump { simulate 0 .. 1 s; report travel in mm }
}
"""


class Editor:
    """A client: requests wait for their answers, at most until `LIMIT`, when the server is ended; notifications are kept."""

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "bondgraph", "lsp"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT
        )
        self.limit = Timer(LIMIT, self.process.kill)
        self.limit.start()
        self.number = 0
        self.notes: list[dict[str, Any]] = []
        folders = [{"uri": folder.as_uri(), "name": "models"}]
        parameters = {"processId": None, "rootUri": None, "capabilities": {}, "workspaceFolders": folders}
        self.capabilities = self.ask("initialize", parameters)["capabilities"]
        self.tell("initialized", {})

    def _send(self, **message: Any) -> None:
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        assert self.process.stdin is not None
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n" % len(body) + body)
        self.process.stdin.flush()

    def _read(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        length = 0
        while line := self.process.stdout.readline().strip():
            if line.lower().startswith(b"content-length"):
                length = int(line.partition(b":")[2])
        assert length, f"the server ended, or gave no answer in {LIMIT} s"
        return json.loads(self.process.stdout.read(length))  # type: ignore[no-any-return]

    def answer(self, method: str, parameters: Any) -> dict[str, Any]:
        self.number += 1
        self._send(id=self.number, method=method, params=parameters)
        while True:
            message = self._read()
            if message.get("id") == self.number and "method" not in message:
                return message
            self.notes.append(message)

    def ask(self, method: str, parameters: Any) -> Any:
        message = self.answer(method, parameters)
        assert "error" not in message, message
        return message["result"]

    def end(self) -> None:
        self.limit.cancel()
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.close()

    def tell(self, method: str, parameters: Any) -> None:
        self._send(method=method, params=parameters)

    def diagnostics(self, address: str) -> list[dict[str, Any]]:
        """The next errors that are told of a file."""
        while True:
            for number, note in enumerate(self.notes):
                if note.get("method") == "textDocument/publishDiagnostics" and note["params"]["uri"] == address:
                    return self.notes.pop(number)["params"]["diagnostics"]  # type: ignore[no-any-return]
            self.notes.append(self._read())


@pytest.fixture
def editor(tmp_path: Path) -> Iterator[Editor]:
    client = Editor(tmp_path)
    yield client
    client.end()


def test_a_session(editor: Editor, tmp_path: Path) -> None:
    """Open a file with a mistake, mend it, ask all there is to ask, rename, format, end."""
    path = tmp_path / "car.bg"
    path.write_text(TEXT, encoding="utf-8")
    address = path.as_uri()
    document = {"uri": address}

    def place(word: str, inside: int = 1) -> dict[str, Any]:
        line, column = lines_of(TEXT, "utf-16").position(TEXT.index(word) + inside)
        return {"textDocument": document, "position": {"line": line, "character": column}}

    editor.tell(
        "textDocument/didOpen",
        {"textDocument": {"uri": address, "languageId": "bondgraph", "version": 1, "text": TEXT}},
    )
    (mistake,) = editor.diagnostics(address)
    assert mistake["code"] == "BG101" and "Did you mean `spring`?" in mistake["message"]
    assert mistake["range"] == {"start": {"line": 7, "character": 25}, "end": {"line": 7, "character": 30}}

    (action,) = editor.ask(
        "textDocument/codeAction",
        {"textDocument": document, "range": mistake["range"], "context": {"diagnostics": [mistake]}},
    )
    (edit,) = action["edit"]["changes"][address]
    assert edit["newText"] == "spring" and edit["range"] == mistake["range"]
    editor.tell(
        "textDocument/didChange",
        {
            "textDocument": {"uri": address, "version": 2},
            "contentChanges": [{"range": edit["range"], "text": "spring"}],
        },
    )
    assert editor.diagnostics(address) == []

    hover = editor.ask("textDocument/hover", place("mass :"))
    assert "`p` in N*s" in hover["contents"]["value"] and "`wheel ->| mass`" in hover["contents"]["value"]
    items = editor.ask("textDocument/completion", place("spring.x", 7))["items"]
    assert [i["label"] for i in items][:3] == ["F", "v", "x"]
    assert editor.ask("textDocument/definition", place("k*x"))["range"]["start"] == {"line": 2, "character": 12}
    assert (
        len(editor.ask("textDocument/references", place("spring :") | {"context": {"includeDeclaration": True}})) == 3
    )
    assert editor.ask("textDocument/prepareRename", place("spring :"))["start"] == {"line": 6, "character": 4}
    renamed = editor.ask("textDocument/rename", place("spring :") | {"newName": "suspension"})
    assert [e["newText"] for e in renamed["changes"][address]] == ["suspension"] * 3
    assert editor.ask("textDocument/rename", place("spring :") | {"newName": "mass"}) is None
    assert any(n.get("method") == "window/showMessage" for n in editor.notes)

    whole = {
        "textDocument": document,
        "range": {"start": {"line": 0, "character": 0}, "end": {"line": 11, "character": 0}},
    }
    hints = {h["label"] for h in editor.ask("textDocument/inlayHint", whole)}
    assert hints == {"→|", "|→", " = 1000 N"}
    tokens = editor.ask("textDocument/semanticTokens/full", {"textDocument": document})["data"]
    assert len(tokens) % 5 == 0 and tokens[:5] == [0, 0, 5, tokens[3], 0]
    (model,) = editor.ask("textDocument/documentSymbol", {"textDocument": document})
    assert model["name"] == "QuarterCar" and "spring" in [c["name"] for c in model["children"]]
    assert {"startLine": 0, "endLine": 10} in editor.ask("textDocument/foldingRange", {"textDocument": document})
    assert [s["name"] for s in editor.ask("workspace/symbol", {"query": "quarter"})] == ["QuarterCar"]
    assert editor.ask("textDocument/signatureHelp", place("step(", 5))["signatures"][0]["label"] == "step(time - 1 s)"
    (change,) = editor.ask(
        "textDocument/formatting", {"textDocument": document, "options": {"tabSize": 2, "insertSpaces": True}}
    )
    assert "  1 wheel\n" in change["newText"]

    for parameters in ({"textDocument": document}, {}, None, [1], place("mass :") | {"position": "there"}):
        refused = editor.answer("textDocument/hover", parameters)["error"]
        assert refused["code"] == -32602 and "textDocument/hover cannot be read" in refused["message"]
    assert editor.answer("textDocument/nothing", {})["error"]["code"] == -32601
    assert editor.ask("textDocument/hover", place("mass :")) == hover  # the session goes on
    assert editor.ask("shutdown", None) is None
    editor.tell("exit", None)
    assert editor.process.wait(20) == 0


@pytest.mark.parametrize(("encoding", "column"), [("utf-8", 4), ("utf-16", 2), ("utf-32", 1)])
def test_columns_are_counted_as_the_editor_counts_them(encoding: str, column: int) -> None:
    text = "a\n\U0001f600b\r\nc"
    lines = lines_of(text, encoding)
    assert lines.position(3) == (1, column) and lines.offset(1, column) == 3
    assert lines.offset(9, 0) == len(text) and lines.position(len(text)) == (2, 1)
    assert all(lines.offset(*lines.position(at)) == at for at in range(len(text)))
