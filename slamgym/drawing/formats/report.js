// A person's corrections of a drawing: two clicks make a line, one click a place. `slamgym cad --corrections` draws them;
// here they are shown, checked and kept in the browser until they are saved. On screen are millimetres, y down.
(() => {
  const byId = (id) => document.getElementById(id);
  const data = JSON.parse(byId("data").textContent);
  const svg = document.querySelector(".editor svg");
  const corner = [Number(svg.dataset.left), Number(svg.dataset.top)];
  const layer = svg.appendChild(document.createElementNS(svg.namespaceURI, "g"));
  const full = svg.viewBox.baseVal.width, tall = svg.viewBox.baseVal.height;
  const file = data.map.name + ".corrections.json", key = "slamgym corrections " + data.map.sha256;
  const tools = {
    split: ["Split a room", "Click two places between which the boundary leads; it goes on to the next walls."],
    join: ["Join rooms", "Click a door or another boundary, or two rooms that touch: they become one room."],
    add_door: ["Add a door", "Click both jambs: in a wall, in a passage, or on the floor, where the wall around it is drawn too."],
    add_wall: ["Add a wall", "Click both ends."],
    remove_wall: ["Remove a wall", "Click the wall, or the thing that was drawn as walls."],
    glass_wall: ["Glass wall", "Click a wall that is glass."],
    remove_room: ["Take away a room", "Click a room that isn't there: one in a mirror, or behind glass."],
    name_room: ["Name a room", "Click the room, then type its name."],
  };
  const names = Object.keys(tools), titles = { ...tools, no_door: ["No door here"] };
  const state = {
    tool: null, first: null, entries: data.provenance.corrections || [], past: [], future: [], saved: true, kept: false,
    dragged: false, corrected: false, plan: null, picture: null, question: null, passed: new Set(),
  };
  const { plan, walls, roomAt, bodyOf, meant } = drawnThings(data);
  // A place is enlarged before it is clicked where a metre takes fewer pixels.
  const CLEAR_PX = 40;
  // A correction so near to the middle of a doubtful line answers it [m].
  const ANSWERED = 0.5;

  // Corrections

  const isLine = (entry) => entry.line !== undefined;

  /** Other corrections: the list, the plan and what the browser keeps follow. */
  function put(entries, words, isSaved = false) {
    Object.assign(state, { entries, saved: isSaved, plan: revised(plan, entries), picture: null });
    try {
      if (isSaved) localStorage.removeItem(key);
      else localStorage.setItem(key, JSON.stringify(entries));
      state.kept = true;
    } catch { state.kept = false; }  // a browser that keeps nothing
    say(words);
    list();
    show();
  }

  function change(entries, words) {
    state.past.push(state.entries);
    state.future = [];
    put(entries, words);
  }

  function add(entry) {
    const reason = revised(plan, [...state.entries, entry]).refused.get(entry);
    if (reason) return say(`${titles[entry.kind][0]}: ${reason}.`);
    return change([...state.entries, entry], `${titles[entry.kind][0]}: added to the list.`);
  }

  /** Take back an own correction at a place rather than correct it; true if there was one. */
  function takenBack(kinds, p) {
    const own = pick(state.entries.filter((entry) => kinds.includes(entry.kind)), p, AT_LINE, (entry) => entry.line || [entry.at, entry.at]);
    if (own) change(state.entries.filter((entry) => entry !== own), "Your own correction is taken back.");
    return own !== null;
  }

  function click(p) {
    const tool = state.tool;
    if (!tool) return say("Choose a tool first.");
    if (!tool.endsWith("_room") && 1 / metresPerPx() < CLEAR_PX) {
      look(p, CLEAR_PX * 2);
      return say("Enlarged: click again, more exactly. 0 shows the whole.");
    }
    if (["split", "add_door", "add_wall"].includes(tool)) return clickLine(tool, p);
    if (tool === "join") return clickJoin(p);
    if (tool === "name_room") return clickRoom(p);
    if (tool === "remove_room") return takenBack(["remove_room"], p) || add({ kind: tool, at: rounded(p) });
    if (tool === "glass_wall") return clickGlass(p);
    if (takenBack(["add_wall"], p)) return undefined;
    const wall = pick(walls, p, AT_LINE), body = wall && bodyOf(wall);
    if (!wall) return say("Click nearer to a wall.");
    if (!body) return say("Only one face of this wall was seen: nothing is known behind it.");
    return add({ kind: tool, ...body });
  }

  function clickGlass(p) {
    if (takenBack(["glass_wall"], p)) return undefined;
    const wall = pick([...walls, ...state.entries.filter((entry) => entry.kind === "add_wall")], p, AT_LINE);
    return wall ? add({ kind: "glass_wall", line: wall.line.map(rounded) }) : say("Click nearer to a wall.");
  }

  function clickLine(tool, p) {
    if (!state.first) {
      state.first = p;
      return say("Click the other end.");
    }
    const line = meant(tool, [state.first, p], state.entries).map(rounded);
    state.first = null;
    if (length(line) < 0.1) return say("The line is too short: click two places.");
    return add(tool === "add_wall" ? { kind: tool, line, thickness: OUTER_THICKNESS } : { kind: tool, line });
  }

  function clickJoin(p) {
    if (!state.first && takenBack(["split", "add_door"], p)) return undefined;
    const boundary = pick(plan.boundaries, p, AT_LINE);
    if (boundary && !state.first) return add({ kind: "join", at: rounded(middle(boundary.line)) });
    const room = roomAt(p);
    if (!room) return say("Click a boundary or a room.");
    if (!state.first) {
      state.first = p;
      return say(`Click a room beside ${room.label}.`);
    }
    const pair = [roomAt(state.first), room];
    state.first = null;
    const shared = plan.boundaries.filter((one) => pair[0] !== pair[1] && pair.every((own) => one.rooms.includes(own.id)));
    if (!shared.length) return say("These two rooms have no boundary but walls: remove the wall, or add a door.");
    return add({ kind: "join", at: rounded(middle(shared[0].line)) });
  }

  function clickRoom(p) {
    const { board, labels } = state.plan, number = board.index(p) < 0 ? 0 : labels[board.index(p)];
    const room = state.plan.rooms.find((one) => one.number === number);
    if (!room) return say("Click inside of a room.");
    state.first = p;
    byId("naming").hidden = false;
    byId("name").value = room.label;
    byId("name").select();
    byId("name").focus();
    return say(`Type a name for ${room.label}.`);
  }

  byId("naming").addEventListener("submit", (event) => {
    event.preventDefault();
    const name = byId("name").value.replace(/[|`\p{C}]/gu, "").replace(/^[.\s]+/, "").trim();
    const { board, labels } = state.plan, numberAt = (p) => labels[board.index(p)];
    byId("naming").hidden = true;
    if (!name) return say("A name needs letters.");
    const at = rounded(state.first);
    state.first = null;
    const rest = state.entries.filter((entry) => entry.kind !== "name_room" || numberAt(entry.at) !== numberAt(at));
    return change([...rest, { kind: "name_room", at, name }], `Named ${name}.`);
  });

  function undo() {
    byId("naming").hidden = true;
    if (state.first) {
      state.first = null;
      show();
      return say("Undone.");
    }
    return step(state.past, state.future, "Undone.", "Nothing to undo.");
  }

  const redo = () => step(state.future, state.past, "Redone.", "Nothing to redo.");

  function step(from, to, words, none) {
    if (!from.length) return say(none);
    to.push(state.entries);
    return put(from.pop(), words);
  }

  // Questions

  /** The most doubtful line that no correction answers. */
  function ask() {
    const said = state.entries.filter((entry) => ["split", "join", "add_door", "no_door"].includes(entry.kind));
    const isOpen = ({ line }) => !said.some((entry) => distance(entry.line || [entry.at, entry.at], middle(line)) <= ANSWERED);
    const open = data.questions.filter((one) => !state.passed.has(one) && isOpen(one)), [question] = open;
    state.question = question || null;
    byId("asking").hidden = !question;
    if (question) byId("question").textContent = `${open.length} to answer. Does the dotted orange line part two rooms? It is `
      + `${length(question.line).toFixed(2)} m wide and ${question.drawn ? "" : "not "}drawn. `;
  }

  function answer(kind) {
    const question = state.question;
    if (!question) return undefined;
    if (kind) add({ kind: question[kind], line: question.line.map(rounded) });
    if (state.question === question) state.passed.add(question);
    ask();
    if (state.question) showQuestion();
    return show();
  }

  function showQuestion() {
    if (state.question && 1 / metresPerPx() < CLEAR_PX) look(middle(state.question.line), CLEAR_PX);
    else if (state.question) look(middle(state.question.line), 1 / metresPerPx());
  }

  // The page

  function say(words) { byId("said").textContent = words; }

  function text() {
    const entries = state.entries.map((entry) => "  " + JSON.stringify(entry)).join(",\n");
    const former = data.rooms.map(({ id, polygon }) => JSON.stringify({ id, polygon })).join(",\n  ");
    return `{"map": ${JSON.stringify(data.map)},\n "rooms": [\n  ${former}],\n "corrections": [\n${entries}\n]}\n`;
  }

  function save() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text()], { type: "application/json" }));
    link.download = file;
    link.click();
    URL.revokeObjectURL(link.href);
    put(state.entries, `Saved ${file}.`, true);
  }

  const onSheet = (p) => [1000 * (p[0] - corner[0]), 1000 * (corner[1] - p[1])];
  const metresPerPx = () => 1e-3 / svg.getScreenCTM().a;

  function onMap(event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [corner[0] + at.x / 1000, corner[1] - at.y / 1000];
  }

  function draw(kind, attributes, words = "") {
    const element = layer.appendChild(document.createElementNS(svg.namespaceURI, kind));
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    element.textContent = words;
  }

  function drawLine(kind, line, thickness) {
    const [a, b] = line.map(onSheet);
    const width = thickness ? 1000 * thickness : 4000 * metresPerPx();
    draw("line", { class: kind, x1: a[0], y1: a[1], x2: b[0], y2: b[1], "stroke-width": width });
  }

  function drawLabel(p, words, kind = "edit") {
    const size = 13000 * metresPerPx(), [x, y] = onSheet(p);
    draw("text", { class: kind + " halo", x, y: y + 0.35 * size, "font-size": size, "stroke-width": size / 4 }, words);
  }

  /** The plan with all corrections, in place of the drawing over its map. */
  function drawPlan() {
    const { board, rooms: found, refused, rests, doors: kept } = state.plan, [x, y] = onSheet([board.left, board.top]);
    for (const wall of svg.querySelectorAll(".over .wall, .over .inferred, .over .glass")) if (wall.querySelector("title")) layer.append(wall.cloneNode(true));
    const [width, height] = [board.width, board.height].map((count) => 1000 * count * board.cell);
    draw("image", { x, y, width, height, href: state.picture ||= roomPicture(state.plan) });
    const own = state.entries.filter((entry) => isLine(entry) && !refused.has(entry));
    for (const rest of rests) drawLine("drawn", rest, OUTER_THICKNESS);
    for (const entry of own) if (entry.kind === "add_wall") drawLine("drawn", entry.line, entry.thickness || OUTER_THICKNESS);
    for (const one of kept) drawLine(one.kind, one.line, 0.04);
    for (const entry of own) if (["split", "add_door"].includes(entry.kind)) drawLine(entry.kind === "split" ? "opening" : "door", entry.line, 0.04);
    for (const room of found) drawLabel(room.at, `${room.label} ${room.area.toFixed(1)} m²`, "name");
  }

  function drawCorrections() {
    const px = metresPerPx();
    state.entries.forEach((entry, index) => {
      const place = isLine(entry) ? middle(entry.line) : entry.at;
      if (isLine(entry)) drawLine("edit " + entry.kind, entry.line, entry.kind.endsWith("wall") ? entry.thickness || OUTER_THICKNESS : 0);
      const [cx, cy] = onSheet(place);
      if (["join", "remove_room"].includes(entry.kind)) draw("circle", { class: "edit " + entry.kind, cx, cy, r: 9000 * px, "stroke-width": 3000 * px });
      drawLabel([place[0] + 16 * px, place[1] + 12 * px], `${index + 1}${entry.name ? " " + entry.name : ""}`);
    });
    for (const rest of state.plan.rests) drawLine("edit add_wall", rest, OUTER_THICKNESS);
  }

  function show(preview = null) {
    layer.replaceChildren();
    svg.classList.toggle("corrected", state.corrected);
    byId("corrected").setAttribute("aria-pressed", String(state.corrected));
    if (state.corrected) drawPlan();
    else drawCorrections();
    if (state.first) {
      const [cx, cy] = onSheet(state.first);
      draw("circle", { class: "edit first", cx, cy, r: 4000 * metresPerPx() });
    }
    if (state.question) drawLine("edit question", state.question.line);
    if (preview) drawLine("edit " + state.tool, preview, state.tool === "add_wall" ? OUTER_THICKNESS : 0);
    if (document.activeElement === svg) {
      const [x, y] = onSheet(viewMiddle()), size = 8000 * metresPerPx();
      draw("path", { class: "edit", d: `M${x - size},${y}h${2 * size}M${x},${y - size}v${2 * size}`, "stroke-width": size / 5 });
    }
  }

  /** The list of corrections, each with why it can't be carried out. */
  function list() {
    const items = state.entries.map((entry) => {
      const item = document.createElement("li"), reason = state.plan.refused.get(entry);
      const places = (entry.line || [entry.at]).map((p) => `(${p.map((value) => value.toFixed(2)).join(", ")})`);
      item.append(`${titles[entry.kind][0]} ${places.join(" to ")} ${entry.name || ""} `);
      if (reason) item.append(Object.assign(document.createElement("b"), { textContent: `left out: ${reason} ` }));
      item.append(button("take back", () => change(state.entries.filter((one) => one !== entry), "Taken back.")));
      return item;
    });
    byId("corrections").replaceChildren(...items);
    ask();
    byId("json").value = text();
    const found = state.plan.rooms;
    byId("sizes").textContent = `${found.length} rooms: ${found.map((room) => `${room.label} ${room.area.toFixed(1)} m²`).join(", ")}`;
  }

  function button(words, act, name = "", hint = "") {
    const element = document.createElement("button");
    Object.assign(element, { type: "button", textContent: words, onclick: act, id: name, title: hint });
    return element;
  }

  function choose(tool) {
    Object.assign(state, { tool, first: null });
    byId("naming").hidden = true;
    for (const name of names) byId(name).setAttribute("aria-pressed", String(name === tool));
    say(tools[tool][1]);
    show();
  }

  function toggle() {
    state.corrected = !state.corrected;
    say(state.corrected ? "The plan with your corrections; the drawing with exact lengths is made by slamgym cad." : "The drawing over its map.");
    show();
  }

  // The view

  const viewMiddle = () => {
    const box = svg.viewBox.baseVal;
    return [corner[0] + (box.x + box.width / 2) / 1000, corner[1] - (box.y + box.height / 2) / 1000];
  };

  function view(x, y, width) {
    const box = svg.viewBox.baseVal, wide = Math.min(full, width), height = wide * tall / full;
    Object.assign(box, { x: Math.min(Math.max(x, 0), full - wide), y: Math.min(Math.max(y, 0), tall - height), width: wide, height });
    show();
  }

  function zoom(factor, at = [0.5, 0.5]) {
    const box = svg.viewBox.baseVal, width = Math.min(full, box.width / factor);
    view(box.x + at[0] * (box.width - width), box.y + at[1] * (box.height - width * tall / full), width);
  }

  /** Show a place in the middle, a metre so many pixels wide. */
  function look(p, pixels) {
    const [x, y] = onSheet(p), width = svg.viewBox.baseVal.width / metresPerPx() / pixels;
    view(x - width / 2, y - width * tall / full / 2, width);
  }

  const pan = (right, down) => {
    const box = svg.viewBox.baseVal;
    view(box.x + 0.1 * right * box.width, box.y + 0.1 * down * box.height, box.width);
  };

  svg.addEventListener("click", (event) => {
    if (!state.dragged) click(onMap(event));
    show();
  });
  svg.addEventListener("pointerdown", () => { state.dragged = false; });
  svg.addEventListener("pointermove", (event) => {
    if (event.buttons === 1 && Math.hypot(event.movementX, event.movementY) > 0) {
      const box = svg.viewBox.baseVal, scale = 1000 * metresPerPx();
      if (Math.hypot(event.movementX, event.movementY) > 2) state.dragged = true;
      view(box.x - event.movementX * scale, box.y - event.movementY * scale, box.width);
    } else if (state.first && ["split", "add_door", "add_wall"].includes(state.tool)) {
      show(meant(state.tool, [state.first, onMap(event)], state.entries));
    }
  });
  svg.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    const frame = svg.getBoundingClientRect();
    const at = [(event.clientX - frame.left) / frame.width, (event.clientY - frame.top) / frame.height];
    zoom(Math.exp(-0.01 * event.deltaY), at);
  }, { passive: false });
  svg.addEventListener("focus", () => show());
  svg.addEventListener("blur", () => show());

  const keys = {
    "+": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: () => view(0, 0, full), p: toggle,
    ArrowLeft: () => pan(-1, 0), ArrowRight: () => pan(1, 0), ArrowUp: () => pan(0, -1), ArrowDown: () => pan(0, 1),
    Enter: () => { click(viewMiddle()); show(); }, y: () => answer("yes"), n: () => answer("no"), q: showQuestion,
    ...Object.fromEntries(names.map((name, k) => [k + 1, () => choose(name)])),
  };

  document.addEventListener("keydown", (event) => {
    const isTyping = ["INPUT", "TEXTAREA"].includes(event.target.tagName), isCommand = event.ctrlKey || event.metaKey;
    if (event.key === "Escape" && (state.first || isTyping)) return undo();
    if (isTyping || event.altKey) return undefined;
    let act = isCommand ? { z: event.shiftKey ? redo : undo, Z: redo, y: redo }[event.key] : keys[event.key];
    if (["Enter", "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"].includes(event.key) && document.activeElement !== svg) act = null;
    if (!act) return undefined;
    event.preventDefault();
    return act();
  });
  window.addEventListener("beforeunload", (event) => { if (!state.saved && !state.kept) event.preventDefault(); });

  svg.setAttribute("tabindex", "0");
  byId("tools").append(
    ...names.map((name, k) => button(tools[name][0], () => choose(name), name, `key ${k + 1}`)),
    button("Undo", undo, "undo", "Ctrl+Z"), button("Redo", redo, "redo", "Ctrl+Y"), button("+", () => zoom(1.5), "larger", "key +"),
    button("−", () => zoom(1 / 1.5), "smaller", "key -"), button("Whole", () => view(0, 0, full), "whole", "key 0"),
    button("Corrected plan", toggle, "corrected", "key p"),
  );
  byId("asking").append(
    button("A door or border", () => answer("yes"), "yes", "key y"), button("No, one room", () => answer("no"), "no", "key n"),
    button("Pass", () => answer(null), "pass"), button("Show it", showQuestion, "where", "key q"),
  );
  byId("files").append(button("Save " + file, save, "save"), " ", button("Copy the text", () => {
    byId("json").select();
    document.execCommand("copy");
    say("Copied.");
  }, "copy"));
  let waiting = null;
  try { waiting = JSON.parse(localStorage.getItem(key)); } catch { waiting = null; }
  if (Array.isArray(waiting)) {
    state.past.push(state.entries);
    put(waiting, "Corrections from last time, not saved yet, are back; undo drops them.");
  } else {
    put(state.entries, "Choose what to correct.", true);
  }
})();
