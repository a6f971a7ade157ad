// A session of the extension with the real server, over an editor that is made of plain objects. Arguments: extension, command as JSON, file.
"use strict";
const Module = require("node:module");
const fs = require("node:fs");
const path = require("node:path");
const { pathToFileURL } = require("node:url");

const [extension, command, file] = process.argv.slice(2);
const providers = {};
const shown = [];
const commands = {};
const tasks = [];
const jumps = [];
const panel = { webview: { posted: [], onDidReceiveMessage: (take) => { panel.take = take; }, postMessage: (m) => panel.webview.posted.push(m) }, onDidDispose() {}, reveal() {}, dispose() {} };
let told;
const listeners = {};
const plain = (...names) => class { constructor(...values) { names.forEach((name, i) => { this[name] = values[i]; }); } };
const nothing = () => ({ dispose() {} });
const listening = (name) => (listener) => { listeners[name] = listener; return nothing(); };
const uri = { toString: () => pathToFileURL(file).href, fsPath: file };
const folder = { toString: () => pathToFileURL(path.dirname(file)).href, fsPath: path.dirname(file) };
const text = { uri, languageId: "bondgraph", version: 1, getText: () => fs.readFileSync(file, "utf8") };
class WorkspaceEdit { constructor() { this.entries = []; } set(where, edits) { this.entries.push([where.text, edits]); } }
class EventEmitter { constructor() { this.event = nothing; } fire() {} dispose() {} }
const registering = (_, name) => (...given) => { providers[name] = given.find((g) => typeof g === "object" && !("language" in g)); return nothing(); };
const vscode = {
  Position: plain("line", "character"), Range: class { constructor(start, end) { Object.assign(this, { start, end }); } },
  Location: plain("uri", "range"), TextEdit: plain("range", "newText"), Diagnostic: plain("range", "message", "severity"), Hover: plain("contents", "range"),
  MarkdownString: plain("value"), CompletionItem: plain("label", "kind"), SnippetString: plain("value"), CodeAction: plain("title", "kind"), WorkspaceEdit, EventEmitter,
  DocumentSymbol: plain("name", "detail", "kind", "range", "selectionRange"), SemanticTokens: plain("data"), SemanticTokensLegend: plain("types", "modifiers"),
  FoldingRange: plain("start", "end"), InlayHint: plain("position", "label", "kind"), DocumentHighlight: plain("range"), CodeActionKind: { QuickFix: "quickfix" },
  SignatureHelp: plain(), SignatureInformation: plain("label", "documentation"), ParameterInformation: plain("label"),
  DiagnosticRelatedInformation: plain("location", "message"), SymbolInformation: plain("name", "kind", "containerName", "location"),
  CodeLens: plain("range", "command"), ProcessExecution: plain("program", "words"), Task: plain("definition", "scope", "name", "source", "execution"), TaskScope: {}, ViewColumn: {},
  Uri: { parse: (written) => ({ text: written, toString: () => written }) },
  window: {
    showErrorMessage: (m) => shown.push(m), showWarningMessage: (m) => shown.push(m), visibleTextEditors: [], createWebviewPanel: () => panel,
    onDidChangeTextEditorSelection: listening("select"), showTextDocument: (_, { selection }) => jumps.push(selection),
  },
  commands: { registerCommand: (name, run) => { commands[name] = run; return nothing(); } },
  tasks: { executeTask: (task) => tasks.push([task.execution.program, ...task.execution.words]) },
  workspace: {
    textDocuments: [text], workspaceFolders: [{ uri: folder, name: "models" }], getConfiguration: () => ({ get: () => JSON.parse(command) }), onDidChangeConfiguration: nothing,
    onDidOpenTextDocument: listening("open"), onDidSaveTextDocument: nothing, onDidCloseTextDocument: nothing, onDidChangeTextDocument: listening("change"),
  },
  languages: new Proxy({ createDiagnosticCollection: () => ({ set: (_, all) => told?.(all), clear() {}, dispose() {} }) },
    { get: (target, name) => target[name] ?? registering(target, name.replace(/^register|Provider$/g, "")) }),
};
const started = [];
const processes = require("node:child_process");
const { spawn } = processes;
processes.spawn = (...words) => { started.push(spawn(...words)); return started.at(-1); };
const load = Module._load;
Module._load = (name, ...rest) => (name === "vscode" ? vscode : load(name, ...rest));
const place = (line, character) => new vscode.Position(line, character);
const errors = () => new Promise((resolve) => { told = resolve; });

// Nothing waits for ever: after the limit all ends, and no server outlives this process.
setTimeout(() => { console.error("no answer within the limit"); process.exit(1); }, 60000).unref();
process.on("exit", () => started.forEach((server) => server.kill()));
process.on("unhandledRejection", (error) => { console.error(error); process.exit(1); });

(async () => {
  const client = require(extension);
  const first = errors();
  await client.activate({ subscriptions: [] });
  if (shown.length) return console.log(JSON.stringify({ shown }));
  const [mistake] = await first;
  const [action] = await providers.CodeActions.provideCodeActions(text, mistake.range, { diagnostics: [mistake] });
  const [edit] = action.edit.entries[0][1];
  const mended = errors();
  listeners.change({ document: { ...text, version: 2 }, contentChanges: [{ range: edit.range, text: edit.newText }] });
  const left = await mended;
  const answer = {
    mistake, edit, left, shown,
    hover: (await providers.Hover.provideHover(text, place(1, 13))).contents.value,
    definition: (await providers.Definition.provideDefinition(text, place(4, 17))).range,
    items: (await providers.CompletionItem.provideCompletionItems(text, place(1, 2))).map((i) => i.label),
    symbols: (await providers.DocumentSymbol.provideDocumentSymbols(text)).map((s) => [s.name, s.children.map((c) => c.name)]),
    tokens: (await providers.DocumentSemanticTokens.provideDocumentSemanticTokens(text)).data.length,
    renamed: (await providers.Rename.provideRenameEdits(text, place(1, 12), "stiffness")).entries[0][1].length,
    formatted: (await providers.DocumentFormattingEdit.provideDocumentFormattingEdits(text, { tabSize: 2, insertSpaces: true }))[0].newText,
    folds: (await providers.FoldingRange.provideFoldingRanges(text)).length,
    hints: (await providers.InlayHints.provideInlayHints(text, { start: place(0, 0), end: place(9, 0) })).map((h) => h.label),
  };
  answer.lenses = await providers.CodeLens.provideCodeLenses(text);
  for (const { command: { command: name, arguments: words } } of answer.lenses) await commands[name](...words);
  await panel.take({ ready: true });
  const [{ svg }] = panel.webview.posted;
  const id = /data-id="(\d+)" data-name="spring"/.exec(svg)[1];
  await panel.take({ id });
  listeners.select({ textEditor: vscode.window.visibleTextEditors[0] = { document: text, selection: { active: place(4, 3) } } });
  Object.assign(answer, { tasks, jumps, script: panel.webview.html, svg, id, lit: panel.webview.posted.at(-1).lit });
  await client.deactivate();
  console.log(JSON.stringify(answer));
})();
