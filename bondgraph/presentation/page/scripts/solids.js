// Solids on a canvas of two dimensions: each point of it keeps its depth, so that near things hide far ones where bodies reach into each other.
// Points are [right, down, towards the reader] in dots of the canvas. What the sun sees is the same picture without a canvas: what it does not see is in shadow.

const SHADE = 0.55;  // brightness without sun
const plus = (a, b, f = 1) => a.map((v, k) => v + f * b[k]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, f) => a.map((v) => v * f);
const unitary = (a) => scaled(a, 1 / (Math.hypot(...a) || 1));
// Two directions across one.
function across(axis) {
  const least = axis.map(Math.abs), k = least.indexOf(Math.min(...least)), u = unitary(cross(axis, [0, 1, 2].map((i) => Number(i === k))));
  return [u, unitary(cross(axis, u))];
}
const corners = (count) => Array.from({ length: count }, (_, i) => [Math.cos(2 * Math.PI * i / count), Math.sin(2 * Math.PI * i / count)]);
const ROUND = corners(20), ROUNDER = corners(48);

const shaded = (tone, r, g, b) => 0xff000000 | Math.min(255, b * tone) << 16 | Math.min(255, g * tone) << 8 | Math.min(255, r * tone);

class Solids {
  constructor(canvas) { this.canvas = canvas; this.context = canvas?.getContext("2d"); }

  // `sun`: solids as it sees them, where it is, and the rows of numbers that lead there from here: of right, down, towards it.
  begin(width, height, sun = null) {
    if (this.width !== width || this.height !== height) {
      Object.assign(this, { width, height, dots: new Uint32Array(width * height), depth: new Float32Array(width * height) });
      if (this.canvas) Object.assign(this.canvas, { width, height });
    }
    this.sun = sun;
    this.dots.fill(0);
    this.depth.fill(-Infinity);
    this.late = [];
  }

  // What one looks through comes last, far before near.
  end() {
    for (const [, draw] of this.late.sort((a, b) => a[0] - b[0])) draw();
    this.context?.putImageData(new ImageData(new Uint8ClampedArray(this.dots.buffer), this.width, this.height), 0, 0);
  }

  // Share of the sun's light at a point, softly between four dots of what it sees; on the floor also what one looks through takes some.
  lit(x, y, z, floor = false) {
    const { solids: { width, height, dots, depth }, rows } = this.sun, right = rows[0] * x + rows[1] * y + rows[2] * z + rows[3], down = rows[4] * x + rows[5] * y + rows[6] * z + rows[7];
    if (!(right >= 0 && down >= 0 && right < width - 1 && down < height - 1)) return 1;
    const i = right | 0, k = down | 0, place = k * width + i, u = right - i, v = down - k, near = rows[8] * x + rows[9] * y + rows[10] * z + rows[11] + 3;
    const a = floor ? 255 - (dots[place] >>> 24) : depth[place] < near ? 255 : 0, b = floor ? 255 - (dots[place + 1] >>> 24) : depth[place + 1] < near ? 255 : 0;
    const c = floor ? 255 - (dots[place + width] >>> 24) : depth[place + width] < near ? 255 : 0, d = floor ? 255 - (dots[place + width + 1] >>> 24) : depth[place + width + 1] < near ? 255 : 0;
    return ((a * (1 - u) + b * u) * (1 - v) + (c * (1 - u) + d * u) * v) / 255;
  }

  // A level floor below all, seen from above: its shadows, and as much grey as shows them. `middle`: the point that it is round about; `above`: the upright.
  floor(middle, above, radius) {
    const { width, height, dots } = this, [, level, steep] = above, reach = radius * steep;
    for (let y = Math.max(0, Math.ceil(middle[1] - reach)); y < Math.min(height, middle[1] + reach); y++)
      for (let x = Math.max(0, Math.ceil(middle[0] - radius)); x < Math.min(width, middle[0] + radius); x++) {
        const right = x + 0.5 - middle[0], down = (y + 0.5 - middle[1]) / steep, inside = 1 - (right ** 2 + down ** 2) / radius ** 2;
        if (!(inside > 0)) continue;
        const dark = 1 - this.lit(x + 0.5, y + 0.5, middle[2] - down * level, true);
        dots[y * width + x] = 255 * (0.13 + 0.24 * dark) * Math.min(1, 3 * inside) << 24 | Math.round(120 * (1 - dark)) * 0x10101;
      }
  }

