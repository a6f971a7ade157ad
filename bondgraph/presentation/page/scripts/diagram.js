// The diagram: links with the text, a readout of the bond under the pointer, and power as the width and colour behind each bond.

const WIDEST = 9;  // px, of the bond with the largest power

class Diagram {
  constructor(data) {
    this.data = data;
    this.sheet = document.querySelector("#diagram .sheet");
    this.picture = this.sheet && this.sheet.querySelector("svg");
    this.readout = document.getElementById("bond");
    this.chosen = null;
    if (!this.picture) return;
    this.picture.setAttribute("role", "group");  // an image would hide from a screen reader that its parts are buttons
    this.nodes = [...this.picture.querySelectorAll("g.node")];
    this.lines = [...this.picture.querySelectorAll("g.bond")];
    this.flows = this.lines.map((group) => this.underlay(group));
    this.link();
    this.zooming();
    this.power = document.getElementById("power");
    this.power.addEventListener("change", () => this.show(this.place));
    this.say();
  }

  // A wide pale line behind a bond that shows its power, and one that nobody sees to point at.
  underlay(group) {
    const shaft = group.querySelector("path.line"), d = shaft.getAttribute("d");
    const flow = svg("path", { class: "flow", d }), target = svg("path", { class: "target", d });
    group.prepend(flow);
    group.append(target);
    return flow;
  }

  // ------------------------------------------------------------ text and diagram
  link() {
    this.at = new Map();
    const parts = [...this.data.parts.nodes.map((p, i) => [p, this.nodes[i]]), ...this.data.parts.lines.map((p, i) => [p, this.lines[i]])];
    parts.forEach(([part, group]) => {
      if (!group) return;
      for (const at of part.at) this.at.set(at, [...(this.at.get(at) || []), group]);
      const light = (on) => { for (const at of part.at.slice(0, 1)) lineOf(at)?.classList.toggle("lit", on); group.classList.toggle("lit", on); };
      group.setAttribute("tabindex", 0);
      group.setAttribute("role", "button");
      const words = (kind) => [...group.querySelectorAll(kind)].map((t) => t.textContent).join(" ");
      group.setAttribute("aria-label", `${words("text")} ${words("title")}`.trim() || part.name);
      const line = this.lines.indexOf(group);
      group.addEventListener("pointerenter", () => { light(true); if (line >= 0) this.choose(line); });
      group.addEventListener("pointerleave", () => light(false));
      group.addEventListener("focus", () => { light(true); if (line >= 0) this.choose(line); });
      group.addEventListener("blur", () => light(false));
      const go = () => { if (line >= 0) this.choose(line); toLine(part.at[0]); };
      group.addEventListener("click", go);
      group.addEventListener("keydown", (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); go(); } });
    });
    for (const [at, groups] of this.at) this.listen(lineOf(at), groups);
  }

  listen(line, groups) {
    if (!line) return;
    line.classList.add("linked");
    if (!page.editor) line.tabIndex = 0;
    const light = (on) => { line.classList.toggle("lit", on); for (const g of groups) g.classList.toggle("lit", on); };
    const go = () => this.scroll(groups[0]);
    for (const kind of ["pointerenter", "focus"]) line.addEventListener(kind, () => light(true));
    for (const kind of ["pointerleave", "blur"]) line.addEventListener(kind, () => light(false));
    line.addEventListener("click", go);
    line.addEventListener("keydown", (event) => { if (event.key === "Enter") go(); });
  }

  scroll(group) {
    const box = group.getBoundingClientRect(), frame = this.sheet.getBoundingClientRect();
    this.sheet.scrollBy({ left: box.left + box.width / 2 - frame.left - frame.width / 2, top: box.top + box.height / 2 - frame.top - frame.height / 2 });
    if (frame.top < 0 || frame.top > innerHeight * 0.8) this.sheet.scrollIntoView({ block: "nearest" });
    const line = this.lines.indexOf(group);
    if (line >= 0) this.choose(line);
  }

  zooming() {
    const natural = Number(this.picture.getAttribute("width")), high = Number(this.picture.getAttribute("height"));
    let scale = 1;
    const put = () => { this.picture.style.width = `${natural * scale}px`; this.picture.style.height = `${high * scale}px`; };
    const fit = () => { scale = Math.min(1.25, (this.sheet.clientWidth - 4) / natural); put(); };
    for (const button of document.querySelectorAll("[data-zoom]"))
      button.addEventListener("click", () => { const by = Number(button.dataset.zoom); if (by) { scale = Math.min(6, Math.max(0.1, scale * by)); put(); } else fit(); });
    fit();
    if (scale < 0.55) { scale = 0.55; put(); }
  }

  // ------------------------------------------------------------ along a run
  load(along) {
    this.along = along;
    if (!this.picture) return;
    this.largest = 0;
    if (along)
      for (let line = 0; line < this.lines.length; line++)
        for (let i = 0; i < along.count; i++) { const p = Math.abs(this.powerOf(line, i)); if (p > this.largest) this.largest = p; }
    this.say();
  }

  value(bond, which, place) {
    const column = this.data.places[bond]?.[which];
    return this.along && column != null ? between(row(this.along.bonds, column, this.along.count), place) : NaN;
  }

  powerOf(line, place) {
    return this.data.parts.lines[line].bonds.reduce((sum, b) => sum + this.value(b, 0, place) * this.value(b, 1, place), 0);
  }

  show(place) {
    this.place = place;
    if (!this.picture) return;
    const shown = this.power.checked && this.along && this.largest > 0;
    this.flows.forEach((flow, line) => {
      const p = shown ? this.powerOf(line, place) : 0, share = Math.abs(p) / this.largest;
      flow.style.strokeWidth = share > 1e-6 ? (WIDEST * Math.sqrt(share)).toFixed(2) : 0;
      flow.classList.toggle("backwards", p < 0);
    });
    if (this.numbers) this.numbers();
  }

  choose(line) {
    if (this.chosen === line) return;
    this.chosen = line;
    this.lines.forEach((group, i) => group.classList.toggle("chosen", i === line));
    this.say();
  }

  // What is known of the chosen bond: its numbers now and their course along the run.
  say() {
    if (!this.readout) return;
    this.numbers = null;
    if (this.chosen === null) { this.readout.textContent = "Point at a bond, or go to it with the tab key: its effort, flow and power are told here."; return; }
    const rows = this.data.parts.lines[this.chosen].bonds.map((bond) => this.rowOf(bond));
    this.readout.replaceChildren(...rows.map((r) => r.box));
    this.numbers = () => rows.forEach((r) => r.put());
    this.numbers();
  }

  rowOf(bond) {
    const told = this.data.parts.bonds[bond], box = html("span", { class: "of-bond" }, html("b", {}, told.name), ` ${told.domain} `);
    const course = (pick) => this.along ? Float64Array.from({ length: this.along.count }, (_, i) => pick(i)) : null;
    const effort = (p) => this.value(bond, 0, p), flow = (p) => this.value(bond, 1, p);
    const cells = [[told.effort[0], told.effort[1], effort], [told.flow[0], told.flow[1], flow], [told.power[0], told.power[1], (p) => effort(p) * flow(p)]].map(([letter, unit, pick]) => {
      const value = html("output", {}), spark = sparkline(course(pick));
      box.append(html("span", { class: "reading" }, `${letter} = `, value, spark.box));
      return () => { const place = this.place ?? 0; value.textContent = this.along ? quantity(pick(place), unit) : "—"; spark.put(this.along ? place / Math.max(1, this.along.count - 1) : 0); };
    });
    return { box, put: () => cells.forEach((cell) => cell()) };
  }
}

