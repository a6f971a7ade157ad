// A mechanism that moves in space: bodies, joints and springs as solids, turned by the reader; points turn with their bodies.

const TINTS = ["#a9cdea", "#f5c6a2", "#a5dcc6", "#e5bdd6", "#c2dfef", "#e6d29c", "#c6cdd3"].map(rgb);
const CORNERS = [[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]];  // of a box, but for their opposites
const JOINT = rgb("#6a7783"), STAND = rgb("#a7afb7"), SPRING = rgb("#b9680f"), HEAVY = rgb("#4c5761"), TRACE = rgb("#d55e00"), THIN = rgb("#8a949d"), AXES = ["#c8443c", "#3f9a52", "#3c72c8"].map(rgb);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
function rgb(hex) { return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16)); }

// A vector turned by a quaternion w, x, y, z.
function turned([w, x, y, z], [a, b, c]) {
  const tx = 2 * (y * c - z * b), ty = 2 * (z * a - x * c), tz = 2 * (x * b - y * a);
  return [a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx];
}

// The turn p after the turn q.
const after = ([a, b, c, d], [w, x, y, z]) => [a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y, a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w];

function hull(points) {
  const sorted = [...points].sort((p, q) => p[0] - q[0] || p[1] - q[1]);
  const half = (list) => {
    const kept = [];
    for (const p of list) {
      while (kept.length > 1) {
        const [a, b] = kept.slice(-2);
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        kept.pop();
      }
      kept.push(p);
    }
    return kept.slice(0, -1);
  };
  return sorted.length < 3 ? sorted : [...half(sorted), ...half(sorted.reverse())];
}

const HOME = { plane: [0, 0], space: [-25, 24] };  // degrees: about the upright, and above the level
const SUN = [-35, 35];  // degrees, from where the reader is at home
const SIDES = { home: null, front: [0, 0], side: [90, 0], top: [0, 90] };

class Stage {
  constructor(host, scene) {
    this.scene = scene;
    this.parts = scene.planar ? 3 : 7;
    this.factor = 1;
    const right = Math.abs(scene.up[0]) > 0.9 ? [0, 1, 0] : unitary(plus([1, 0, 0], scene.up, -scene.up[0]));
    this.level = [right, cross(right, scene.up)];  // to the right and towards the reader, seen from the front
    this.canvas = html("canvas", {});
    this.eye = new Solids(this.canvas);
    this.shadows = new Solids();
    this.letters = svg("svg", { "aria-hidden": "true" });
    this.box = html("div", { class: "stage bondgraph", tabindex: 0, role: "img", "aria-label": `mechanism ${scene.name}; drag or arrow keys turn it, plus and minus zoom, 0 shows all` }, this.canvas, this.letters);
    this.range = html("input", { type: "range", min: 0, max: 4, step: 0.05, value: 0, "aria-label": "how much motions are exaggerated" });
    this.told = html("output", {});
    this.traces = html("input", { type: "checkbox" });
    const views = Object.entries(SIDES).map(([words, angles]) => { const made = html("button", { type: "button" }, words); made.addEventListener("click", () => this.look(angles)); return made; });
    const label = html("label", { class: "factor" }, "motion ", this.range, this.told);
    host.append(html("figure", { class: "panel" }, html("figcaption", {}, scene.name, label, html("label", { class: "factor" }, this.traces, "traces"), html("span", { class: "choice views" }, ...views)), this.box));
    this.range.addEventListener("input", () => { this.exaggerate(10 ** Number(this.range.value)); this.show(this.place); });
    this.traces.addEventListener("change", () => this.show(this.place));
    this.names = scene.bodies.map((body) => this.letter(body.name, "port"));
    this.ends = ["x", "y", "z"].map((name) => this.letter(name, "port"));
    this.look(null);
    this.listen();
    new ResizeObserver(() => this.show(this.place)).observe(this.box);
  }

  letter(words, kind) { const made = svg("text", { class: kind }, words); this.letters.append(made); return made; }

