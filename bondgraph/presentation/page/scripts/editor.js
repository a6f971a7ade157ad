// The text that is edited: a textarea over lines in colours, the files of the folder, errors of the text that stands there, and saving.

const PIECES = /(?<remark>#.*)|(?<words>"[^"]*"?)|(?<number>(?<![\w.])\d[\d.]*(?:[eE][-+]?\d+)?)|(?<name>[\p{L}_][\p{L}\p{N}_]*)|(?<arrow>->|=>)/gu;

class Editor {
  // `ask(path, body)` asks the server.
  constructor(ask) {
    this.ask = ask;
    this.area = html("textarea", { spellcheck: "false", autocapitalize: "off", wrap: "off", "aria-label": "text of the model; Ctrl+S saves it" });
    this.lines = html("ol", { class: "listing" });
    this.box = html("div", { class: "editor" }, this.lines, this.area);
    this.problems = document.getElementById("problems");
    this.files = html("select", { id: "file", "aria-label": "file" });
    this.said = html("span", { id: "said", role: "status" });
    const button = (words, action, attributes = {}) => { const made = html("button", { type: "button", ...attributes }, words); made.addEventListener("click", action); return made; };
    this.saver = button("Save", () => this.save(), { title: "Ctrl+S" });
    this.other = button("take the file's", () => this.theirs.text === undefined ? this.open(this.file) : this.take(this.theirs), { hidden: true });
    this.force = button("save this one", () => { if (this.theirs.file === this.file) this.base = this.theirs.stamp; this.save(); }, { hidden: true });
    this.bar = html("nav", { id: "bar", class: "choice", "aria-label": "files" }, this.files, button("New", () => this.begin()), this.saver, this.said, this.other, this.force);
    this.problems.before(this.bar);
    this.suggestions = new Suggestions(this);  // its keys before those of the editor
    this.files.addEventListener("change", () => { if (this.may()) this.open(this.files.value); else this.files.value = this.file; });
    this.area.addEventListener("input", () => { this.paint(); this.say(); clearTimeout(this.waiting); this.waiting = setTimeout(() => this.check(), 300); });
    this.area.addEventListener("keydown", (event) => { if (event.key === "Enter") this.indent(event); });
    document.addEventListener("keydown", (event) => { if ((event.ctrlKey || event.metaKey) && event.key === "s") { event.preventDefault(); if (this.changed) this.save(); } });
    addEventListener("beforeunload", (event) => { if (this.changed) event.preventDefault(); });
    for (const kind of ["pointermove", "pointerleave"]) this.area.addEventListener(kind, (event) => this.light(Math.floor(event.offsetY / this.high()), kind === "pointerleave"));
    for (const kind of ["keyup", "click"]) this.area.addEventListener(kind, () => this.light(this.area.value.slice(0, this.area.selectionStart).split("\n").length - 1));
  }

  get changed() { return this.file !== undefined && this.area.value !== this.saved; }
  high() { return this.area.offsetHeight / this.lines.children.length; }
  may() { return !this.changed || confirm(`${this.file} has changes that are not saved. Leave them?`); }

  // The place of the text in the page, after the page was made anew.
  place() {
    const first = document.querySelector("#text .listing"), focused = document.activeElement === this.area, place = [this.area.selectionStart, this.area.selectionEnd];
    if (first && first !== this.lines) first.replaceWith(this.box);
    document.getElementById("text")?.append(this.problems);
    if (focused) { this.area.focus(); this.area.setSelectionRange(...place); }
  }

  // What the server says of the file: its text is shown, unless another is being written here.
  follow(state) {
    const mine = !this.opening;
    this.opening = false;
    if (state.file === this.file && state.text === this.sent) Object.assign(this, { base: state.stamp, saved: state.text, theirs: null });  // what was saved here, while more may have been typed
    this.files.replaceChildren(...state.files.map((name) => html("option", { value: name, selected: name === state.file }, name)));
    this.files.disabled = state.files.length < 2;
    document.body.classList.toggle("stale", Boolean(state.problems));
    if (mine && this.changed && state.text !== this.area.value) { if (state.stamp !== this.base) this.theirs = state; this.say(); return; }
    this.take(state);
    this.tell(state);
  }

  take(state) {
    Object.assign(this, { file: state.file, base: state.stamp, saved: state.text, theirs: null });
    if (this.area.value !== state.text) this.area.value = state.text;
    this.paint();
    this.say();
  }

  say() {
    this.said.textContent = this.theirs ? `${this.file}: ${this.theirs.file === this.file ? "it changed on disk meanwhile" : `${this.theirs.file} was opened elsewhere`}; nothing was overwritten.` : this.changed ? "not saved" : "";
    this.other.hidden = this.force.hidden = !this.theirs;
    this.saver.disabled = !this.changed;
  }

  paint() {
    const rows = this.area.value.split("\n"), lines = this.lines.children;
    while (lines.length > rows.length) lines[lines.length - 1].remove();
    rows.forEach((words, i) => {
      if (lines[i]?.words === words) return;
      const line = html("li", { "data-at": `0:${i + 1}` }, html("code", {}, ...pieces(words)));
      line.words = words;
      if (lines[i]) lines[i].replaceWith(line); else this.lines.append(line);
    });
  }

  // The parts of the diagram that a line makes.
  light(place, off) {
    if (this.lit !== place || off) this.lines.children[this.lit]?.dispatchEvent(new Event("pointerleave"));
    this.lit = off ? -1 : place;
    if (!off) this.lines.children[place]?.dispatchEvent(new Event("pointerenter"));
  }

  indent(event) {
    const start = this.area.value.lastIndexOf("\n", this.area.selectionStart - 1) + 1, [blank] = /^ */.exec(this.area.value.slice(start, this.area.selectionStart));
    if (blank && document.execCommand("insertText", false, `\n${blank}`)) event.preventDefault();
  }

  // Puts the cursor at the begin of a line, counted from 1.
  go(line) {
    const start = this.area.value.split("\n").slice(0, line - 1).join("\n").length + (line > 1);
    this.area.focus();
    this.area.setSelectionRange(start, start);
    this.lines.children[line - 1]?.scrollIntoView({ block: "nearest" });
  }

  async check() {
    const text = this.area.value;
    try {
      const found = await this.ask("/check", { text });
      if (text === this.area.value) this.tell(found);
    } catch { this.said.textContent = "No answer."; }
  }

  // Errors stand below the text that has them, each with its line, and what mends it.
  tell(found) {
    this.problems.innerHTML = found.problems;
    this.problems.classList.toggle("wrong", Boolean(found.problems));
    [...this.lines.children].forEach((line, i) => line.classList.toggle("bad", found.lines.includes(i + 1)));
    this.problems.querySelectorAll("li strong").forEach((place, i) => { if (found.lines[i]) place.replaceChildren(html("a", { href: "#text", "data-to": `0:${found.lines[i]}` }, place.textContent)); });
    this.area.setAttribute("aria-invalid", String(Boolean(found.problems)));
    const mend = found.corrections.map((c) => { const made = html("button", { type: "button" }, `${c.title} (line ${c.line})`); made.addEventListener("click", () => { this.area.value = c.text; this.paint(); this.say(); this.check(); this.area.focus(); }); return made; });
    if (mend.length) this.problems.append(html("div", { class: "choice mend" }, ...mend));
  }

  async save(file = this.file, text = this.area.value, before = this.base) {
    this.sent = text;
    try {
      const found = await this.ask("/save", { file, text, before });
      if (file === this.file && before === this.base && !found.saved) this.theirs = { file, ...this.theirs, stamp: found.stamp };
      this.say();
      if (file !== this.file && !found.saved) { this.opening = false; this.said.textContent = `${file} exists already.`; }
    } catch (problem) { this.said.textContent = problem.message; }
  }

  begin() {
    const name = this.may() && prompt("Name of the new file", "model.bg");
    if (!name) return;
    this.saved = this.area.value;
    this.opening = true;
    this.save(name, `model ${name.replace(/\.bg$/, "").replace(/\W+/g, "_").replace(/^\w/, (c) => c.toUpperCase())} {\n}\n`, "");
  }

  async open(file) {
    this.saved = this.area.value;
    this.opening = true;
    try { await this.ask("/open", { file }); } catch (problem) { this.opening = false; this.said.textContent = problem.message; }
  }
}

function pieces(words) {
  const found = [];
  let done = 0;
  for (const match of words.matchAll(PIECES)) {
    let kind = Object.keys(match.groups).find((name) => match.groups[name] !== undefined);
    if (kind === "name") kind = kindOf(words.slice(0, match.index), match[0], words.slice(match.index + match[0].length));
    if (kind) { found.push(words.slice(done, match.index), html("span", { class: kind }, match[0])); done = match.index + match[0].length; }
  }
  return [...found, words.slice(done)];
}

// The class of a name by what stands around it, as in a report: a letter is a kind at the begin of a statement, and a word in a bond or left of `=` is a name.
function kindOf(before, name, after) {
  const { words, kinds } = page.data, declared = new RegExp(`(?:^|[{;])[ \\t]*(?:[01]|${kinds.join("|")})[ \\t]+$|[-=]>[ \\t]*$`);
  if (kinds.includes(name)) return /(?:^|[{;])[ \t]*$/.test(before) && /^[ \t]+[\p{L}_]/u.test(after) ? "kind" : "";
  return words.includes(name) && !declared.test(before) && !/^[ \t]*(?:[-=]>|[.:[]|=(?!=))/.test(after) ? "word" : "";
}
