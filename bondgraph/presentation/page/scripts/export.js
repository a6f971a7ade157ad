// A plot as a file: what is drawn as SVG with its own style or as PNG, the numbers of its curves as CSV.

const STYLES = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-opacity", "stroke-linecap", "font"];

function exports(plot) {
  return [["SVG", "image/svg+xml", svgText], ["PNG", "image/png", pngDots], ["CSV", "text/csv", csvText]].map(([kind, type, made]) => {
    const button = html("button", { type: "button", class: "export", title: `save this plot as ${kind}` }, kind);
    button.addEventListener("click", async () => {
      const name = [page.data.model, page.chosen, plot.title || plot.curves.map((c) => c.name).join(" ")].filter(Boolean).join(" ").replace(/[^\p{L}\p{N}]+/gu, "_").slice(0, 80);
      const link = html("a", { href: URL.createObjectURL(new Blob([await made(plot)], { type })), download: `${name}.${kind.toLowerCase()}` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
    return button;
  });
}

function svgText(plot) {
  const copy = plot.picture.cloneNode(true), drawn = [...plot.picture.querySelectorAll("*")], shown = plot.curves.map((c, i) => [c, i]).filter(([, i]) => !plot.hidden.has(i));
  [...copy.querySelectorAll("*")].forEach((part, i) => { const style = getComputedStyle(drawn[i]); for (const name of STYLES) part.style.setProperty(name, style.getPropertyValue(name)); });
  for (const cursor of copy.querySelectorAll(".cursor")) cursor.remove();
  copy.setAttribute("xmlns", SPACE);
  copy.setAttribute("width", plot.width);
  copy.setAttribute("height", HEIGHT + 16 * shown.length);
  copy.setAttribute("viewBox", `0 0 ${plot.width} ${HEIGHT + 16 * shown.length}`);
  const paths = [...plot.picture.querySelectorAll(".curve")];
  shown.forEach(([curve], k) => {
    const y = HEIGHT + 16 * k + 8, style = getComputedStyle(paths[k]);
    copy.append(svg("path", { d: `M${LEFT} ${y}h${curve.dots ? 0 : 24}`, fill: "none", stroke: style.stroke, "stroke-dasharray": style.strokeDasharray, "stroke-linecap": style.strokeLinecap, "stroke-width": style.strokeWidth }), svg("text", { x: LEFT + 30, y: y + 4, fill: style.stroke, "font-family": "sans-serif", "font-size": 12 }, `${curve.name}${plot.unit && ` [${plot.unit}]`}`));
  });
  return new XMLSerializer().serializeToString(copy);
}

// Twice as many dots as the page has.
async function pngDots(plot) {
  const image = new Image(), canvas = html("canvas", {}), context = canvas.getContext("2d");
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svgText(plot))}`;
  await image.decode();
  Object.assign(canvas, { width: 2 * image.width, height: 2 * image.height });
  context.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--sheet");
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.drawImage(image, 0, 0, canvas.width, canvas.height);
  return new Promise((done) => canvas.toBlob(done));
}

// Curves at the same instants share a column of them.
function csvText(plot) {
  const cell = (words) => /[",\n]/.test(words) ? `"${words.replace(/"/g, '""')}"` : words, columns = [], { name, unit, factor, log } = page.axis;
  const bracketed = (words, u) => cell(u ? `${words} [${u}]` : words);
  let times = null;
  plot.curves.forEach((curve, i) => {
    if (plot.hidden.has(i)) return;
    if (!times || times.length !== curve.times.length || times.some((t, k) => t !== curve.times[k])) { times = curve.times; columns.push([bracketed(name, factor === 1 ? unit : "s"), log ? times.map((t) => 10 ** t) : times]); }
    columns.push([bracketed(curve.name, plot.unit), curve.values]);
  });
  const rows = Array.from({ length: Math.max(...columns.map(([, v]) => v.length)) }, (_, i) => columns.map(([, v]) => i < v.length && Number.isFinite(v[i]) ? v[i] : "").join(","));
  return [columns.map(([head]) => head).join(","), ...rows, ""].join("\n");
}
