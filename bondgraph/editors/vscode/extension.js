// Client of the language server `bondgraph lsp` for VS Code: the protocol over standard streams, without packages.
"use strict";
const vscode = require("vscode");
const { spawn } = require("node:child_process");
const { DiagramView } = require("./diagram.js");

const SELECTOR = { language: "bondgraph" };
const PATIENCE = 2000; // ms in which a server must end
let session;

// ---------------------------------------------------------------- messages

class Connection {
  // `answer(method, parameters)` answers what the server asks and tells; `ended(why)` is called once.
  constructor([program, ...words], folder, answer, ended) {
    this.waiting = new Map();
    this.number = 0;
    this.answer = answer;
    this.input = Buffer.alloc(0);
    this.isOpen = true;
    this.process = spawn(program, words, { cwd: folder, stdio: ["pipe", "pipe", "pipe"] });
    const end = (why) => {
      if (!this.isOpen) return;
      this.isOpen = false;
      for (const { reject } of this.waiting.values()) reject(new Error(why));
      this.waiting.clear();
      ended(why);
    };
    let errors = "";
    this.process.stderr.on("data", (text) => { errors = (errors + text).slice(-2000); });
    this.process.stdin.on("error", () => {});
    this.process.stdout.on("data", (data) => this.read(data));
    this.process.on("error", (error) => end(error.message));
    this.process.on("close", (code) => end(errors.trim() || `it ended with code ${code}`));
  }

  read(data) {
    this.input = Buffer.concat([this.input, data]);
    for (;;) {
      const head = this.input.indexOf("\r\n\r\n");
      if (head < 0) return;
      const length = Number(/content-length: *(\d+)/i.exec(this.input.toString("ascii", 0, head))[1]);
      if (this.input.length < head + 4 + length) return;
      const message = JSON.parse(this.input.toString("utf8", head + 4, head + 4 + length));
      this.input = this.input.subarray(head + 4 + length);
      this.take(message);
    }
  }

  take(message) {
    if (message.method) {
      const result = this.answer(message.method, message.params) ?? null;
      if (message.id !== undefined) this.send({ id: message.id, result });
      return;
    }
    const waits = this.waiting.get(message.id);
    this.waiting.delete(message.id);
    if (waits && message.error) waits.reject(new Error(message.error.message));
    else if (waits) waits.resolve(message.result);
  }

  send(message) {
    if (!this.isOpen) return;
    const body = JSON.stringify({ jsonrpc: "2.0", ...message });
    this.process.stdin.write(`Content-Length: ${Buffer.byteLength(body)}\r\n\r\n${body}`);
  }

  tell(method, params) { this.send({ method, params }); }

  ask(method, params, cancellation) {
    if (!this.isOpen) return Promise.resolve(null);
    const id = ++this.number;
    const result = new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
    cancellation?.onCancellationRequested(() => this.tell("$/cancelRequest", { id }));
    this.send({ id, method, params });
    return result.catch((error) => { if (cancellation?.isCancellationRequested || !this.isOpen) return null; throw error; });
  }

  // Asks the server to end; a server that does not is ended.
  async end() {
    const limit = setTimeout(() => this.process.kill(), PATIENCE);
    this.process.once("exit", () => clearTimeout(limit));
    await this.ask("shutdown").catch(() => {});
    this.tell("exit");
    this.isOpen = false;
  }
}

// ---------------------------------------------------------------- the protocol's values as the editor's, and back

const position = (p) => new vscode.Position(p.line, p.character);
const range = (r) => new vscode.Range(position(r.start), position(r.end));
const place = (l) => new vscode.Location(vscode.Uri.parse(l.uri), range(l.range));
const edit = (e) => new vscode.TextEdit(range(e.range), e.newText);
const markdown = (m) => (m === undefined || m === null ? undefined : new vscode.MarkdownString(m.value ?? m));
const list = (items, convert) => (items ?? []).map(convert);
const document = (d) => ({ textDocument: { uri: d.uri.toString() } });
const plain = (r) => ({ start: { line: r.start.line, character: r.start.character }, end: { line: r.end.line, character: r.end.character } });
const at = (d, p) => ({ ...document(d), position: { line: p.line, character: p.character } });

