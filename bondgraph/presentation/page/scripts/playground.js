// Whom a playground asks: a worker, which runs the same Python in the reader's browser. What is saved stays in this browser.

const SAVED = `bondgraph ${location.pathname} `;

function asking() {
  const worker = new Worker("worker.js", { type: "module" }), open = new Map(), saved = {}, said = html("p", { id: "loading", role: "status" });
  let count = 0, failure = "", file = page.data.file;
  try { file = decodeURIComponent(location.hash.slice(1)) || file; } catch { /* no name */ }
  try { for (const key of Object.keys(localStorage)) if (key.startsWith(SAVED)) saved[key.slice(SAVED.length)] = localStorage[key]; } catch { /* a browser that keeps nothing */ }
  const fail = (words) => {
    failure = words;
    said.textContent = `The playground cannot start: ${words}`;
    said.classList.add("wrong");
    for (const { path, failed } of open.values()) if (!path.startsWith("/changes")) failed(new Error(words));
  };
  worker.onerror = (event) => fail(event.message || "worker.js cannot be loaded");
  worker.onmessage = ({ data: { id, status, words, told, failure } }) => {
    if (failure !== undefined) { fail(failure); return; }
    if (told !== undefined) { said.textContent = told; return; }
    const { path, body, done, failed } = open.get(id);
    open.delete(id);
    if (status !== 200) { failed(new Error(words)); return; }
    const found = JSON.parse(words);
    try { if (path === "/save" && found.saved) localStorage[SAVED + body.file] = body.text; } catch { /* as above */ }
    done(found);
  };
  document.getElementById("problems").before(said);
  worker.postMessage({ saved, file });
  return (path, body) => new Promise((done, failed) => {
    if (path === "/stop") { done({ stopped: false }); return; }  // a worker hears nothing while it runs
    if (failure) { if (!path.startsWith("/changes")) failed(new Error(failure)); return; }
    open.set(++count, { path, body, done, failed });
    worker.postMessage({ id: count, path, body: body && JSON.stringify(body) });  // undefined is None in Python, null is not
  });
}
