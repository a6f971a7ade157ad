// Numbers: typed arrays from base64, places between instants, and how a number is written.

const KINDS = { f4: Float32Array, f8: Float64Array };

function unpack(packed) {
  const [kind, text] = Object.entries(packed)[0];
  const letters = atob(text);
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  return new KINDS[kind](bytes.buffer);
}

// The row of a matrix that stands in one array.
const row = (matrix, place, length) => matrix.subarray(place * length, (place + 1) * length);

// Where an instant is among sorted ones: a place with a fraction.
function placeOf(times, instant) {
  let low = 0, high = times.length - 1;
  if (!(instant > times[0])) return 0;
  if (instant >= times[high]) return high;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= instant) low = middle; else high = middle;
  }
  return low + (instant - times[low]) / (times[high] - times[low] || 1);
}

// A value at a place with a fraction.
function between(values, place) {
  const first = Math.floor(place), share = place - first;
  return share && first + 1 < values.length ? values[first] * (1 - share) + values[first + 1] * share : values[first];
}

function extent(arrays) {
  let low = Infinity, high = -Infinity;
  for (const values of arrays) for (const v of values) { if (v < low) low = v; if (v > high) high = v; }
  return low <= high ? [low, high] : [0, 1];
}

const PREFIXED = new Set(["m", "s", "N", "V", "A", "W", "J", "Pa", "Hz", "N*m", "m/s", "C", "F", "H", "Wb", "kg"]);
const PREFIXES = ["f", "p", "n", "µ", "m", "", "k", "M", "G", "T"];

function digits(value, count = 4) {
  if (!Number.isFinite(value)) return "—";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e5 || size < 1e-3 ? value.toExponential(count - 1) : value.toPrecision(count);
  const [mantissa, power] = text.split("e");
  const short = mantissa.includes(".") ? mantissa.replace(/\.?0+$/, "") : mantissa;
  return (power ? `${short}e${Number(power)}` : short).replace("-", "−");
}

const unitWords = (unit) => unit.replace(/\*/g, "·").replace(/\^2/g, "²").replace(/\^3/g, "³");

// A value in SI with its unit, in thousands of it where that reads better.
function quantity(value, unit) {
  if (!PREFIXED.has(unit) || unit === "kg" || !value || !Number.isFinite(value)) return `${digits(value)} ${unitWords(unit)}`.trim();
  const step = Math.max(-5, Math.min(4, Math.floor(Math.log10(Math.abs(value)) / 3)));
  return `${digits(value / 10 ** (3 * step))} ${PREFIXES[step + 5]}${unitWords(unit)}`;
}

// The unit in which a time reads best, and how many of it make a second.
function timeUnit(largest) {
  for (const [unit, factor, least] of [["day", 1 / 86400, 2], ["h", 1 / 3600, 2], ["min", 1 / 60, 5], ["s", 1, 1], ["ms", 1e3, 1], ["µs", 1e6, 1], ["ns", 1e9, 1], ["ps", 1e12, 1]])
    if (largest * factor >= 0.9999999 * least) return [unit, factor];
  return ["s", 1];
}
