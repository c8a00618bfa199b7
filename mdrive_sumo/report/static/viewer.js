// The page: player, input, and the loop that draws. `window.viewer` is for tests.

const RATES = [0.25, 0.5, 1, 2, 4, 8];
const LAYERS = ["sight", "intentions", "messages", "links", "shared", "transcript"];
const LABELS = ["near", "all", "none"];
const LONGEST_FRAME_MS = 100; // after a pause of the browser: go on from here, do not jump
const LEAST_STAGE_PX = 380; // where less is left for the map, the strips start hidden
const KEPT_TIMES = 1200;
const SCALE_BARS_M = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];

const $ = (id) => document.getElementById(id);

class Viewer {
  constructor(replay) {
    this.replay = replay;
    Object.assign(this, { time: 0, playing: false, rate: 1, selected: 0, followed: -1, labels: "near" });
    this.view = new View();
    this.frameTimes = [];
    this.drawTimes = [];
    this.ctx = $("map").getContext("2d", { alpha: false });
    this.roads = new RoadLayer(replay);
    this.scene = new Scene(replay);
    const talk = new Talk(replay);
    this.layers = new Layers(replay, talk);
    this.missing = this.layers.missing();
    $("link-classes").hidden = talk.linkNames.size === 0; // only a radio's recordings have them
    this.on = new Set(this.missing.intentions ? [] : ["intentions"]);
    this.firstLayers = this.shownLayers();
    const seek = (tick) => this.seek(tick);
    this.timeline = new Timeline(replay, seek);
    this.panel = new Panel(replay, { seek, select: (ego) => this.select(ego), follow: (ego) => this.follow(ego === this.followed ? -1 : ego) });
    this.lists = new Lists(replay, talk, { seek, open: (name) => this.openList(name), redraw: () => this.changed() });
    this.lists.show("events");
    this.cameras = new Cameras();
    this.space = new Space(replay, talk, () => this.changed());
    $("duration").textContent = ` / ${replay.seconds(replay.lastTick).toFixed(2)} s`;
    this.theme = readTheme();
    this.bounds = sceneBounds(replay);
    this.fit();
    listenToFolds(this);
    if ($("stage").clientHeight < LEAST_STAGE_PX) this.toggleStrips();
    this.readLink();
  }

  // ---- player

  play() {
    if (this.time >= this.replay.lastTick) this.time = 0;
    this.playing = true;
    this.before = undefined;
    this.changed();
  }

  pause() {
    this.playing = false;
    this.time = Math.floor(this.time);
    this.changed();
  }

  seek(tick) {
    this.time = Math.min(Math.max(Math.round(tick), 0), this.replay.lastTick);
    this.changed();
  }

  /** Steps by whole ticks, and stops playing. */
  step(ticks) {
    this.playing = false;
    this.seek(Math.floor(this.time) + ticks);
  }

  jumpToEvent(direction) {
    const now = Math.floor(this.time);
    const marks = this.replay.marks.filter((mark) => direction * (mark.tick - now) > 0);
    if (marks.length) this.seek(marks.at(direction > 0 ? 0 : -1).tick);
  }

  setRate(rate) {
    this.rate = rate;
    $("rate").value = String(rate);
  }

  // ---- what is shown

  select(ego) {
    if (ego === this.selected) return;
    this.selected = ego;
    if (this.followed >= 0) this.followed = ego;
    this.restyle();
  }

  follow(ego) {
    this.followed = ego < this.replay.egos ? ego : -1;
    if (this.followed >= 0) this.select(this.followed);
    this.fitted = false;
    if (this.followed >= 0 && this.view.scale < 6 * devicePixelRatio) this.view.scale = 8 * devicePixelRatio;
    this.changed();
  }

  /** Shows or hides the strips; without them the map is larger. */
  toggleStrips() {
    document.body.classList.toggle("compact");
    this.resize();
  }

  cycleLabels() {
    this.labels = LABELS[(LABELS.indexOf(this.labels) + 1) % LABELS.length];
    this.changed();
  }

  /** Switches a layer on or off; a list that belongs to it opens and closes with it. */
  toggleLayer(name) {
    if (this.missing[name]) return;
    if (this.on.delete(name)) {
      if (this.lists.shown === name) this.lists.show("events");
    } else {
      this.on.add(name);
      if (this.lists.tabs.has(name)) this.lists.show(name);
    }
    this.changed();
  }

  openList(name) {
    this.lists.show(name);
    this.changed();
  }

  /** Shows the whole scene, and keeps showing it when panels fold or the window changes, until the view is moved. */
  fit() {
    this.followed = -1;
    this.fitted = true;
    arrangeScene(this, true);
    this.changed();
  }

  resize() {
    if (!innerWidth || !innerHeight) return; // a frame that is hidden
    const ratio = devicePixelRatio;
    [$("map").width, $("map").height] = [Math.round(innerWidth * ratio), Math.round(innerHeight * ratio)];
    this.timeline.draw(this.theme, this.selected); // first: its height decides how much is left for the stage
    arrangeScene(this, this.fitted);
    this.roads.invalidate();
    this.changed();
  }

  /** Reads the theme's colours anew, and draws what is drawn only once. */
  restyle() {
    this.theme = readTheme();
    this.roads.invalidate();
    this.timeline.draw(this.theme, this.selected);
    this.changed();
  }

  // ---- link "#t=12.4", with "&show=sight,messages" where the layers are not those of the beginning