function changes(answer) {
  if (!answer) return undefined;
  const edits = new vscode.WorkspaceEdit();
  for (const [uri, listed] of Object.entries(answer.changes ?? {})) edits.set(vscode.Uri.parse(uri), listed.map(edit));
  return edits;
}

function diagnostic(d) {
  const shown = new vscode.Diagnostic(range(d.range), d.message, (d.severity ?? 1) - 1);
  shown.code = d.code;
  shown.source = d.source;
  shown.relatedInformation = list(d.relatedInformation, (r) => new vscode.DiagnosticRelatedInformation(place(r.location), r.message));
  return shown;
}

function item(i) {
  const shown = new vscode.CompletionItem(i.label, (i.kind ?? 1) - 1);
  shown.detail = i.detail;
  shown.documentation = markdown(i.documentation);
  const text = i.insertText ?? i.label;
  shown.insertText = i.insertTextFormat === 2 ? new vscode.SnippetString(text) : text;
  shown.sortText = i.sortText;
  shown.additionalTextEdits = list(i.additionalTextEdits, edit);
  return shown;
}

function symbol(s) {
  const shown = new vscode.DocumentSymbol(s.name, s.detail ?? "", s.kind - 1, range(s.range), range(s.selectionRange));
  shown.children = list(s.children, symbol);
  return shown;
}

function usage(answer) {
  if (!answer) return undefined;
  const help = new vscode.SignatureHelp();
  help.signatures = answer.signatures.map((s) => {
    const shown = new vscode.SignatureInformation(s.label, markdown(s.documentation));
    shown.parameters = list(s.parameters, (p) => new vscode.ParameterInformation(p.label));
    return shown;
  });
  help.activeSignature = answer.activeSignature ?? 0;
  help.activeParameter = answer.activeParameter ?? 0;
  return help;
}

function action(a) {
  const shown = new vscode.CodeAction(a.title, vscode.CodeActionKind.QuickFix);
  shown.edit = changes(a.edit);
  shown.diagnostics = list(a.diagnostics, diagnostic);
  return shown;
}

// ---------------------------------------------------------------- one server

class Session {
  constructor() {
    this.errors = vscode.languages.createDiagnosticCollection("bondgraph");
    this.hints = new vscode.EventEmitter();
    this.diagram = new DiagramView((uri) => this.server.ask("bondgraph/diagram", { textDocument: { uri } }));
    this.disposables = [this.errors, this.hints, this.diagram];
  }

  async start() {
    const command = serverCommand();
    const folders = list(vscode.workspace.workspaceFolders, (f) => ({ uri: f.uri.toString(), name: f.name }));
    const ended = (why) => {
      this.errors.clear();
      vscode.window.showErrorMessage(`The server of bondgraph (${command.join(" ")}) has ended: ${why}. The setting bondgraph.command names it.`);
    };
    this.server = new Connection(command, vscode.workspace.workspaceFolders?.[0]?.uri.fsPath, (m, p) => this.answer(m, p), ended);
    const capabilities = {
      general: { positionEncodings: ["utf-16"] },
      textDocument: { completion: { completionItem: { snippetSupport: true } }, documentSymbol: { hierarchicalDocumentSymbolSupport: true } },
      workspace: { workspaceFolders: true, inlayHint: { refreshSupport: true } },
    };
    const rootUri = folders[0]?.uri ?? null;
    const answer = await this.server.ask("initialize", { processId: process.pid, rootUri, capabilities, workspaceFolders: folders });
    if (!answer) return;
    this.server.tell("initialized", {});
    this.watch();
    this.provide(answer.capabilities);
  }

