// The page of a network: lanes with their ids, and clicks that become the steps of a route. `window.page` is for tests.

const $ = (id) => document.getElementById(id);
const REACH_M = 6; // a click takes a lane within this distance
const NAMED_SCALE = 2.5; // px/m from which on names of lanes are legible
const ARROW_M = 25; // between arrows along a lane
const WHEEL_ZOOM = 0.0016; // per px of the wheel

class Lane {
  constructor([id, flat, junction, width, speed]) {
    Object.assign(this, { id, junction: Boolean(junction), width, speed, points: pairs(flat) });
    this.stations = [0];
    for (let i = 1; i < this.points.length; i++) {
      const [[ax, ay], [bx, by]] = [this.points[i - 1], this.points[i]];
      this.stations.push(this.stations[i - 1] + Math.hypot(bx - ax, by - ay));
    }
    this.length = this.stations.at(-1);
  }

  /** Distance to a point and arc length of the nearest place [m]. */
  project(x, y) {
    let nearest = { distance: Infinity, s: 0 };
    for (let i = 1; i < this.points.length; i++) {
      const [[ax, ay], [bx, by]] = [this.points[i - 1], this.points[i]];
      const [dx, dy] = [bx - ax, by - ay];
      const share = Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1)));
      const distance = Math.hypot(x - ax - share * dx, y - ay - share * dy);
      if (distance < nearest.distance) nearest = { distance, s: this.stations[i - 1] + share * Math.hypot(dx, dy) };
    }
    return nearest;
  }

  /** Point and direction at an arc length. */
  at(s) {
    let i = this.stations.findIndex((station) => station >= s);
    i = i < 1 ? (i ? this.points.length - 1 : 1) : i;
    const [[ax, ay], [bx, by]] = [this.points[i - 1], this.points[i]];
    const share = (s - this.stations[i - 1]) / (this.stations[i] - this.stations[i - 1] || 1);
    return [ax + share * (bx - ax), ay + share * (by - ay), Math.atan2(by - ay, bx - ax)];
  }
}

class Page {
  constructor(data) {
    Object.assign(this, { origin: data.origin, bounds: data.bounds, steps: [], names: true });
    this.lanes = data.lanes.map((lane) => new Lane(lane));
    this.view = new View();
    this.roads = new RoadLayer({ map: data.map, routes: [] });
    this.ctx = $("map").getContext("2d", { alpha: false });
    this.theme = readTheme();
    for (const lane of this.lanes) if (!lane.junction) $("lanes").append(Object.assign(document.createElement("option"), { value: lane.id }));
    this.fit();
  }

  fit() {
    this.resize();
    this.view.fit(this.bounds, this.ctx.canvas.width, this.ctx.canvas.height);
    this.draw();
  }

  resize() {
    const canvas = this.ctx.canvas;
    [canvas.width, canvas.height] = [innerWidth * devicePixelRatio, innerHeight * devicePixelRatio];
    [this.view.middleX, this.view.middleY] = [canvas.width / 2, canvas.height / 2];
  }

  /** The lane nearest to a point; roads go before the many lanes inside a junction. */
  findLane(x, y) {
    const near = this.lanes.map((lane) => ({ lane, ...lane.project(x, y) })).filter((one) => one.distance <= REACH_M);
    near.sort((a, b) => Number(a.lane.junction) - Number(b.lane.junction) || a.distance - b.distance);
    return near[0];
  }

  add(x, y, asPoint) {
    const found = asPoint ? undefined : this.findLane(x, y);
    const text = found ? `${found.lane.id} ${found.s.toFixed(1)}` : `${this.worldX(x)},${this.worldY(y)}`;
    const place = found ? found.lane.at(found.s) : [x, y];
    this.steps.push({ text, x: place[0], y: place[1], point: `(${this.worldX(x)}, ${this.worldY(y)})`, lane: found?.lane });
    this.showSteps();
  }

  worldX(x) {
    return (x + this.origin[0]).toFixed(1);
  }

  worldY(y) {
    return (y + this.origin[1]).toFixed(1);
  }

  /** A lane between start and goal leads the way without a number: with one it says where a lane change begins. */
  route() {
    const last = this.steps.length - 1;
    return this.steps.map(({ text, lane }, i) => (lane && i > 0 && i < last ? lane.id : text)).join(" > ");
  }

  showSteps() {
    $("steps").replaceChildren(...this.steps.map(({ text }) => Object.assign(document.createElement("li"), { textContent: text })));
    $("no-steps").hidden = this.steps.length > 0;
    $("route").value = this.route();
    $("points").value = this.steps.map(({ point }) => point).join(", ");
    this.draw();
  }

  draw() {
    this.roads.invalidate();
    this.roads.blit(this.ctx, this.view, this.theme, -1, performance.now() - 1e6);
    const named = this.names && this.view.scale >= NAMED_SCALE * devicePixelRatio;
    for (const lane of this.lanes) if (!lane.junction) this.drawLane(lane, named);
    this.drawSteps();
  }

