// The layers over the scene: sight, shared objects, messages in flight, intentions, and what is being said.

const GLOW_TICKS = 8; // how long a message's way is seen after its arrival
const BUBBLE_TICKS = 60; // how long a word stays beside its speaker
const BUBBLE_LINES = 3;
const BUBBLE_LINE_CHARS = 30;
const BULGES = { cam: 0.05, cpm: 0.11, mcm: 0.17, text: 0.23 }; // of the distance: each type has its own way
const DASHES = { NLOSv: [9, 6], NLOSb: [2.5, 4] }; // of a link that a vehicle, a building obstructs [px]
const GROUP_PX = 30;
const RANK_AHEAD_M = 6; // from the middle of a car: a car's length before its front
const AGREE_M = 1; // objects as near as this, told of by several, are drawn one around the other
const MOST_RINGS = 3;

class Layers {
  constructor(replay, talk) {
    this.replay = replay;
    this.talk = talk;
    this.pose = { x: 0, y: 0, yaw: 0, speed: 0 };
    this.transcript = talk.transcript();
    this.words = this.transcript.filter((entry) => entry.spoken);
  }

  /** Which layers the recording has something for: name -> "" or why not. */
  missing() {
    const { talk, replay } = this;
    return {
      sight: replay.ids.length > 1 ? "" : "This recording has no other road user",
      shared: talk.has("cpm") ? "" : "No CPM was sent in this recording",
      messages: talk.sent.length ? "" : "No message was sent in this recording",
      links: talk.air.size ? "" : "No message was transmitted in this recording",
      intentions: talk.has("mcm") ? "" : "No MCM was sent in this recording",
      transcript: this.transcript.length ? "" : "Nothing was said in words, negotiated or noted in this recording",
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
    if (on.has("intentions")) this.talk.groupsAt(tick).forEach((group, _, all) => this.drawGroup(group, time, 0.1 / all.length));
    if (on.has("sight")) this.drawSight(selected, time);
    if (on.has("intentions")) for (let ego = 0; ego < this.replay.egos; ego++) this.drawTrajectories(ego, tick, selected);
    if (on.has("intentions")) for (const [station, rank] of this.talk.ranksAt(tick)) this.drawRank(station, rank, time);
  }

  /** What lies on them, below all labels. */
  drawOver({ on, time, selected }) {
    if (!on.has("shared")) return;
    const drawn = [];
    for (const message of this.talk.received(selected, Math.floor(time))) this.drawShared(message, drawn);
    this.ctx.setTransform(1, 0, 0, 1, 0, 0);
  }

  /** What lies above everything; tops: upper edge of each CAV's label [px]. */
  drawAbove({ on, time, selected, tops, types }) {
    if (on.has("links")) for (const link of this.talk.linksAt(Math.floor(time))) this.drawLink(link, time, selected);
    if (on.has("messages")) for (const flight of this.talk.latestFlights(time, types)) this.drawFlight(flight, time, selected);
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
  drawShared(message, drawn) {
    const { ctx, view, theme, dpr } = this;
    for (const { x, y, yaw, length, width, kind } of message.content.objects) {
      const rings = drawn.filter(([ox, oy]) => Math.hypot(ox - x, oy - y) < AGREE_M).length;
      drawn.push([x, y]);
      if (rings >= MOST_RINGS) continue;
      const gap = Math.max(0.2, (2 * dpr) / view.scale) + (2.4 * rings * dpr) / view.scale;
      const [px, py] = view.toScreen(x, y);
      const [cos, sin] = [view.scale * Math.cos(yaw), view.scale * Math.sin(yaw)];
      ctx.setTransform(cos, -sin, -sin, -cos, px, py);
      ctx.beginPath();
      if (kind === "pedestrian") ctx.arc(0, 0, length / 2 + gap, 0, 2 * Math.PI);
      else ctx.roundRect(-length / 2 - gap, -width / 2 - gap, length + 2 * gap, width + 2 * gap, Math.min(gap + 0.3, 1));
      ctx.strokeStyle = theme.ground;
      ctx.lineWidth = (2.8 * dpr) / view.scale;
      ctx.stroke();
      ctx.strokeStyle = this.stationColour(message.from);
      ctx.lineWidth = (1.5 * dpr) / view.scale;
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
      ctx.globalAlpha = 0.45 * Math.min(1, 1 - after / GLOW_TICKS);
      ctx.lineWidth = (message.type === "cam" ? 1 : 1.4) * dpr;
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

  /** The half of a link before its receiver: as much of it as was received in one colour, the rest in the other. */
  drawLink({ from, to, share, name }, time, selected) {
    const [a, b] = [this.place(from, time), this.place(to, time)];
    if (!a || !b) return;
    const { ctx, theme, dpr } = this;
    const mine = from === selected || to === selected;
    const point = (part) => [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])];
    const begin = from < this.replay.egos ? 0.5 : 0; // a road-side unit receives nothing: the whole line is of its messages
    const turn = 1 - share * (1 - begin);
    ctx.lineWidth = (mine ? 2.6 : 1.4) * dpr;
    ctx.globalAlpha = mine ? 0.9 : 0.4;
    ctx.setLineDash((DASHES[name] ?? []).map((length) => length * dpr));
    for (const [first, last, colour] of [[begin, turn, theme.bad], [turn, 1, theme.good]]) {
      ctx.strokeStyle = colour;
      ctx.beginPath();
      ctx.moveTo(...point(first));
      ctx.lineTo(...point(last));
      if (last > first) ctx.stroke();
    }
    ctx.setLineDash([]);
    if (mine) this.drawShare(point(begin + 0.36 * (1 - begin)), `${name} ${Math.round(100 * share)} %`.trim());
    ctx.globalAlpha = 1;
  }

  drawShare([px, py], text) {
    const { ctx, theme, dpr } = this;
    ctx.font = `600 ${10.5 * dpr}px system-ui, sans-serif`;
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    const half = ctx.measureText(text).width / 2 + 4 * dpr;
    ctx.globalAlpha = 0.85;
    ctx.fillStyle = theme.card;
    ctx.beginPath();
    ctx.roundRect(px - half, py - 8 * dpr, 2 * half, 16 * dpr, 4 * dpr);
    ctx.fill();
    ctx.globalAlpha = 1;
    ctx.fillStyle = theme.ink;
    ctx.fillText(text, px, py);
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

  /** One soft outline around all CAVs that consider themselves in a conflict. */
  drawGroup(stations, time, strength) {
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
    ctx.globalAlpha = strength;
    ctx.fill();
    ctx.globalAlpha = 0.8;
    ctx.lineWidth = 1.3 * dpr;
    ctx.setLineDash([6 * dpr, 4 * dpr]);
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
  }

  /** The CAV's place in the agreed order, as a number on the road ahead of it. */
  drawRank(station, rank, time) {
    if (!this.replay.sample(station, time, this.pose)) return;
    const { ctx, theme, dpr, pose } = this;
    const [px, py] = this.view.toScreen(pose.x + RANK_AHEAD_M * Math.cos(pose.yaw), pose.y + RANK_AHEAD_M * Math.sin(pose.yaw));
    disc(ctx, px, py, 11 * dpr, this.stationColour(station));
    disc(ctx, px, py, 9 * dpr, theme.card);
    ctx.font = `700 ${12 * dpr}px system-ui, sans-serif`;
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    ctx.fillStyle = theme.ink;
    ctx.fillText(String(rank), px, py);
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
      if (!latest.has(this.words[i].station)) latest.set(this.words[i].station, this.words[i]);
    }
    const taken = [];
    for (const [station, { text, tick }] of latest) {
      const at = this.place(station, time);
      if (at) this.drawBubble(wrapped(text), at[0], tops.get(station) ?? at[1], this.stationColour(station), (BUBBLE_TICKS - (time - tick)) / 10, taken);
    }
  }

  /** Above the label that begins at py, and above the bubbles there are already. */
  drawBubble(lines, px, py, edge, strength, taken) {
    const { ctx, dpr, theme } = this;
    ctx.font = `${11.5 * dpr}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    ctx.textBaseline = "middle";
    const width = Math.max(...lines.map((line) => ctx.measureText(line).width)) + 16 * dpr;
    const height = (15 * lines.length + 8) * dpr;
    const left = px - 16 * dpr;
    let top = py - height - 13 * dpr;
    const clash = ([l, t, w, h]) => left < l + w && l < left + width && top < t + h + 4 * dpr && t < top + height + 4 * dpr;
    while (taken.some(clash)) top -= 8 * dpr;
    taken.push([left, top, width, height]);
    ctx.globalAlpha = Math.min(1, strength);
    ctx.beginPath();
    ctx.moveTo(left + 22 * dpr, top + height - dpr);
    ctx.lineTo(px, top + height + 7 * dpr);
    ctx.lineTo(left + 10 * dpr, top + height - dpr);
    ctx.roundRect(left, top, width, height, 8 * dpr);
    ctx.strokeStyle = edge;
    ctx.lineWidth = 2.4 * dpr;
    ctx.stroke();
    ctx.fillStyle = theme.card;
    ctx.fill();
    ctx.fillStyle = theme.ink;
    lines.forEach((line, i) => ctx.fillText(line, left + 8 * dpr, top + (12 + 15 * i) * dpr));
    ctx.globalAlpha = 1;
  }
}

/** The beginning of a text in a few short lines. */
function wrapped(text) {
  const lines = [""];
  for (const word of text.split(/\s+/)) {
    if (lines.at(-1) && lines.at(-1).length + word.length >= BUBBLE_LINE_CHARS) lines.push("");
    lines[lines.length - 1] += (lines.at(-1) && " ") + word.slice(0, BUBBLE_LINE_CHARS);
  }
  if (lines.length > BUBBLE_LINES) lines[BUBBLE_LINES - 1] += " …";
  return lines.slice(0, BUBBLE_LINES);
}
