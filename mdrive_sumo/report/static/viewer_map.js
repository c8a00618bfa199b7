// The view (world to screen) and the road map, drawn once to a canvas that is larger than the screen.

const MIN_SCALE = 0.05; // px/m
const MAX_SCALE = 150;
const MARGIN = 0.3; // of the screen, on every side of the drawn map
const SETTLE_MS = 140; // after the last change of scale the map is drawn anew

/** CAV_COLOURS: from `palette.py`, in front of the scripts. */
function colourOf(ego) {
  return CAV_COLOURS[ego % CAV_COLOURS.length];
}

/** Colours of the theme: the same custom properties as the style sheet. */
function readTheme() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ground", "road", "apron", "line", "footway", "building", "building-edge", "vehicle", "vehicle-edge", "cyclist",
    "pedestrian", "static", "ink", "muted", "halo", "good", "warn", "bad", "grid", "card", "cam", "cpm", "mcm",
    "text"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

/** x, y [m] at the middle of the stage, scale [device px per m]. Origins are whole pixels, so that nothing shimmers. */
class View {
  constructor() {
    Object.assign(this, { x: 0, y: 0, scale: 4, middleX: 0, middleY: 0 });
  }
  get left() {
    return Math.round(this.middleX - this.x * this.scale);
  }
  get top() {
    return Math.round(this.middleY + this.y * this.scale);
  }
  toScreen(x, y) {
    return [this.left + x * this.scale, this.top - y * this.scale];
  }
  toWorld(px, py) {
    return [(px - this.left) / this.scale, (this.top - py) / this.scale];
  }
  /** Changes the scale so that the world point under (px, py) stays there. */
  zoom(factor, px = this.middleX, py = this.middleY) {
    const [x, y] = [this.x + (px - this.middleX) / this.scale, this.y - (py - this.middleY) / this.scale];
    this.scale = Math.min(MAX_SCALE, Math.max(MIN_SCALE, this.scale * factor));
    this.x = x - (px - this.middleX) / this.scale;
    this.y = y + (py - this.middleY) / this.scale;
  }
  pan(dx, dy) {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }
  fit([x0, y0, x1, y1], width, height) {
    this.x = (x0 + x1) / 2;
    this.y = (y0 + y1) / 2;
    this.scale = this.scaleFor([x0, y0, x1, y1], width, height);
  }
  /** The scale at which the bounds fit into this many px. */
  scaleFor([x0, y0, x1, y1], width, height) {
    return Math.max(MIN_SCALE, Math.min(30, width / Math.max(x1 - x0, 30), height / Math.max(y1 - y0, 30)));
  }
}

function pairs(flatCm) {
  return Array.from({ length: flatCm.length / 2 }, (_, i) => [flatCm[2 * i] / 100, flatCm[2 * i + 1] / 100]);
}

function addLine(path, points) {
  points.forEach(([x, y], i) => (i ? path.lineTo(x, y) : path.moveTo(x, y)));
}

/** The static picture: what to draw (paths in metres), and the canvas that holds it for one scale. */
class RoadLayer {
  constructor(replay) {
    this.canvas = document.createElement("canvas");
    this.changedAt = -Infinity;
    const { pavements, aprons, asphalt, stripes, buildings, solid, dashed, stops } = replay.map;
    this.areas = Object.entries({ footway: pavements, apron: aprons, road: asphalt, line: stripes }).map(([name, shapes]) => [name, polygons(shapes)]);
    this.buildings = polygons(buildings);
    this.solid = lines(solid);
    this.dashed = lines(dashed);
    this.stops = stops;
    this.routes = replay.routes.map((flat) => ({ path: lines([flat]), ends: [pairs(flat)[0], pairs(flat).at(-1)] }));
  }

  invalidate() {
    this.scale = 0;
  }

  /** Puts the map on the screen; true if a sharper drawing is still to come. */
  blit(ctx, view, theme, selected, now) {
    const { width, height } = ctx.canvas;
    const ratio = view.scale / (this.scale || Infinity);
    let x = view.left - this.left * ratio;
    let y = view.top - this.top * ratio;
    const covers = x <= 0 && y <= 0 && x + this.canvas.width * ratio >= width && y + this.canvas.height * ratio >= height;
    if (ratio !== 1 && this.seenScale !== view.scale) this.changedAt = now;
    this.seenScale = view.scale;
    const zooming = ratio !== 1 && now - this.changedAt < SETTLE_MS;
    if (!ratio || (!zooming && (ratio !== 1 || !covers))) {
      this.draw(view, theme, selected, width, height);
      x = view.left - this.left;
      y = view.top - this.top;
    }
    const scale = view.scale / this.scale;
    if (!covers) {
      ctx.fillStyle = theme.ground;
      ctx.fillRect(0, 0, width, height);
    }
    ctx.drawImage(this.canvas, x, y, this.canvas.width * scale, this.canvas.height * scale);
    return scale !== 1;
  }