  // What is behind shows through a colour.
  through(place, tone, r, g, b, alpha) {
    const below = this.dots[place], under = (below >>> 24) / 255 * (1 - alpha), all = alpha + under, own = tone * alpha / all, rest = under / all;
    this.dots[place] = all * 255 << 24 | Math.min(255, b * own + (below >>> 16 & 255) * rest) << 16 | Math.min(255, g * own + (below >>> 8 & 255) * rest) << 8 | Math.min(255, r * own + (below & 255) * rest);
  }

  // `tones`: brightness at the three corners.
  triangle(a, b, c, tones, colour, alpha = 1) {
    const area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    if (!(Math.abs(area) > 1e-9)) return;
    const { width, height, dots, depth, sun } = this, corners = [a, b, c], [red, green, blue] = colour;
    const rise = (p, q, r) => [((q - p) * (c[1] - a[1]) - (r - p) * (b[1] - a[1])) / area, ((r - p) * (b[0] - a[0]) - (q - p) * (c[0] - a[0])) / area];
    const [zx, zy] = rise(a[2], b[2], c[2]), [tx, ty] = rise(...tones), ys = corners.map((p) => p[1]);
    for (let y = Math.max(0, Math.ceil(Math.min(...ys) - 0.5)), last = Math.min(height - 1, Math.max(...ys) - 0.5); y <= last; y++) {
      let low = Infinity, high = -Infinity;
      for (let i = 0; i < 3; i++) {
        const [x0, y0] = corners[i], [x1, y1] = corners[(i + 1) % 3];
        if (y0 === y1 || y + 0.5 < Math.min(y0, y1) || y + 0.5 > Math.max(y0, y1)) continue;
        const x = x0 + (y + 0.5 - y0) / (y1 - y0) * (x1 - x0);
        if (x < low) low = x;
        if (x > high) high = x;
      }
      const first = Math.max(0, Math.ceil(low - 0.5)), right = first + 0.5 - a[0], down = y + 0.5 - a[1];
      let z = a[2] + zx * right + zy * down, tone = tones[0] + tx * right + ty * down, place = y * width + first;
      for (let left = Math.floor(Math.min(width - 1, high - 0.5)) - first; left >= 0; left--, place++, z += zx, tone += tx) {
        if (z <= depth[place]) continue;
        const seen = sun && tone > SHADE ? SHADE + (tone - SHADE) * this.lit(place - y * width + 0.5, y + 0.5, z) : tone;
        if (alpha < 1) { this.through(place, seen, red, green, blue, alpha); continue; }
        depth[place] = z;
        dots[place] = shaded(seen, red, green, blue);
      }
    }
  }

  tone(normal) { const n = unitary(normal); const towards = this.sun ? (n[2] < 0 ? -1 : 1) * dot(n, this.sun.at) : 0; return SHADE + (towards < 0 ? 0.15 : 0.5) * towards; }

  face(points, colour, alpha) {
    const draw = () => { const tone = this.tone(cross(plus(points[1], points[0], -1), plus(points[2], points[0], -1))); for (let i = 2; i < points.length; i++) this.triangle(points[0], points[i - 1], points[i], [tone, tone, tone], colour, alpha); };
    if (alpha < 1) this.late.push([points.reduce((sum, p) => sum + p[2], 0) / points.length, draw]); else draw();
  }

  line(points, width, colour) {
    for (let i = 1; i < points.length; i++) {
      const [p, q] = [points[i - 1], points[i]], length = Math.hypot(q[0] - p[0], q[1] - p[1]);
      if (!(length > 1e-9)) continue;
      const side = [-(q[1] - p[1]) / length * width / 2, (q[0] - p[0]) / length * width / 2, 0], ahead = scaled(plus(q, p, -1), 0.3 * width / length), near = [0, 0, this.sun ? width : 0];
      const [a, b, c, d] = [plus(plus(p, side), ahead, -1), plus(plus(q, side), ahead), plus(plus(q, side, -1), ahead), plus(plus(p, side, -1), ahead, -1)].map((v) => plus(v, near));
      this.triangle(a, b, c, [1, 1, 1], colour);
      this.triangle(a, c, d, [1, 1, 1], colour);
    }
  }

