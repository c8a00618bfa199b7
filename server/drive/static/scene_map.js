// The road for the top view: outlines of the scene's flat triangles, in squares, so that only what is near is drawn.

const SQUARE_M = 64;
const ROOF_M = 4; // flat triangles higher than this are roofs
const LAYER_COLOURS = { 5: "footway", 4: "apron", 3: "road", 2: "footway", 1: "line" }; // layers of the ground in `static_scene`, from below
const SIGNAL_COLOURS = { r: "bad", u: "bad", y: "warn", g: "good", G: "good", s: "warn" };

class SceneMap {
  constructor(scene) {
    this.squares = new Map();
    this.roofs = [];
    for (const part of scene.parts) this.addPart(part);
    for (const square of this.squares.values()) for (const [layer, triangles] of square.triangles) square.paths.set(layer, toPath(findRings(triangles)));
    this.addBuildings();
    this.lamps = scene.lamps.names.map((name, i) => {
      const cut = name.lastIndexOf(":");
      return { tls: name.slice(0, cut), index: Number(name.slice(cut + 1)), place: scene.lamps.place[i], turn: scene.lamps.turn[i] };
    });
  }

  addPart({ layer, positions: p }) {
    for (let at = 0; at < p.length; at += 9) {
      const triangle = p.subarray(at, at + 9);
      const isRoof = p[at + 2] > ROOF_M && p[at + 2] === p[at + 5] && p[at + 2] === p[at + 8];
      if (layer > 0) this.squareAt((p[at] + p[at + 3] + p[at + 6]) / 3, (p[at + 1] + p[at + 4] + p[at + 7]) / 3).add(layer, triangle);
      else if (isRoof) this.roofs.push(triangle);
    }
  }

  squareAt(x, y) {
    const [i, j] = [Math.floor(x / SQUARE_M), Math.floor(y / SQUARE_M)];
    const key = `${i} ${j}`;
    if (!this.squares.has(key)) this.squares.set(key, new MapSquare((i + 0.5) * SQUARE_M, (j + 0.5) * SQUARE_M));
    return this.squares.get(key);
  }

  /** Each building belongs to the square of its first corner, whole: its edge is drawn. */
  addBuildings() {
    for (const ring of findRings(this.roofs)) {
      const { paths } = this.squareAt(...ring[0]);
      if (!paths.has("building")) paths.set("building", new Path2D());
      paths.get("building").addPath(toPath([ring]));
    }
    this.roofs = undefined;
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

class MapSquare {
  constructor(x, y) {
    Object.assign(this, { x, y, triangles: new Map(), paths: new Map() });
  }

  add(layer, triangle) {
    if (!this.triangles.has(layer)) this.triangles.set(layer, []);
    this.triangles.get(layer).push(triangle);
  }
}

/** The outlines [[x, y], ...] of triangles that share edges: an edge that two of them have, in both directions, is inside. */
function findRings(triangles) {
  const edges = new Map(); // beginning -> [ends], as "x y" in cm
  const points = new Map();
  const remove = (from, to) => {
    const ends = edges.get(from);
    const i = ends ? ends.indexOf(to) : -1;
    if (i >= 0) ends.splice(i, 1);
    return i >= 0;
  };
  for (const p of triangles) {
    const corners = [0, 3, 6].map((at) => `${Math.round(p[at] * 100)} ${Math.round(p[at + 1] * 100)}`);
    corners.forEach((corner, i) => points.set(corner, [p[3 * i], p[3 * i + 1]]));
    for (let i = 0; i < 3; i++) {
      const [from, to] = [corners[i], corners[(i + 1) % 3]];
      if (from === to || remove(to, from)) continue;
      if (!edges.has(from)) edges.set(from, []);
      edges.get(from).push(to);
    }
  }
  const rings = [];
  for (const [start, ends] of edges) while (ends.length) rings.push(traceRing(start, edges).map((corner) => points.get(corner)));
  return rings;
}

/** Corners from one back to it; a gap, where triangles only touch, is closed by a straight line. */
function traceRing(start, edges) {
  const ring = [start];
  for (let at = edges.get(start).pop(); at !== start && at !== undefined; at = edges.get(at)?.pop()) ring.push(at);
  return ring;
}

function toPath(rings) {
  const path = new Path2D();
  for (const ring of rings) {
    path.moveTo(...ring[0]);
    for (const point of ring.slice(1)) path.lineTo(...point);
    path.closePath();
  }
  return path;
}
