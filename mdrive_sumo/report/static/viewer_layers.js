// The layers over the scene: sight, shared objects, messages in flight, intentions, and what is being said.

const GLOW_TICKS = 8; // how long a message's way is seen after its arrival
const BUBBLE_TICKS = 60; // how long a word stays beside its speaker
const BUBBLE_CHARS = 56;
const BULGES = { cam: 0.05, cpm: 0.11, mcm: 0.17, text: 0.23 }; // of the distance: each type has its own way
const GROUP_PX = 30;

class Layers {
  constructor(replay, talk) {
    this.replay = replay;
    this.talk = talk;
    this.pose = { x: 0, y: 0, yaw: 0, speed: 0 };
    this.words = talk.transcript().filter((entry) => entry.spoken);
  }

  /** Which layers the recording has something for: name -> "" or why not. */
  missing() {
    const { talk, replay } = this;
    return {
      sight: replay.ids.length > 1 ? "" : "Nobody else is in this recording",
      shared: talk.has("cpm") ? "" : "No CPM was sent in this recording",
      messages: talk.sent.length ? "" : "No message was sent in this recording",
      intentions: talk.has("mcm") ? "" : "No MCM was sent in this recording",
      transcript: talk.texts.length || replay.notes.length ? "" : "Nothing was said in words or noted in this recording",
    };
  }

  /** Whether the CAV sees road user i. */
  sees(ego, i, tick) {
    const columns = this.replay.columns.sight;
    return this.replay.tables.sight[(ego * this.replay.ids.length + i) * columns + Math.floor(tick / this.replay.sight_every)] === 1;
  }

  begin(ctx, view, theme) {
    Object.assign(this, { ctx, view, theme, dpr: devicePixelRatio });
    ctx.setTransform(1, 0, 0, 1, 0, 0);
  }

  /** What lies below the road users. */
  drawBelow({ on, time, selected }) {
    const tick = Math.floor(time);
    if (on.has("intentions")) for (const group of this.talk.groupsAt(tick)) this.drawGroup(group, time);
    if (on.has("sight")) this.drawSight(selected, time);
    if (on.has("intentions")) for (let ego = 0; ego < this.replay.egos; ego++) this.drawTrajectories(ego, tick, selected);
  }

  /** What lies above them; tops: upper edge of each CAV's label [px]. */
  drawAbove({ on, time, selected, tops }) {
    const tick = Math.floor(time);
    if (on.has("shared")) this.talk.received(selected, tick).forEach((message, nth) => this.drawShared(message, nth));
    this.ctx.setTransform(1, 0, 0, 1, 0, 0);
    if (on.has("messages")) for (const flight of this.talk.latestFlights(time)) this.drawFlight(flight, time, selected);
    if (on.has("transcript")) this.drawWords(time, tops);
    this.ctx.globalAlpha = 1;
  }

  /** Screen coordinates of a station, undefined if it is not there. */
  place(station, time) {
    if (station >= this.replay.egos) {
      const place = this.talk.station_places[station];
      return place && this.view.toScreen(place[0] / 100, place[1] / 100);
    }
    return this.replay.sample(station, time, this.pose) ? this.view.toScreen(this.pose.x, this.pose.y) : undefined;
  }

  drawSight(ego, time) {
    const { ctx, replay, dpr } = this;
    const eye = this.place(ego, time);
    if (!eye) return;
    ctx.strokeStyle = colourOf(ego);
    ctx.lineWidth = dpr;
    ctx.globalAlpha = 0.45;
    ctx.beginPath();
    for (let i = 0; i < replay.ids.length; i++) {
      if (i === ego || !this.sees(ego, i, Math.floor(time)) || !replay.sample(i, time, this.pose)) continue;
      ctx.moveTo(...eye);
      ctx.lineTo(...this.view.toScreen(this.pose.x, this.pose.y));
    }
    ctx.stroke();
    ctx.globalAlpha = 0.35;
    ctx.setLineDash([2 * dpr, 5 * dpr]);
    ctx.beginPath();
    ctx.arc(...eye, replay.sight_range * this.view.scale, 0, 2 * Math.PI);
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
  }

