// Two replays in step: this page keeps the time, plays, and passes the view of one map on to the other.

const LONGEST_FRAME_MS = 100; // after a pause of the browser: go on from here, do not jump
const RATES = [0.25, 0.5, 1, 2, 4, 8];
const $ = (id) => document.getElementById(id);
const frames = [...document.querySelectorAll("iframe")];
const tickOf = (id) => Number($(id)?.dataset.tick ?? NaN);
const LINES = { part: "parted", apart: "separated" }; // what a button jumps to, and its line over the marks

class Player {
  constructor() {
    Object.assign(this, { time: 0, playing: false, rate: 1, lastTick: 1, tickSeconds: 0.05, ready: [] });
    this.space = { isOn: false, mode: "chase" };
  }

  send(order, frame) {
    for (const one of frame ? [frame] : frames) one.contentWindow.postMessage(order, "*");
  }

  play() {
    if (this.time >= this.lastTick) this.time = 0;
    Object.assign(this, { playing: true, before: undefined });
    this.changed();
  }

  pause() {
    Object.assign(this, { playing: false, time: Math.floor(this.time) });
    this.changed();
  }

  seek(tick) {
    this.time = Math.min(Math.max(Math.round(tick), 0), this.lastTick);
    this.changed();
  }

  step(ticks) {
    this.playing = false;
    this.seek(Math.floor(this.time) + ticks);
  }

  /** To the tick of a button in the heading, if there is one. */
  jump(id) {
    if (!Number.isNaN(tickOf(id))) this.step(tickOf(id) - Math.floor(this.time));
  }

  /** To the next event of either run, or to the one before. */
  jumpToEvent(direction) {
    const now = Math.floor(this.time);
    const ticks = this.ready.flatMap((one) => one.marks.map((mark) => mark.tick)).filter((tick) => direction * (tick - now) > 0);
    if (ticks.length) this.seek(direction * Math.min(...ticks.map((tick) => direction * tick)));
  }

  setRate(rate) {
    if (!RATES.includes(rate)) return;
    this.rate = rate;
    $("rate").value = String(rate);
    this.changed();
  }

  fit() {
    const bounds = this.ready.map((one) => one.bounds);
    const side = (i, pick) => pick(...bounds.map((one) => one[i]));
    this.send({ kind: "fit", bounds: [side(0, Math.min), side(1, Math.min), side(2, Math.max), side(3, Math.max)] });
  }

  /** 3-D view or map in both. */
  showSpace(isOn, mode) {
    this.space = { isOn, mode };
    this.send({ kind: "space", isOn, mode });
  }

  changed() {
    this.pending ??= requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.pending = undefined;
    if (this.playing) this.advance(now);
    this.send({ kind: "show", time: this.time, playing: this.playing, rate: this.rate });
    this.showState();
    if (this.playing) this.changed();
  }

  advance(now) {
    const elapsed = Math.min(now - (this.before ?? now), LONGEST_FRAME_MS);
    this.before = now;
    this.time += (elapsed * this.rate) / (1000 * this.tickSeconds);
    if (this.time >= this.lastTick) Object.assign(this, { time: this.lastTick, playing: false });
  }

  showState() {
    const tick = Math.floor(this.time);
    const seconds = (tick * this.tickSeconds).toFixed(2);
    $("time").textContent = seconds;
    $("tick").textContent = `tick ${tick} / ${this.lastTick}`;
    $("slider").value = tick;
    $("slider").setAttribute("aria-valuetext", `${seconds} seconds`);
    document.body.classList.toggle("playing", this.playing);
    $("play").setAttribute("aria-label", this.playing ? "Pause (Space)" : "Play (Space)");
    clearTimeout(this.linkTimer);
    if (!this.playing) this.linkTimer = setTimeout(() => history.replaceState(null, "", `#t=${seconds}`), 250);
  }

  readLink() {
    const seconds = Number(new URLSearchParams(location.hash.slice(1)).get("t"));
    if (seconds > 0) this.seek(seconds / this.tickSeconds);
  }

