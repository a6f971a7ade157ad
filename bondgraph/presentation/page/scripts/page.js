// The page: what is chosen among experiments and modes, its plots, and everything that follows the time.

const page = { pins: [], measured: [] };
const FRAMES = 96;  // of one cycle of a mode

function start() {
  page.player = new Player((share) => follow(share));
  document.addEventListener("click", (event) => {
    const link = event.target.closest && event.target.closest("a[data-to]");
    if (link) { event.preventDefault(); toLine(link.dataset.to); }
  });
  document.addEventListener("keydown", (event) => {
    const busy = event.target.closest && event.target.closest("input,textarea,select,button,summary,a,[tabindex]:not(.sheet,.wide,.stage)");
    if (event.key === " " && !busy) { event.preventDefault(); page.player.play(!page.player.playing); }
  });
  addEventListener("beforeprint", () => { for (const one of document.querySelectorAll("details")) one.open = true; });
  page.data = JSON.parse(document.getElementById("data").textContent);
  if (typeof live === "function") live(); else load(page.data);
  performance.mark("interactive");
}

function load(data) {
  page.data = data;
  page.diagram = new Diagram(data);
  page.plots = [];
  page.view = null;
  const stages = document.getElementById("stages");
  page.stages = stages ? data.scenes.map((scene) => new Stage(stages, scene)) : [];
  const choice = document.getElementById("choice");
  if (!choice) { page.player.load(null); return; }
  page.buttons = data.experiments.map((experiment, i) => {
    const button = html("button", { type: "button", "aria-pressed": "false" }, experiment.name);
    button.addEventListener("click", () => choose(i));
    return button;
  });
  page.modes = modeChoice(data.modes);
  choice.replaceChildren(...page.buttons, ...(data.modes.length ? [html("label", {}, "mode ", page.modes)] : []));
  const before = data.experiments.findIndex((e) => e.name === page.chosen);
  if (data.experiments.length) choose(Math.max(0, before)); else if (data.modes.length) { page.modes.value = "0"; swing(data.modes[0]); } else page.player.load(null);
}

function choose(place) {
  const experiment = page.data.experiments[place];
  const same = page.chosen === experiment.name && page.swinging === undefined;
  page.chosen = experiment.name;
  page.swinging = undefined;
  page.buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(i === place)));
  if (page.modes) page.modes.value = "";
  if (page.asked) { page.asked(experiment.name); return; }
  show(experiment, same);
}

// An experiment: its plots, what is told of it, and whatever moves along it.
function show(experiment) {
  const told = document.getElementById("told");
  told.innerHTML = experiment.told || "";
  const run = experiment.run, plots = document.getElementById("plots");
  if (!run) {
    clear(plots);
    if (experiment.plot) draw(plots, { ...experiment.plot, along: null });
    along(null);
    return;
  }
  for (const note of run.notes) told.prepend(html("p", { class: "note" }, note));
  clear(plots);
  draw(plots, run);
  along(run.along);
}

function clear(plots) { plots.replaceChildren(); page.plots = []; page.view = null; }

// Plots over one axis, with buttons to zoom for those who have neither keys nor a mouse.
function draw(plots, run) {
  page.run = run;
  const found = panels(run), times = computed(found);
  if (!times.some((t) => t.length)) return;
  const [low, high] = extent(times);
  page.view = new View(low, high);
  const { name, unit } = page.axis = axisOf(run, low, high), words = `${name}${unit && `, ${unitWords(unit)}`}`;
  const chosen = (instant, hovering) => { if (!hovering || !page.player.playing) { if (!hovering) page.player.play(false); page.player.put((instant - low) / (high - low)); } };
  page.mark = null;
  plots.append(tools(), pinned());
  for (const panel of found) page.plots.push(new Plot(plots, panel.title, panel.unit, panel.curves, { words, ...page.axis }, page.view, chosen));
}

// Instants of what was computed: measured values do not make the axis longer.
const computed = (panels) => panels.flatMap((panel) => panel.curves.filter((curve) => !curve.dots).map((curve) => curve.times));

// What a run is plotted over: the swept quantity, or the time in the unit in which it reads best.
function axisOf(run, low, high) {
  const [unit, factor] = run.axis ? [run.axis.unit, 1] : timeUnit(Math.max(Math.abs(low), Math.abs(high)));
  return { name: run.axis ? run.axis.name : "time", unit, factor, log: run.axis?.log };
}

