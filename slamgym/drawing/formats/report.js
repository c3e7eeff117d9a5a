"use strict";

// A person's corrections of a drawing: two clicks make a line, one click a place. What is shown here is a sketch;
// `slamgym cad --corrections` draws it. Coordinates are metres in the map's frame, on screen millimetres, y down.
(() => {
  const byId = (id) => document.getElementById(id);
  const data = JSON.parse(byId("data").textContent);
  const svg = document.querySelector(".editor svg");
  const corner = [Number(svg.dataset.left), Number(svg.dataset.top)];
  const layer = svg.appendChild(document.createElementNS(svg.namespaceURI, "g"));
  const full = svg.viewBox.baseVal.width, tall = svg.viewBox.baseVal.height;
  const file = data.map.name + ".corrections.json";
  const tools = {
    split: ["Split a room", "Click two places between which the boundary leads; it goes on to the next walls."],
    join: ["Join rooms", "Click a door or another boundary, or two rooms that touch: they become one room."],
    add_door: ["Add a door", "Click both jambs: in a wall, in a passage, or on the floor, where the wall around it is drawn too."],
    add_wall: ["Add a wall", "Click both ends."],
    remove_wall: ["Remove a wall", "Click the wall, or the thing that was drawn as walls."],
    name_room: ["Name a room", "Click the room, then type its name."],
  };
  const state = { tool: null, first: null, entries: data.provenance.corrections || [], past: [], saved: true, dragged: false };
  const SNAP = 6 * Math.PI / 180, REACH_PX = 14, AT_JAMB = 0.2;

  // Geometry

  const minus = (a, b) => [a[0] - b[0], a[1] - b[1]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1];
  const cross = (a, b) => a[0] * b[1] - a[1] * b[0];
  const along = ([a, b], t) => [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
  const middle = (line) => along(line, 0.5);
  const length = ([a, b]) => Math.hypot(...minus(b, a));
  const share = ([a, b], p) => dot(minus(p, a), minus(b, a)) / Math.max(dot(minus(b, a), minus(b, a)), 1e-12);
  const nearest = (line, p) => along(line, Math.min(Math.max(share(line, p), 0), 1));
  const distance = (line, p) => length([nearest(line, p), p]);
  const edges = (rings) => rings.flatMap((ring) => ring.slice(1).map((p, k) => [ring[k], p]));
  const isIn = (rings, p) => edges(rings).filter(([a, b]) =>
    (a[1] > p[1]) !== (b[1] > p[1]) && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])).length % 2 === 1;
  const overlap = ([a, b], rings) => edges(rings).some((edge) => distance(edge, a) < 0.005 && distance(edge, b) < 0.005);
  const roomAt = (p) => rooms.find((room) => isIn(room.rings, p));
  const rounded = (p) => p.map((value) => Math.round(1000 * value) / 1000);

  const rooms = data.rooms.map((room) => ({ id: room.id, label: room.name, rings: room.polygon }));
  const extents = new Map(rooms.map((room) => [room, [0, 1].map((axis) => {
    const values = room.rings[0].map((p) => p[axis]);
    return [Math.min(...values), Math.max(...values)];
  })]));
  const extent = (room, axis) => extents.get(room)[axis];
  const doors = data.doors.map((door) => ({ rooms: door.rooms, line: [door.start, door.end] }));

  /** Doors, and where rooms touch without one. */
  const boundaries = [...doors];
  rooms.forEach((one, index) => rooms.slice(index + 1).forEach((other) => {
    if ([0, 1].some((axis) => extent(one, axis)[0] > extent(other, axis)[1] + 0.01
      || extent(other, axis)[0] > extent(one, axis)[1] + 0.01)) return;
    for (const line of edges(one.rings)) {
      const isFree = length(line) > 0.1 && !doors.some((door) => distance(door.line, middle(line)) < 0.05);
      if (isFree && overlap(line, other.rings)) boundaries.push({ rooms: [one.id, other.id], line });
    }
  }));

  /** What is taken away with a wall; of walls round a thing that stands alone on the floor it is the whole thing. */
  function bodyOf(wall) {
    if (wall.thickness_known) return { line: wall.line.map(rounded), thickness: rounded([wall.thickness_m])[0] };
    const hole = rooms.flatMap((room) => room.rings.slice(1))
      .find((ring) => edges([ring]).some((edge) => distance(edge, middle(wall.line)) < wall.thickness_m));
    if (!hole) return null;
    const turn = data.angle_deg * Math.PI / 180, u = [Math.cos(turn), Math.sin(turn)], v = [-u[1], u[0]];
    const [low, high] = [Math.min, Math.max].map((most) => [u, v].map((axis) => most(...hole.map((p) => dot(p, axis)))));
    const isLong = high[0] - low[0] >= high[1] - low[1];
    const [from, to] = isLong ? [u, v] : [v, u], k = isLong ? 0 : 1;
    const at = (t) => from.map((value, i) => t * value + 0.5 * (low[1 - k] + high[1 - k]) * to[i]);
    return { line: [at(low[k]), at(high[k])].map(rounded), thickness: rounded([high[1 - k] - low[1 - k]])[0] };
  }
  const walls = data.walls.map((wall) => ({ ...wall, line: [wall.start, wall.end] }));

  /** The one of some lines that is nearest to a point, if it is near enough to be meant. */
  function pick(items, p, line = (item) => item.line, reach = REACH_PX * metresPerPx()) {
    const found = items.map((item) => [distance(line(item), p), item]).sort((a, b) => a[0] - b[0])[0];
    return found && found[0] < reach ? found[1] : null;
  }

  /** The corner of a room at a place, if one is near. */
  function snapped(p) {
    const corner = pick(rooms.flatMap((room) => edges(room.rings)), p, ([a]) => [a, a]);
    return corner ? corner[0] : p;
  }

  /** A line turned into a main direction of the walls if it nearly lies there. */
  function straight([a, b]) {
    const turn = Math.atan2(b[1] - a[1], b[0] - a[0]) - data.angle_deg * Math.PI / 180;
    const off = turn - Math.round(turn / (Math.PI / 2)) * (Math.PI / 2);
    if (Math.abs(off) > SNAP) return [a, b];
    const [x, y] = minus(b, a), cos = Math.cos(off), sin = Math.sin(off);
    return [a, [a[0] + cos * (cos * x + sin * y), a[1] + cos * (cos * y - sin * x)]];
  }

  /** The line from wall to wall through its middle. */
  function across(line) {
    const room = roomAt(middle(line));
    if (!room) return line;
    const isEnd = (p) => edges(room.rings).some((edge) => distance(edge, p) < 0.005);
    const direction = minus(line[1], line[0]), cuts = [];
    for (const [a, b] of edges(room.rings)) {
      const side = minus(b, a), slope = cross(direction, side);
      if (Math.abs(slope) < 1e-9) continue;
      const t = cross(minus(a, line[0]), side) / slope, u = cross(minus(a, line[0]), direction) / slope;
      if (u >= 0 && u <= 1) cuts.push(t);
    }
    const low = Math.max(...cuts.filter((t) => t < 0.5)), high = Math.min(...cuts.filter((t) => t >= 0.5));
    if (!Number.isFinite(low) || !Number.isFinite(high)) return line;
    return [isEnd(line[0]) ? line[0] : along(line, low), isEnd(line[1]) ? line[1] : along(line, high)];
  }

  /** Where jambs may be that a click near them means: corners, or else a face. */
  function jambs(p) {
    const all = rooms.flatMap((room) => edges(room.rings));
    const corners = all.filter(([a]) => length([a, p]) < AT_JAMB).map(([a]) => a);
    const face = pick(all, p, (edge) => edge, AT_JAMB);
    return corners.length ? corners : [face ? nearest(face, p) : p];
  }

  /** The line from jamb to jamb that lies best along the walls. */
  function between(line) {
    const pairs = jambs(line[0]).flatMap((a) => jambs(line[1]).map((b) => [a, b]));
    const astray = (pair) => length([straight(pair)[1], pair[1]]) + 0.1 * (length([pair[0], line[0]]) + length([pair[1], line[1]]));
    const best = pairs.sort((a, b) => astray(a) - astray(b))[0];
    return best[1] === line[1] ? straight(best) : best;
  }

  /** A door between two clicks: in the wall that both are at, or on the floor. */
  function doorAt(line) {
    const own = state.entries.filter((entry) => entry.kind === "add_wall");
    const isAt = (wall) => line.every((p) => distance(wall.line, p) < 0.5 * (wall.thickness || wall.thickness_m) + 0.1);
    const wall = pick([...own, ...walls].filter(isAt), middle(line));
    return wall ? line.map((p) => along(wall.line, share(wall.line, p))) : between(line);
  }

  /** The line that two clicks mean. */
  function meant(tool, line) {
    if (tool === "add_door") return doorAt(line);
    const [from, to] = line.map(snapped);
    const turned = to === line[1] ? straight([from, to]) : [from, to];
    return tool === "add_wall" ? turned : across(turned);
  }

  // Corrections

  const isLine = (entry) => entry.line !== undefined;

  function change(entries, words) {
    state.past.push(state.entries);
    state.entries = entries;
    state.saved = false;
    say(words);
    show();
  }

  function add(entry) { change([...state.entries, entry], `${tools[entry.kind][0]}: added to the list.`); }

  /** Take back an own correction at a place rather than correct it; true if there was one. */
  function takenBack(kinds, p) {
    const own = pick(state.entries.filter((entry) => kinds.includes(entry.kind)), p);
    if (own) change(state.entries.filter((entry) => entry !== own), "Your own correction is taken back.");
    return own !== null;
  }

  function click(p) {
    const tool = state.tool;
    if (!tool) return say("Choose a tool first.");
    if (["split", "add_door", "add_wall"].includes(tool)) return clickLine(tool, p);
    if (tool === "join") return clickJoin(p);
    if (tool === "name_room") return clickRoom(p);
    if (takenBack(["add_wall"], p)) return undefined;
    const wall = pick(walls, p), body = wall && bodyOf(wall);
    if (!wall) return say("Click nearer to a wall.");
    if (!body) return say("Only one face of this wall was seen: nothing is known behind it.");
    return add({ kind: tool, ...body });
  }

  function clickLine(tool, p) {
    if (!state.first) {
      state.first = p;
      return say("Click the other end.");
    }
    const line = meant(tool, [state.first, p]).map(rounded);
    state.first = null;
    if (length(line) < 0.1) return say("The line is too short: click two places.");
    return add(tool === "add_wall" ? { kind: tool, line, thickness: 0.1 } : { kind: tool, line });
  }

  function clickJoin(p) {
    if (!state.first && takenBack(["split", "add_door"], p)) return undefined;
    const boundary = pick(boundaries, p);
    if (boundary && !state.first) return add({ kind: "join", at: rounded(middle(boundary.line)) });
    const room = roomAt(p);
    if (!room) return say("Click a boundary or a room.");
    if (!state.first) {
      state.first = p;
      return say(`Click a room beside ${room.label}.`);
    }
    const pair = [roomAt(state.first), room];
    state.first = null;
    const between = boundaries.filter((one) => pair[0] !== pair[1] && pair.every((own) => one.rooms.includes(own.id)));
    if (!between.length) return say("These two rooms have no boundary but walls: remove the wall, or add a door.");
    return add({ kind: "join", at: rounded(middle(between[0].line)) });
  }

  function clickRoom(p) {
    const room = roomAt(p);
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
    const room = roomAt(state.first);
    byId("naming").hidden = true;
    if (!name) return say("A name needs letters.");
    const rest = state.entries.filter((entry) => entry.kind !== "name_room" || roomAt(entry.at) !== room);
    const at = rounded(state.first);
    state.first = null;
    return change([...rest, { kind: "name_room", at, name }], `Named ${name}.`);
  });

  function undo() {
    byId("naming").hidden = true;
    if (state.first) state.first = null;
    else if (state.past.length) state.entries = state.past.pop();
    else return say("Nothing to undo.");
    state.saved = false;
    show();
    return say("Undone.");
  }

  // The page

  function say(words) { byId("said").textContent = words; }

  function text() {
    const entries = state.entries.map((entry) => "  " + JSON.stringify(entry)).join(",\n");
    return `{"map": ${JSON.stringify(data.map)},\n "corrections": [\n${entries}\n]}\n`;
  }

  function save() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text()], { type: "application/json" }));
    link.download = file;
    link.click();
    URL.revokeObjectURL(link.href);
    state.saved = true;
    say(`Saved ${file}.`);
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
    draw("line", { class: "edit " + kind, x1: a[0], y1: a[1], x2: b[0], y2: b[1], "stroke-width": width });
  }

  function drawLabel(p, words) {
    const size = 13000 * metresPerPx(), [x, y] = onSheet(p);
    draw("text", { class: "edit halo", x, y: y + 0.35 * size, "font-size": size, "stroke-width": size / 4 }, words);
  }

  function show(preview = null) {
    layer.replaceChildren();
    const px = metresPerPx();
    state.entries.forEach((entry, index) => {
      const place = isLine(entry) ? middle(entry.line) : entry.at;
      if (isLine(entry)) drawLine(entry.kind, entry.line, entry.kind.endsWith("wall") ? entry.thickness || 0.1 : 0);
      const [cx, cy] = onSheet(place);
      if (entry.kind === "join") draw("circle", { class: "edit join", cx, cy, r: 9000 * px, "stroke-width": 3000 * px });
      drawLabel([place[0] + 16 * px, place[1] + 12 * px], `${index + 1}${entry.name ? " " + entry.name : ""}`);
    });
    if (state.first) {
      const [cx, cy] = onSheet(state.first);
      draw("circle", { class: "edit first", cx, cy, r: 4000 * px });
    }
    if (preview) drawLine(state.tool, preview, state.tool === "add_wall" ? 0.1 : 0);
    const items = state.entries.map((entry) => {
      const item = document.createElement("li");
      const places = (entry.line || [entry.at]).map((p) => `(${p.map((value) => value.toFixed(2)).join(", ")})`);
      item.append(`${tools[entry.kind][0]} ${places.join(" to ")} ${entry.name || ""} `);
      item.append(button("take back", () =>
        change(state.entries.filter((one) => one !== entry), "Taken back; what was drawn with it goes with the next drawing.")));
      return item;
    });
    byId("corrections").replaceChildren(...items);
    byId("json").value = text();
  }

  function button(words, act, name = "") {
    const element = document.createElement("button");
    Object.assign(element, { type: "button", textContent: words, onclick: act, id: name });
    return element;
  }

  function choose(tool) {
    Object.assign(state, { tool, first: null });
    byId("naming").hidden = true;
    for (const name of Object.keys(tools)) byId(name).setAttribute("aria-pressed", String(name === tool));
    say(tools[tool][1]);
    show();
  }

  function zoom(factor, at = [0.5, 0.5]) {
    const box = svg.viewBox.baseVal;
    const width = Math.min(full, box.width / factor), height = width * tall / full;
    box.x = Math.min(Math.max(box.x + at[0] * (box.width - width), 0), full - width);
    box.y = Math.min(Math.max(box.y + at[1] * (box.height - height), 0), tall - height);
    Object.assign(box, { width, height });
    show();
  }

  svg.addEventListener("click", (event) => {
    if (!state.dragged) click(onMap(event));
    show();
  });
  svg.addEventListener("pointerdown", () => { state.dragged = false; });
  svg.addEventListener("pointermove", (event) => {
    if (event.buttons === 1 && Math.hypot(event.movementX, event.movementY) > 0) {
      const box = svg.viewBox.baseVal, scale = 1000 * metresPerPx();
      if (Math.hypot(event.movementX, event.movementY) > 2) state.dragged = true;
      box.x = Math.min(Math.max(box.x - event.movementX * scale, 0), full - box.width);
      box.y = Math.min(Math.max(box.y - event.movementY * scale, 0), tall - box.height);
    } else if (state.first && !["join", "name_room"].includes(state.tool)) {
      show(meant(state.tool, [state.first, onMap(event)]));
    }
  });
  svg.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    const frame = svg.getBoundingClientRect();
    const at = [(event.clientX - frame.left) / frame.width, (event.clientY - frame.top) / frame.height];
    zoom(Math.exp(-0.01 * event.deltaY), at);
  }, { passive: false });
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && state.first) undo();
    if ((event.ctrlKey || event.metaKey) && event.key === "z" && event.target !== byId("name")) {
      event.preventDefault();
      undo();
    }
  });
  window.addEventListener("beforeunload", (event) => { if (!state.saved) event.preventDefault(); });

  byId("tools").append(
    ...Object.entries(tools).map(([name, [words]]) => button(words, () => choose(name), name)),
    button("Undo", undo, "undo"), button("+", () => zoom(1.5), "larger"), button("−", () => zoom(1 / 1.5), "smaller"),
  );
  byId("files").append(button("Save " + file, save, "save"), " ", button("Copy the text", () => {
    byId("json").select();
    document.execCommand("copy");
    say("Copied.");
  }, "copy"));
  show();
})();
