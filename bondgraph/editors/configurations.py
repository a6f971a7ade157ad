"""Short configurations of editors that start the server. COMMAND, PROGRAM and WORDS stand for its command, KEYWORDS and KINDS for words of the language."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence

from ..language_service.vocabulary import classes
from .rules import textmate_grammar

_NEOVIM = """\
-- Neovim 0.11 and later: in init.lua. Colours come from the server.
vim.filetype.add({ extension = { bg = "bondgraph" } })
vim.lsp.config("bondgraph", { cmd = { COMMAND }, filetypes = { "bondgraph" }, root_markers = { ".git" } })
vim.lsp.enable("bondgraph")
vim.api.nvim_create_autocmd("FileType", { pattern = "bondgraph", callback = function()
  vim.bo.commentstring, vim.bo.shiftwidth, vim.bo.expandtab = "# %s", 2, true
end })
-- Colours and folds of a tree, too: `bondgraph editor tree-sitter -o FOLDER`; there `tree-sitter generate` and `tree-sitter build -o parser/bondgraph.so`;
-- then vim.opt.runtimepath:append("FOLDER") here, and vim.treesitter.start() in the callback above.
-- `Run`, `Modes` and `Bode` above experiments: vim.lsp.codelens.refresh() shows them, vim.lsp.codelens.run() runs one.
vim.lsp.commands["bondgraph.terminal"] = function(lens)
  vim.cmd.write()
  local words = { COMMAND }
  words[#words] = nil
  vim.cmd.new()
  vim.fn.jobstart(vim.list_extend(words, lens.arguments), { term = true })
end
"""
_HELIX = """\
# Helix: in languages.toml of its configuration folder.
[language-server.bondgraph]
command = PROGRAM
args = [WORDS]

[[language]]
name = "bondgraph"
scope = "source.bondgraph"
file-types = ["bg"]
comment-token = "#"
indent = { tab-width = 2, unit = "  " }
language-servers = ["bondgraph"]

# Colours need a grammar: `bondgraph editor tree-sitter -o FOLDER`, there `tree-sitter generate`; then these lines, `hx --grammar build`, and
# a copy of FOLDER/queries/bondgraph in runtime/queries of the configuration folder.
# [[grammar]]
# name = "bondgraph"
# source = { path = "FOLDER" }
"""
_EMACS = """\
;; Emacs 29 and later, with its own eglot: in init.el. It takes the colours from a tree if it has a parser: `bondgraph editor tree-sitter -o FOLDER`;
;; there `tree-sitter generate` and `tree-sitter build -o libtree-sitter-bondgraph.so`; then (add-to-list 'treesit-extra-load-path "FOLDER") before this.
(define-derived-mode bondgraph-mode prog-mode "bondgraph"
  (modify-syntax-entry ?# "<") (modify-syntax-entry ?\\n ">") (modify-syntax-entry ?_ "w")
  (setq-local comment-start "# " comment-end "" tab-width 2)
  (setq-local font-lock-defaults
    (list (list (cons (regexp-opt '(KEYWORDS) 'words) 'font-lock-keyword-face)
                (cons (regexp-opt '(KINDS) 'words) 'font-lock-type-face))))
  (when (and (require 'treesit nil t) (treesit-ready-p 'bondgraph t))
    (treesit-parser-create 'bondgraph)
    (setq-local treesit-font-lock-feature-list '((all)) treesit-font-lock-settings
      (treesit-font-lock-rules :language 'bondgraph :feature 'all
        '((comment) @font-lock-comment-face (string) @font-lock-string-face [(number) (junction)] @font-lock-constant-face
          (unit) @font-lock-type-face [KEYWORDS] @font-lock-keyword-face (declaration kind: (name) @font-lock-type-face)
          (model name: (name) @font-lock-type-face) (declared :anchor (name) @font-lock-variable-name-face)
          (item name: (name) @font-lock-variable-name-face) (call function: (name) @font-lock-function-name-face))))
    (treesit-major-mode-setup)))
(add-to-list 'auto-mode-alist '("\\\\.bg\\\\'" . bondgraph-mode))
(with-eval-after-load 'eglot (add-to-list 'eglot-server-programs '(bondgraph-mode . (COMMAND))))
(add-hook 'bondgraph-mode-hook #'eglot-ensure)
"""
_ZED = """\
# Zed takes languages from extensions: put these four files into a folder, and choose it by `zed: install dev extension` (which needs Rust).
# ---- extension.toml
id = "bondgraph"
name = "bondgraph"
version = "0.1.0"
schema_version = 1
authors = []
[language_servers.bondgraph]
name = "bondgraph"
languages = ["bondgraph"]
# Colours: `bondgraph editor tree-sitter -o FOLDER`, there `tree-sitter generate`, `git init` and a commit of all; the next three lines with its hash;
# FOLDER/queries/bondgraph/highlights.scm beside config.toml, and in that `grammar = "bondgraph"`.
# [grammars.bondgraph]
# repository = "file:///FOLDER"
# rev = "HASH"
# ---- languages/bondgraph/config.toml
name = "bondgraph"
path_suffixes = ["bg"]
line_comments = ["# "]
tab_size = 2
# ---- Cargo.toml
[package]
name = "bondgraph"
version = "0.1.0"
edition = "2021"
[lib]
crate-type = ["cdylib"]
[dependencies]
zed_extension_api = "0.1"
# ---- src/lib.rs
use zed_extension_api as zed;
struct Bondgraph;
impl zed::Extension for Bondgraph {
    fn new() -> Self { Bondgraph }
    fn language_server_command(&mut self, _: &zed::LanguageServerId, _: &zed::Worktree) -> zed::Result<zed::Command> {
        Ok(zed::Command { command: PROGRAM.to_string(), args: [WORDS].map(String::from).to_vec(), env: vec![] })
    }
}
zed::register_extension!(Bondgraph);
"""
_PYGMENTS = """\
The lexer comes with this package, and Pygments finds it by the name bondgraph, or bg:

  pygmentize -l bondgraph model.bg            on a terminal
  .. code-block:: bondgraph                   in Sphinx
  \\begin{minted}{bondgraph}                   in LaTeX
  ```bondgraph                                in MkDocs and other Markdown that Pygments colours
"""


def _filled(template: str, command: Sequence[str]) -> str:
    program, *words = (json.dumps(word, ensure_ascii=False) for word in command)
    between = " " if template is _EMACS else ", "
    filled = {
        "COMMAND": between.join([program, *words]), "PROGRAM": program, "WORDS": between.join(words),
        "KEYWORDS": " ".join(json.dumps(w) for w in (*classes()["keyword"], *classes()["operator"])),
        "KINDS": " ".join(json.dumps(w) for w in classes()["kind"]),
    }  # fmt: skip
    return re.sub(rf"\b(?:{'|'.join(filled)})\b", lambda match: filled[match[0]], template)


def _template(text: str) -> Callable[[Sequence[str]], str]:
    return lambda command: _filled(text, command)


# Editor -> its text for the command of the server.
CONFIGURATIONS: dict[str, Callable[[Sequence[str]], str]] = {
    "neovim": _template(_NEOVIM),
    "helix": _template(_HELIX),
    "emacs": _template(_EMACS),
    "zed": _template(_ZED),
    "textmate": lambda command: json.dumps(textmate_grammar(), indent=2) + "\n",
    "pygments": lambda command: _PYGMENTS,
}
