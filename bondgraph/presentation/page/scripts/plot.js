// A plot: curves of one unit over a common axis, with a cursor, zoom by dragging, by keys and by buttons.

const SPACE = "http://www.w3.org/2000/svg";
const HEIGHT = 190, LEFT = 58, RIGHT = 12, TOP = 10, BOTTOM = 30;

function svg(name, attributes = {}, ...inside) {
  const made = document.createElementNS(SPACE, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...inside);
  return made;
}

function html(name, attributes = {}, ...inside) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) if (value !== false && value != null) made.setAttribute(key, value === true ? "" : value);
  made.append(...inside);
  return made;
}

// Round numbers inside a range.
function ticks(low, high, most) {
  const span = high - low || 1, raw = span / most, size = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * size).find((s) => span / s <= most) || 10 * size;
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9 && found.length < 20; k++) found.push(k * step);
  return found;
}

// Round numbers inside a range of powers of ten: decades, or 1, 2 and 5 in each, or all where these are few.
function powerTicks(low, high, most) {
  const decades = ticks(low, high, most).filter(Number.isInteger), found = [];
  if (decades.length > 2) return decades;
  for (let k = Math.floor(low); k <= high; k++) found.push(...[1, 2, 5].map((digit) => k + Math.log10(digit)).filter((t) => t >= low - 1e-9 && t <= high + 1e-9));
  return found.length > 2 ? found : ticks(10 ** low, 10 ** high, most).map(Math.log10);
}

// A tick with as many decimals as tell it from its neighbours.
function tickWords(value, step) {
  if (Math.abs(value) < step * 1e-6) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) return digits(value, Math.max(1, Math.min(7, Math.round(Math.log10(size / step)) + 2)));
  return value.toFixed(Math.max(0, Math.min(9, -Math.floor(Math.log10(step) + 1e-9)))).replace("-", "−");
}

// `view` is shared by the plots of a run: the range of the axis that is shown, and who follows it.
class View {
  constructor(low, high) { this.whole = [low, high]; this.range = [low, high]; this.plots = []; }
  show(low, high) {
    const least = (this.whole[1] - this.whole[0]) * 1e-6;
    low = Math.max(low, this.whole[0]); high = Math.min(high, this.whole[1]);
    if (!(high - low > least)) return;
    this.range = [low, high];
    for (const plot of this.plots) plot.draw();
  }
  zoom(factor, about) {
    const [low, high] = this.range;
    this.show(about - (about - low) * factor, about + (high - about) * factor);
  }
}

// Colour and dashes of a curve: its own, or those of its place.
const look = (curve, place) => `${curve.dots ? "dots " : ""}c${(curve.colour ?? place) % 7} d${curve.dash ?? Math.floor(place / 7) % 3}`;

class Plot {
  // `curves`: {name, times, values, turns, colour, dash}; `axis`: {words, factor, log}, of log the values are powers of ten; `chosen(instant)` is called where the reader points.
  constructor(host, title, unit, curves, axis, view, chosen) {
    Object.assign(this, { title, unit, curves, axis, view, chosen, instant: view.whole[0], hidden: new Set() });
    this.picture = svg("svg", { class: "plot", tabindex: 0, role: "img", "aria-label": `${title} over ${axis.words}; arrow keys move the cursor, M marks where it is, plus and minus zoom, 0 shows all` });
    this.legend = html("div", { class: "legend" });
    this.box = html("figure", { class: "panel" }, html("figcaption", {}, title, " ", html("small", {}, unit && `[${unitWords(unit)}]`), this.legend, html("span", { class: "exports" }, ...exports(this))), this.picture);
    host.append(this.box);
    this.keys = curves.map((curve, place) => this.key(curve, place));
    this.legend.append(...this.keys.map((key) => key.button));
    view.plots.push(this);
    this.listen();
    this.width = 0;
    new ResizeObserver(() => { const width = this.box.clientWidth; if (Math.abs(width - this.width) > 1) { this.width = width; this.draw(); } }).observe(this.box);
  }

  key(curve, place) {
    const value = html("span", { class: "value" });
    const button = html("button", { type: "button", class: `key ${look(curve, place)}`, "aria-pressed": "true" }, html("i"), curve.name, " ", value);
    button.addEventListener("click", () => {
      if (!this.hidden.delete(place)) this.hidden.add(place);
      button.setAttribute("aria-pressed", String(!this.hidden.has(place)));
      this.draw();
    });
    return { button, value };
  }

  replace(curves) { this.curves = curves; this.draw(); }

  x(value) { const [low, high] = this.view.range; return LEFT + (value - low) / (high - low) * (this.width - LEFT - RIGHT); }
  back(x) { const [low, high] = this.view.range; return low + (x - LEFT) / (this.width - LEFT - RIGHT) * (high - low); }
  y(value) { const [low, high] = this.scale; return TOP + (high - value) / (high - low) * (HEIGHT - TOP - BOTTOM); }

  // The places of a curve's values that are in the range, with one beyond on both sides.
  places({ times, turns }) {
    if (turns) return [0, times.length];
    const [low, high] = this.view.range;
    return [Math.max(0, Math.floor(placeOf(times, low))), Math.min(times.length, Math.ceil(placeOf(times, high)) + 1)];
  }

