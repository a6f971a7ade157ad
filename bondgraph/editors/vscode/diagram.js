// The diagram beside the text: a part that is chosen shows its place in the text, and the line of the cursor lights its parts.
"use strict";
const vscode = require("vscode");

const PAUSE = 400; // ms without a change after which the picture is drawn again
const ERRORS = "The text has errors: this is the diagram of the last text without.";
const NONE = "No diagram: the text has errors, no model, or more parts than one can read.";
const STYLE = `
  body { margin: 0; padding: 8px; background: var(--vscode-editor-background); color: var(--vscode-editor-foreground); }
  svg { max-width: 100%; height: auto; }
  [data-id] { cursor: pointer; outline: none; }
  .target { fill: none; stroke: transparent; stroke-width: 14; pointer-events: stroke; }
  .lit .target, g.bond:focus-visible .target { stroke: rgba(64, 128, 255, 0.3); }
  .lit text, g.node:focus-visible text { text-decoration: underline; font-weight: bold; }`;

// Runs in the page of the picture.
function page() {
  const editor = acquireVsCodeApi();
  const main = document.querySelector("main");
  const choose = (event) => { const part = event.target.closest("[data-id]"); if (part) editor.postMessage({ id: part.dataset.id }); };
  main.addEventListener("click", choose);
  main.addEventListener("keydown", (event) => { if (event.key === "Enter") choose(event); });
  const draw = (svg) => {
    main.innerHTML = svg;
    for (const part of main.querySelectorAll("[data-id]")) part.tabIndex = 0;
    for (const line of main.querySelectorAll("g.bond path.line")) { // a wide line that nobody sees, to point at
      const target = line.cloneNode();
      target.setAttribute("class", "target");
      line.parentNode.append(target);
    }
  };
  window.addEventListener("message", ({ data }) => {
    if (data.svg) draw(data.svg);
    if (data.note !== undefined) document.querySelector("p").textContent = data.note;
    for (const part of main.querySelectorAll("[data-id]")) part.classList.toggle("lit", data.lit.includes(part.dataset.id));
  });
  editor.postMessage({ ready: true });
}

const html = (nonce) => `<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; script-src 'nonce-${nonce}'">
<style>${STYLE}</style></head><body><p role="status"></p><main></main><script nonce="${nonce}">(${page})()</script></body></html>`;

class DiagramView {
  // `ask(uri)` promises the server's `bondgraph/diagram` of a file.
  constructor(ask) {
    this.ask = ask;
    this.parts = [];
    this.disposables = [vscode.window.onDidChangeTextEditorSelection(({ textEditor }) => this.light(textEditor))];
  }

  show(uri) {
    this.uri = uri;
    this.parts = [];
    if (this.panel) {
      this.panel.reveal(undefined, true);
      this.draw();
      return;
    }
    const place = { viewColumn: vscode.ViewColumn.Beside, preserveFocus: true };
    this.panel = vscode.window.createWebviewPanel("bondgraph.diagram", "Bond graph", place, { enableScripts: true, retainContextWhenHidden: true });
    this.panel.webview.onDidReceiveMessage(({ ready, id }) => (ready ? this.draw() : this.jump(id)));
    this.panel.onDidDispose(() => { this.panel = undefined; });
    this.panel.webview.html = html(Math.random().toString(36).slice(2));
  }

  // Called when the errors of a file are known again: its text has changed.
  changed() {
    if (!this.panel) return;
    clearTimeout(this.pause);
    this.pause = setTimeout(() => this.draw(), PAUSE);
  }

  async draw() {
    const uri = this.uri;
    const answer = await this.ask(uri).catch(() => null);
    if (!this.panel || uri !== this.uri) return;
    if (answer) {
      this.parts = answer.parts;
      this.panel.title = `Bond graph of ${answer.model}`;
    }
    this.send({ svg: answer?.svg, note: answer ? "" : this.parts.length ? ERRORS : NONE });
  }

  send(message) {
    const lit = this.lit(vscode.window.visibleTextEditors.find((e) => e.document.uri.toString() === this.uri));
    return this.panel?.webview.postMessage({ ...message, lit });
  }

  // Parts on the line of the cursor.
  lit(editor) {
    if (!editor) return [];
    const uri = editor.document.uri.toString(), line = editor.selection.active.line;
    const here = ({ locations: [own] }) => vscode.Uri.parse(own.uri).toString() === uri && own.range.start.line <= line && line <= own.range.end.line;
    return this.parts.filter(here).map((part) => part.id);
  }

  light(editor) {
    if (this.panel && editor.document.uri.toString() === this.uri) this.send({});
  }

  async jump(id) {
    const part = this.parts.find((p) => p.id === id);
    if (!part) return;
    const [{ uri, range: { start, end } }] = part.locations;
    const selection = new vscode.Range(new vscode.Position(start.line, start.character), new vscode.Position(end.line, end.character));
    await vscode.window.showTextDocument(vscode.Uri.parse(uri), { viewColumn: vscode.ViewColumn.One, selection });
  }

  dispose() {
    clearTimeout(this.pause);
    this.panel?.dispose();
    this.disposables.forEach((d) => d.dispose());
  }
}

module.exports = { DiagramView };