  /** Both replays are there: marks, length, and the same part of the map in both. */
  begin() {
    this.lastTick = Math.max(...this.ready.map((one) => one.lastTick));
    this.tickSeconds = this.ready[0].tickSeconds;
    $("slider").max = this.lastTick;
    $("duration").textContent = ` / ${(this.lastTick * this.tickSeconds).toFixed(2)} s`;
    this.ready.forEach(({ marks }, side) => marks.forEach((mark) => this.addMark(mark, side)));
    for (const [id, line] of Object.entries(LINES)) {
      $(line).hidden = Number.isNaN(tickOf(id));
      $(line).style.left = `calc(22px + ${tickOf(id) / this.lastTick || 0} * (100% - 30px))`;
    }
    this.fit();
    this.readLink();
    this.changed();
  }

  addMark({ tick, name, text, kind, grade }, side) {
    const button = document.createElement("button");
    button.className = `mark ${["good", "bad"].includes(grade) ? grade : ""}`;
    button.style.left = `${(100 * tick) / this.lastTick}%`;
    button.title = `${(tick * this.tickSeconds).toFixed(2)} s · ${name} · ${text || kind}`;
    button.setAttribute("aria-label", button.title);
    button.addEventListener("click", () => this.seek(tick));
    document.querySelector(`.marks[data-side="${side}"]`).append(button);
  }
}

const player = new Player();
const orders = {
  ready(message, side) {
    if (player.ready[side]) return;
    player.ready[side] = message;
    if (frames.every((_, i) => player.ready[i])) player.begin();
  },
  play: () => player.play(),
  pause: () => player.pause(),
  seek: ({ tick }) => player.seek(tick),
  step: ({ ticks }) => player.step(ticks),
  rate: ({ rate }) => player.setRate(rate),
  part: ({ apart }) => player.jump(apart ? "apart" : "part"),
  fit: () => player.fit(),
  space: ({ isOn, mode }) => player.showSpace(isOn, mode),
  event: ({ direction }) => player.jumpToEvent(direction > 0 ? 1 : -1),
  view: ({ x, y, scale }, side) => player.send({ kind: "view", x, y, scale }, frames[1 - side]),
};
addEventListener("message", (event) => {
  const side = frames.findIndex((frame) => frame.contentWindow === event.source);
  if (side >= 0 && Object.hasOwn(orders, event.data?.kind)) orders[event.data.kind](event.data, side);
});

const toggle = () => (player.playing ? player.pause() : player.play());
const buttons = {
  home: () => player.seek(0),
  back: () => player.step(-1),
  play: toggle,
  forth: () => player.step(1),
  end: () => player.seek(player.lastTick),
  fit: () => player.fit(),
  part: () => player.jump("part"),
  apart: () => player.jump("apart"),
};
for (const [id, action] of Object.entries(buttons)) $(id)?.addEventListener("click", action);
$("slider").addEventListener("input", () => player.seek(Number($("slider").value)));
$("rate").addEventListener("change", () => player.setRate(Number($("rate").value)));
addEventListener("hashchange", () => player.readLink());

const second = () => Math.round(1 / player.tickSeconds);
const faster = (by) => player.setRate(RATES[Math.min(Math.max(RATES.indexOf(player.rate) + by, 0), RATES.length - 1)]);
const keys = {
  " ": toggle,
  ArrowLeft: (event) => player.step(event.shiftKey ? -second() : -1),
  ArrowRight: (event) => player.step(event.shiftKey ? second() : 1),
  Home: () => player.seek(0),
  End: () => player.seek(player.lastTick),
  "<": () => faster(-1),
  ">": () => faster(1),
  n: () => player.jumpToEvent(1),
  p: () => player.jumpToEvent(-1),
  g: (event) => player.jump(event.shiftKey ? "apart" : "part"),
  d: () => player.showSpace(!player.space.isOn, player.space.mode),
  e: () => player.send({ kind: "mode" }, frames[0]), // the first replay knows what comes next, and asks for it in both
  0: () => player.fit(),
};
addEventListener("keydown", (event) => {
  const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action || event.ctrlKey || event.metaKey || event.altKey || event.target.closest?.("select")) return;
  if (event.key === " " && event.target.closest?.("button")) return;
  event.preventDefault();
  action(event);
});
player.send({ kind: "hello" });
window.player = player; // for tests
