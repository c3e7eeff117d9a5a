"use strict";

// Geometry of a drawing, and the drawing with a person's corrections: worked out on cells, so that the page can show it
// and refuse what `slamgym cad --corrections` would leave out. Coordinates are metres in the map's frame.

const minus = (a, b) => [a[0] - b[0], a[1] - b[1]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1];
const cross = (a, b) => a[0] * b[1] - a[1] * b[0];
const along = ([a, b], t) => [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
const middle = (line) => along(line, 0.5);
const length = ([a, b]) => Math.hypot(...minus(b, a));
const share = ([a, b], p) => dot(minus(p, a), minus(b, a)) / Math.max(dot(minus(b, a), minus(b, a)), 1e-12);
const nearest = (line, p) => along(line, Math.min(Math.max(share(line, p), 0), 1));
const distance = (line, p) => length([nearest(line, p), p]);
const lengthened = (line, by) => [along(line, -by / length(line)), along(line, 1 + by / length(line))];
const edges = (rings) => rings.flatMap((ring) => ring.slice(1).map((p, k) => [ring[k], p]));
const isIn = (rings, p) => edges(rings).filter(([a, b]) =>
  (a[1] > p[1]) !== (b[1] > p[1]) && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])).length % 2 === 1;
const rounded = (p) => p.map((value) => Math.round(1000 * value) / 1000);

/** The one of some lines that is nearest to a point, if it lies within reach. */
function pick(items, p, reach, line = (item) => item.line) {
  const found = items.map((item) => [distance(line(item), p), item]).sort((a, b) => a[0] - b[0])[0];
  return found && found[0] < reach ? found[1] : null;
}

// As slamgym.drawing has them: floor smaller than a room [m2], ends of the same boundary [m], a wall's thickness [m].
const SMALLEST_ROOM = 1, SAME_DOOR = 0.3, OUTER_THICKNESS = 0.1;
// What the cells are, and at most so many of at least such a side [m].
const WALL = 0, FLOOR = 1, CUT = 2, MOST_CELLS = 2e6, SMALLEST_CELL = 0.025;

/** Cells over the rooms of a drawing. */
class Board {
  constructor(rooms) {
    const points = rooms.flatMap((room) => room.rings[0]);
    const [left, bottom, right, top] = [Math.min, Math.max].flatMap((most) =>
      [0, 1].map((axis) => points.reduce((best, p) => most(best, p[axis]), points[0][axis])));
    this.cell = Math.max(SMALLEST_CELL, Math.sqrt((right - left) * (top - bottom) / MOST_CELLS));
    this.left = left - 1;
    this.top = top + 1;
    this.width = Math.ceil((right + 1 - this.left) / this.cell);
    this.height = Math.ceil((this.top - bottom + 1) / this.cell);
    const canvas = this.canvas();
    const pen = canvas.getContext("2d");
    const path = new Path2D();
    for (const room of rooms) for (const ring of room.rings) {
      ring.forEach((p, k) => path[k ? "lineTo" : "moveTo"](...this.at(p)));
      path.closePath();
    }
    pen.fill(path, "evenodd");
    const drawn = pen.getImageData(0, 0, this.width, this.height).data;
    this.cells = new Uint8Array(this.width * this.height).map((_, k) => (drawn[4 * k + 3] > 127 ? FLOOR : WALL));
  }

  canvas() { return Object.assign(document.createElement("canvas"), { width: this.width, height: this.height }); }
  at(p) { return [(p[0] - this.left) / this.cell, (this.top - p[1]) / this.cell]; }
  from(index) {
    const row = Math.floor(index / this.width), column = index - row * this.width;
    return [this.left + (column + 0.5) * this.cell, this.top - (row + 0.5) * this.cell];
  }
  index(p) {
    const [column, row] = this.at(p).map(Math.floor);
    return column < 1 || row < 1 || column >= this.width - 1 || row >= this.height - 1 ? -1 : row * this.width + column;
  }
  isFloor(p) { return this.index(p) >= 0 && this.cells[this.index(p)] !== WALL; }