  ball(centre, radius, colour) {
    const { width, height } = this, [cx, cy, cz] = centre;
    for (let y = Math.max(0, Math.floor(cy - radius)); y <= Math.min(height - 1, cy + radius); y++)
      for (let x = Math.max(0, Math.floor(cx - radius)); x <= Math.min(width - 1, cx + radius); x++) {
        const u = (x + 0.5 - cx) / radius, v = (y + 0.5 - cy) / radius, rest = 1 - u * u - v * v;
        if (!(rest >= 0)) continue;
        const place = y * width + x, z = cz + radius * Math.sqrt(rest);
        if (z <= this.depth[place]) continue;
        const tone = this.tone([u, v, Math.sqrt(rest)]);
        this.depth[place] = z;
        this.dots[place] = shaded(this.sun ? SHADE + (tone - SHADE) * this.lit(x + 0.5, y + 0.5, z) : tone, ...colour);
      }
  }

  // A flat face moved along `way`, with its edges.
  prism(base, way, colour, alpha = 1, edges = this.sun) {
    const top = base.map((p) => plus(p, way)), dark = scaled(colour, 0.5), closed = (points) => [...points, points[0]];
    this.face(base, colour, alpha);
    this.face(top, colour, alpha);
    base.forEach((p, i) => { const k = (i + 1) % base.length; this.face([p, base[k], top[k], top[i]], colour, alpha); if (edges && base.length < 9) this.line([p, top[i]], 1.2, dark); });
    if (edges) for (const points of [base, top]) this.line(closed(points), 1.6, dark);
  }

  // `u`, `v`, `w`: halves of the sides.
  box(centre, [u, v, w], colour, alpha) {
    this.prism([[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([s, t]) => plus(plus(plus(centre, u, s), v, t), w, -1)), scaled(w, 2), colour, alpha);
  }

  // `w`: half of the axis; `u` and `v`: radii across it.
  cylinder(centre, [u, v, w], colour, alpha = 1) {
    const rim = (alpha < 1 ? ROUNDER : ROUND).map(([c, s]) => plus(scaled(u, c), v, s)), ends = [-1, 1].map((f) => rim.map((p) => plus(plus(centre, p), w, f))), tones = rim.map((p) => this.tone(p));
    if (alpha < 1) { this.prism(ends[0], scaled(w, 2), colour, alpha); return; }
    rim.forEach((_, i) => {
      const k = (i + 1) % rim.length, [a, b, c, d] = [ends[0][i], ends[0][k], ends[1][k], ends[1][i]];
      this.triangle(a, b, c, [tones[i], tones[k], tones[k]], colour);
      this.triangle(a, c, d, [tones[i], tones[k], tones[i]], colour);
    });
    for (const end of ends) { this.face(end, colour, 1); if (this.sun) this.line([...end, end[0]], 1.2, scaled(colour, 0.5)); }
  }

  rod(p, q, radius, colour) {
    const half = scaled(plus(q, p, -1), 0.5);
    if (Math.hypot(...half) > 1e-9) this.cylinder(plus(p, half), [...across(half).map((v) => scaled(v, radius)), half], colour);
  }

  coil(p, q, radius, colour) {
    const way = plus(q, p, -1);
    if (!(Math.hypot(...way) > 1e-9)) return;
    const [u, v] = across(way).map((side) => scaled(side, radius)), turns = 7, steps = turns * 14;
    const at = (i) => plus(plus(plus(p, way, 0.12 + 0.76 * i / steps), u, Math.sin(2 * Math.PI * i * turns / steps)), v, 1 - Math.cos(2 * Math.PI * i * turns / steps));
    this.line([p, ...Array.from({ length: steps + 1 }, (_, i) => at(i)), q].map((point) => plus(point, [0, 0, 2 * radius])), 3, colour);  // before what it holds
  }
}
