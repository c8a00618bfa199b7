// Buttons, keys, pointer.

const WHEEL_ZOOM = 0.0016; // per px of the wheel
const KEY_ZOOM = 1.3;

function listenToButtons(viewer) {
  const actions = {
    home: () => viewer.seek(0),
    back: () => viewer.step(-1),
    play: () => (viewer.playing ? viewer.pause() : viewer.play()),
    forth: () => viewer.step(1),
    end: () => viewer.seek(viewer.replay.lastTick),
    follow: () => viewer.follow(viewer.followed + 1),
    labels: () => viewer.cycleLabels(),
    "toggle-3d": () => viewer.space.toggle(),
    "view-mode": () => viewer.space.cycleMode(),
    strips: () => viewer.toggleStrips(),
    fit: () => viewer.fit(),
    "zoom-in": () => zoomBy(viewer, KEY_ZOOM),
    "zoom-out": () => zoomBy(viewer, 1 / KEY_ZOOM),
    ask: () => $("help").showModal(),
  };
  for (const [id, action] of Object.entries(actions)) {
    $(id).addEventListener("click", action);
    showTip($(id), $(id).getAttribute("aria-label").replace("Play (", "Play, pause ("));
  }
  for (const name of LAYERS) listenToLayer(viewer, name);
  $("rate").addEventListener("change", () => viewer.setRate(Number($("rate").value)));
  // After a click with the pointer the keys belong to the player again; after the keyboard's, focus stays visible.
  document.addEventListener("click", (event) => event.detail > 0 && event.target.closest("button")?.blur());
  $("rate").addEventListener("change", () => $("rate").blur());
  addEventListener("hashchange", () => viewer.readLink());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => viewer.restyle());
}

/** The button of a layer, and its list; a layer without anything in the recording says so. */
function listenToLayer(viewer, name) {
  const why = viewer.missing[name];
  const tab = viewer.lists.tabs.get(name);
  for (const button of [$(`layer-${name}`), tab].filter(Boolean)) {
    button.disabled = Boolean(why);
    if (why) button.title = why;
  }
  $(`layer-${name}`).addEventListener("click", () => viewer.toggleLayer(name));
}

function zoomBy(viewer, factor, px, py) {
  viewer.fitted = false;
  if (viewer.followed >= 0) viewer.view.zoom(factor);
  else viewer.view.zoom(factor, px, py);
  viewer.changed();
}

function listenToKeys(viewer) {
  const second = Math.round(1 / viewer.replay.tick_s);
  const rateStep = (by) => viewer.setRate(RATES[Math.min(Math.max(RATES.indexOf(viewer.rate) + by, 0), RATES.length - 1)]);
  const keys = {
    " ": () => (viewer.playing ? viewer.pause() : viewer.play()),
    ArrowLeft: (event) => viewer.step(event.shiftKey ? -second : -1),
    ArrowRight: (event) => viewer.step(event.shiftKey ? second : 1),
    Home: () => viewer.seek(0),
    End: () => viewer.seek(viewer.replay.lastTick),
    "<": () => rateStep(-1),
    ">": () => rateStep(1),
    n: () => viewer.jumpToEvent(1),
    p: () => viewer.jumpToEvent(-1),
    f: () => viewer.follow(viewer.followed + 1),
    l: () => viewer.cycleLabels(),
    s: () => viewer.toggleStrips(),
    h: () => $("panel-fold").click(),
    y: () => $("layers-fold").click(),
    c: () => viewer.cameras.toggle(),
    d: () => viewer.space.toggle(),
    e: () => viewer.space.cycleMode(),
    "+": () => zoomBy(viewer, KEY_ZOOM),
    "=": () => zoomBy(viewer, KEY_ZOOM),
    "-": () => zoomBy(viewer, 1 / KEY_ZOOM),
    0: () => viewer.fit(),
    v: () => viewer.toggleLayer("sight"),
    i: () => viewer.toggleLayer("intentions"),
    m: () => viewer.toggleLayer("messages"),
    r: () => viewer.toggleLayer("links"),
    o: () => viewer.toggleLayer("shared"),
    t: () => viewer.toggleLayer("transcript"),
    "?": () => $("help").showModal(),
  };
  addEventListener("keydown", (event) => {
    const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action || event.ctrlKey || event.metaKey || event.altKey || $("help").open) return;
    if (event.target.closest?.("select")) return;
    if (event.key === " " && event.target.closest?.("button, summary")) return;
    event.preventDefault();
    action(event);
  });
}

/** One pointer drags, two pinch, the wheel zooms, a click selects a CAV. */
function listenToPointer(viewer) {
  const map = $("map");
  const down = new Map();
  let travelled = 0;
  const device = (event) => [event.clientX * devicePixelRatio, event.clientY * devicePixelRatio];
  map.addEventListener("pointerdown", (event) => {
    map.setPointerCapture(event.pointerId);
    down.set(event.pointerId, device(event));
    travelled = 0;
  });
  map.addEventListener("pointermove", (event) => {
    showPointer(viewer, device(event));
    if (!down.has(event.pointerId)) return;
    const before = [...down.values()];
    const [ox, oy] = down.get(event.pointerId);
    const [px, py] = device(event);
    down.set(event.pointerId, [px, py]);
    travelled += Math.hypot(px - ox, py - oy);
    if (down.size === 2) pinch(viewer, before, [...down.values()]);
    else if (travelled > 4) {
      Object.assign(viewer, { followed: -1, fitted: false });
      viewer.view.pan(px - ox, py - oy);
      map.classList.add("dragging");
    }
    viewer.changed();
  });
  const release = (event) => {
    down.delete(event.pointerId);
    map.classList.remove("dragging");
  };
  map.addEventListener("pointerup", (event) => {
    if (travelled <= 4) selectAt(viewer, device(event));
    release(event);
  });
  map.addEventListener("pointercancel", release);
  map.addEventListener("pointerleave", () => ($("pointer").textContent = ""));
  map.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 33 : 1;
    zoomBy(viewer, Math.exp(-event.deltaY * lines * WHEEL_ZOOM), ...device(event));
  }, { passive: false });
}

function pinch(viewer, before, after) {
  const apart = ([[ax, ay], [bx, by]]) => Math.hypot(bx - ax, by - ay) || 1;
  const middle = ([[ax, ay], [bx, by]]) => [(ax + bx) / 2, (ay + by) / 2];
  zoomBy(viewer, apart(after) / apart(before), ...middle(after));
}

function selectAt(viewer, [px, py]) {
  const { replay, view } = viewer;
  const pose = {};
  for (let ego = 0; ego < replay.egos; ego++) {
    if (!replay.sample(ego, viewer.time, pose)) continue;
    const [ex, ey] = view.toScreen(pose.x, pose.y);
    const reach = Math.max(12 * devicePixelRatio, (replay.sizes[ego][0] / 2) * view.scale);
    if (Math.hypot(px - ex, py - ey) <= reach) return viewer.select(ego);
  }
}

function showPointer(viewer, [px, py]) {
  const [x, y] = viewer.view.toWorld(px, py);
  const [x0, y0] = viewer.replay.origin;
  $("pointer").textContent = `x ${(x + x0).toFixed(1)}  y ${(y + y0).toFixed(1)} m`;
}