  // Poses along a run: rows of numbers, one for each part of each body.
  load(poses, count, free) {
    Object.assign(this, { poses, count, free });
    const [size, moved] = this.sizes();
    const wanted = free ? 0.12 * size / (moved || 1) : moved > 0 && moved < 0.03 * size ? 0.08 * size / moved : 1;
    this.exaggerate(free ? wanted : wanted > 1 ? 10 ** Math.min(4, Math.round(Math.log10(wanted) * 4) / 4) : 1);
    this.range.parentElement.hidden = free;
    this.range.value = Math.log10(this.factor);
  }

  exaggerate(factor) {
    this.factor = factor;
    this.told.textContent = factor === 1 ? "as it is" : `× ${digits(factor, 2)}`;
    this.frame();
  }

  // Instants that stand for all.
  some(most) { const step = Math.max(1, Math.floor(this.count / most)); return Array.from({ length: Math.ceil(this.count / step) }, (_, i) => i * step); }

  // Points that a body fills at rest.
  filled(body) { return [body.centre, ...body.points, ...body.outlines.flat(), ...(this.thick(body) ? (body.given ? CORNERS.map((signs) => signs.reduce((sum, sign, k) => plus(sum, body.solid.axes[k], sign), [0, 0, 0])) : body.solid.axes).flatMap((axis) => [plus(body.centre, axis), plus(body.centre, axis, -1)]) : [])]; }

  // A solid of the same mass and inertia; one beyond the mechanism, as of a rotor behind its gear, says nothing of a shape.
  thick({ solid, given }) { return given || solid && !(this.span > 0 && Math.max(...solid.axes.map((a) => Math.hypot(...a))) > 1.5 * this.span); }

  sizes() {
    const rest = this.scene.bodies.flatMap((b) => [b.centre, ...b.points, ...b.outlines.flat()]).concat(this.scene.links.flatMap((l) => l.ends.map((e) => e.at)));
    const reach = (points) => Math.max(0, ...[0, 1, 2].map((k) => { const [low, high] = extent([points.map((p) => p[k])]); return points.length ? high - low : 0; }));
    this.span = reach(rest);
    const size = this.span || reach(this.scene.bodies.flatMap((b) => this.filled(b))) || 1;
    this.factor = 1;
    let moved = 0;
    for (const i of this.some(60)) {
      const poses = this.all(i);
      this.scene.bodies.forEach((body, b) => { for (const point of [body.centre, ...body.points]) moved = Math.max(moved, Math.hypot(...plus(this.at(poses, b, point), point, -1))); });
    }
    return [size, moved];
  }

  pose(b, place) {
    const value = (k) => between(row(this.poses, this.scene.first + b * this.parts + k, this.count), place);
    const body = this.scene.bodies[b], f = this.factor, near = (now, rest) => rest + f * (now - rest);
    if (this.scene.planar) {
      const rest = 2 * Math.atan2(body.turn[3], body.turn[0]), turn = f * (value(2) - rest);
      return { place: [near(value(0), body.at[0]), near(value(1), body.at[1]), 0], turn: [Math.cos(turn / 2), 0, 0, Math.sin(turn / 2)] };
    }
    const [w, x, y, z] = body.turn;
    let turn = after([3, 4, 5, 6].map(value), [w, -x, -y, -z]);
    if (f !== 1) turn = [1 + f * (turn[0] - 1), f * turn[1], f * turn[2], f * turn[3]];
    const size = Math.hypot(...turn) || 1;
    return { place: [0, 1, 2].map((k) => near(value(k), body.at[k])), turn: turn.map((v) => v / size) };
  }

  all(place) { return this.scene.bodies.map((_, b) => this.pose(b, place)); }

  // Where a point of a body is, and where a direction of it points.
  at(poses, b, point) { return b < 0 ? point : plus(turned(poses[b].turn, plus(point, this.scene.bodies[b].at, -1)), poses[b].place); }
  along(poses, b, axis) { return unitary(b < 0 ? axis : turned(poses[b].turn, axis)); }

