// What moves: road users, plans, lights, contacts. Drawn anew for every frame.

const FLASH_TICKS = 20; // how long a contact glows after it ended
const MARK_TICKS = 60; // how long an event stays on the map
const FADED = 0.22; // opacity of what the selected CAV does not see, in the layer "sight"
const LIGHTS = { r: "bad", u: "bad", y: "warn", g: "good", G: "good", s: "warn" };

class Scene {
  constructor(replay) {
    this.replay = replay;
    this.pose = { x: 0, y: 0, yaw: 0, speed: 0 };
    this.labels = new Labels(replay);
    this.heads = replay.map.heads.map(([at, yaw, width, lights]) => ({ x: at[0] / 100, y: at[1] / 100, yaw, width, lights }));
  }

  draw(ctx, view, theme, { time, selected, labels, layers, lists, on }) {
    Object.assign(this, { ctx, view, theme, dpr: devicePixelRatio });
    const tick = Math.floor(time);
    const replay = this.replay;
    for (const head of this.heads) this.drawHead(head, tick);
    layers.begin(ctx, view, theme);
    layers.drawBelow({ on, time, selected });
    const shown = [];
    for (let i = replay.ids.length - 1; i >= 0; i--) { // CAVs last, on top
      if (!replay.sample(i, time, this.pose)) continue;
      const [px, py] = view.toScreen(this.pose.x, this.pose.y);
      if (px < -200 || py < -200 || px > ctx.canvas.width + 200 || py > ctx.canvas.height + 200) continue;
      this.hidden = on.has("sight") && i !== selected && replay.present(selected, tick) && !layers.sees(selected, i, tick);
      this.drawRoadUser(i, px, py, i === selected);
      shown.push({ i, px, py, ...this.halfSize(i) });
    }
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    const told = (ego) => on.has("intentions") && layers.trajectories(ego, tick); // drawn below: the plan would be twice there
    for (let ego = 0; ego < replay.egos; ego++) if (replay.present(ego, tick) && !told(ego)) this.drawPlan(ego, tick);
    layers.drawOver({ on, time, selected });
    for (const contact of replay.contactsWithin(time, FLASH_TICKS)) this.drawFlash(contact, time);
    this.labels.begin(ctx, theme);
    for (const mark of replay.marks) if (tick >= mark.tick && tick - mark.tick < MARK_TICKS) this.drawMark(mark, time);
    const words = replay.ids.slice(0, replay.egos).map((_, ego) => (on.has("intentions") ? layers.wordOf(ego, tick) : ""));
    const tops = this.labels.draw(shown, { labels, words, scale: view.scale });
    layers.drawAbove({ on, time, selected, tops, types: lists.types });
  }

  drawHead({ x, y, yaw, width, lights }, tick) {
    const { ctx, view, theme } = this;
    this.place(x, y, yaw);
    const thick = Math.max(0.35, (2.5 * this.dpr) / view.scale);
    const share = (width - 0.4) / lights.length;
    lights.forEach((light, i) => {
      ctx.fillStyle = theme[LIGHTS[this.replay.signalAt(light, tick)]] ?? theme.muted;
      ctx.fillRect(-thick - 0.2, width / 2 - 0.2 - (i + 1) * share + 0.05, thick, share - 0.1);
    });
  }

  /** From here on, coordinates are metres ahead and to the left of the pose. */
  place(x, y, yaw, enlarged = 1) {
    const [px, py] = this.view.toScreen(x, y);
    const scale = this.view.scale * enlarged;
    const [cos, sin] = [scale * Math.cos(yaw), scale * Math.sin(yaw)];
    this.ctx.setTransform(cos, -sin, -sin, -cos, px, py);
  }

  drawRoadUser(i, px, py, selected) {
    const { ctx, view, theme, replay } = this;
    const [length, width] = replay.sizes[i];
    const isEgo = i < replay.egos;
    const least = (isEgo ? 11 : 5) * this.dpr; // px: every road user stays visible from afar
    const enlarged = Math.max(1, least / (Math.max(length, width) * view.scale));
    const pixel = this.dpr / (view.scale * enlarged);
    const kind = replay.kinds[i];
    this.place(this.pose.x, this.pose.y, this.pose.yaw, enlarged);
    if (selected) this.box(length + 10 * pixel, width + 10 * pixel, 7 * pixel, colourOf(i), 0.3);
    const colour = isEgo ? colourOf(i) : theme[kind];
    ctx.globalAlpha = this.hidden ? FADED : 1;
    if (kind === "pedestrian") disc(ctx, 0, 0, Math.max(length, width) / 2, theme.pedestrian);
    else this.box(length, width, Math.min(0.5, width / 4), colour, 1);
    ctx.globalAlpha = 1;
    if (this.hidden) return this.dashedEdge(colour, pixel);
    ctx.lineWidth = (isEgo ? 1.4 : 1) * pixel;
    ctx.strokeStyle = isEgo ? theme.halo : theme["vehicle-edge"];
    ctx.stroke();
    if (kind === "pedestrian") this.tickAhead(length, pixel);
    else if (kind === "static") this.crossed(length, width, pixel);
    else if (6 * pixel < width) this.heading(length, width, isEgo);
  }