  draw() {
    if (!this.width) this.width = this.box.clientWidth;
    if (!this.width) return;
    const shown = this.curves.filter((_, place) => !this.hidden.has(place)).map((curve) => curve.values.subarray(...this.places(curve)));
    let [low, high] = extent(shown);
    const size = Math.max(Math.abs(low), Math.abs(high));
    if (high - low <= 1e-9 * size || high === low) { const half = size * 0.5 || 1; low -= half; high += half; }
    const room = (high - low) * 0.06;
    this.scale = [low - room, high + room];
    this.picture.setAttribute("viewBox", `0 0 ${this.width} ${HEIGHT}`);
    this.picture.setAttribute("height", HEIGHT);
    [this.cursor, this.marker] = ["cursor", "cursor marker"].map((kind) => svg("path", { class: kind }));
    this.picture.replaceChildren(...this.frame(), ...this.paths(), this.cursor, this.marker);
    this.point(this.instant);
  }

  frame() {
    const found = [], [low, high] = this.view.range, { factor, log } = this.axis;
    const right = this.width - RIGHT, bottom = HEIGHT - BOTTOM;
    const xs = (log ? powerTicks : ticks)(low * factor, high * factor, Math.max(2, Math.floor((this.width - LEFT) / 90)));
    const ys = ticks(...this.scale, 5);
    for (const t of xs) {
      const x = this.x(t / factor);
      found.push(svg("path", { class: "grid", d: `M${x} ${TOP}V${bottom}` }), svg("text", { class: "tick", x, y: bottom + 14, "text-anchor": "middle" }, log ? digits(10 ** t, 3) : tickWords(t, xs[1] - xs[0] || t || 1)));
    }
    for (const t of ys) {
      const y = this.y(t);
      found.push(svg("path", { class: "grid", d: `M${LEFT} ${y}H${right}` }), svg("text", { class: "tick", x: LEFT - 6, y: y + 4, "text-anchor": "end" }, tickWords(t, ys[1] - ys[0] || t || 1)));
    }
    found.push(svg("text", { class: "tick", x: right, y: HEIGHT - 2, "text-anchor": "end" }, this.axis.words));
    return found;
  }

  paths() {
    return this.curves.map((curve, place) => {
      if (this.hidden.has(place)) return svg("g");
      const [first, last] = this.places(curve);
      let way = "", pen = "M";
      for (let i = first; i < last; i++) {
        const v = curve.values[i];
        if (Number.isFinite(v) && Number.isFinite(curve.times[i])) { if (curve.dots) { way += `M${this.x(curve.times[i]).toFixed(1)} ${this.y(v).toFixed(1)}h0`; continue; } way += `${pen}${this.x(curve.times[i]).toFixed(1)} ${this.y(v).toFixed(1)}`; pen = "L"; } else pen = "M";
      }
      return svg("path", { class: `curve ${look(curve, place)}`, d: way || "M0 0" });
    });
  }

  // The value of a curve at an instant; of measured ones the nearest.
  value({ times, values, turns, dots }, instant) {
    const place = placeOf(times, instant);
    return turns ? NaN : dots ? values[Math.round(place)] : between(values, place);
  }

  // Puts the cursor at an instant, and the values there into the legend, with their differences to those at the mark.
  point(instant) {
    this.instant = instant;
    if (!this.cursor) return;
    const [low, high] = this.view.range, line = (t) => t != null && t >= low && t <= high ? `M${this.x(t)} ${TOP}V${HEIGHT - BOTTOM}` : "M0 0";
    this.cursor.setAttribute("d", line(instant));
    this.marker.setAttribute("d", line(page.mark));
    this.keys.forEach((key, i) => {
      const curve = this.curves[i], now = curve && this.value(curve, instant);
      key.value.textContent = !curve || curve.turns ? "" : page.mark == null ? digits(now) : `${digits(now)}, Δ ${digits(now - this.value(curve, page.mark))}`;
    });
  }

  listen() {
    const at = (event) => this.back(event.clientX - this.picture.getBoundingClientRect().left);
    let from = null, band = null;
    this.picture.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      from = at(event);
      band = svg("rect", { class: "band", y: TOP, height: HEIGHT - TOP - BOTTOM, width: 0 });
      this.picture.append(band);
      this.picture.setPointerCapture(event.pointerId);
    });
    this.picture.addEventListener("pointermove", (event) => {
      const here = at(event);
      if (from === null) { if (event.pointerType === "mouse") this.chosen(here, true); return; }
      const [a, b] = [this.x(from), this.x(here)].sort((u, v) => u - v);
      band.setAttribute("x", a); band.setAttribute("width", Math.max(0, b - a));
    });
    const end = (event) => {
      if (from === null) return;
      const here = at(event), wide = Math.abs(this.x(here) - this.x(from)) > 8, start = from;
      from = null; band.remove();
      if (event.type !== "pointerup") return;
      if (wide) this.view.show(Math.min(start, here), Math.max(start, here)); else if (event.shiftKey) mark(here); else this.chosen(here, false);
    };
    this.picture.addEventListener("pointerup", end);
    this.picture.addEventListener("pointercancel", end);
    this.picture.addEventListener("dblclick", () => this.view.show(...this.view.whole));
    this.picture.addEventListener("keydown", (event) => {
      const [low, high] = this.view.range, step = (high - low) / (event.shiftKey ? 20 : 200);
      const action = {
        ArrowLeft: () => this.chosen(this.instant - step, false), ArrowRight: () => this.chosen(this.instant + step, false),
        "+": () => this.view.zoom(0.5, this.instant), "=": () => this.view.zoom(0.5, this.instant), "-": () => this.view.zoom(2, this.instant),
        m: () => mark(this.instant),
        0: () => this.view.show(...this.view.whole), Escape: () => this.view.show(...this.view.whole),
      }[event.key];
      if (action && !event.ctrlKey && !event.metaKey) { event.preventDefault(); action(); }
    });
  }
}
