// A mechanism that moves: points turn with their bodies, and bodies, joints and springs are drawn anew at each instant.

const WIDE = 520, EDGE = 34, BAR = 7;
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

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

const way = (points, closed) => points.map((p, i) => `${i ? "L" : "M"}${p[0].toFixed(2)} ${p[1].toFixed(2)}`).join("") + (closed ? "Z" : "");

function coil([x, y], [u, v]) {
  const length = Math.hypot(u - x, v - y) || 1, a = (u - x) / length, b = (v - y) / length, teeth = 9, found = [[x, y]];
  for (let i = 1; i < teeth; i++) {
    const s = length * (0.12 + 0.76 * i / teeth), side = 5 * (i % 2 ? 1 : -1);
    found.push([x + s * a - side * b, y + s * b + side * a]);
  }
  return way([...found, [u, v]]);
}

function hatch([x, y], [u, v]) {
  const length = Math.hypot(u - x, v - y) || 1, a = (u - x) / length, b = (v - y) / length;
  let d = way([[x, y], [u, v]]);
  for (let s = 0; s <= length; s += 6) d += way([[x + s * a, y + s * b], [x + s * a - 5 * a - 5 * b, y + s * b - 5 * b + 5 * a]]);
  return d;
}

const disc = ([x, y], r) => `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`;

class Stage {
  constructor(host, scene) {
    this.scene = scene;
    this.parts = scene.planar ? 3 : 7;
    this.factor = 1;
    this.picture = svg("svg", { class: "stage bondgraph", role: "img", "aria-label": `mechanism ${scene.name}` });
    this.range = html("input", { type: "range", min: 0, max: 4, step: 0.05, value: 0, "aria-label": "how much motions are exaggerated" });
    this.told = html("output", {});
    const label = html("label", { class: "factor" }, "motion ", this.range, this.told);
    host.append(html("figure", { class: "panel" }, html("figcaption", {}, scene.name, " ", label), this.picture));
    this.range.addEventListener("input", () => { this.exaggerate(10 ** Number(this.range.value)); this.show(this.place); });
    this.make();
  }

  make() {
    const add = (look) => { const made = svg("path", { class: look }); this.picture.append(made); return made; };
    this.plates = this.scene.bodies.map(() => [add("edge"), add("plate")]);
    this.outlines = this.scene.bodies.map((body) => body.outlines.map(() => add("line")));
    this.links = this.scene.links.map((link) => {
      const found = { rail: add("hatch"), line: add("line"), sign: add("sign pin") };
      found.line.append(svg("title", {}, document.createTextNode([link.kind, link.name, ...link.sprung].join(" "))));
      return found;
    });
    this.masses = this.scene.bodies.map((body) => {
      const name = svg("text", { class: "port" });
      name.textContent = body.name;
      this.picture.append(name);
      return [add("solid"), name];
    });
    this.marks = this.scene.marks.map(() => add("line"));
  }

  // Poses along a run: rows of numbers, one for each part of each body.
  load(poses, count, free) {
    this.poses = poses; this.count = count;
    const [size, moved] = this.sizes();
    const wanted = free ? 0.12 * size / (moved || 1) : moved > 0 && moved < 0.03 * size ? 0.08 * size / moved : 1;
    this.size = size;
    this.exaggerate(free ? wanted : wanted > 1 ? 10 ** Math.min(4, Math.round(Math.log10(wanted) * 4) / 4) : 1);
    this.free = free;
    this.range.parentElement.hidden = free;
    this.range.value = Math.log10(this.factor);
  }

  exaggerate(factor) {
    this.factor = factor;
    this.told.textContent = factor === 1 ? "as it is" : `× ${digits(factor, 2)}`;
    this.frame();
  }

  sizes() {
    let moved = 0;
    const rest = this.scene.bodies.flatMap((b) => [b.centre, ...b.points, ...b.outlines.flat()]).concat(this.scene.links.flatMap((l) => l.ends.map((e) => e.at)));
    const all = rest.map((p) => this.flat(p));
    const span = (k) => all.length ? Math.max(...all.map((p) => p[k])) - Math.min(...all.map((p) => p[k])) : 1;
    const size = Math.max(span(0), span(1)) || 1;
    const saved = this.factor;
    this.factor = 1;
    for (let i = 0; i < this.count; i += Math.max(1, Math.floor(this.count / 60)))
      this.scene.bodies.forEach((body, b) => {
        for (const point of [body.centre, ...body.points]) {
          const [x, y] = this.at(b, point, i), [u, v] = this.flat(point);
          moved = Math.max(moved, Math.hypot(x - u, y - v));
        }
      });
    this.factor = saved;
    return [Math.max(size, 1e-12), moved];
  }

  flat(point) { return [dot(this.scene.right, point), dot(this.scene.up, point)]; }

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

  // Where a point of a body is in the plane of the picture.
  at(b, point, place) {
    if (b < 0) return this.flat(point);
    const { place: centre, turn } = this.pose(b, place), rest = this.scene.bodies[b].at;
    const arm = turned(turn, point.map((v, k) => v - rest[k]));
    return this.flat(arm.map((v, k) => v + centre[k]));
  }

  points(place) {
    const { bodies, links, marks } = this.scene;
    return {
      bodies: bodies.map((body, b) => [body.centre, ...body.points].map((p) => this.at(b, p, place))),
      outlines: bodies.map((body, b) => body.outlines.map((line) => line.map((p) => this.at(b, p, place)))),
      links: links.map((link) => link.ends.map((e) => this.at(e.body, e.at, place))),
      marks: marks.map((m) => this.at(m.body, m.at, place)),
    };
  }

