// The live page: asks for runs, and follows the file. One run is on its way at a time; of those that wait the last is made.

function live() {
  const ask = asking();
  const state = { busy: false, wanted: null, version: page.data.version, shown: null };
  const known = new Set();  // experiments that have been compiled
  const editor = page.editor = new Editor(ask), banner = editor.bar;
  const note = (words) => { const host = document.getElementById("told"); if (host) host.replaceChildren(html("p", { class: "note" }, words)); };

  async function run(name) {
    if (editor.opening) return;  // what comes is run then
    state.wanted = name;
    if (state.busy) {
      if (performance.now() - state.began > 800 && !state.first) { state.began = performance.now(); ask("/stop", {}).catch(() => {}); }
      return;
    }
    state.busy = true;
    document.body.classList.add("busy");
    while (state.wanted !== null) {
      const wanted = state.wanted, version = state.version;
      state.wanted = null;
      state.began = performance.now();
      state.first = !known.has(wanted);
      try {
        const found = await ask("/run", { experiment: wanted, settings: page.sliders ? page.sliders.values : {} });
        known.add(wanted);
        if (version !== state.version) continue;
        page.sliders?.answer(found);
        if (found.wrong && !state.shown) state.wanted ??= wanted;  // with the values that hold instead
        if (!found.wrong && wanted === page.chosen && page.swinging === undefined) put(found);
      } catch (problem) { note(`No answer: ${problem.message}`); }
    }
    state.busy = false;
    document.body.classList.remove("busy");
  }

  function put(found) {
    const again = found.run && state.shown === found.name && page.view && refresh(found.run);
    if (!again) show(found);
    else { const told = document.getElementById("told"); told.replaceChildren(...found.run.notes.map((n) => html("p", { class: "note" }, n))); }
    state.shown = found.run ? found.name : null;
    requestAnimationFrame(() => {
      if (performance.getEntriesByName("slider moved").length) { performance.measure("slider", "slider moved"); performance.clearMarks("slider moved"); }
      performance.mark("drawn");
    });
  }

  // The page of a text: sliders with the values that were chosen, unless it is another file's, then its first run.
  function arm(data) {
    state.shown = null;
    const host = document.getElementById("sliders"), before = page.sliders && state.file === editor.file ? page.sliders.values : {};
    state.file = editor.file;
    page.sliders = host && data.parameters ? new Sliders(host, data.parameters, () => { if (page.swinging !== undefined) choose(Math.max(0, page.data.experiments.findIndex((e) => e.name === page.chosen))); else run(page.chosen); }) : null;
    page.sliders?.keep(before);
    load(data);
    if (!data.modes.length) ask("/modes").then((found) => { if (found.version === state.version && found.modes.length) addModes(found.modes); }).catch(() => {});
  }

  function addModes(modes) {
    const choice = document.getElementById("choice");
    if (!choice) return;
    page.data.modes = modes;
    page.modes = modeChoice(modes);
    choice.append(html("label", {}, "mode ", page.modes));
  }

  function follow(change) {
    state.version = change.version;
    if (!change.data) { editor.follow(change); return; }
    known.clear();
    const [x, y] = [scrollX, scrollY], text = document.getElementById("text"), down = text && text.scrollTop;
    document.body.append(editor.problems);
    document.getElementById("page").innerHTML = change.sections;
    page.data = change.data;
    editor.place();
    editor.follow(change);
    document.title = change.title;
    arm(change.data);
    const now = document.getElementById("text");
    if (now) now.scrollTop = down;
    scrollTo(x, y);
  }

  async function changes() {
    for (;;) {
      try {
        const change = await ask(`/changes?since=${state.version}`);
        banner.classList.remove("away");
        if (change.version !== state.version) follow(change);
      } catch (problem) {
        banner.classList.add("away");
        await new Promise((done) => setTimeout(done, 1500));
      }
    }
  }

  page.asked = (name) => run(name);
  editor.place();
  editor.follow(page.data);
  arm(page.data);
  changes();
}