function tools() {
  const middle = () => (page.view.range[0] + page.view.range[1]) / 2;
  const button = (words, told, action) => { const made = html("button", { type: "button", "aria-label": told, title: told }, words); made.addEventListener("click", action); return made; };
  return html("div", { class: "tools" }, button("+", "zoom in", () => page.view.zoom(0.5, middle())), button("−", "zoom out", () => page.view.zoom(2, middle())), button("all", "all of the run", () => page.view.show(...page.view.whole)), button("pin", "pin: keep these curves beside those of the next run", () => pin()), button("mark", "mark: measure from here: values in the legend are told with their difference to those here (M; shift and click)", () => mark(page.plots[0].instant)), ...fileChoice(), html("output", { id: "apart" }));
}

// A second cursor; at the same instant again it goes.
function mark(instant) {
  page.mark = page.mark === instant ? null : instant;
  for (const plot of page.plots) plot.point(plot.instant);
  apart();
}

// How far the cursor is from the mark.
function apart() {
  const told = document.getElementById("apart"), { name, unit, factor, log } = page.axis ?? {}, now = page.plots[0]?.instant;
  if (told) told.textContent = page.mark == null ? "" : `Δ ${name} = ${log ? quantity(10 ** now - 10 ** page.mark, unit) : `${digits((now - page.mark) * factor)} ${unitWords(unit)}`}`;
}

// ---------------------------------------------------------------- pins: curves that stay

function pin() {
  const set = page.sliders ? page.sliders.words : "", name = [page.pins.some((p) => p.model !== page.data.model) && page.data.model, page.chosen, set].filter(Boolean).join(", ");
  page.pins.push({ model: page.data.model, name, run: page.run });
  again();
}

// The plots drawn anew, with the pins as they are now.
function again() { const plots = document.getElementById("plots"); clear(plots); draw(plots, page.run); page.player.put(page.player.share); }

function pinned() {
  return html("div", { class: "choice pins" }, ...[page.pins, page.measured].flatMap((list) => list.map((one, i) => {
    const button = html("button", { type: "button", "aria-label": `remove ${one.name}`, class: `key d${1 + i % 2}` }, list === page.pins ? html("i") : "• ", one.name, " ×");
    button.addEventListener("click", () => { list.splice(i, 1); again(); });
    return button;
  })));
}

// One panel for each unit, with the curves of pinned runs over the same axis, then energies and powers along the run.
function panels(run) {
  const groups = new Map(), axis = (one) => one.axis ? `${one.axis.name} ${one.axis.unit}` : "";
  const add = (one, words, dash) => {
    const times = one.axis?.log ? unpack(one.time).map(Math.log10) : unpack(one.time), values = unpack(one.values);
    const turns = times.some((t, i) => t < times[i - 1]);  // a branch round its folds
    one.outputs.forEach((output, i) => {
      if (!groups.has(output.unit)) groups.set(output.unit, { unit: output.unit, title: "", curves: [] });
      const { curves } = groups.get(output.unit), like = curves.findIndex((c) => c.output === output.name);
      curves.push({ name: words ? `${output.name} (${words})` : output.name, output: output.name, times, turns, values: row(values, i, times.length), ...(words && { colour: like < 0 ? curves.length : like, dash }) });
    });
  };
  add(run, "", 0);
  page.pins.forEach((one, i) => { if (axis(one.run) === axis(run)) add(one.run, one.name, 1 + i % 2); });
  addMeasured(groups, run);
  return run.along ? [...groups.values(), ...flows(run.along)] : [...groups.values()];
}

const STRONGEST = 6;  // elements whose powers are plotted

function flows(told) {
  const times = unpack(told.time), count = times.length, energy = unpack(told.energy), bonds = unpack(told.bonds);
  const sums = ["supplied", "dissipated", "stored"].map((name, i) => ({ name, times, values: row(energy, i, count) }));
  const powers = page.data.powers.map(([name, , around]) => {
    const values = new Float32Array(count);
    for (const [bond, sign] of around) {
      const [effort, flow] = page.data.places[bond];
      for (let i = 0; i < count; i++) values[i] += effort === null || flow === null ? NaN : sign * bonds[effort * count + i] * bonds[flow * count + i];
    }
    return { name, times, values, size: values.reduce((sum, v) => sum + Math.abs(v), 0) };
  });
  const largest = Math.max(0, ...powers.map((p) => p.size || 0));
  const strong = powers.filter((p) => p.size > 1e-6 * largest).sort((p, q) => q.size - p.size).slice(0, STRONGEST);
  const found = [];
  if (energy.some((v) => v)) found.push({ title: "energy since the start", unit: "J", curves: sums });
  if (strong.length) found.push({ title: "power into", unit: "W", curves: strong });
  return found;
}