// A small curve with a mark where the run stands.
function sparkline(values) {
  const box = svg("svg", { class: "spark", viewBox: "0 0 90 22", width: 90, height: 22, "aria-hidden": true });
  if (!values || !values.length) return { box, put: () => {} };
  const [low, high] = extent([values]), y = (v) => (20 - (v - low) / (high - low || 1) * 18).toFixed(1);
  let d = "";
  values.forEach((v, i) => { if (Number.isFinite(v)) d += `${d ? "L" : "M"}${(i / Math.max(1, values.length - 1) * 88 + 1).toFixed(1)} ${y(v)}`; });
  const mark = svg("circle", { r: 2.5 });
  box.append(svg("path", { d: d || "M0 0" }), mark);
  return { box, put: (share) => { mark.setAttribute("cx", 1 + 88 * share); mark.setAttribute("cy", y(between(values, share * (values.length - 1))) || 0); } };
}

const lineOf = (at) => document.querySelector(`#text li[data-at="${CSS.escape(at)}"]`);

function toLine(at) {
  const line = at && lineOf(at);
  if (!line) return;
  line.closest("details").open = true;
  if (page.editor && at.startsWith("0:")) { page.editor.go(Number(at.slice(2))); return; }
  const list = line.closest("#text"), box = line.getBoundingClientRect(), frame = list.getBoundingClientRect();
  if (list.scrollHeight > list.clientHeight + 4) list.scrollBy({ top: box.top - frame.top - frame.height / 2 }); else line.scrollIntoView({ block: "center" });
}