  answer(method, p) {
    if (method === "textDocument/publishDiagnostics") {
      this.errors.set(vscode.Uri.parse(p.uri), p.diagnostics.map(diagnostic));
      this.diagram.changed();
    }
    else if (method === "window/showMessage") vscode.window.showWarningMessage(p.message);
    else if (method === "workspace/inlayHint/refresh") this.hints.fire();
  }

  watch() {
    const tell = (method, d, more) => { if (d.languageId === SELECTOR.language) this.server.tell(`textDocument/${method}`, more ?? document(d)); };
    const open = (d) => tell("didOpen", d, { textDocument: { uri: d.uri.toString(), languageId: d.languageId, version: d.version, text: d.getText() } });
    this.disposables.push(
      vscode.workspace.onDidOpenTextDocument(open),
      vscode.workspace.onDidSaveTextDocument((d) => tell("didSave", d)),
      vscode.workspace.onDidCloseTextDocument((d) => tell("didClose", d)),
      vscode.workspace.onDidChangeTextDocument(({ document: d, contentChanges }) => {
        const textDocument = { uri: d.uri.toString(), version: d.version };
        const changed = contentChanges.map((c) => ({ range: plain(c.range), text: c.text }));
        if (changed.length) tell("didChange", d, { textDocument, contentChanges: changed });
      }),
    );
    vscode.workspace.textDocuments.forEach(open);
  }

  provide(capabilities) {
    const { languages } = vscode;
    const ask = (method, parameters, cancellation, convert) =>
      this.server.ask(`textDocument/${method}`, parameters, cancellation).then((answer) => (answer ? convert(answer) : undefined));
    const atPlace = (method, convert) => (d, p, c) => ask(method, at(d, p), c, convert);
    const ofFile = (method, convert) => (d, c) => ask(method, document(d), c, convert);
    const { tokenTypes, tokenModifiers } = capabilities.semanticTokensProvider.legend;
    const legend = new vscode.SemanticTokensLegend(tokenTypes, tokenModifiers);
    this.disposables.push(
      languages.registerHoverProvider(SELECTOR, { provideHover: atPlace("hover", (h) => new vscode.Hover(markdown(h.contents), h.range && range(h.range))) }),
      languages.registerDefinitionProvider(SELECTOR, { provideDefinition: atPlace("definition", place) }),
      languages.registerReferenceProvider(SELECTOR, {
        provideReferences: (d, p, { includeDeclaration }, c) => ask("references", { ...at(d, p), context: { includeDeclaration } }, c, (l) => l.map(place)),
      }),
      languages.registerDocumentHighlightProvider(SELECTOR, {
        provideDocumentHighlights: atPlace("documentHighlight", (l) => l.map((h) => new vscode.DocumentHighlight(range(h.range)))),
      }),
      languages.registerRenameProvider(SELECTOR, {
        prepareRename: (d, p, c) => ask("prepareRename", at(d, p), c, range).then((r) => r ?? Promise.reject(new Error("There is no name here."))),
        provideRenameEdits: (d, p, newName, c) => ask("rename", { ...at(d, p), newName }, c, changes),
      }),
      languages.registerCompletionItemProvider(SELECTOR, {
        provideCompletionItems: atPlace("completion", (answer) => (answer.items ?? answer).map(item)),
      }, ...capabilities.completionProvider.triggerCharacters),
      languages.registerSignatureHelpProvider(SELECTOR, { provideSignatureHelp: atPlace("signatureHelp", usage) }, ...capabilities.signatureHelpProvider.triggerCharacters),
      languages.registerDocumentSymbolProvider(SELECTOR, { provideDocumentSymbols: ofFile("documentSymbol", (l) => l.map(symbol)) }),
      languages.registerWorkspaceSymbolProvider({
        provideWorkspaceSymbols: (query, c) => this.server.ask("workspace/symbol", { query }, c).then((l) =>
          list(l, (s) => new vscode.SymbolInformation(s.name, s.kind - 1, s.containerName ?? "", place(s.location)))),
      }),
      languages.registerFoldingRangeProvider(SELECTOR, {
        provideFoldingRanges: (d, _, c) => ask("foldingRange", document(d), c, (l) => l.map((f) => new vscode.FoldingRange(f.startLine, f.endLine))),
      }),
      languages.registerDocumentFormattingEditProvider(SELECTOR, {
        provideDocumentFormattingEdits: (d, { tabSize, insertSpaces }, c) => ask("formatting", { ...document(d), options: { tabSize, insertSpaces } }, c, (l) => l.map(edit)),
      }),
      languages.registerCodeActionsProvider(SELECTOR, {
        provideCodeActions: (d, r, context, c) => {
          const diagnostics = context.diagnostics.map((e) => ({ range: plain(e.range), message: e.message, code: e.code, source: e.source, severity: e.severity + 1 }));
          return ask("codeAction", { ...document(d), range: plain(r), context: { diagnostics } }, c, (l) => l.map(action));
        },
      }),
      languages.registerCodeLensProvider(SELECTOR, {
        provideCodeLenses: ofFile("codeLens", (l) => l.map((lens) => new vscode.CodeLens(range(lens.range), lens.command))),
      }),
      languages.registerDocumentSemanticTokensProvider(SELECTOR, {
        provideDocumentSemanticTokens: ofFile("semanticTokens/full", (t) => new vscode.SemanticTokens(new Uint32Array(t.data))),
      }, legend),
      languages.registerInlayHintsProvider(SELECTOR, {
        onDidChangeInlayHints: this.hints.event,
        provideInlayHints: (d, r, c) => ask("inlayHint", { ...document(d), range: plain(r) }, c, (l) => l.map((h) => {
          const shown = new vscode.InlayHint(position(h.position), h.label, h.kind);
          shown.tooltip = h.tooltip;
          shown.paddingRight = h.paddingRight;
          return shown;
        })),
      }),
    );
  }

