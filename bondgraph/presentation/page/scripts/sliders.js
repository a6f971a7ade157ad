// Sliders for parameters and inputs; what moves is told to whoever runs the model.

class Sliders {
  constructor(host, parameters, changed) {
    this.host = host;
    this.changed = changed;
    this.values = {};
    host.hidden = !parameters.length;
    const reset = html("button", { type: "button" }, "as in the text");
    reset.addEventListener("click", () => { this.values = {}; for (const put of this.puts) put(); changed(); });
    this.puts = [];
    const groups = ["parameter", "input"].map((role) => parameters.filter((p) => p.role === role)).filter((list) => list.length);
    host.replaceChildren(...groups.map((list, i) => html("details", { open: i === 0 }, html("summary", {}, list[0].role === "input" ? "Inputs" : "Parameters"), html("div", { class: "grid" }, ...list.map((p) => this.slider(p))))), reset);
  }

  slider(p) {
    const range = html("input", { type: "range", min: 0, max: 1000, "aria-label": p.name }), number = html("input", { type: "text", inputmode: "decimal", "aria-label": `${p.name} in ${p.unit}`, size: 9, spellcheck: "false" });
    const unit = html("span", { class: "unit" }, unitWords(p.unit));
    const size = p.size || 0;  // of what is zero: the largest number of its kind in the text; without one a number must be typed first
    let [low, high] = p.value ? [Math.min(0, 2 * p.value), Math.max(0, 2 * p.value)] : [-size, size];
    range.disabled = high === low;
    const put = (value, text) => {
      if (value < low || value > high) [low, high] = [Math.min(0, low, 2 * value), Math.max(0, high, 2 * value)];
      range.disabled = high === low;
      range.value = String(high > low ? (value - low) / (high - low) * 1000 : 500);
      if (!text) number.value = digits(value, 6).replace("−", "-");
    };
    const set = (value, text) => { this.values[p.name] = value; put(value, text); this.changed(); };
    range.addEventListener("input", () => { performance.mark("slider moved"); const value = low + Number(range.value) / 1000 * (high - low); set(Number(value.toPrecision(6)), false); });
    number.addEventListener("change", () => { const value = Number(number.value.replace("−", "-")); if (Number.isFinite(value) && number.value.trim()) set(value, true); else put(this.values[p.name] ?? p.value); });
    this.puts.push(() => put(this.values[p.name] ?? p.value));
    put(p.value);
    return html("label", { class: "slider", title: p.description || "" }, html("span", { class: "name" }, p.name), range, number, unit);
  }
}