  readLink() {
    const link = new URLSearchParams(location.hash.slice(1));
    const seconds = Number(link.get("t"));
    if (seconds > 0) this.seek(seconds / this.replay.tick_s);
    const wanted = link.get("show")?.split(",");
    for (const name of wanted ? LAYERS : []) if (wanted.includes(name) !== this.on.has(name)) this.toggleLayer(name);
  }

  shownLayers() {
    return LAYERS.filter((name) => this.on.has(name)).join(",");
  }

  writeLink() {
    clearTimeout(this.linkTimer);
    if (this.playing) return;
    const show = this.shownLayers();
    const hash = `#t=${this.replay.seconds(Math.floor(this.time)).toFixed(2)}${show === this.firstLayers ? "" : `&show=${show}`}`;
    if (location.protocol === "about:") return; // inside a notebook there is no address to keep the time in
    this.linkTimer = setTimeout(() => history.replaceState(null, "", hash), 250); // browsers limit how often
  }

  // ---- drawing

  changed() {
    this.pending ??= requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.pending = undefined;
    if (this.playing) this.advance(now);
    keep(this.frameTimes, now);
    const begin = performance.now();
    const unsettled = this.draw(now);
    keep(this.drawTimes, performance.now() - begin);
    if (this.playing || unsettled) this.changed();
  }

  advance(now) {
    const elapsed = Math.min(now - (this.before ?? now), LONGEST_FRAME_MS);
    this.before = now;
    this.time += (elapsed * this.rate) / (1000 * this.replay.tick_s);
    if (this.time < this.replay.lastTick) return;
    this.time = this.replay.lastTick;
    this.playing = false;
  }

  draw(now) {
    const { ctx, view, theme, replay } = this;
    const pose = {};
    if (this.followed >= 0 && replay.sample(this.followed, this.time, pose)) [view.x, view.y] = [pose.x, pose.y];
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    const unsettled = this.roads.blit(ctx, view, theme, this.selected, now);
    this.scene.draw(ctx, view, theme, this);
    this.timeline.show(this.time, this.selected);
    this.panel.show(Math.floor(this.time), this.selected, this.followed);
    this.lists.update(Math.floor(this.time), this.selected);
    this.cameras.show(Math.floor(this.time), this.selected);
    const waits = this.space.show(this);
    this.showState();
    return unsettled || waits;
  }

  showState() {
    const { replay } = this;
    const tick = Math.floor(this.time);
    setText($("time"), replay.seconds(tick).toFixed(2));
    setText($("tick"), `tick ${tick} / ${replay.lastTick}`);
    setText($("labels"), `Labels: ${this.labels}`);
    setText($("follow"), this.followed < 0 ? "Follow: none" : `Follow: ${shortened(replay.ids[this.followed])}`);
    for (const name of LAYERS) pressed($(`layer-${name}`), this.on.has(name));
    document.body.classList.toggle("playing", this.playing);
    const wanted = this.playing ? "Pause (Space)" : "Play (Space)";
    if ($("play").getAttribute("aria-label") !== wanted) $("play").setAttribute("aria-label", wanted);
    if (this.shownScale !== this.view.scale) this.showScale();
    this.writeLink();
  }

  showScale() {
    this.shownScale = this.view.scale;
    const perMetre = this.view.scale / devicePixelRatio;
    const metres = SCALE_BARS_M.find((m) => m * perMetre >= 70) ?? SCALE_BARS_M.at(-1);
    $("scale-bar").style.width = `${metres * perMetre}px`;
    setText($("scale-text"), metres < 1000 ? `${metres} m` : `${metres / 1000} km`);
  }
}

function keep(times, value) {
  times.push(value);
  if (times.length > KEPT_TIMES) times.shift();
}

// ---- start

function showTrouble(text) {
  const note = element("p", "", text);
  note.id = "trouble";
  document.body.append(note);
}

async function start() {
  const replay = await readReplay($("data").textContent.trim());
  // In a frame of a page that is not laid out yet the window has no size, and nothing can be drawn.
  while (!innerWidth || !innerHeight) await new Promise((wake) => addEventListener("resize", wake, { once: true }));
  const viewer = new Viewer(replay);
  listenToButtons(viewer);
  listenToKeys(viewer);
  listenToPointer(viewer);
  followPage(viewer);
  window.viewer = {
    get tick() {
      return Math.floor(viewer.time);
    },
    get playing() {
      return viewer.playing;
    },
    get followed() {
      return viewer.followed;
    },
    get selected() {
      return viewer.selected;
    },
    get view() {
      return { x: viewer.view.x, y: viewer.view.y, scale: viewer.view.scale };
    },
    /** Where the CAV is on the screen [px of the style sheet]; undefined if it is not in the world. */
    screen(ego) {
      const pose = {};
      if (!viewer.replay.sample(ego, viewer.time, pose)) return undefined;
      return viewer.view.toScreen(pose.x, pose.y).map((px) => px / devicePixelRatio);
    },
    get layers() {
      return [...viewer.on];
    },
    get labels() {
      return { mode: viewer.labels, rects: viewer.scene.labels.rects };
    },
    space: viewer.space,
    replay: viewer.replay,
    talk: viewer.lists.talk,
    ticks: viewer.replay.ticks,
    seek: (tick) => viewer.seek(tick),
    frameTimes: viewer.frameTimes,
    drawTimes: viewer.drawTimes,
  };
}

start().catch((error) => {
  showTrouble(`The replay cannot be shown: ${error.message}`);
  throw error;
});