  /** Places along a line, so near to each other that no cell between two is missed. */
  places(line) {
    const count = Math.ceil(length(line) / (0.4 * this.cell)) + 1;
    return Array.from({ length: count }, (_, k) => along(line, k / Math.max(count - 1, 1)));
  }
  shareOfFloor(line) {
    const places = this.places(line);
    return places.filter((p) => this.isFloor(p)).length / places.length;
  }
  /** Cells within a body along a line, walls as wide as a cell at least. */
  body(line, thickness) {
    const found = new Set(), u = minus(line[1], line[0]).map((value) => value / length(line));
    const half = Math.max(0.5 * thickness, 0.5 * this.cell);
    for (let aside = -half; aside <= half + 1e-9; aside += 0.4 * this.cell) {
      for (const p of this.places(line)) found.add(this.index([p[0] - aside * u[1], p[1] + aside * u[0]]));
    }
    found.delete(-1);
    return [...found];
  }
  paint(line, thickness, value) { for (const k of this.body(line, thickness)) this.cells[k] = value; }
  cut(line) {
    for (const p of this.places(lengthened(line, 1.5 * this.cell))) {
      if (this.isFloor(p)) this.cells[this.index(p)] = CUT;
    }
  }
  /** From a place on, how far the floor reaches in a direction, to a wall or a cut [m]. */
  reach(p, direction) {
    let far = this.cell;
    while (this.cells[this.index([p[0] + far * direction[0], p[1] + far * direction[1]])] === FLOOR) far += 0.4 * this.cell;
    return far;
  }

  isAtWall(p) {
    const turns = Array.from({ length: 8 }, (_, k) => k * Math.PI / 4);
    return turns.some((turn) => !this.isFloor([p[0] + 1.5 * this.cell * Math.cos(turn), p[1] + 1.5 * this.cell * Math.sin(turn)]));
  }
  /** A line led on to the next walls; the line itself if that makes it more than twice as long. */
  ledOn(line) {
    const u = minus(line[1], line[0]).map((value) => value / length(line));
    const [before, after] = [[line[0], u.map((value) => -value)], [line[1], u]].map(([p, d]) => (this.isFloor(p) ? this.reach(p, d) : 0));
    if (before + after > length(line)) return line;
    return [along(line, -before / length(line)), along(line, 1 + after / length(line))];
  }

  /** Numbers of the rooms that cuts and walls part, from 1, and how many cells each has. */
  labelled() {
    const labels = new Int32Array(this.cells.length), sizes = [0], stack = [];
    const steps = [1, -1, this.width, -this.width];
    for (let start = 0; start < labels.length; start += 1) {
      if (this.cells[start] !== FLOOR || labels[start]) continue;
      const number = sizes.length;
      let size = 0;
      labels[start] = number;
      stack.push(start);
      while (stack.length) {
        const k = stack.pop();
        size += 1;
        for (const step of steps) {
          if (this.cells[k + step] === FLOOR && !labels[k + step]) {
            labels[k + step] = number;
            stack.push(k + step);
          }
        }
      }
      sizes.push(size);
    }
    this.cells.forEach((value, k) => {
      if (value === CUT) labels[k] = Math.max(...steps.map((step) => (this.cells[k + step] === FLOOR ? labels[k + step] : 0)));
    });
    return { labels, areas: sizes.map((size) => size * this.cell ** 2) };
  }

  /** For each room the place that is farthest from its walls. */
  middles(labels, count) {
    const away = new Float32Array(labels.length), best = new Float32Array(count), at = new Int32Array(count);
    const w = this.width;
    const sweep = (order, steps) => {
      for (const k of order) {
        if (!labels[k]) continue;
        let least = away[k] || Infinity;
        for (const [step, far] of steps) least = Math.min(least, labels[k + step] === labels[k] ? away[k + step] + far : far);
        away[k] = least;
      }
    };
    const all = function* (from, to, by) { for (let k = from; k !== to; k += by) yield k; };
    sweep(all(w + 1, labels.length - w - 1, 1), [[-1, 1], [-w, 1], [-w - 1, 1.4], [-w + 1, 1.4]]);
    sweep(all(labels.length - w - 2, w, -1), [[1, 1], [w, 1], [w + 1, 1.4], [w - 1, 1.4]]);
    labels.forEach((number, k) => { if (away[k] > best[number]) { best[number] = away[k]; at[number] = k; } });
    return Array.from(at, (k) => this.from(k));
  }
}

/** Where the wall beside a door on the floor stands: from jambs that are free to the next walls. */
function besideDoor(board, line) {
  const u = minus(line[1], line[0]).map((value) => value / length(line));
  return [[line[0], u.map((value) => -value)], [line[1], u]].filter(([p]) => !board.isAtWall(p)).map(([p, direction]) => {
    const far = board.reach(p, direction);
    return [p, [p[0] + far * direction[0], p[1] + far * direction[1]]];
  });
}

/**
 * The drawing with corrections: its rooms, doors and new walls, and why some corrections can't be carried out.
 * `plan` has rooms (rings, label), boundaries and walls (line, thickness_m).
 */