  /** Outlines in the sender's colour, a little larger than what they are about; where senders agree, one in the other. */
  drawShared(message, nth) {
    const { ctx, view, theme, dpr } = this;
    const gap = Math.max(0.2, (2 * dpr) / view.scale) + (2.6 * nth * dpr) / view.scale;
    for (const { x, y, yaw, length, width, kind } of message.content.objects) {
      const [px, py] = view.toScreen(x, y);
      const [cos, sin] = [view.scale * Math.cos(yaw), view.scale * Math.sin(yaw)];
      ctx.setTransform(cos, -sin, -sin, -cos, px, py);
      ctx.beginPath();
      if (kind === "pedestrian") ctx.arc(0, 0, length / 2 + gap, 0, 2 * Math.PI);
      else ctx.roundRect(-length / 2 - gap, -width / 2 - gap, length + 2 * gap, width + 2 * gap, Math.min(gap + 0.3, 1));
      ctx.strokeStyle = theme.ground;
      ctx.lineWidth = (3.4 * dpr) / view.scale;
      ctx.stroke();
      ctx.strokeStyle = this.stationColour(message.from);
      ctx.lineWidth = (1.8 * dpr) / view.scale;
      ctx.stroke();
    }
  }

  stationColour(station) {
    return station < this.replay.egos ? colourOf(station) : this.theme.muted;
  }

  drawFlight({ message, to, tick, until, fate }, time, selected) {
    const lasts = Math.max(until - tick, 1);
    const share = (time - tick) / lasts;
    const after = time - tick - lasts;
    const mine = message.from === selected || to === selected;
    if (after > (mine ? GLOW_TICKS : 0)) return;
    const [a, b] = [this.place(message.from, time), this.place(to, time)];
    if (!a || !b) return;
    const { ctx, theme, dpr } = this;
    const arrives = fate === "delivered";
    const bulge = BULGES[message.type] ?? 0.2;
    const bend = [(a[0] + b[0]) / 2 + bulge * (b[1] - a[1]), (a[1] + b[1]) / 2 - bulge * (b[0] - a[0])];
    ctx.strokeStyle = ctx.fillStyle = theme[message.type] || theme.ink;
    if (mine) {
      ctx.globalAlpha = 0.55 * Math.min(1, 1 - after / GLOW_TICKS);
      ctx.lineWidth = (message.type === "cam" ? 1 : 1.6) * dpr;
      this.drawWay(a, bend, b, arrives ? 1 : 0.5);
    }
    if (!arrives && share >= 0.5) return mine ? this.drawLoss(between(a, bend, b, 0.5), after) : undefined;
    if (share > 1) return;
    ctx.globalAlpha = (mine ? 1 : 0.35) * (arrives ? 1 : 1 - 2 * share);
    const [px, py] = between(a, bend, b, share);
    const radius = (message.type === "cam" ? 2.2 : 3.6) * dpr;
    disc(ctx, px, py, radius + dpr, theme.halo);
    disc(ctx, px, py, radius, theme[message.type] || theme.ink);
  }

  drawWay(a, bend, b, share) {
    const { ctx } = this;
    ctx.beginPath();
    ctx.moveTo(...a);
    if (share === 1) ctx.quadraticCurveTo(...bend, ...b);
    else ctx.quadraticCurveTo((a[0] + bend[0]) / 2, (a[1] + bend[1]) / 2, ...between(a, bend, b, 0.5));
    ctx.stroke();
  }

  drawLoss([px, py], after) {
    const { ctx, theme, dpr } = this;
    const reach = 4 * dpr;
    ctx.globalAlpha = Math.min(1, 1 - after / GLOW_TICKS);
    ctx.strokeStyle = theme.bad;
    ctx.lineWidth = 2 * dpr;
    ctx.beginPath();
    ctx.moveTo(px - reach, py - reach);
    ctx.lineTo(px + reach, py + reach);
    ctx.moveTo(px + reach, py - reach);
    ctx.lineTo(px - reach, py + reach);
    ctx.stroke();
  }

  /** The contents of the newest MCM of the CAV of which the page carries the trajectories. */
  trajectories(ego, tick) {
    return this.talk.newest("mcm", ego, tick, (message) => message.content?.planned.length)?.content;
  }

