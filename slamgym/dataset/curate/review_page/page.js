"use strict";

(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const maps = data.maps;
  const byId = (id) => document.getElementById(id);
  const store = openStore("slamgym-review/" + data.digest);
  const known = new Set(maps.map((map) => map.name));
  const saved = store.read();
  const state = { decisions: new Map(), history: [], current: 0 };

  for (const map of maps) {
    if (map.decision) state.decisions.set(map.name, map.decision);
  }
  for (const [name, decision] of Object.entries(saved.decisions || {})) {
    if (!known.has(name)) continue;
    if (decision === "keep" || decision === "drop") state.decisions.set(name, decision);
    if (decision === null) state.decisions.delete(name);
  }

  /** What survives a reload; where the browser forbids it (private windows), the page works without. */
  function openStore(key) {
    return {
      read() {
        try { return JSON.parse(localStorage.getItem(key)) || {}; } catch { return {}; }
      },
      write(value) {
        try { localStorage.setItem(key, JSON.stringify(value)); return true; } catch { return false; }
      },
    };
  }

  function save() {
    const decisions = {};
    for (const map of maps) decisions[map.name] = state.decisions.get(map.name) || null;
    const done = store.write({ decisions, current: maps[state.current].name });
    if (!done && !save.warned) {
      save.warned = true;
      announce("This browser keeps nothing: save decisions.json before you close the page.");
    }
  }

  function announce(text) { byId("announcement").textContent = text; }

  function decide(decision) {
    const map = maps[state.current];
    state.history.push({ name: map.name, before: state.decisions.get(map.name) || null });
    state.decisions.set(map.name, decision);
    const words = decision === "keep" ? "Kept" : "Dropped";
    const next = nextOpen(state.current);
    announce(next === null ? `${words} ${map.name}. All maps are decided: save decisions.json.` : `${words} ${map.name}.`);
    if (next !== null) state.current = next;
    update();
  }

  function undo() {
    const last = state.history.pop();
    if (!last) { announce("Nothing to undo."); return; }
    if (last.before) state.decisions.set(last.name, last.before); else state.decisions.delete(last.name);
    state.current = maps.findIndex((map) => map.name === last.name);
    announce(`Undid the decision about ${last.name}.`);
    update();
  }

  /** The next map without a decision, from a place on and round the end; null if there is none. */
  function nextOpen(from) {
    for (let step = 1; step <= maps.length; step++) {
      const place = (from + step) % maps.length;
      if (!state.decisions.has(maps[place].name)) return place;
    }
    return null;
  }

  function goTo(place) {
    state.current = Math.min(Math.max(place, 0), maps.length - 1);
    announce("");
    update();
  }

  function goToOpen() {
    const next = nextOpen(state.current);
    if (next === null) announce("All maps are decided."); else goTo(next);
  }

  function download() {
    const decisions = maps
      .filter((map) => state.decisions.has(map.name))
      .map((map) => ({ name: map.name, decision: state.decisions.get(map.name), sha256: map.sha256 }));
    const document_ = { format: data.format, version: data.version, decisions };
    const blob = new Blob([JSON.stringify(document_, null, 1) + "\n"], { type: "application/json" });
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = "decisions.json";
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    announce(`Saved ${decisions.length} decisions. Apply them: ${data.command}`);
  }

  const source = (png) => "data:image/png;base64," + png;

  function update() {
    const map = maps[state.current];
    const decision = state.decisions.get(map.name);
    byId("name").textContent = map.name;
    byId("place").textContent = `${state.current + 1} of ${maps.length}`;
    const badge = byId("state");
    badge.className = "badge " + (decision || "");
    badge.textContent = decision === "keep" ? "kept" : decision === "drop" ? "dropped" : "not decided";
    byId("keep").setAttribute("aria-pressed", String(decision === "keep"));
    byId("drop").setAttribute("aria-pressed", String(decision === "drop"));
    byId("undo").disabled = state.history.length === 0;
    byId("previous").disabled = state.current === 0;
    byId("next").disabled = state.current === maps.length - 1;
    const count = maps.filter((one) => state.decisions.has(one.name)).length;
    byId("progress").max = maps.length;
    byId("progress").value = count;
    byId("progress-text").textContent = `${count} of ${maps.length} decided`;
    document.title = `(${count}/${maps.length}) ${data.title}`;
    showMap(map);
    showFigures(map);
    for (const [place, button] of strip.entries()) mark(button, place);
    strip[state.current].scrollIntoView({ block: "nearest", inline: "nearest" });
    save();
  }

  function mark(button, place) {
    const decision = state.decisions.get(maps[place].name) || "";
    button.dataset.decision = decision;
    button.setAttribute("aria-current", String(place === state.current));
    const word = decision === "keep" ? "kept" : decision === "drop" ? "dropped" : "not decided";
    button.setAttribute("aria-label", `${maps[place].name}, ${word}`);
    button.querySelector(".mark").textContent = decision === "keep" ? "✓" : decision === "drop" ? "✕" : "";
  }

  function showMap(map) {
    const slam = byId("slam"), cad = byId("cad");
    const hasCad = Boolean(map.cad);
    slam.src = source(map.slam);
    slam.alt = `SLAM map ${map.name}, ${map.width} by ${map.height} cells`;
    byId("cad-panel").hidden = byId("overlay-panel").hidden = !hasCad;
    byId("panels").classList.toggle("alone", !hasCad);
    if (!hasCad) return;
    cad.src = source(map.cad);
    cad.alt = `CAD map of ${map.plan}`;
    Promise.all([slam.decode(), cad.decode()])
      .then(() => { if (maps[state.current] === map) drawOverlay(map, slam, cad); })
      .catch(() => {});  // the reader has gone on to another map
  }

  function pixels(image, width, height) {
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0, width, height);
    return context.getImageData(0, 0, width, height).data;
  }

  function colour(name) {
    const hex = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  }

  function drawOverlay(map, slamImage, cadImage) {
    const { width, height } = map;
    const slam = pixels(slamImage, width, height), cad = pixels(cadImage, width, height);
    const colours = Object.fromEntries(
      ["wall", "cad", "unseen", "beyond", "inside", "outside"].map((name) => [name, colour("--" + name)]));
    const inside = (x, y) => x >= 0 && y >= 0 && x < width && y < height && cad[4 * (y * width + x)] > 127;
    const canvas = byId("overlay");
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext("2d");
    const out = context.createImageData(width, height);
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        const at = 4 * (y * width + x), value = slam[at];
        let name;
        if (value < 100) name = "wall";
        else if (inside(x, y)) name = value < 230 ? "unseen" : "inside";
        else if (inside(x - 1, y) || inside(x + 1, y) || inside(x, y - 1) || inside(x, y + 1)) name = "cad";
        else name = value >= 230 ? "beyond" : "outside";
        out.data.set(colours[name], at);
        out.data[at + 3] = 255;
      }
    }
    context.putImageData(out, 0, 0);
  }

  function showFigures(map) {
    const percent = (value) => `${100 * value}%`;
    const [low, high] = data.band;
    byId("probability").textContent = map.probability === null ? "–" : map.probability.toFixed(2);
    byId("band").style.left = percent(low);
    byId("band").style.width = percent(high - low);
    byId("needle").style.left = map.probability === null ? "0" : `${100 * map.probability}%`;
    byId("needle").hidden = map.probability === null;
    byId("band-text").textContent = `A person decides between ${low} and ${high}.`;
    const list = byId("figures");
    list.replaceChildren();
    for (const [label, value] of map.figures) {
      const term = document.createElement("dt"), text = document.createElement("dd");
      term.textContent = label;
      text.textContent = value;
      if (value.length > 24) text.className = "wide";
      list.append(term, text);
    }
  }

  const strip = maps.map((map, place) => {
    const item = document.createElement("li"), button = document.createElement("button");
    const image = document.createElement("img"), sign = document.createElement("span");
    button.type = "button";
    image.src = source(map.slam);
    image.alt = "";
    image.loading = "lazy";
    sign.className = "mark";
    sign.setAttribute("aria-hidden", "true");
    button.append(image, sign);
    button.addEventListener("click", () => goTo(place));
    item.append(button);
    byId("strip").append(item);
    return button;
  });

  function setTheme(theme) {
    document.documentElement.dataset.theme = theme;
    const map = maps[state.current];
    if (map.cad) showMap(map);
  }

  function toggleHelp() {
    const dialog = byId("help-dialog");
    if (dialog.open) dialog.close(); else dialog.showModal();
  }

  const keys = {
    k: () => decide("keep"), d: () => decide("drop"), u: undo, n: goToOpen, s: download, "?": toggleHelp,
    arrowleft: () => goTo(state.current - 1), arrowright: () => goTo(state.current + 1),
    home: () => goTo(0), end: () => goTo(maps.length - 1),
  };

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    if (byId("help-dialog").open && key !== "?") return;
    if (!Object.hasOwn(keys, key)) return;
    event.preventDefault();
    keys[key]();
  });

  byId("keep").addEventListener("click", () => decide("keep"));
  byId("drop").addEventListener("click", () => decide("drop"));
  byId("undo").addEventListener("click", undo);
  byId("previous").addEventListener("click", () => goTo(state.current - 1));
  byId("next").addEventListener("click", () => goTo(state.current + 1));
  byId("download").addEventListener("click", download);
  byId("help").addEventListener("click", toggleHelp);
  byId("help-close").addEventListener("click", toggleHelp);
  byId("theme").addEventListener("click", () => {
    const theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    setTheme(theme);
    try { localStorage.setItem("slamgym-review/theme", theme); } catch { /* not kept */ }
  });

  let theme = null;
  try { theme = localStorage.getItem("slamgym-review/theme"); } catch { /* not kept */ }
  const prefersDark = matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = theme === "dark" || theme === "light" ? theme : prefersDark ? "dark" : "light";
  byId("subtitle").textContent = data.subtitle;
  byId("command").textContent = data.command;
  const last = maps.findIndex((map) => map.name === saved.current);
  state.current = last >= 0 ? last : 0;
  update();
})();