function revised(plan, entries) {
  const of = (...kinds) => entries.filter((entry) => kinds.includes(entry.kind));
  const board = new Board(plan.rooms), refused = new Map(), rests = [];
  for (const entry of of("remove_wall")) {
    const cells = board.body(entry.line, (entry.thickness || OUTER_THICKNESS) + 0.04);
    const solid = cells.filter((k) => board.cells[k] === WALL).length;
    if (solid < 0.1 * cells.length || solid === cells.length) refused.set(entry, "no wall stands there");
    else cells.forEach((k) => { board.cells[k] = FLOOR; });
  }
  for (const entry of of("add_wall")) {
    const thickness = entry.thickness || OUTER_THICKNESS;
    if (board.shareOfFloor(entry.line) < 0.5) refused.set(entry, "no floor lies there");
    else board.paint(board.isFloor(lengthened(entry.line, 0.2)[1]) ? entry.line : lengthened(entry.line, 0.1), thickness, WALL);
  }
  for (const { line } of of("add_door")) {
    if (board.shareOfFloor(line) >= 0.5) for (const rest of besideDoor(board, line)) {
      rests.push(rest);
      board.paint(rest, OUTER_THICKNESS, WALL);
    } else {
      const wall = pick([...plan.walls, ...of("add_wall")], middle(line), 0.5);
      if (wall) board.paint(line, (wall.thickness_m || wall.thickness || OUTER_THICKNESS) + 0.06, FLOOR);
    }
  }
  for (const entry of of("glass_wall")) {
    if (!pick([...plan.walls, ...of("add_wall")], middle(entry.line), 0.5)) refused.set(entry, "no wall stands along it");
  }
  const gone = of("join").map((entry) => {
    const found = pick(plan.boundaries, entry.at, SAME_DOOR);
    if (!found) refused.set(entry, "no door and no boundary between two rooms lies there");
    return found;
  });
  const added = of("split", "add_door");
  const isSame = (a, b) => [b, [b[1], b[0]]].some((other) => a.every((p, k) => length([p, other[k]]) < SAME_DOOR));
  const other = [...added, ...of("no_door")];
  const kept = plan.boundaries.filter((one) => !gone.includes(one) && !other.some(({ line }) => isSame(line, one.line)));
  for (const { line } of kept) board.cut(line);
  const own = added.map((entry) => ({ entry, line: entry.kind === "split" ? board.ledOn(entry.line) : entry.line }));
  for (const { line } of own) board.cut(line);
  const { labels, areas } = board.labelled();
  const isRoom = (number) => areas[number] >= SMALLEST_ROOM;
  for (const { entry, line } of own) {
    const u = minus(line[1], line[0]).map((value) => 2.5 * board.cell * value / length(line));
    const sides = [0.2, 0.35, 0.5, 0.65, 0.8].map((t) => along(line, t)).map((p) => [1, -1].map((side) =>
      labels[board.index([p[0] - side * u[1], p[1] + side * u[0]])]));
    if (!sides.some(([a, b]) => a !== b && isRoom(a) && isRoom(b))) {
      refused.set(entry, `it doesn't part two rooms of ${SMALLEST_ROOM} m² or more; lead it from wall to wall`);
    }
  }
  const middles = board.middles(labels, areas.length);
  const rooms = areas.map((area, number) => ({ number, area, at: middles[number] })).filter((room) => isRoom(room.number));
  for (const entry of of("remove_room")) {
    const found = rooms.findIndex((one) => one.number === labels[board.index(entry.at)]);
    if (found < 0 || rooms.length === 1) refused.set(entry, "no room lies there, or no other");
    else {
      const [{ number }] = rooms.splice(found, 1);
      labels.forEach((own, k) => { if (own === number) { labels[k] = 0; board.cells[k] = WALL; } });
    }
  }
  for (const room of rooms) room.label = (plan.rooms.find((one) => isIn(one.rings, room.at)) || { label: "" }).label;
  for (const entry of of("name_room")) {
    const room = rooms.find((one) => one.number === labels[board.index(entry.at)]);
    if (room) room.label = entry.name;
    else refused.set(entry, "no room lies there");
  }
  const isOpen = ({ line }) => board.shareOfFloor(line) > 0.3;
  return { board, labels, rooms, refused, rests, doors: kept.filter(isOpen) };
}

/** A picture of the rooms in light colours, as a data address. */
function roomPicture({ board, labels, rooms }) {
  const canvas = board.canvas(), pen = canvas.getContext("2d"), picture = pen.createImageData(board.width, board.height);
  const tints = new Map(rooms.map((room, k) => [room.number, [[255, 243, 191], [211, 249, 216], [208, 235, 255], [255, 227, 227], [229, 219, 255]][k % 5]]));
  labels.forEach((number, k) => {
    if (board.cells[k] !== WALL) picture.data.set([...(tints.get(number) || [248, 249, 250]), 255], 4 * k);
  });
  pen.putImageData(picture, 0, 0);
  return canvas.toDataURL();
}
