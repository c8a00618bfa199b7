// The road from above on a 2-D canvas: the small map, the view "top", and the only view of a browser without WebGL.

const AHEAD_SHARE = 0.68; // the own car stands so far down the canvas: what lies ahead matters more
const LEAST_PX = 5; // every road user stays visible from afar
const SMALL_SPAN_M = 90; // height of the small map
const SPAN_M = 70; // height of the large one at standstill; at speed more
const SPAN_S = 3;

class TopView {
  constructor(canvas) {
    this.canvas = canvas;
    this.ctx = canvas.getContext("2d", { alpha: false });
    this.zoomFactor = 1;
    this.restyle();
  }

  restyle() {
    this.theme = readTheme();
  }

  resize(width, height) {
    const ratio = devicePixelRatio;
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) [this.canvas.width, this.canvas.height] = size;
  }

  zoom(factor) {
    this.zoomFactor = Math.min(8, Math.max(0.15, this.zoomFactor * factor));
  }

  /** `picture`: {centre: {x, y, yaw, speed}, own, users, map, overlays, isSmall}; the direction of travel is up. */
  draw(picture) {
    const { ctx, canvas, theme } = this;
    const { centre, isSmall } = picture;
    const span = (isSmall ? SMALL_SPAN_M : SPAN_M + SPAN_S * Math.max(0, centre.speed)) * this.zoomFactor;
    this.scale = Math.max(canvas.height, canvas.width * 0.8) / span;
    const [cos, sin] = [Math.cos(centre.yaw - Math.PI / 2) * this.scale, Math.sin(centre.yaw - Math.PI / 2) * this.scale];
    const [px, py] = [canvas.width / 2, canvas.height * AHEAD_SHARE];
    // Screen = rotate(-(yaw - 90 degrees)) and flip of y, so that the heading points up.
    this.base = [cos, sin, sin, -cos, px - cos * centre.x - sin * centre.y, py - sin * centre.x + cos * centre.y];
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    ctx.fillStyle = theme.ground;
    ctx.fillRect(0, 0, canvas.width, canvas.height);
    ctx.setTransform(...this.base);
    ctx.lineJoin = ctx.lineCap = "round";
    const reach = span * Math.max(1, canvas.width / canvas.height);
    picture.map?.draw(ctx, theme, this.scale, centre, reach);
    this.drawRoute(picture.overlays.route, Math.max(0.5, (4 * devicePixelRatio) / this.scale));
    picture.map?.drawSignals(ctx, theme, picture.signals, this.scale, centre, reach);
    this.drawOverlays(picture.overlays);
    for (const user of picture.users) this.drawRoadUser(user, false);
    if (picture.own) this.drawRoadUser(picture.own, true);
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    const { words = [], warnings = [] } = picture.overlays;
    for (const { x, y } of warnings) this.drawWarning(...this.project(x, y), (isSmall ? 7 : 12) * devicePixelRatio);
    if (!isSmall) this.drawWords([...warnings, ...words]);
  }

  drawRoute(points, width) {
    if (!points?.length) return;
    const { ctx, theme } = this;
    ctx.strokeStyle = theme.focus;
    ctx.globalAlpha = 0.4;
    this.line(points, width);
    ctx.globalAlpha = 1;
    const [x, y] = points.at(-1);
    ctx.fillStyle = theme.focus;
    this.disc(x, y, 2.2 * width);
    ctx.fillStyle = theme.halo;
    this.disc(x, y, 1.1 * width);
  }

  line(points, width, dash = []) {
    const { ctx } = this;
    ctx.beginPath();
    for (const [x, y] of points) ctx.lineTo(x, y);
    ctx.lineWidth = width;
    ctx.setLineDash(dash);
    ctx.stroke();
    ctx.setLineDash([]);
  }

  disc(x, y, radius) {
    this.ctx.beginPath();
    this.ctx.arc(x, y, radius, 0, 2 * Math.PI);
    this.ctx.fill();
  }

  /** Intentions as lines, shared objects as outlines, ghosts as pale cars. */
  drawOverlays({ shared = [], intentions = [], ghosts = [] }) {
    const { ctx, theme } = this;
    const pixel = devicePixelRatio / this.scale;
    for (const { path, colour } of intentions) {
      ctx.strokeStyle = colour ?? theme.mcm;
      this.line(path, 2.5 * pixel, [6 * pixel, 5 * pixel]);
    }
    for (const { x, y, yaw, length, width, colour } of shared) {
      ctx.strokeStyle = colour ?? theme.cpm;
      this.box(x, y, yaw, Math.max(length, LEAST_PX * pixel) + 0.5, Math.max(width, LEAST_PX * pixel) + 0.5);
      ctx.lineWidth = 2 * pixel;
      ctx.stroke();
      ctx.setTransform(...this.base);
    }
    for (const ghost of ghosts) {
      ctx.strokeStyle = ctx.fillStyle = ghost.colour;
      ctx.globalAlpha = 0.5;
      this.line(ghost.path, 1.5 * pixel);
      this.box(ghost.x, ghost.y, ghost.yaw, ghost.size[0], ghost.size[1]);
      ctx.fill();
      ctx.globalAlpha = 1;
      ctx.setTransform(...this.base);
    }
  }

  box(x, y, yaw, length, width) {
    const { ctx } = this;
    ctx.translate(x, y);
    ctx.rotate(yaw);
    ctx.beginPath();
    ctx.roundRect(-length / 2, -width / 2, length, width, Math.min(0.5, width / 4));
  }

  drawRoadUser(user, isOwn) {
    const { ctx, theme } = this;
    const pixel = devicePixelRatio / this.scale;
    const [length, width] = [Math.max(user.length, LEAST_PX * pixel), Math.max(user.width, LEAST_PX * pixel)];
    ctx.globalAlpha = user.ended ? 0.45 : 1;
    this.box(user.x, user.y, user.yaw, length, width);
    ctx.fillStyle = user.colour ?? (isOwn ? theme.focus : theme[user.kind] ?? theme.vehicle);
    ctx.fill();
    ctx.lineWidth = (isOwn ? 2.6 : user.colour ? 1.6 : 1) * pixel;
    ctx.strokeStyle = isOwn || user.colour ? theme.halo : theme["vehicle-edge"];
    ctx.stroke();
    if (user.kind !== "pedestrian" && user.kind !== "static") this.drawDetails(length, width, user);
    ctx.globalAlpha = 1;
    ctx.setTransform(...this.base);
  }

  /** The windscreen, which tells the front, and the lamps. */
  drawDetails(length, width, { lamps = 0, braking }) {
    const { ctx, theme } = this;
    ctx.fillStyle = theme["vehicle-edge"];
    ctx.globalAlpha *= 0.85;
    ctx.fillRect(0.12 * length, -0.36 * width, 0.14 * length, 0.72 * width);
    ctx.globalAlpha = 1;
    ctx.fillStyle = theme.bad;
    if (braking || lamps & 1) for (const side of [-1, 1]) ctx.fillRect(-0.5 * length, side * 0.36 * width - 0.2, 0.35, 0.4);
    ctx.fillStyle = theme.warn;
    if (lamps & 6 && performance.now() % 800 < 450) {
      const side = lamps & 2 ? 1 : -1;
      for (const end of [-0.44, 0.44]) ctx.fillRect(end * length - 0.25, side * 0.42 * width - 0.25, 0.5, 0.5);
    }
  }

  /** A place as pixels of the canvas. */
  project(x, y) {
    const { base } = this;
    return [base[0] * x + base[2] * y + base[4], base[1] * x + base[3] * y + base[5]];
  }

  /** The sign of a danger: a triangle with an exclamation mark, both in colours that every ground shows. */
  drawWarning(px, py, size) {
    const { ctx, theme } = this;
    ctx.beginPath();
    for (const [right, down] of [[0, -1], [1, 0.75], [-1, 0.75]]) ctx.lineTo(px + right * size, py + down * size);
    ctx.closePath();
    ctx.fillStyle = theme.bad;
    ctx.fill();
    ctx.strokeStyle = ctx.fillStyle = theme.halo;
    ctx.lineWidth = size / 5;
    ctx.stroke();
    ctx.fillRect(px - size / 10, py - size / 2, size / 5, size / 1.6);
    ctx.fillRect(px - size / 10, py + size / 3, size / 5, size / 5);
  }

  /** The last words and warnings of others, beside them. */
  drawWords(said) {
    const { ctx, theme } = this;
    const ratio = devicePixelRatio;
    ctx.font = `${13 * ratio}px system-ui, sans-serif`;
    ctx.textBaseline = "middle";
    for (const { x, y, text: words } of said) {
      const text = shortened(words);
      const [px, py] = this.project(x, y);
      const width = ctx.measureText(text).width + 16 * ratio;
      ctx.beginPath();
      ctx.roundRect(px - width / 2, py - 44 * ratio, width, 24 * ratio, 8 * ratio);
      ctx.fillStyle = theme.card;
      ctx.fill();
      ctx.strokeStyle = theme.text;
      ctx.lineWidth = 1.5 * ratio;
      ctx.stroke();
      ctx.fillStyle = theme.ink;
      ctx.fillText(text, px - width / 2 + 8 * ratio, py - 32 * ratio);
    }
  }
}