  /** A prop. */
  crossed(length, width, pixel) {
    const { ctx } = this;
    ctx.beginPath();
    for (const side of [1, -1]) {
      ctx.moveTo(-length / 2, (-side * width) / 2);
      ctx.lineTo(length / 2, (side * width) / 2);
    }
    ctx.lineWidth = pixel;
    ctx.stroke();
  }

  /** Outline of what the selected CAV does not see. */
  dashedEdge(colour, pixel) {
    const { ctx } = this;
    ctx.strokeStyle = colour;
    ctx.lineWidth = 1.1 * pixel;
    ctx.setLineDash([2.5 * pixel, 2.5 * pixel]);
    ctx.stroke();
    ctx.setLineDash([]);
  }

  /** Of the box on the screen [px], turned as it is. */
  halfSize(i) {
    const [length, width] = [this.replay.sizes[i][0], Math.max(this.replay.sizes[i][1], 1.2)];
    const [cos, sin] = [Math.abs(Math.cos(this.pose.yaw)), Math.abs(Math.sin(this.pose.yaw))];
    const half = this.view.scale / 2;
    return { halfWidth: half * (length * cos + width * sin), halfHeight: half * (length * sin + width * cos) };
  }

  box(length, width, radius, colour, alpha) {
    const ctx = this.ctx;
    ctx.beginPath();
    ctx.roundRect(-length / 2, -width / 2, length, width, radius);
    ctx.fillStyle = colour;
    ctx.globalAlpha = alpha * (this.hidden ? FADED : 1);
    ctx.fill();
    ctx.globalAlpha = 1;
  }

  tickAhead(length, pixel) {
    const ctx = this.ctx;
    ctx.beginPath();
    ctx.moveTo(0, 0);
    ctx.lineTo(length, 0);
    ctx.strokeStyle = this.theme.pedestrian;
    ctx.lineWidth = 1.5 * pixel;
    ctx.stroke();
  }

  /** An arrow head in the front half of the box. */
  heading(length, width, isEgo) {
    const ctx = this.ctx;
    ctx.beginPath();
    ctx.moveTo(0.42 * length, 0);
    ctx.lineTo(0.16 * length, 0.32 * width);
    ctx.lineTo(0.16 * length, -0.32 * width);
    ctx.closePath();
    ctx.fillStyle = isEgo ? "#fff" : this.theme["vehicle-edge"];
    ctx.fill();
  }

  drawPlan(ego, tick) {
    const { ctx, view, theme, dpr } = this;
    for (const [x, y] of this.replay.planAt(ego, tick)) {
      const [px, py] = view.toScreen(x, y);
      disc(ctx, px, py, 3.4 * dpr, theme.halo);
      disc(ctx, px, py, 2.3 * dpr, colourOf(ego));
    }
  }

  drawFlash({ ego, other, age }, time) {
    const { ctx, theme, dpr, replay } = this;
    const here = this.positionOf(ego, time - age);
    const there = replay.columnOf.has(other) ? this.positionOf(replay.columnOf.get(other), time - age) : here;
    const [px, py] = [(here[0] + there[0]) / 2, (here[1] + there[1]) / 2];
    const share = age / FLASH_TICKS;
    ctx.strokeStyle = ctx.fillStyle = theme.bad;
    ctx.lineWidth = 3 * dpr;
    ctx.beginPath();
    ctx.arc(px, py, (12 + 26 * share) * dpr, 0, 2 * Math.PI);
    ctx.globalAlpha = 0.25 * (1 - share);
    ctx.fill();
    ctx.globalAlpha = 1 - share;
    ctx.stroke();
    ctx.globalAlpha = 1;
  }

  positionOf(i, time) {
    const pose = { x: NaN, y: NaN };
    this.replay.sample(i, Math.floor(time), pose);
    return this.view.toScreen(pose.x, pose.y);
  }

  /** A pin with the text of the event, fading at its end. */
  drawMark(mark, time) {
    const { ctx, view, theme, dpr } = this;
    const [px, py] = view.toScreen(mark.x, mark.y);
    ctx.globalAlpha = Math.min(1, (MARK_TICKS - (time - mark.tick)) / 15);
    const colour = theme[gradeOf(mark.kind)];
    disc(ctx, px, py, 6 * dpr, theme.halo);
    disc(ctx, px, py, 4 * dpr, colour);
    this.labels.pin(mark.kind, px, py + 18 * dpr, colour);
    ctx.globalAlpha = 1;
  }
}