  // What holds everything at every instant, and the ways of frames, or else of the centres.
  frame() {
    const { bodies, links, marks } = this.scene, low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity], seen = [];
    const marked = marks.filter((m) => m.body >= 0), traced = marked.length ? marked : bodies.map((body, b) => ({ body: b, at: body.centre }));
    this.ways = traced.map(() => []);
    const instants = this.some(400), few = Math.max(1, Math.floor(instants.length / 40)), deep = [];
    instants.forEach((i, n) => {
      const poses = this.all(i);
      traced.forEach((m, k) => this.ways[k].push([i, this.at(poses, m.body, m.at)]));
      deep.push(...this.deep(poses));
      if (n % few) return;
      for (const point of [...bodies.flatMap((body, b) => this.filled(body).map((p) => this.at(poses, b, p))), ...links.flatMap((l) => l.ends.map((e) => this.at(poses, e.body, e.at)))]) {
        if (!point.every(Number.isFinite)) continue;
        seen.push(point);
        point.forEach((v, k) => { low[k] = Math.min(low[k], v); high[k] = Math.max(high[k], v); });
      }
    });
    this.middle = low.map((v, k) => (v + high[k]) / 2 || 0);
    this.seen = seen.map((p) => plus(p, this.middle, -1));
    const size = Math.max(...high.map((v, k) => v - low[k])) / 2;
    this.thin = (size > 0 && size < Infinity ? size : 1) / 30;  // radius of rods and joints
    this.floor = extent([deep.map(([height, room]) => height - room * this.thin)])[0] - dot(this.scene.up, this.middle);
    this.round = 1.3 * extent([this.seen.map((p) => Math.hypot(...p))])[1];
    this.aim(HOME[this.scene.planar ? "plane" : "space"]);
    this.shapely = this.half[1] / this.half[0];
    this.shapes = bodies.map((body) => this.shape(body));
  }

  // How deep each part goes, and how many thicknesses of a rod below that it is drawn.
  deep(poses) {
    const { bodies, links, up } = this.scene, height = (b, p) => dot(up, this.at(poses, b, p));
    return [...bodies.flatMap((body, b) => {
      const own = height(b, body.centre), points = [...body.given ? [] : body.points.map((p) => [height(b, p), 1.2]), ...body.outlines.flat().map((p) => [height(b, p), 0])];
      if (!this.thick(body)) return [[own, 1], ...points];
      const [u, v, w] = body.solid.axes.map((axis) => Math.abs(dot(up, turned(poses[b].turn, axis))));
      return [[own - (body.solid.round === 3 ? Math.hypot(u, v, w) : body.solid.round === 2 ? Math.hypot(u, v) + w : u + v + w), 0], ...points];
    }), ...links.map(({ kind, grounded, ends: [, end] }) => [height(end.body, end.at), ["wheel", "skate"].includes(kind) ? 0 : grounded ? 2.7 : 1.5])];
  }

  // A body at rest: a plate through its points where they lie in a plane, else rods between those nearest each other.
  shape(body) {
    const near = 1e-6 * (this.span || 1), apart = (list) => list.filter((p, i) => list.findIndex((q) => Math.hypot(...plus(p, q, -1)) <= near) === i), held = apart(body.points);
    const points = this.thick(body) && held.length > 1 ? held : apart([body.centre, ...held]), arms = points.slice(1).map((p) => plus(p, points[0], -1));
    let normal = this.scene.planar ? [0, 0, 1] : null;
    for (const a of arms) for (const b of arms) { const n = cross(a, b); if (!normal && Math.hypot(...n) > 0.05 * Math.hypot(...a) * Math.hypot(...b)) normal = unitary(n); }
    if (!points.length || (points.length < 2 && !this.scene.planar)) return { rods: [] };
    if (normal && arms.every((a) => Math.abs(dot(a, normal)) <= 1e-3 * this.span)) {
      const [u, v] = across(normal), r = 1.2 * this.thin;
      const flat = hull(points.flatMap((p) => ROUND.map(([c, s]) => [dot(u, p) + r * c, dot(v, p) + r * s])));
      const base = plus(scaled(normal, dot(normal, points[0])), normal, -r / 5);
      return { plate: flat.map(([s, t]) => plus(plus(base, u, s), v, t)), thickness: scaled(normal, 2 * r / 5), rods: [] };
    }
    const rods = [], joined = [points[0]], left = points.slice(1);
    while (left.length) {
      const [, p, q] = left.flatMap((q) => joined.map((p) => [Math.hypot(...plus(q, p, -1)), p, q])).reduce((best, one) => one[0] < best[0] ? one : best);
      rods.push([p, q]);
      joined.push(...left.splice(left.indexOf(q), 1));
    }
    return { rods };
  }

  // ---------------------------------------------------------------- where the reader is

  look(angles) { Object.assign(this, { angles: [...(angles ?? HOME[this.scene.planar ? "plane" : "space"])], zoom: 1, shift: [0, 0] }); this.show(this.place); }

  turn(yaw, pitch) { this.angles = [this.angles[0] + yaw, Math.max(-90, Math.min(90, this.angles[1] + pitch))]; this.show(this.place); }
  nearer(factor) { this.zoom = Math.max(0.2, Math.min(50, this.zoom * factor)); this.show(this.place); }
  push(right, down) { this.shift = [this.shift[0] + right, this.shift[1] + down]; this.show(this.place); }

  listen() {
    const held = new Map(), box = this.box;
    const spread = () => { const [p, q] = [...held.values()]; return q ? Math.hypot(p[0] - q[0], p[1] - q[1]) : 0; };
    box.addEventListener("pointerdown", (event) => { held.set(event.pointerId, [event.clientX, event.clientY]); box.setPointerCapture(event.pointerId); });
    box.addEventListener("pointermove", (event) => {
      if (!held.has(event.pointerId)) return;
      const [x, y] = held.get(event.pointerId), before = spread(), right = event.clientX - x, down = event.clientY - y;
      held.set(event.pointerId, [event.clientX, event.clientY]);
      if (held.size > 1) this.zoom *= spread() / (before || 1) || 1;
      if (event.shiftKey || event.buttons & 6) this.push(right, down); else this.turn(-right / 2, down / 2 * (held.size > 1 ? 0.5 : 1));
    });
    for (const kind of ["pointerup", "pointercancel"]) box.addEventListener(kind, (event) => held.delete(event.pointerId));
    box.addEventListener("contextmenu", (event) => event.preventDefault());
    box.addEventListener("wheel", (event) => { if (document.activeElement !== box && !event.ctrlKey) return; event.preventDefault(); this.nearer(1.0015 ** -event.deltaY); }, { passive: false });
    box.addEventListener("dblclick", () => this.look(null));
    box.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key], factor = { "+": 1.25, "=": 1.25, "-": 0.8 }[event.key];
      if (event.ctrlKey || event.metaKey || !(way || factor || event.key === "0")) return;
      event.preventDefault();
      if (way && event.shiftKey) this.push(20 * way[0], 20 * way[1]); else if (way) this.turn(-10 * way[0], 10 * way[1]); else if (factor) this.nearer(factor); else this.look(null);
    });
  }

  // Right, down and towards the reader who looks from angles.
  sides(angles) {
    const [yaw, pitch] = angles.map((a) => a * Math.PI / 180), [front, ahead] = this.level, { up } = this.scene;
    const right = plus(scaled(front, Math.cos(yaw)), ahead, -Math.sin(yaw)), level = plus(scaled(ahead, Math.cos(yaw)), front, Math.sin(yaw));
    const above = plus(scaled(up, Math.cos(pitch)), level, -Math.sin(pitch)), towards = plus(scaled(level, Math.cos(pitch)), up, Math.sin(pitch));
    return [right, scaled(above, -1), towards];
  }

  // Sets how directions of space are seen, and what of the plane that is seen holds everything.
  aim(angles) {
    this.axes = this.sides(angles);
    const seen = this.seen.map((p) => this.way(p)), ranges = [0, 1].map((k) => extent([seen.map((p) => p[k])]));
    this.centre = [...ranges.map(([low, high]) => (low + high) / 2), 0];
    this.half = ranges.map(([low, high]) => (high - low) / 2 + 4 * this.thin);
  }

  way(v) { return this.axes.map((axis) => dot(axis, v)); }
  view(p) { return plus(this.origin, this.way(plus(p, this.middle, -1)), this.scale); }

  // ---------------------------------------------------------------- what is seen

  show(place) {
    this.place = place;
    const width = this.box.clientWidth;
    if (!this.poses || !this.count || !width || place === undefined) return;
    const height = Math.round(Math.max(0.4 * width, Math.min(width * this.shapely, 0.95 * width, 480))), hasty = performance.now() - this.drawn < 150, fine = hasty ? 1 : 2;  // dots of the canvas for each of the page: few while it moves
    clearTimeout(this.waiting);
    if (hasty) this.waiting = setTimeout(() => this.show(this.place), 200);
    this.box.style.setProperty("height", `${height}px`);
    this.letters.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.aim(this.angles);
    const scale = fine * this.zoom * Math.min(width / this.half[0], height / this.half[1]) / 2, { axes, scene, eye } = this, poses = this.all(place);
    const origin = plus([(width / 2 + this.shift[0]) * fine, (height / 2 + this.shift[1]) * fine, 0], this.centre, -scale), sun = this.sunlit(poses, 320 * fine);
    const rows = this.axes.flatMap((axis, k) => { const row = axes.map((own) => dot(axis, own) * this.scale / scale); return [...row, this.origin[k] - dot(row, origin)]; });
    Object.assign(this, { axes, scale, origin, solids: eye });
    eye.begin(width * fine, height * fine, { solids: this.shadows, rows: new Float64Array(rows), at: this.way(sun) });
    const above = this.way(scene.up);
    if (scene.floor && above[2] > 0.01) eye.floor(plus(origin, above, this.floor * scale), above, this.round * scale);
    this.paint(poses);
    for (const { body, at } of scene.marks) this.cross(this.view(this.at(poses, body, at)), 1.4 * this.thin * scale, (v) => this.way(this.along(poses, body, v)));
    if (this.traces.checked) for (const way of this.ways) eye.line(way.map(([, p]) => this.view(p)), 3, TRACE);
    const corner = [26 * fine, (height - 26) * fine, 1e6];
    this.cross(corner, 18 * fine, (v) => this.way(v), 1);
    eye.end();
    this.drawn = performance.now();
    this.ends.forEach((letter, k) => { const [x, y] = plus(scaled(corner, 1 / fine), this.way([0, 1, 2].map((i) => Number(i === k))), 24); letter.setAttribute("x", x - 3); letter.setAttribute("y", y + 4); });
    this.label(scene.bodies.map((body, b) => scaled(this.view(this.at(poses, b, body.centre)), 1 / fine)), height);
  }

  // The same as the sun sees it, with as much of it as there is now; returns where the sun is.
  sunlit(poses, size) {
    const home = HOME[this.scene.planar ? "plane" : "space"], { bodies, links } = this.scene;
    this.axes = this.sides(plus(home, SUN));
    const round = [...bodies.flatMap((body, b) => [[this.at(poses, b, body.centre), this.thick(body) ? Math.hypot(...body.solid.axes.flat()) : 0], ...[...body.points, ...body.outlines.flat()].map((p) => [this.at(poses, b, p), 0])]), ...links.flatMap((l) => l.ends.map((e) => [this.at(poses, e.body, e.at), 0]))];
    const ranges = [0, 1].map((k) => extent([round.flatMap(([p, r]) => { const v = this.way(plus(p, this.middle, -1))[k]; return [v - r, v + r]; })])), room = 5 * this.thin;
    const scale = size / (Math.max(...ranges.map(([low, high]) => high - low)) + 2 * room);
    Object.assign(this, { scale, solids: this.shadows, origin: [...ranges.map(([low]) => (room - low) * scale), 0] });
    this.shadows.begin(size, size);
    this.paint(poses);
    this.shadows.end();
    return this.axes[2];
  }

  paint(poses) {
    const { bodies, links } = this.scene, seen = (b, p) => this.view(this.at(poses, b, p));
    bodies.forEach((body, b) => this.body(body, this.shapes[b], body.colour ? rgb(body.colour) : TINTS[b % TINTS.length], (p) => seen(b, p), (v) => this.way(turned(poses[b].turn, v))));
    for (const link of links) this.link(link, ...link.ends.map((e) => seen(e.body, e.at)), this.way(this.along(poses, link.axis_of, link.axis)));
  }

  // Names beside the centres, below each other where they would meet.
  label(centres, height) {
    const taken = [];
    centres.map((at, b) => [at, b]).sort(([p], [q]) => p[1] - q[1]).forEach(([[x, y], b]) => {
      const words = this.scene.bodies[b].name, wide = 7 * words.length, left = x + 9;
      let base = y - 7;
      for (const [l, r, t] of taken) if (left < r && left + wide > l && Math.abs(base - t) < 12) base = t + 12;
      taken.push([left, left + wide, base]);
      this.names[b].setAttribute("x", left);
      this.names[b].setAttribute("y", Math.min(base, height - 3));
    });
  }

  cross(at, size, way, width = 0.5) {
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => this.solids.line([at, plus(at, way(axis), size)], 2 + 2 * width, AXES[k]));
  }

  body(body, shape, tint, seen, way) {
    const s = this.scale, thin = this.thin * s, centre = seen(body.centre);
    if (body.given) shape = { rods: [] };
    if (shape.plate) this.solids.prism(shape.plate.map(seen), scaled(way(shape.thickness), s), tint);
    for (const rod of shape.rods) this.solids.rod(...rod.map(seen), 0.55 * thin, scaled(tint, 0.85));
    for (const line of body.outlines) this.solids.line(line.map(seen), 4, HEAVY);
    if (this.thick(body)) {
      const axes = body.solid.axes.map((axis) => scaled(way(axis), s));
      if (body.solid.round === 3) this.solids.ball(centre, Math.hypot(...axes[0]), tint);
      else this.solids[body.solid.round === 2 ? "cylinder" : "box"](centre, axes, tint, body.given ? 0.85 : 0.45);
    }
    if (body.heavy && !body.given) this.solids.ball(centre, (shape.plate || shape.rods.length || body.solid ? 0.55 : 1) * thin, HEAVY);
  }

  link(link, first, second, axis) {
    const { solids } = this, r = this.thin * this.scale, spring = link.sprung.length > 0, apart = Math.hypot(...plus(second, first, -1)) > 0.3 * r;
    const sides = (axis, u, w = u) => [...across(axis).map((v) => scaled(v, u)), scaled(axis, w)], up = this.way(this.scene.up);
    if (["distance", "rod", "free", "planar"].includes(link.kind)) {
      if (spring) solids.coil(...(apart ? [first, second] : [plus(first, [2.4 * r, 0, 0], -1), plus(first, [2.4 * r, 0, 0])]), 0.7 * r, SPRING);
      else if (apart) { if (link.kind === "rod") solids.rod(first, second, 0.3 * r, JOINT); else solids.line([first, second], 2, THIN); }
      for (const end of apart ? [first, second] : [first]) solids.ball(end, 0.45 * r, JOINT);
      return;
    }
    if (["slide", "cylinder", "screw"].includes(link.kind)) {
      const gone = dot(plus(second, first, -1), axis), low = plus(second, axis, Math.min(-gone, 0) - 3.2 * r), high = plus(second, axis, Math.max(-gone, 0) + 3.2 * r), half = scaled(plus(high, low, -1), 0.5);
      const rail = [...across(axis).map((v) => scaled(v, 0.45 * r)), half];
      solids[link.kind === "slide" ? "box" : "cylinder"](plus(low, half), rail, link.grounded ? STAND : JOINT);
      solids.box(second, sides(axis, r, 1.3 * r), JOINT);
    } else if (link.kind === "skate") solids.box(second, sides(axis, 0.3 * r, 2 * r), JOINT);
    else if (link.kind === "wheel") solids.ball(second, 0.4 * r, JOINT);
    else {
      if (link.grounded) { const foot = plus(second, up, -2.4 * r); solids.rod(second, foot, 0.5 * r, STAND); solids.box(foot, sides(up, 1.7 * r, 0.3 * r), STAND); }
      if (link.kind === "weld") solids.box(second, sides(axis, 0.8 * r), JOINT);
      if (["ball", "universal"].includes(link.kind)) solids.ball(second, r, JOINT);
      if (["hinge", "universal"].includes(link.kind)) solids.cylinder(second, sides(axis, link.kind === "hinge" ? 0.85 * r : 0.5 * r, 1.5 * r), JOINT);
      if (spring) { const [u, v] = across(axis); for (const f of [-0.6, 0, 0.6]) solids.line([...ROUND, ROUND[0]].map(([c, s]) => plus(plus(plus(second, u, 1.5 * r * c), v, 1.5 * r * s), axis, f * r)), 3, SPRING); }
    }
  }
}
