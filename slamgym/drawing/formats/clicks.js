// What is drawn, and what clicks on it mean: they are at corners and walls that are near, and lines lie along the walls.

// A line so near to a main direction of the walls lies along it [rad]; clicks are at corners and jambs so near [m], and at
// walls and doors so near [m].
const SNAP = 6 * Math.PI / 180, AT_CORNER = 0.2, AT_LINE = 0.4;

function drawnThings(data) {
  const rooms = data.rooms.map((room) => ({ id: room.id, label: room.name, rings: room.polygon }));
  const allEdges = rooms.flatMap((room) => edges(room.rings));
  const roomAt = (p) => rooms.find((room) => isIn(room.rings, p));
  const doors = data.doors.map((door) => ({ rooms: door.rooms, line: [door.start, door.end], kind: door.kind }));
  const walls = data.walls.map((wall) => ({ ...wall, line: [wall.start, wall.end] }));
  const plan = { rooms, walls, boundaries: [...doors, ...touching()] };

  /** Where rooms touch without a door. */
  function touching() {
    const extents = new Map(rooms.map((room) => [room, [0, 1].map((axis) => {
      const values = room.rings[0].map((p) => p[axis]);
      return [Math.min(...values), Math.max(...values)];
    })]));
    const areApart = (one, other) => [0, 1].some((axis) => extents.get(one)[axis][0] > extents.get(other)[axis][1] + 0.01
      || extents.get(other)[axis][0] > extents.get(one)[axis][1] + 0.01);
    const isOf = ([a, b], rings) => edges(rings).some((edge) => distance(edge, a) < 0.005 && distance(edge, b) < 0.005);
    return rooms.flatMap((one, index) => rooms.slice(index + 1).filter((other) => !areApart(one, other)).flatMap((other) =>
      edges(one.rings).filter((line) => length(line) > 0.1 && !doors.some((door) => distance(door.line, middle(line)) < 0.05)
        && isOf(line, other.rings)).map((line) => ({ rooms: [one.id, other.id], line, kind: "opening" }))));
  }

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

  /** The corner of a room at a place, if one is near. */
  function snapped(p) {
    const found = pick(allEdges, p, AT_CORNER, ([a]) => [a, a]);
    return found ? found[0] : p;
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
    const corners = allEdges.filter(([a]) => length([a, p]) < AT_CORNER).map(([a]) => a);
    const face = pick(allEdges, p, AT_CORNER, (edge) => edge);
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
  function doorAt(line, entries) {
    const own = entries.filter((entry) => entry.kind === "add_wall");
    const isAt = (wall) => line.every((p) => distance(wall.line, p) < 0.5 * (wall.thickness || wall.thickness_m || OUTER_THICKNESS) + 0.1);
    const wall = pick([...own, ...walls].filter(isAt), middle(line), AT_LINE);
    return wall ? line.map((p) => along(wall.line, share(wall.line, p))) : between(line);
  }

  /** The line that two clicks mean, beside the corrections that there are. */
  function meant(tool, line, entries) {
    if (tool === "add_door") return doorAt(line, entries);
    const [from, to] = line.map(snapped);
    const turned = to === line[1] ? straight([from, to]) : [from, to];
    return tool === "split" ? across(turned) : turned;
  }

  return { plan, rooms, walls, roomAt, bodyOf, meant };
}
