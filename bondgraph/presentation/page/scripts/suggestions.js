// What is known at the cursor: a text about the word there, and words that may follow; both from the service that editors ask.

const WORD = /[\p{L}_][\p{L}\p{N}_]*$/u;
// Characters are counted as the service counts them: one for each letter, whatever its code.
const counted = (text, place) => [...text.slice(0, place)].length;
const reached = (text, count) => [...text].slice(0, count).join("").length;

// A snippet's text, and the part of it that is filled in first.
function filled(snippet, blank) {
  let text = "", done = 0, first = null;
  const source = snippet.replace(/\n/g, `\n${blank}`);
  for (const match of source.matchAll(/\$(?:\{(\d+)(?::([^}]*)|\|([^,|]*)[^}]*)?\}|(\d+))/g)) {
    text += source.slice(done, match.index);
    const order = Number(match[1] ?? match[4]) || Infinity, words = match[2] ?? match[3] ?? "";
    if (!first || order < first.order) first = { order, start: text.length, end: text.length + words.length };
    text += words;
    done = match.index + match[0].length;
  }
  text += source.slice(done);
  return { text, start: first ? first.start : text.length, end: first ? first.end : text.length };
}

// Paragraphs, lists, bold words and pieces of text, as the service writes them.
function marked(text) {
  const spans = (words) => words.split(/(\*\*[^*]+\*\*|`[^`]+`)/).filter(Boolean).map((part) => /^\*\*.+\*\*$/.test(part) ? html("b", {}, part.slice(2, -2)) : /^`.+`$/.test(part) ? html("code", {}, part.slice(1, -1)) : part);
  return text.split(/\n{2,}/).map((part) => part.startsWith("- ") ? html("ul", {}, ...part.split("\n").map((line) => html("li", {}, ...spans(line.replace(/^- /, ""))))) : html("p", {}, ...spans(part)));
}

class Suggestions {
  constructor(editor) {
    Object.assign(this, { editor, area: editor.area, offered: [], chosen: 0, number: 0 });
    this.box = html("div", { id: "suggestions", role: "region", "aria-label": "help at the cursor", hidden: true });
    this.list = html("ul", { role: "listbox", id: "offered", tabindex: 0, "aria-label": "words that may follow" });
    this.about = html("div", { class: "about", role: "status", tabindex: 0 });
    this.box.append(this.list, this.about);
    document.body.append(this.box);  // nothing that scrolls cuts it off
    // Whoever scrolls closes it; a page that moves as results come in does not, nor does it lose the answer to a question.
    for (const kind of ["wheel", "touchmove", "pointerdown"]) document.addEventListener(kind, (event) => { if (!this.box.contains(event.target)) this.close(); }, { capture: true, passive: true });
    for (const [name, value] of Object.entries({ "aria-autocomplete": "list", "aria-controls": "offered", "aria-haspopup": "listbox", title: "Ctrl+Space: words that may follow; F1: about the word at the cursor" })) this.area.setAttribute(name, value);
    this.area.addEventListener("keydown", (event) => this.key(event));
    this.area.addEventListener("input", (event) => { if (!this.putting && (!this.list.hidden && !this.box.hidden || /^[\p{L}_.]$/u.test(event.data ?? ""))) this.later(() => this.complete(), 120); });
    this.area.addEventListener("pointermove", (event) => this.later(() => { if (this.box.hidden || this.list.hidden) this.hover(this.under(event)); }, 450));
    for (const kind of ["blur", "pointerleave"]) this.area.addEventListener(kind, () => this.close());
    this.list.addEventListener("pointerdown", (event) => { event.preventDefault(); const place = [...this.list.children].indexOf(event.target.closest("li")); if (place >= 0) this.put(place); });
  }

  later(action, wait) { clearTimeout(this.waiting); this.waiting = setTimeout(action, wait); }
  close() { clearTimeout(this.waiting); this.number++; this.box.hidden = true; this.area.removeAttribute("aria-activedescendant"); }

  // Where lines begin, and how wide a letter is.
  measure() {
    const context = html("canvas", {}).getContext("2d"), style = getComputedStyle(this.area);
    context.font = style.font;
    return [parseFloat(style.paddingLeft), context.measureText("0").width];
  }

  // The character under the pointer; none where a line has ended.
  under(event) {
    const lines = this.area.value.split("\n"), [start, wide] = this.measure(), line = Math.floor(event.offsetY / this.editor.high()), place = Math.floor((event.offsetX - start) / wide);
    return place >= 0 && place < (lines[line] ?? "").length ? lines.slice(0, line).join("\n").length + (line > 0) + place : -1;
  }

  // The answer, or null if another question came meanwhile.
  async ask(path, place) {
    const number = ++this.number, text = this.area.value;
    try { const found = await this.editor.ask(path, { text, at: String(counted(text, place)) }); return number === this.number && text === this.area.value ? found : null; } catch { return null; }
  }

  // Opens below a character, or above it where there is more room.
  open(place, listed) {
    const before = this.area.value.slice(0, place).split("\n"), { left, top } = this.area.getBoundingClientRect(), [start, wide] = this.measure(), high = this.editor.high(), below = top + before.length * high;
    this.list.hidden = !listed;
    this.box.hidden = false;
    const { width } = this.box.getBoundingClientRect(), above = below > 0.6 * innerHeight;
    Object.assign(this.box.style, { left: `${Math.max(4, Math.min(left + start + before.at(-1).length * wide, innerWidth - width - 4))}px`, top: above ? "auto" : `${below}px`, bottom: above ? `${innerHeight - below + high}px` : "auto" });
  }

  async hover(place) {
    if (place < 0) { this.close(); return; }
    const answer = await this.ask("/hover", place), found = answer?.[0];
    if (!answer) return;
    if (!found) { if (this.list.hidden) this.box.hidden = true; return; }
    this.about.replaceChildren(...marked(found.text));
    this.open(reached(this.area.value, found.start), false);
  }

  async complete(sure = false) {
    const place = this.area.selectionStart, found = await this.ask("/complete", place);
    if (!found) return;
    this.sure = sure;  // else a line may end here
    if (!found.length) { this.close(); return; }
    this.offered = found;
    this.list.replaceChildren(...found.map((one, i) => html("li", { role: "option", id: `offered-${i}` }, html("b", {}, one.label), " ", html("small", {}, one.detail || one.kind))));
    this.open(place - found[0].typed, true);
    this.choose(0);
  }

  choose(place, sure = this.sure) {
    this.sure = sure;
    this.chosen = (place + this.offered.length) % this.offered.length;
    [...this.list.children].forEach((line, i) => line.setAttribute("aria-selected", String(i === this.chosen)));
    this.list.children[this.chosen].scrollIntoView({ block: "nearest" });
    this.area.setAttribute("aria-activedescendant", `offered-${this.chosen}`);
    this.about.replaceChildren(...marked(this.offered[this.chosen].documentation));
  }

  key(event) {
    if (event.key === " " && event.ctrlKey) { event.preventDefault(); clearTimeout(this.waiting); this.complete(true); return; }
    if (event.key === "F1") { event.preventDefault(); this.hover(this.area.selectionStart); return; }
    if (this.box.hidden) return;
    const action = { Escape: () => this.close(), ...(!this.list.hidden && { ArrowDown: () => this.choose(this.chosen + 1, true), ArrowUp: () => this.choose(this.chosen - 1, true), Tab: () => this.put(this.chosen), ...(this.sure && { Enter: () => this.put(this.chosen) }) }) }[event.key];
    if (action) { event.preventDefault(); event.stopImmediatePropagation(); action(); } else if (!event.shiftKey && (this.list.hidden || /^(Arrow|Home|End|Page)/.test(event.key))) this.close();
  }

  // Writes the word that was chosen, and what it needs elsewhere, so that one can take it back.
  put(place) {
    const one = this.offered[place], { area } = this, text = area.value, end = area.selectionStart, start = end - (WORD.exec(text.slice(0, end))?.[0].length ?? 0);
    const [blank] = /^ */.exec(text.slice(text.lastIndexOf("\n", start - 1) + 1)), { text: words, ...hole } = one.is_snippet ? filled(one.insert, blank) : { text: one.insert, start: one.insert.length, end: one.insert.length };
    const write = (from, to, new_) => { area.setSelectionRange(from, to); if (!document.execCommand("insertText", false, new_)) area.setRangeText(new_, from, to, "end"); };
    this.putting = true;
    write(start, end, words);
    let moved = 0;
    for (const edit of one.edits.sort((a, b) => b.place[0] - a.place[0])) {
      const [from, to] = edit.place.map((at) => reached(text, at));
      write(from, to, edit.text);
      moved += from < start ? edit.text.length - (to - from) : 0;
    }
    this.putting = false;
    area.setSelectionRange(start + moved + hole.start, start + moved + hole.end);
    this.close();
  }
}