  /** What the CAV last said that it plans (a band) and would rather do (dots). */
  drawTrajectories(ego, tick, selected) {
    const { ctx, dpr } = this;
    const mcm = this.replay.present(ego, tick) && this.trajectories(ego, tick);
    if (!mcm) return;
    const begin = this.place(ego, tick);
    ctx.strokeStyle = colourOf(ego);
    ctx.lineJoin = ctx.lineCap = "round";
    for (const [line, width, dash, alpha] of [[mcm.planned, 8, [], ego === selected ? 0.5 : 0.32], [mcm.desired, 2.2, [1, 6], 1]]) {
      ctx.globalAlpha = alpha;
      ctx.lineWidth = width * dpr;
      ctx.setLineDash(dash.map((length) => length * dpr));
      ctx.beginPath();
      ctx.moveTo(...begin);
      for (const [x, y] of line) ctx.lineTo(...this.view.toScreen(x, y));
      if (line.length) ctx.stroke();
    }
    ctx.setLineDash([]);
    ctx.lineCap = "butt";
    ctx.globalAlpha = 1;
  }

  /** One soft outline around all who take themselves to be in a conflict. */
  drawGroup(stations, time) {
    const { ctx, theme, dpr } = this;
    const hull = convexHull(stations.map((station) => this.place(station, time)).filter(Boolean));
    if (hull.length < 2) return;
    const turn = (from, to) => Math.atan2(to[1] - from[1], to[0] - from[0]) - Math.PI / 2;
    ctx.beginPath();
    hull.forEach((point, i) => {
      const [before, next] = [hull.at(i - 1), hull[(i + 1) % hull.length]];
      ctx.arc(...point, GROUP_PX * dpr, turn(before, point), turn(point, next));
    });
    ctx.closePath();
    ctx.fillStyle = ctx.strokeStyle = theme.warn;
    ctx.globalAlpha = 0.1;
    ctx.fill();
    ctx.globalAlpha = 0.8;
    ctx.lineWidth = 1.3 * dpr;
    ctx.setLineDash([6 * dpr, 4 * dpr]);
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
  }

  /** What the CAV last said that it means to do, in words; "" if it said nothing. */
  wordOf(ego, tick) {
    const mcm = this.talk.newest("mcm", ego, tick)?.content;
    if (!mcm) return "";
    const straight = mcm.direction === "ahead" || mcm.direction === "straight";
    return straight ? mcm.intention : `${mcm.intention}, ${mcm.direction}`;
  }

  /** What each has just said, over its label. */
  drawWords(time, tops) {
    const latest = new Map();
    for (let i = countAtOrBefore(this.words, time) - 1; i >= 0 && time - this.words[i].tick < BUBBLE_TICKS; i--) {
      if (!latest.has(this.words[i].who)) latest.set(this.words[i].who, this.words[i]);
    }
    for (const [who, { text, tick }] of latest) {
      const at = this.place(who, time);
      if (at) this.drawBubble(cut(text, BUBBLE_CHARS), at[0], tops.get(who) ?? at[1], this.stationColour(who), (BUBBLE_TICKS - (time - tick)) / 10);
    }
  }

  drawBubble(text, px, py, edge, strength) {
    const { ctx, dpr, theme } = this;
    ctx.globalAlpha = Math.min(1, strength);
    ctx.font = `${11.5 * dpr}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    ctx.textBaseline = "middle";
    const [left, top, width] = [px - 16 * dpr, py - 36 * dpr, ctx.measureText(text).width + 16 * dpr];
    ctx.beginPath();
    ctx.moveTo(left + 22 * dpr, top + 22 * dpr);
    ctx.lineTo(px, top + 29 * dpr);
    ctx.lineTo(left + 10 * dpr, top + 22 * dpr);
    ctx.roundRect(left, top, width, 23 * dpr, 8 * dpr);
    ctx.strokeStyle = edge;
    ctx.lineWidth = 2.4 * dpr;
    ctx.stroke();
    ctx.fillStyle = theme.card;
    ctx.fill();
    ctx.fillStyle = theme.ink;
    ctx.fillText(text, left + 8 * dpr, top + 12 * dpr);
    ctx.globalAlpha = 1;
  }
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

function cut(text, most) {
  return text.length <= most ? text : `${text.slice(0, most - 1)}…`;
}
