// The timeline: an axis, one line a CAV with its events, and the strips of the selected CAV. Drawn once, not per frame.

const AXIS_PX = 18;
const STRIP_PX = 38;
const STRIP_GAP_PX = 8;
const STEPS_S = [0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600];

class Timeline {
  constructor(replay, seek) {
    this.replay = replay;
    this.track = document.getElementById("track");
    this.chart = document.getElementById("chart");
    this.cursor = document.getElementById("cursor");
    this.rowPx = replay.egos <= 6 ? 15 : Math.max(4, 90 / replay.egos);
    this.stripsTop = AXIS_PX + replay.egos * this.rowPx + STRIP_GAP_PX;
    this.track.setAttribute("aria-valuemax", replay.seconds(replay.lastTick));
    this.addGutter();
    for (const mark of replay.marks) this.addMark(mark, seek);
    this.listen(seek);
  }

  addGutter() {
    const { replay } = this;
    const gutter = document.getElementById("gutter");
    if (replay.egos <= 6) {
      for (let ego = 0; ego < replay.egos; ego++) this.gutterLabel(gutter, replay.ids[ego], this.rowTop(ego), this.rowPx);
    }
    this.values = ["Speed", "Pedals", "Steer"].map((name, i) => {
      const label = this.gutterLabel(gutter, name, this.stripTop(i), STRIP_PX);
      label.className = "strip";
      const value = document.createElement("b");
      label.append(value);
      return value;
    });
  }

  gutterLabel(gutter, text, top, height) {
    const label = document.createElement("div");
    label.append(text);
    Object.assign(label.style, { top: `${top}px`, height: `${height}px` });
    gutter.append(label);
    return label;
  }

  rowTop(ego) {
    return AXIS_PX + ego * this.rowPx;
  }

  stripTop(i) {
    return this.stripsTop + i * (STRIP_PX + STRIP_GAP_PX);
  }

  addMark(mark, seek) {
    const button = document.createElement("button");
    button.className = `mark ${gradeOf(mark.kind)}`;
    button.tabIndex = -1; // the list of events is the way for the keyboard
    button.style.left = `${(100 * mark.tick) / Math.max(this.replay.lastTick, 1)}%`;
    button.style.top = `${this.rowTop(Math.max(mark.ego, 0)) + this.rowPx / 2}px`;
    const text = describe(this.replay, mark);
    button.setAttribute("aria-label", text);
    showTip(button, text);
    button.addEventListener("click", () => seek(mark.tick));
    document.getElementById("marks").append(button);
  }

