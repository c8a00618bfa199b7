// Names of road users and pins of events: none covers another one.

const NEAR_SCALE = 6; // px/m (of the style sheet) from which moving road users have labels in "near"
const MOVED_M = 1; // a road user that never gets this far from where it appeared stands: parked, or a prop
const LABEL_HEIGHT = 17; // px
const STEP_PX = 6;
const MOST_STEPS = 60; // away from the others; so many labels in one place cover each other

class Labels {
  constructor(replay) {
    this.replay = replay;
    this.sides = new Map(); // road user -> side of its label, kept while there is room
    this.moves = replay.ids.map((_, i) => i < replay.egos || movesFrom(replay, i));
    this.rects = []; // of the last drawing [px]: left, top, right, bottom
  }

  begin(ctx, theme) {
    Object.assign(this, { ctx, theme, dpr: devicePixelRatio, rects: [] });
  }

  isFree(rect) {
    return this.rects.every((other) => areApart(rect, other));
  }

  /** A pill below a point, below the pins that are there already. */
  pin(text, px, py, colour) {
    const rect = this.stack(px, py, this.measure(text, true), STEP_PX * this.dpr);
    this.rects.push(rect);
    this.pill(text, rect, colour);
  }

  /** CAVs get a place in any case, others where there is room. Returns the upper edges of the CAVs' labels [px]. */
  draw(shown, { labels, words, scale }) {
    const { replay, dpr } = this;
    const near = scale >= NEAR_SCALE * dpr;
    const tops = new Map();
    this.bodies = shown.map(({ px, py, halfWidth, halfHeight }) => [px - halfWidth, py - halfHeight, px + halfWidth, py + halfHeight]);
    for (const { i, px, py, halfWidth, halfHeight } of shown.toReversed()) {
      const isEgo = i < replay.egos;
      if (labels === "none" && !words[i]) continue; // an intention is shown even without labels
      if (!isEgo && labels !== "all" && !(near && this.moves[i])) continue;
      const text = `${shortened(replay.ids[i])} · ${isEgo ? words[i] || "CAV" : replay.kinds[i]}`;
      const width = this.measure(text, isEgo);
      const rect = isEgo ? this.stack(px, py - halfHeight - 12 * this.dpr, width, -STEP_PX * this.dpr) : this.beside(i, px, py, halfWidth, halfHeight, width);
      if (!rect) continue;
      this.rects.push(rect);
      if (isEgo) tops.set(i, rect[1]);
      if (isEgo) this.pill(text, rect, colourOf(i));
      else this.plain(text, rect);
    }
    return tops;
  }

  measure(text, bold) {
    this.ctx.font = bold ? `600 ${11 * this.dpr}px system-ui, sans-serif` : `${10.5 * this.dpr}px system-ui, sans-serif`;
    return this.ctx.measureText(text).width + (bold ? 12 : 4) * this.dpr;
  }

  around(px, py, width) {
    const half = (LABEL_HEIGHT / 2) * this.dpr;
    return [px - width / 2, py - half, px + width / 2, py + half];
  }

  /** The first free place from a point on, up or down. */
  stack(px, py, width, step) {
    let rect = this.around(px, py, width);
    for (let k = 1; k <= MOST_STEPS && !this.isFree(rect); k++) rect = this.around(px, py + k * step, width);
    return rect;
  }

  /** Above, below, right or left of a box, undefined if another label or road user is at each. */
  beside(i, px, py, halfWidth, halfHeight, width) {
    const [up, aside] = [halfHeight + 10 * this.dpr, halfWidth + width / 2 + 3 * this.dpr];
    const places = [[0, -up], [0, up], [aside, 0], [-aside, 0]].map(([x, y]) => this.around(px + x, py + y, width));
    const last = this.sides.get(i) ?? 0;
    const side = [last, 0, 1, 2, 3].find((each) => this.isFree(places[each]) && this.bodies.every((body) => areApart(body, places[each])));
    if (side !== undefined) this.sides.set(i, side);
    return places[side];
  }

  plain(text, [left, top, right, bottom]) {
    const { ctx, dpr, theme } = this;
    this.align(false);
    ctx.lineJoin = "round";
    ctx.lineWidth = 2 * dpr;
    ctx.strokeStyle = theme.ground;
    ctx.strokeText(text, (left + right) / 2, (top + bottom) / 2);
    ctx.fillStyle = theme.muted;
    ctx.fillText(text, (left + right) / 2, (top + bottom) / 2);
  }

  pill(text, [left, top, right, bottom], colour) {
    const { ctx, dpr } = this;
    this.align(true);
    ctx.beginPath();
    ctx.roundRect(left, top, right - left, bottom - top, (bottom - top) / 2);
    ctx.fillStyle = colour;
    ctx.fill();
    ctx.fillStyle = "#fff";
    ctx.fillText(text, (left + right) / 2, (top + bottom) / 2 + 0.5 * dpr);
  }

  align(bold) {
    this.measure("", bold);
    this.ctx.textAlign = "center";
    this.ctx.textBaseline = "middle";
  }
}

function areApart([left, top, right, bottom], [l, t, r, b]) {
  return left >= r || l >= right || top >= b || t >= bottom;
}

/** Whether a road user ever gets away from where it appeared. */
function movesFrom(replay, i) {
  const { motion, valid } = replay.tables;
  const [x, y] = [4 * i, 4 * i + 1].map((row) => row * replay.ticks);
  let first = -1;
  for (let tick = 0; tick < replay.ticks; tick++) {
    if (!valid[i * replay.ticks + tick]) continue;
    if (first < 0) first = tick;
    if (Math.hypot(motion[x + tick] - motion[x + first], motion[y + tick] - motion[y + first]) > MOVED_M * 1000) return true;
  }
  return false;
}

function shortened(text) {
  return text.length <= 32 ? text : `${text.slice(0, 31)}…`;
}