  async stop() {
    this.disposables.splice(0).forEach((d) => d.dispose());
    if (!this.server?.isOpen) return;
    await this.server.end();
  }
}

const serverCommand = () => vscode.workspace.getConfiguration("bondgraph").get("command");

// Runs a command of the program that has the server, such as `run FILE -e EXPERIMENT`, on the text as it is now.
async function inTerminal(...words) {
  const [program, ...before] = serverCommand();
  if (before.at(-1) !== "lsp") {
    vscode.window.showErrorMessage(`The setting bondgraph.command (${[program, ...before].join(" ")}) does not end in lsp, so it names no program for \`${words[0]}\`.`);
    return;
  }
  await vscode.workspace.textDocuments.find((d) => d.uri.fsPath === words[1] && d.isDirty)?.save();
  const execution = new vscode.ProcessExecution(program, [...before.slice(0, -1), ...words]);
  await vscode.tasks.executeTask(new vscode.Task({ type: "bondgraph" }, vscode.TaskScope.Workspace, words.join(" "), "bondgraph", execution));
}

async function activate(context) {
  const start = async () => {
    await session?.stop();
    session = new Session();
    await session.start();
  };
  const changed = (event) => event.affectsConfiguration("bondgraph.command") && start();
  const here = () => vscode.window.activeTextEditor?.document.uri.toString();
  context.subscriptions.push(
    vscode.commands.registerCommand("bondgraph.restart", start),
    vscode.commands.registerCommand("bondgraph.terminal", inTerminal),
    vscode.commands.registerCommand("bondgraph.diagram", (uri = here()) => uri && session?.diagram.show(vscode.Uri.parse(uri).toString())),
    vscode.workspace.onDidChangeConfiguration(changed),
  );
  await start();
}

module.exports = { activate, deactivate: () => session?.stop() };