  /** Pressing and dragging anywhere on the track scrubs. */
  listen(seek) {
    const scrub = (event) => {
      const { left, width } = this.track.getBoundingClientRect();
      seek(Math.round(((event.clientX - left) / width) * this.replay.lastTick));
    };
    this.track.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || event.target.closest(".mark")) return;
      this.track.setPointerCapture(event.pointerId);
      scrub(event);
    });
    this.track.addEventListener("pointermove", (event) => {
      if (this.track.hasPointerCapture(event.pointerId)) scrub(event);
    });
  }

  /** Moves the cursor; the values beside the strips are those of the whole tick. */
  show(time, selected) {
    const { replay } = this;
    const tick = Math.floor(time);
    this.cursor.style.transform = `translateX(${(time / Math.max(replay.lastTick, 1)) * this.width}px)`;
    if (tick === this.tick && selected === this.selected) return;
    Object.assign(this, { tick, selected });
    this.track.setAttribute("aria-valuenow", replay.seconds(tick).toFixed(2));
    this.track.setAttribute("aria-valuetext", `${replay.seconds(tick).toFixed(2)} seconds`);
    const here = replay.present(selected, tick);
    const pedals = replay.control(selected, 0, tick) - replay.control(selected, 1, tick);
    const texts = [`${replay.speed(selected, tick).toFixed(1)} m/s`, share(pedals), share(replay.control(selected, 2, tick))];
    this.values.forEach((value, i) => (value.textContent = here ? texts[i] : "–"));
  }

  /** Draws axis, lines and strips for the current width and selection. */
  draw(theme, selected) {
    const ratio = devicePixelRatio;
    const compact = document.body.classList.contains("compact");
    this.height = compact ? this.stripsTop : this.stripsTop + 3 * (STRIP_PX + STRIP_GAP_PX) - 2;
    this.track.style.height = `${this.height}px`;
    this.width = this.track.clientWidth;
    this.chart.width = this.width * ratio;
    this.chart.height = this.height * ratio;
    const ctx = this.chart.getContext("2d");
    ctx.scale(ratio, ratio);
    this.tick = -1;
    this.drawAxis(ctx, theme);
    for (let ego = 0; ego < this.replay.egos; ego++) this.drawRow(ctx, ego, ego === selected);
    if (compact) return;
    this.drawSpeed(ctx, theme, selected);
    this.drawPedals(ctx, theme, selected);
    this.drawSteer(ctx, theme, selected);
  }

  xOf(tick) {
    return (tick / Math.max(this.replay.lastTick, 1)) * this.width;
  }

  drawAxis(ctx, theme) {
    const seconds = this.replay.seconds(this.replay.lastTick);
    const step = STEPS_S.find((s) => (s / seconds) * this.width >= 56) ?? 1200;
    ctx.fillStyle = theme.muted;
    ctx.strokeStyle = theme.grid;
    ctx.lineWidth = 1;
    ctx.font = "10px system-ui, sans-serif";
    ctx.beginPath();
    for (let s = 0; s <= seconds; s += step) {
      const x = Math.round(this.xOf(s / this.replay.tick_s)) + 0.5;
      ctx.moveTo(x, AXIS_PX - 4);
      ctx.lineTo(x, this.height);
      ctx.textAlign = s === 0 ? "left" : x > this.width - 16 ? "right" : "center";
      ctx.fillText(`${s} s`, s === 0 ? 0 : Math.min(x, this.width), 10);
    }
    ctx.stroke();
  }

  drawRow(ctx, ego, selected) {
    const y = this.rowTop(ego) + this.rowPx / 2;
    ctx.strokeStyle = colourOf(ego);
    ctx.lineCap = "round";
    ctx.lineWidth = selected ? 4 : 2.5;
    ctx.globalAlpha = selected ? 1 : 0.65;
    this.polyline(ctx, ego, () => y);
    ctx.globalAlpha = 1;
  }

  /** A line through heightOf(tick) [px] wherever the CAV is in the world. */
  polyline(ctx, ego, heightOf) {
    let down = false;
    ctx.beginPath();
    for (let tick = 0; tick < this.replay.ticks; tick++) {
      const here = this.replay.present(ego, tick);
      if (here && down) ctx.lineTo(this.xOf(tick), heightOf(tick));
      if (here && !down) ctx.moveTo(this.xOf(tick), heightOf(tick));
      down = here;
    }
    ctx.stroke();
  }

  /** The ground of strip i with its zero line; its top [px]. */
  frame(ctx, theme, i, zero) {
    const y = this.stripTop(i);
    ctx.fillStyle = theme.grid;
    ctx.globalAlpha = 0.35;
    ctx.fillRect(0, y, this.width, STRIP_PX);
    ctx.globalAlpha = 1;
    ctx.fillRect(0, Math.round(y + zero * STRIP_PX) - (zero === 1 ? 1 : 0), this.width, 1);
    ctx.lineWidth = 1.5;
    ctx.lineCap = "butt";
    return y;
  }

  /** What up and down mean, over the curve. */
  caption(ctx, theme, i, top, bottom) {
    ctx.font = "9px system-ui, sans-serif";
    ctx.textAlign = "right";
    ctx.lineWidth = 3;
    ctx.strokeStyle = theme.card;
    ctx.fillStyle = theme.muted;
    for (const [text, y] of [[top, 9], [bottom, STRIP_PX - 3]]) {
      ctx.strokeText(text, this.width - 3, this.stripTop(i) + y);
      ctx.fillText(text, this.width - 3, this.stripTop(i) + y);
    }
  }

  drawSpeed(ctx, theme, ego) {
    const { replay } = this;
    const speeds = Array.from({ length: replay.ticks }, (_, tick) => replay.speed(ego, tick));
    const top = Math.max(5, Math.ceil(speeds.reduce((a, b) => Math.max(a, b), 0) / 5) * 5);
    const y = this.frame(ctx, theme, 0, 1);
    ctx.strokeStyle = colourOf(ego);
    this.polyline(ctx, ego, (tick) => y + STRIP_PX * (1 - Math.max(speeds[tick], 0) / top));
    this.caption(ctx, theme, 0, `${top} m/s`, "0");
  }

  /** Throttle as an area upwards, brake as one downwards. */
  drawPedals(ctx, theme, ego) {
    const { replay } = this;
    const middle = this.frame(ctx, theme, 1, 0.5) + STRIP_PX / 2;
    for (const [which, colour, sign] of [[0, theme.good, -1], [1, theme.bad, 1]]) {
      ctx.fillStyle = colour;
      ctx.beginPath();
      ctx.moveTo(0, middle);
      for (let tick = 0; tick < replay.ticks; tick++) {
        ctx.lineTo(this.xOf(tick), middle + (sign * replay.control(ego, which, tick) * STRIP_PX) / 2);
      }
      ctx.lineTo(this.width, middle);
      ctx.fill();
    }
    this.caption(ctx, theme, 1, "throttle 100 %", "brake 100 %");
  }

  drawSteer(ctx, theme, ego) {
    const middle = this.frame(ctx, theme, 2, 0.5) + STRIP_PX / 2;
    ctx.strokeStyle = colourOf(ego);
    this.polyline(ctx, ego, (tick) => middle - (this.replay.control(ego, 2, tick) * STRIP_PX) / 2);
    this.caption(ctx, theme, 2, "left 100 % of the lock", "right 100 %");
  }
}

/** Of the whole pedal or lock. */
function share(value) {
  return `${value < 0 ? "−" : "+"}${Math.round(100 * Math.abs(value))} %`;
}

function describe(replay, mark) {
  const words = [`${replay.seconds(mark.tick).toFixed(2)} s`, mark.name, mark.kind].filter(Boolean).join(" · ");
  return mark.text ? `${words} · ${mark.text}` : words;
}

/** Shows the text above the element while the pointer is over it. */
function showTip(element, text) {
  const tip = document.getElementById("tip");
  element.addEventListener("pointerenter", () => {
    tip.textContent = text;
    tip.hidden = false;
    const { left, top, width } = element.getBoundingClientRect();
    const half = tip.offsetWidth / 2;
    tip.style.left = `${Math.min(Math.max(left + width / 2 - half, 8), innerWidth - 2 * half - 8)}px`;
    tip.style.top = `${top - tip.offsetHeight - 8}px`;
  });
  element.addEventListener("pointerleave", () => (tip.hidden = true));
}
