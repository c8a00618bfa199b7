// A replay beside another one: in a frame named "beside", the page around it keeps the time and the view of both.

const BESIDE = "beside";

/** Everything that would change the time asks the page instead, which tells both replays. */
function followPage(viewer) {
  if (window.name !== BESIDE || parent === window) return;
  const { replay, view } = viewer;
  const tell = (kind, values = {}) => parent.postMessage({ kind, ...values }, "*");
  document.body.classList.add(BESIDE);
  Object.assign(viewer, {
    play: () => tell("play"),
    pause: () => tell("pause"),
    seek: (tick) => tell("seek", { tick: Math.round(tick) }),
    step: (ticks) => tell("step", { ticks }),
    jumpToEvent: (direction) => tell("event", { direction }),
    setRate: (rate) => tell("rate", { rate }),
    advance: () => {},
  });
  const { space } = viewer;
  const show = space.show3D.bind(space);
  space.show3D = (isOn, mode) => tell("space", { isOn, mode });
  const place = () => [view.x, view.y, view.scale / devicePixelRatio].join();
  let known = place();
  const fit = viewer.fit.bind(viewer);
  viewer.fit = () => tell("fit");
  const draw = viewer.draw.bind(viewer);
  viewer.draw = (now) => {
    const unsettled = draw(now);
    if (!viewer.fitted && place() !== known) tell("view", { x: view.x, y: view.y, scale: view.scale / devicePixelRatio });
    known = place();
    return unsettled;
  };
  const marks = replay.marks.map(({ tick, name, kind, text }) => ({ tick, name, kind, text, grade: gradeOf(kind) }));
  const orders = {
    /** The page may be ready before this replay or after it. */
    hello: () => tell("ready", { lastTick: replay.lastTick, tickSeconds: replay.tick_s, bounds: viewer.bounds, marks }),
    show({ time, playing, rate }) {
      Object.assign(viewer, { time: Math.min(time, replay.lastTick), playing, rate });
    },
    view({ x, y, scale }) {
      Object.assign(viewer, { followed: -1, fitted: false });
      Object.assign(view, { x, y, scale: scale * devicePixelRatio });
      known = place();
    },
    space: ({ isOn, mode }) => show(isOn, mode),
    mode: () => space.cycleMode(),
    fit({ bounds }) {
      viewer.bounds = bounds;
      fit();
    },
  };
  addEventListener("message", (event) => {
    if (event.source !== parent || !Object.hasOwn(orders, event.data?.kind)) return;
    orders[event.data.kind](event.data);
    viewer.changed();
  });
  addEventListener("keydown", (event) => {
    if (event.key.toLowerCase() === "g" && !event.ctrlKey && !event.metaKey) tell("part", { apart: event.shiftKey });
  });
  orders.hello();
}
