// Measured values from a file of columns, as dots over the curves of a run: the file of `column` in the language, its first column the axis.

const OTHER_UNITS = { g: ["kg", 1e-3], min: ["s", 60], h: ["s", 3600], day: ["s", 86400], deg: ["rad", Math.PI / 180] };

// The unit without its prefix, and how many of that it is; a unit that is not known stands for itself alone.
function unprefixed(unit) {
  if (PREFIXED.has(unit)) return [unit, 1];
  const plain = unit.replace(/^u/, "µ"), place = PREFIXES.findIndex((p) => p && plain.startsWith(p) && PREFIXED.has(plain.slice(p.length)) && plain.slice(p.length) !== "kg");
  return OTHER_UNITS[unit] ?? (place < 0 ? [unit, 1] : [plain.slice(PREFIXES[place].length), 10 ** (3 * (place - 5))]);
}

// By what values in a unit are multiplied to be in another; none if they are of other kinds.
function factor(from, to) { const [[a, f], [b, g]] = [unprefixed(from), unprefixed(to)]; return a === b ? f / g : null; }

// The columns of a text, each with its axis. Throws an error that says what is wrong, and in which line.
function columnsOf(text) {
  const lines = text.replace(/^\ufeff/, "").split(/\r?\n/).map((words, i) => [words.trim(), i + 1]).filter(([words]) => words && !words.startsWith("#"));
  const cells = (words) => [...words.matchAll(/(?:^|,)(?:\s*"((?:[^"]|"")*)"\s*|([^,]*))/g)].map(([, quoted, plain]) => quoted === undefined ? plain.trim() : quoted.replace(/""/g, '"'));
  if (lines.length < 2) throw new Error("it has no line of names and lines of numbers");
  const heads = cells(lines[0][0]).map((words) => { const [, name, unit] = /^(.*?)\s*(?:\[([^\]]*)\])?$/.exec(words); return { name, unit: unit ?? "" }; });
  if (heads.length < 2) throw new Error("it needs two columns, with commas between");
  const values = heads.map(() => new Float64Array(lines.length - 1));
  lines.slice(1).forEach(([words, number], i) => {
    const found = cells(words);
    if (found.length !== heads.length) throw new Error(`line ${number} has ${found.length} values, not ${heads.length}`);
    found.forEach((cell, k) => {
      if (cell && !BARE.test(cell)) throw new Error(`line ${number}: \`${cell}\` is no number`);
      values[k][i] = cell ? Number(cell) : NaN;
    });
  });
  let axis = null;
  return heads.flatMap((head, k) => {
    if (k === 0 || (head.name === heads[0].name && head.unit === heads[0].unit)) { axis = { ...head, values: values[k] }; return []; }
    return [{ ...head, values: values[k], axis }];
  });
}

// A column over the axis of a run, of which `axis` has no unit where it is time; none if its first column is another quantity.
function measuredAlong({ axis }, run) {
  const scale = run.axis ? (axis.name === run.axis.name ? factor(axis.unit, run.axis.unit) : null) : factor(axis.unit, "s");
  return scale === null ? null : axis.values.map((v) => run.axis?.log ? Math.log10(v * scale) : v * scale);
}

// Adds the dots to the panel whose unit is of their kind, else to one of their own.
function addMeasured(groups, run) {
  for (const { name: file, columns } of page.measured)
    for (const column of columns) {
      const times = measuredAlong(column, run);
      if (!times) continue;
      const unit = [...groups.keys()].find((u) => factor(column.unit, u) !== null) ?? column.unit, scale = factor(column.unit, unit);
      if (!groups.has(unit)) groups.set(unit, { unit, title: "", curves: [] });
      const { curves } = groups.get(unit), like = curves.findIndex((c) => c.output === column.name);
      curves.push({ name: `${column.name} (${file})`, times, values: column.values.map((v) => v * scale), dots: true, turns: times.some((t, i) => !(t >= times[i - 1]) && i > 0), colour: like < 0 ? curves.length : like });
    }
}

function fileChoice() {
  const files = html("input", { type: "file", accept: ".csv,text/csv", multiple: true, hidden: true, "aria-label": "files of measured values" });
  const button = html("button", { type: "button", title: "lay measured values over the curves: a file .csv whose first line is as `time [s], x [mm]`" }, "data");
  button.addEventListener("click", () => files.click());
  files.addEventListener("change", async () => {
    const wrong = [];
    for (const file of files.files) {
      try {
        const columns = columnsOf(await file.text()), over = columns.filter((column) => measuredAlong(column, page.run));
        if (!over.length) throw new Error(`its first column is \`${columns[0].axis.name}${columns[0].axis.unit && ` [${columns[0].axis.unit}]`}\`, not ${page.run.axis ? `\`${page.run.axis.name} [${page.run.axis.unit}]\`` : "a time, as `time [s]`"}`);
        page.measured.push({ name: file.name, columns });
      } catch (problem) { wrong.push(`${file.name}: ${problem.message}`); }
    }
    again();
    for (const words of wrong) document.getElementById("plots").prepend(html("p", { class: "note", role: "alert" }, words));
  });
  return [button, files];
}