  // The part of the plane that holds everything at every instant.
  frame() {
    if (!this.poses) return;
    let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
    for (let i = 0; i < this.count; i += Math.max(1, Math.floor(this.count / 40))) {
      const { bodies, links, outlines } = this.points(i);
      for (const [x, y] of [...bodies.flat(), ...links.flat(), ...outlines.flat(2)]) {
        if (!Number.isFinite(x + y)) continue;
        left = Math.min(left, x); right = Math.max(right, x); low = Math.min(low, y); high = Math.max(high, y);
      }
    }
    const span = Math.max(right - left, high - low) || 1;
    this.unit = WIDE / span; this.origin = [left, high];
    this.picture.setAttribute("viewBox", `0 0 ${((right - left) * this.unit || 0) + 2 * EDGE} ${((high - low) * this.unit || 0) + 2 * EDGE}`);
  }

  page([x, y]) { return [(x - this.origin[0]) * this.unit + EDGE, (this.origin[1] - y) * this.unit + EDGE]; }

  show(place) {
    this.place = place;
    if (!this.poses || !this.count) return;
    const found = this.points(place);
    found.bodies.forEach((points, b) => {
      const [centre, ...others] = points.map((p) => this.page(p));
      const outline = way(hull([centre, ...others]), true);
      for (const path of this.plates[b]) path.setAttribute("d", outline);
      this.masses[b][0].setAttribute("d", disc(centre, 3));
      this.masses[b][1].setAttribute("x", centre[0] + 10);
      this.masses[b][1].setAttribute("y", centre[1] - 8);
    });
    found.outlines.forEach((lines, b) => lines.forEach((line, i) => this.outlines[b][i].setAttribute("d", way(line.map((p) => this.page(p))))));
    found.links.forEach((ends, i) => this.link(this.scene.links[i], this.links[i], ...ends.map((p) => this.page(p)), place));
    found.marks.forEach((p, i) => { const [x, y] = this.page(p); this.marks[i].setAttribute("d", `M${x - 4} ${y}h8M${x} ${y - 4}v8`); });
  }

  link(link, paths, first, second, place) {
    const spring = link.sprung.length > 0;
    let rail = "", line = "", sign = "", look = "line", mark = "pin";
    if (["distance", "rod"].includes(link.kind)) {
      line = spring ? coil(first, second) : way([first, second]);
      look = spring ? "spring" : link.kind === "rod" ? "line" : "measure";
      sign = disc(first, 3) + disc(second, 3);
    } else if (["slide", "cylinder", "screw"].includes(link.kind)) {
      [rail, line] = this.slide(link, first, second, place);
    } else if (["free", "planar"].includes(link.kind)) {
      const apart = Math.hypot(first[0] - second[0], first[1] - second[1]) > 1.5;
      line = apart ? (spring ? coil(first, second) : way([first, second])) : spring ? coil([first[0] - 15, first[1]], [first[0] + 15, first[1]]) : "";
      look = spring ? "spring" : "measure";
      sign = disc(first, 3) + (apart ? disc(second, 3) : "");
    } else if (["wheel", "skate"].includes(link.kind)) {
      if (link.kind === "skate") line = way([-18, 18].map((half) => second.map((v, k) => v + half * this.along(link, place)[k])));
      sign = disc(second, 3);
    } else {
      const [x, y] = second;
      if (link.grounded) { line = way([[x, y], [x - 9, y + 16], [x + 9, y + 16]], true); rail = hatch([x - 14, y + 16], [x + 14, y + 16]); look = "stand"; }
      sign = link.kind === "weld" ? way([[x - 4, y - 4], [x + 4, y - 4], [x + 4, y + 4], [x - 4, y + 4]], true) : disc(second, 5);
      mark = ["weld", "ball"].includes(link.kind) ? "solid" : "pin";
      if (spring) line += disc(second, 9) + disc(second, 12);
    }
    for (const [path, d] of [[paths.rail, rail], [paths.line, line], [paths.sign, sign]]) path.setAttribute("d", d || "M0 0");
    paths.line.setAttribute("class", look);
    paths.sign.setAttribute("class", `sign ${mark}`);
  }

  // The direction of a joint's axis on the page.
  along(link, place) {
    const axis = link.axis_of < 0 ? link.axis : turned(this.pose(link.axis_of, place).turn, link.axis);
    const [u, v] = this.flat(axis), length = Math.hypot(u, v);
    return length > 1e-9 ? [u / length, -v / length] : [1, 0];
  }

  // A block on a rail along its axis; the rail is hatched where it is the ground.
  slide(link, first, second, place) {
    const [u, v] = this.along(link, place);
    const across = u > 0 || (u === 0 && v > 0) ? [-v, u] : [v, -u];
    const gone = (second[0] - first[0]) * u + (second[1] - first[1]) * v;
    const base = [second[0] + 8 * across[0], second[1] + 8 * across[1]];
    const along = (s) => [base[0] + (s - gone) * u, base[1] + (s - gone) * v];
    const low = Math.min(0, gone) - 26, high = Math.max(0, gone) + 26;
    const ends = across[0] * -v + across[1] * u > 0 ? [along(low), along(high)] : [along(high), along(low)];
    const corner = (s, t) => [second[0] + s * u + t * across[0], second[1] + s * v + t * across[1]];
    const block = way([corner(-11, -8), corner(11, -8), corner(11, 8), corner(-11, 8)], true);
    return [link.grounded ? hatch(...ends) : way(ends), block];
  }
}