// The same experiment with other values: the curves change where they stand.
function refresh(run) {
  const found = panels(run), [low, high] = extent(computed(found));
  const alike = found.length === page.plots.length && found.every((panel, i) => panel.curves.length === page.plots[i].curves.length && panel.curves.every((c, k) => c.name === page.plots[i].curves[k].name));
  if (!alike || low !== page.view.whole[0] || high !== page.view.whole[1]) return false;
  page.run = run;
  found.forEach((panel, i) => page.plots[i].replace(panel.curves));
  along(run.along);
  return true;
}

// What moves along a run: the diagram and the mechanisms.
function along(told) {
  if (!told) { page.along = null; page.diagram.load(null); page.diagram.show(0); hideStages(true); page.player.load(page.view ? (share) => at(share) : null, false); return; }
  const times = unpack(told.time), count = times.length;
  page.along = { times, count, bonds: unpack(told.bonds), poses: unpack(told.poses) };
  page.diagram.load(page.along);
  hideStages(false);
  for (const stage of page.stages) stage.load(page.along.poses, count, false);
  page.player.load((share) => at(share), false);
}

function at(share) {
  const [low, high] = page.view.whole, { name, unit, factor, log } = page.axis, between = low + share * (high - low), value = Math.abs(between) < 1e-9 * (high - low) ? 0 : between;
  return `${name} = ${log ? quantity(10 ** value, unit) : `${digits(value * factor)} ${unitWords(unit)}`}`.trim();
}

function hideStages(hidden) { const stages = document.getElementById("stages"); if (stages) stages.hidden = hidden || !page.stages.length; }

// Everything goes to a share of the run.
function follow(share) {
  if (page.view) { const [low, high] = page.view.whole; for (const plot of page.plots) plot.point(low + share * (high - low)); apart(); }
  if (!page.along) return;
  const { times, count } = page.along;
  const place = page.swinging === undefined ? placeOf(times, times[0] + share * (times[count - 1] - times[0])) : share * (count - 1);
  page.diagram.show(place);
  for (const stage of page.stages) stage.show(place);
}

// ---------------------------------------------------------------- modes

function modeWords(mode, place) {
  const damping = mode.damping === null ? "" : `, damping ${digits(mode.damping, 3)}`;
  return `${place + 1}: ${quantity(mode.frequency, "Hz")}${damping}`;
}

function modeChoice(modes) {
  const made = html("select", { "aria-label": "mode" }, html("option", { value: "" }, "none"), ...modes.map((mode, i) => html("option", { value: i }, modeWords(mode, i))));
  made.addEventListener("change", () => { if (made.value === "") choose(0); else swing(modes[Number(made.value)]); });
  return made;
}

// A mode goes round: amplitudes turn through one cycle about the state of rest.
function swing(mode) {
  const place = page.data.modes.indexOf(mode);
  page.swinging = place;
  page.buttons.forEach((button) => button.setAttribute("aria-pressed", "false"));
  const plots = document.getElementById("plots"), told = document.getElementById("told");
  clear(plots);
  told.replaceChildren();
  const shares = mode.energy.map(([name, share]) => html("li", {}, html("span", {}, name), html("meter", { min: 0, max: 1, value: Math.max(0, share) }), ` ${digits(100 * share, 3)} %`));
  plots.append(html("figure", { class: "panel" }, html("figcaption", {}, `mode ${modeWords(mode, place)}`), html("p", {}, "where its energy is:"), html("ul", { class: "shares" }, ...shares)));
  const poses = cycle(unpack(mode.poses.re), unpack(mode.poses.im), unpack(mode.rest));
  page.along = { times: Float64Array.from({ length: FRAMES }, (_, i) => i), count: FRAMES, bonds: cycle(unpack(mode.bonds.re), unpack(mode.bonds.im), null), poses };
  page.diagram.load(page.along);
  hideStages(false);
  for (const stage of page.stages) stage.load(page.along.poses, FRAMES, true);
  page.player.load((share) => `${Math.round(360 * share)}° of the cycle`, true);
  page.player.put(page.player.share);
}

// One cycle of complex amplitudes, row by row. Those about a state of rest are made small, so that pictures, which enlarge them, stay linear.
function cycle(re, im, rest) {
  const largest = rest ? Math.max(1e-300, ...re.map(Math.abs), ...im.map(Math.abs)) * 1e3 : 1;
  const found = new Float64Array(re.length * FRAMES);
  for (let k = 0; k < re.length; k++)
    for (let i = 0; i < FRAMES; i++) {
      const phase = 2 * Math.PI * i / (FRAMES - 1);
      found[k * FRAMES + i] = (rest ? rest[k] : 0) + (re[k] * Math.cos(phase) - im[k] * Math.sin(phase)) / largest;
    }
  return found;
}
