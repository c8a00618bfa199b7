// The large picture and the small map: 3-D with WebGL, else from above.

const VIEWS = ["driver", "four", "chase", "top"];
const VIEW_NAMES = { driver: "driver's view", four: "four cameras", chase: "chase", top: "top view" };
const LEAST_MIRROR_PX = 700; // width of the window
const LEAST_HEIGHT_PX = 500;
const NOTHING = []; // the same list each time: the view does nothing for one that it knows
const SMALL_EVERY_MS = 90; // the small map is drawn eleven times a second
const WITHIN_M = 3.5; // a ghost so near is around the eyes of the driver, and nothing else would be seen

class Picture {
  /** `tell` shows a sentence. */
  constructor(tell) {
    this.top = new TopView($("map"));
    this.view = "driver";
    this.hasMirrors = recall("mirrors", true);
    this.hasMap = recall("map", true);
    this.tell = tell;
    this.smallAt = 0;
    this.placed = new Set();
    $("scene").addEventListener("webglcontextlost", () => this.withoutWebGL(new Error("The graphics driver has stopped the 3-D view. The top view drives as well.")));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.top.restyle());
  }

  /** Builds the 3-D view of a decoded scene; without WebGL the top view drives. */
  build(scene, weather) {
    this.map = new SceneMap(scene);
    this.placed.clear();
    try {
      this.view3d = new View3D($("scene"), scene, { weather });
    } catch (error) {
      this.withoutWebGL(error);
    }
    this.resize();
  }

  withoutWebGL(error) {
    this.view3d = undefined;
    this.view = "top";
    this.tell(error.message);
    this.resize();
  }

  choose(view) {
    if (view !== "top" && !this.view3d) return this.tell("This browser has no WebGL: only the top view is there.");
    this.view = view;
    this.resize();
    return this.tell(VIEW_NAMES[view].replace(/^./, (letter) => letter.toUpperCase()), true);
  }

  next() {
    this.choose(this.view3d ? VIEWS[(VIEWS.indexOf(this.view) + 1) % VIEWS.length] : "top");
  }

  /** On a phone mirrors would be slits, and hide the road. */
  get showsMirrors() {
    return this.hasMirrors && innerWidth > LEAST_MIRROR_PX && innerHeight > LEAST_HEIGHT_PX;
  }

  resize() {
    const isTop = this.view === "top";
    $("scene").hidden = isTop;
    $("four").hidden = this.view !== "four";
    $("map").classList.toggle("small", !isTop);
    $("map").hidden = !isTop && !this.hasMap;
    const { width, height } = $("map").getBoundingClientRect();
    if (width) this.top.resize(width, height);
    if (!isTop) this.view3d?.resize(innerWidth, innerHeight);
  }

  /** `what`: {centre, own, users, overlays, signals}, all in the scene's frame. Returns whether the large picture is a new one. */
  draw(what, now) {
    const isTop = this.view === "top";
    const isReady = isTop || Boolean(this.view3d?.isReady()); // else pictures queue, and show what is long past
    if (!isTop && isReady) this.draw3D(what);
    if (isTop || (this.hasMap && now - this.smallAt > SMALL_EVERY_MS)) {
      this.smallAt = now;
      this.top.draw({ ...what, map: this.map, isSmall: !isTop });
    }
    return isReady;
  }

  draw3D({ centre, own, users, overlays, signals }) {
    const view = this.view3d;
    const gone = new Set(this.placed);
    const place = (user) => {
      view.place(user.index, user.model, user.paint, [user.length, user.width, user.height], user.x, user.y, user.yaw, user.lamps);
      gone.delete(user.index);
      this.placed.add(user.index);
    };
    users.forEach(place);
    if (own?.index !== undefined) place(own);
    for (const index of gone) {
      view.remove(index);
      this.placed.delete(index);
    }
    view.setSignals(signals);
    const { route = NOTHING, shared = NOTHING, intentions = NOTHING, ghosts = NOTHING } = overlays;
    const sitsInside = this.view === "driver" || this.view === "four";
    const seen = sitsInside ? ghosts.filter(({ x, y }) => Math.hypot(x - centre.x, y - centre.y) > WITHIN_M) : ghosts;
    view.setOverlays({ route, shared, intentions, ghosts: seen });
    view.look({ x: centre.x, y: centre.y, yaw: centre.yaw, own: centre.index, mode: this.view === "driver" && this.showsMirrors ? "mirrors" : this.view });
    view.draw();
  }
}