  drawLane(lane, named) {
    const { ctx, view } = this;
    ctx.fillStyle = this.theme.muted;
    for (let s = Math.min(ARROW_M, lane.length) / 2; s < lane.length; s += ARROW_M) {
      const [x, y, yaw] = lane.at(s);
      const [px, py] = view.toScreen(x, y);
      if (px < 0 || py < 0 || px > ctx.canvas.width || py > ctx.canvas.height) continue;
      ctx.save();
      ctx.translate(px, py);
      ctx.rotate(-yaw);
      const size = Math.max(3 * devicePixelRatio, 0.6 * view.scale);
      ctx.beginPath();
      ctx.moveTo(size, 0);
      ctx.lineTo(-size, -size * 0.6);
      ctx.lineTo(-size, size * 0.6);
      ctx.fill();
      ctx.restore();
    }
    if (named) this.drawName(lane);
  }

  drawName(lane) {
    const { ctx, view } = this;
    const [x, y, yaw] = lane.at(lane.length / 2);
    const [px, py] = view.toScreen(x, y);
    ctx.save();
    ctx.translate(px, py);
    ctx.rotate(Math.cos(yaw) < 0 ? Math.PI - yaw : -yaw);
    ctx.font = `${11 * devicePixelRatio}px ui-monospace, monospace`;
    [ctx.textAlign, ctx.textBaseline, ctx.lineWidth] = ["center", "middle", 3 * devicePixelRatio];
    [ctx.strokeStyle, ctx.fillStyle] = [this.theme.halo, this.theme.ink];
    ctx.strokeText(lane.id, 0, 0);
    ctx.fillText(lane.id, 0, 0);
    ctx.restore();
  }

  drawSteps() {
    const { ctx, view } = this;
    ctx.strokeStyle = colourOf(0);
    ctx.lineWidth = 2 * devicePixelRatio;
    ctx.beginPath();
    addLine(ctx, this.steps.map(({ x, y }) => view.toScreen(x, y)));
    ctx.setLineDash([6 * devicePixelRatio, 5 * devicePixelRatio]);
    ctx.stroke();
    ctx.setLineDash([]);
    for (const { x, y } of this.steps) disc(ctx, ...view.toScreen(x, y), 5 * devicePixelRatio, colourOf(0));
  }

  showPointer(x, y) {
    const found = this.findLane(x, y);
    const lane = found ? `${found.lane.id}  ${found.s.toFixed(1)} of ${found.lane.length.toFixed(1)} m, ${Math.round(found.lane.speed * 3.6)} km/h\n` : "";
    $("pointer").textContent = `${lane}x ${this.worldX(x)}  y ${this.worldY(y)} m`;
  }

  showLane(id) {
    const lane = this.lanes.find((one) => one.id === id);
    if (!lane) return;
    [this.view.x, this.view.y] = lane.at(lane.length / 2);
    this.view.scale = Math.max(this.view.scale, 4 * devicePixelRatio);
    this.draw();
  }
}

function listen(page) {
  const map = $("map");
  const world = (event) => page.view.toWorld(event.clientX * devicePixelRatio, event.clientY * devicePixelRatio);
  let before;
  let travelled = 0;
  map.addEventListener("pointerdown", (event) => {
    map.setPointerCapture(event.pointerId);
    [before, travelled] = [[event.clientX, event.clientY], 0];
  });
  map.addEventListener("pointermove", (event) => {
    page.showPointer(...world(event));
    if (!before) return;
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    travelled += Math.hypot(dx, dy);
    before = [event.clientX, event.clientY];
    if (travelled <= 4) return;
    map.classList.add("dragging");
    page.view.pan(dx * devicePixelRatio, dy * devicePixelRatio);
    page.draw();
  });
  map.addEventListener("pointerup", (event) => {
    if (before && travelled <= 4) page.add(...world(event), event.shiftKey);
    before = undefined;
    map.classList.remove("dragging");
  });
  map.addEventListener("wheel", (event) => {
    event.preventDefault();
    page.view.zoom(Math.exp(-event.deltaY * WHEEL_ZOOM), event.clientX * devicePixelRatio, event.clientY * devicePixelRatio);
    page.draw();
  }, { passive: false });
  const copy = (id) => {
    $(id).select();
    document.execCommand("copy"); // the clipboard's own interface is closed to pages of files
  };
  $("copy-route").addEventListener("click", () => copy("route"));
  $("copy-points").addEventListener("click", () => copy("points"));
  $("undo").addEventListener("click", () => (page.steps.pop(), page.showSteps()));
  $("clear").addEventListener("click", () => (page.steps.splice(0), page.showSteps()));
  $("find").addEventListener("change", (event) => page.showLane(event.target.value));
  addEventListener("resize", () => (page.resize(), page.draw()));
  addEventListener("keydown", (event) => {
    if (event.target.closest("input, textarea")) return;
    if (event.key === "0") page.fit();
    if (event.key.toLowerCase() !== "l") return;
    page.names = !page.names;
    page.draw();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    page.theme = readTheme();
    page.draw();
  });
}

window.page = new Page(JSON.parse($("data").textContent));
listen(window.page);
