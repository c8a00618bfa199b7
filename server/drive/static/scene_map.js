// The road for the top view: outlines of the scene's flat triangles, in squares, so that only what is near is drawn.

const SQUARE_M = 64;
const ROOF_M = 4; // flat triangles higher than this are roofs
const LAYER_COLOURS = { 5: "footway", 4: "apron", 3: "road", 2: "footway", 1: "line" }; // layers of the ground in `static_scene`, from below
const SIGNAL_COLOURS = { r: "bad", u: "bad", y: "warn", g: "good", G: "good", s: "warn" };

class SceneMap {
  constructor(scene) {
    this.squares = new Map();
    for (const part of scene.parts) this.addPart(part);
    for (const square of this.squares.values()) square.paths = new Map([...square.triangles].map(([name, triangles]) => [name, outline(triangles)]));
    this.lamps = scene.lamps.names.map((name, i) => {
      const cut = name.lastIndexOf(":");
      return { tls: name.slice(0, cut), index: Number(name.slice(cut + 1)), place: scene.lamps.place[i], turn: scene.lamps.turn[i] };
    });
  }

  addPart({ layer, positions: p }) {
    for (let at = 0; at < p.length; at += 9) {
      const isFlat = p[at + 2] === p[at + 5] && p[at + 2] === p[at + 8];
      const name = layer > 0 ? layer : isFlat && p[at + 2] > ROOF_M ? "building" : undefined;
      if (name !== undefined) this.triangles((p[at] + p[at + 3] + p[at + 6]) / 3, (p[at + 1] + p[at + 4] + p[at + 7]) / 3, name).push(p.subarray(at, at + 9));
    }
  }

  triangles(x, y, name) {
    const [i, j] = [Math.floor(x / SQUARE_M), Math.floor(y / SQUARE_M)];
    const key = `${i} ${j}`;
    if (!this.squares.has(key)) this.squares.set(key, { x: (i + 0.5) * SQUARE_M, y: (j + 0.5) * SQUARE_M, triangles: new Map() });
    const { triangles } = this.squares.get(key);
    if (!triangles.has(name)) triangles.set(name, []);
    return triangles.get(name);
  }

  /** Draws what lies within `reach` [m] of the middle. */
  draw(ctx, theme, scale, { x, y }, reach) {
    const near = [...this.squares.values()].filter((square) => Math.hypot(square.x - x, square.y - y) < reach + 2 * SQUARE_M);
    for (const layer of [5, 4, 3, 2, 1]) {
      ctx.fillStyle = ctx.strokeStyle = theme[LAYER_COLOURS[layer]];
      ctx.lineWidth = 1 / scale; // squares touch: without an edge the ground shines through
      for (const { paths } of near) {
        if (!paths.has(layer)) continue;
        ctx.fill(paths.get(layer));
        if (layer > 2) ctx.stroke(paths.get(layer));
      }
    }
    ctx.fillStyle = theme.building;
    ctx.strokeStyle = theme["building-edge"];
    for (const { paths } of near) {
      if (!paths.has("building")) continue;
      ctx.fill(paths.get("building"));
      ctx.stroke(paths.get("building"));
    }
  }

  /** Traffic lights as bars across their lane, in their colour. */
  drawSignals(ctx, theme, states, scale, { x, y }, reach) {
    const radius = Math.max(0.7, (4 * devicePixelRatio) / scale);
    for (const { tls, index, place } of this.lamps) {
      if (Math.hypot(place[0] - x, place[1] - y) > reach) continue;
      ctx.beginPath();
      ctx.arc(place[0], place[1], radius, 0, 2 * Math.PI);
      ctx.fillStyle = theme[SIGNAL_COLOURS[states[tls]?.[index]]] ?? theme.muted;
      ctx.fill();
      ctx.lineWidth = 0.3 * radius;
      ctx.strokeStyle = theme.card;
      ctx.stroke();
    }
  }
}

/** The outline of triangles that share edges: an edge that two of them have, one in each direction, is inside. */
function outline(triangles) {
  const edges = new Map(); // "x y" of the beginning -> [ends]
  const keyOf = (x, y) => `${Math.round(x * 100)} ${Math.round(y * 100)}`;
  const points = new Map();
  const remove = (from, to) => {
    const ends = edges.get(from);
    const i = ends ? ends.indexOf(to) : -1;
    if (i >= 0) ends.splice(i, 1);
    return i >= 0;
  };
  for (const p of triangles) {
    const corners = [0, 3, 6].map((at) => keyOf(p[at], p[at + 1]));
    [0, 3, 6].forEach((at, i) => points.set(corners[i], [p[at], p[at + 1]]));
    for (let i = 0; i < 3; i++) {
      const [from, to] = [corners[i], corners[(i + 1) % 3]];
      if (from === to || remove(to, from)) continue;
      if (!edges.has(from)) edges.set(from, []);
      edges.get(from).push(to);
    }
  }
  const path = new Path2D();
  for (const [start, ends] of edges) while (ends.length) traceRing(path, start, edges, points);
  return path;
}

function traceRing(path, start, edges, points) {
  path.moveTo(...points.get(start));
  for (let at = edges.get(start).pop(); at !== start; at = edges.get(at)?.pop()) {
    if (at === undefined) break; // triangles that only touch: the fill closes the ring
    path.lineTo(...points.get(at));
  }
  path.closePath();
}