  draw(view, theme, selected, width, height) {
    const margin = [Math.round(width * MARGIN), Math.round(height * MARGIN)];
    const size = [width + 2 * margin[0], height + 2 * margin[1]];
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) [this.canvas.width, this.canvas.height] = size;
    Object.assign(this, { scale: view.scale, left: view.left + margin[0], top: view.top + margin[1] });
    const ctx = this.canvas.getContext("2d", { alpha: false });
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    ctx.fillStyle = theme.ground;
    ctx.fillRect(0, 0, ...size);
    ctx.setTransform(this.scale, 0, 0, -this.scale, this.left, this.top);
    ctx.lineJoin = "round";
    this.drawRoads(ctx, theme, 1 / this.scale);
    this.drawBuildings(ctx, theme, 1 / this.scale);
    for (const stop of this.stops) drawStop(ctx, theme, stop, 1 / this.scale);
    this.routes.forEach((route, ego) => drawRoute(ctx, theme, route, colourOf(ego), ego === selected, devicePixelRatio / this.scale));
  }

  drawRoads(ctx, theme, pixel) {
    for (const [name, path] of this.areas) {
      ctx.fillStyle = theme[name];
      ctx.fill(path);
    }
    if (this.scale < 1.2) return; // from afar lines would only grey the road
    ctx.strokeStyle = theme.line;
    const thin = Math.max(0.13, 0.9 * pixel);
    stroke(ctx, this.solid, thin);
    ctx.setLineDash([3, 4.5]);
    stroke(ctx, this.dashed, thin);
    ctx.setLineDash([]);
  }

  drawBuildings(ctx, theme, pixel) {
    ctx.fillStyle = theme.building;
    ctx.strokeStyle = theme["building-edge"];
    ctx.fill(this.buildings);
    stroke(ctx, this.buildings, pixel);
  }
}

function stroke(ctx, path, width) {
  ctx.lineWidth = width;
  ctx.stroke(path);
}

function lines(flats) {
  const path = new Path2D();
  for (const flat of flats) addLine(path, pairs(flat));
  return path;
}

/** Of shapes with their rings: outline and holes. */
function polygons(shapes) {
  const path = new Path2D();
  for (const flat of shapes.flat()) {
    addLine(path, pairs(flat));
    path.closePath();
  }
  return path;
}

/** A stop line across the lane, and the octagon beside the outermost lane. */
function drawStop(ctx, theme, [line, sign], pixel) {
  ctx.strokeStyle = theme.line;
  stroke(ctx, lines([line]), 0.4);
  if (!sign) return;
  const [[x, y]] = pairs(sign);
  const radius = Math.max(0.8, 4 * devicePixelRatio * pixel);
  ctx.beginPath();
  for (let i = 0; i < 8; i++) {
    const angle = ((i + 0.5) * Math.PI) / 4;
    ctx.lineTo(x + radius * Math.cos(angle), y + radius * Math.sin(angle));
  }
  ctx.closePath();
  ctx.fillStyle = theme.bad;
  ctx.fill();
  ctx.strokeStyle = "#fff";
  ctx.lineWidth = 0.18 * radius;
  ctx.stroke();
}

/** A thin line, a ring at the start, a ringed disc at the goal. */
function drawRoute(ctx, theme, { path, ends }, colour, selected, pixel) {
  ctx.strokeStyle = ctx.fillStyle = colour;
  ctx.globalAlpha = selected ? 0.9 : 0.55;
  stroke(ctx, path, (selected ? 2.4 : 1.6) * pixel);
  ctx.globalAlpha = 1;
  ends.forEach(([x, y], goal) => {
    disc(ctx, x, y, (goal ? 7 : 4.5) * pixel, theme.halo);
    ctx.lineWidth = 2 * pixel;
    ctx.stroke();
    if (goal) disc(ctx, x, y, 3.2 * pixel, colour);
  });
}

function disc(ctx, x, y, radius, colour) {
  ctx.beginPath();
  ctx.arc(x, y, radius, 0, 2 * Math.PI);
  ctx.fillStyle = colour;
  ctx.fill();
}

/** A point of the quadratic curve. */
function between(a, bend, b, share) {
  const [u, v] = [1 - share, share];
  return [0, 1].map((k) => u * u * a[k] + 2 * u * v * bend[k] + v * v * b[k]);
}

/** Counter-clockwise in a frame with y up, so clockwise on the screen; Andrew's monotone chain. */
function convexHull(points) {
  const sorted = points.toSorted((p, q) => p[0] - q[0] || p[1] - q[1]);
  if (sorted.length < 3) return sorted;
  const cross = (o, p, q) => (p[0] - o[0]) * (q[1] - o[1]) - (p[1] - o[1]) * (q[0] - o[0]);
  const half = (list) => {
    const chain = [];
    for (const point of list) {
      while (chain.length > 1 && cross(chain.at(-2), chain.at(-1), point) <= 0) chain.pop();
      chain.push(point);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.toReversed())];
}
