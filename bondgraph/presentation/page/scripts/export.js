// A plot as a file: what is drawn as SVG with its own style, the numbers of its curves as CSV.

const STYLES = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-opacity", "font"];

function exports(plot) {
  return [["SVG", "image/svg+xml", svgText], ["CSV", "text/csv", csvText]].map(([kind, type, text]) => {
    const button = html("button", { type: "button", class: "export", title: `save this plot as ${kind}` }, kind);
    button.addEventListener("click", () => {
      const name = [page.data.model, page.chosen, plot.title || plot.curves.map((c) => c.name).join(" ")].filter(Boolean).join(" ").replace(/[^\p{L}\p{N}]+/gu, "_").slice(0, 80);
      const link = html("a", { href: URL.createObjectURL(new Blob([text(plot)], { type })), download: `${name}.${kind.toLowerCase()}` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
    return button;
  });
}

function svgText(plot) {
  const copy = plot.picture.cloneNode(true), drawn = [...plot.picture.querySelectorAll("*")], shown = plot.curves.map((c, i) => [c, i]).filter(([, i]) => !plot.hidden.has(i));
  [...copy.querySelectorAll("*")].forEach((part, i) => { const style = getComputedStyle(drawn[i]); for (const name of STYLES) part.style.setProperty(name, style.getPropertyValue(name)); });
  copy.querySelector(".cursor").remove();
  copy.setAttribute("xmlns", SPACE);
  copy.setAttribute("width", plot.width);
  copy.setAttribute("height", HEIGHT + 16 * shown.length);
  copy.setAttribute("viewBox", `0 0 ${plot.width} ${HEIGHT + 16 * shown.length}`);
  const paths = [...plot.picture.querySelectorAll(".curve")];
  shown.forEach(([curve], k) => {
    const y = HEIGHT + 16 * k + 8, style = getComputedStyle(paths[k]);
    copy.append(svg("path", { d: `M${LEFT} ${y}h24`, fill: "none", stroke: style.stroke, "stroke-dasharray": style.strokeDasharray }), svg("text", { x: LEFT + 30, y: y + 4, fill: style.stroke, "font-family": "sans-serif", "font-size": 12 }, `${curve.name}${plot.unit && ` [${plot.unit}]`}`));
  });
  return new XMLSerializer().serializeToString(copy);
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
