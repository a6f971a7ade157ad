// The worker of a playground: it loads Pyodide from the folder beside this file, unpacks our packages there, and answers the page as the server of a live page does.

const PACKAGES = ["numpy", "scipy"];
const waiting = [];  // requests for changes, until there are some
let answers;

onmessage = ({ data }) => {
  if (data.saved) answers = start(data).catch((problem) => { postMessage({ failure: problem.message }); return null; });
  else answers.then((answer) => { if (answer) reply(answer, data); });
};

async function start({ saved, file }) {
  postMessage({ told: "Python is being loaded into the browser …" });
  const place = new URL("pyodide/", self.location.href).href;
  const { loadPyodide } = await import(`${place}pyodide.mjs`).catch(() => { throw new Error("pyodide/pyodide.mjs is not beside this page"); });
  const python = await loadPyodide({ indexURL: place, packageBaseUrl: place, env: { HOME: "/home/pyodide", BONDGRAPH_CACHE: "" } });
  await python.loadPackage(PACKAGES);
  for (const name of PACKAGES) if (!python.loadedPackages[name]) throw new Error(`pyodide/ has no wheel of ${name} that can be loaded`);
  const found = await fetch("packages.zip");
  if (!found.ok) throw new Error("packages.zip is not beside this page");
  python.unpackArchive(await found.arrayBuffer(), "zip", { extractDir: "/playground" });
  postMessage({ told: "The model is being compiled …" });
  python.runPython("import sys; sys.path.insert(0, '/playground')");
  const answer = python.pyimport("bondgraph.presentation.page.serve.playground").answers_of("/playground/models", python.toPy(saved), file);
  postMessage({ told: "" });
  return (path, body) => { const both = answer(path, body), [status, words] = both.toJs(); both.destroy(); return { status, words }; };
}

function reply(answer, { id, path, body }) {
  let found;
  try { found = answer(path, body); } catch (problem) { found = { status: 500, words: problem.message }; }
  if (path.startsWith("/changes?") && found.status === 200 && path === `/changes?since=${JSON.parse(found.words).version}`) waiting.push({ id, path, body });
  else postMessage({ id, ...found });
  if (!path.startsWith("/changes")) for (const request of waiting.splice(0)) reply(answer, request);
}
