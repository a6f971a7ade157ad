// Sliders and entries for parameters and inputs, in the author's units; what is set is told, as texts with units, to whoever runs the model.

const BARE = /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i;

class Sliders {
  constructor(host, parameters, changed) {
    this.changed = changed;
    this.values = {};
    this.accepted = {};  // the values of the last run that was made
    this.rows = new Map();
    host.hidden = !parameters.length;
    const reset = html("button", { type: "button" }, "as in the text");
    reset.addEventListener("click", () => { this.values = {}; for (const row of this.rows.values()) row.reset(); changed(); });
    const groups = ["parameter", "input"].map((role) => parameters.filter((p) => p.role === role)).filter((list) => list.length);
    host.replaceChildren(...groups.map((list, i) => html("details", { open: i === 0 }, html("summary", {}, list[0].role === "input" ? "Inputs" : "Parameters"), html("div", { class: "grid" }, ...list.map((p) => this.slider(p))))), reset);
  }

  slider(p) {
    const range = html("input", { type: "range", min: 0, max: 1000, "aria-label": p.name }), wrong = html("small", { class: "wrong", role: "alert", hidden: true });
    const entry = html("input", { type: "text", "aria-label": `${p.name} in ${p.unit || "bare numbers"}`, size: 9, spellcheck: "false" });
    const words = (value) => `${digits(value, 12).replace("−", "-")} ${p.unit}`.trim();
    const size = p.size || 0;  // of what is zero: the largest number of its kind in the text; without one a number must be typed first
    let [low, high] = p.value ? [Math.min(0, 2 * p.value), Math.max(0, 2 * p.value)] : [-size, size];
    const put = (value) => {
      if (value < low || value > high) [low, high] = [Math.min(0, low, 2 * value), Math.max(0, high, 2 * value)];
      range.disabled = high === low;
      range.value = String(high > low ? (value - low) / (high - low) * 1000 : 500);
    };
    const tell = (reason) => { wrong.textContent = reason; wrong.hidden = !reason; entry.setAttribute("aria-invalid", String(Boolean(reason))); };
    const set = (text) => { tell(""); entry.value = this.values[p.name] = text; this.changed(); };
    range.addEventListener("input", () => { performance.mark("slider moved"); set(words(Number((low + Number(range.value) / 1000 * (high - low)).toPrecision(4)))); });
    entry.addEventListener("change", () => { const text = entry.value.replace("−", "-").trim(); set(BARE.test(text) ? `${text} ${p.unit}`.trim() : text); });
    const row = { put, tell, text: (text) => { entry.value = text; }, reset: () => { tell(""); put(p.value); entry.value = words(p.value); } };
    row.reset();
    this.rows.set(p.name, row);
    return html("label", { class: "slider", title: p.description || "" }, html("span", { class: "name" }, p.name), range, entry, wrong);
  }

  // Values that were chosen before the text changed stay, where their names do.
  keep(before) { for (const [name, row] of this.rows) if (name in before) { row.text(before[name]); this.values[name] = before[name]; } }

  // What the server made of the values: a text that is none of a parameter's is told beside its entry, and the last run stays.
  answer(found) {
    for (const [name, row] of this.rows) {
      if (found.wrong?.[name]) row.tell(found.wrong[name]);
      if (found.set && name in found.set) row.put(found.set[name]);
    }
    if (found.wrong) for (const name of Object.keys(found.wrong)) { if (name in this.accepted) this.values[name] = this.accepted[name]; else delete this.values[name]; }
    else this.accepted = { ...this.values };
  }

  get words() { return Object.entries(this.accepted).map(([name, text]) => `${name} = ${text}`).join(", "); }
}
