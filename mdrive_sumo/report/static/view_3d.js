// View3D: a scene of `pack_scene` in a canvas with WebGL 2.
//
//   const view = new View3D(canvas, await decodeScene(buffer), { weather: "rain", quality: "high" });
//   view.place(3, "car", [200, 30, 30], [4.9, 1.9, 1.5], x, y, yaw, lamps);  // x, y: its middle; lamps: bits of `SignalLamp`
//   view.setSignals({ tls: "GrGr" });
//   view.look({ x, y, yaw, mode: "driver", own: 3 });
//   view.setOverlays({ route: [[x, y], ...], shared: [{ x, y, yaw, length, width, height?, from?, colour? }],
//     intentions: [{ path: [[x, y], ...], from?, colour? }], ghosts: [{ model, paint, size, x, y, yaw, label? }] });
//   view.draw();
//
// Of overlays, a name that is left out stays as it is, an empty list takes it away; colours are "#rrggbb".
// Coordinates are metres relative to the scene's origin, z up. Nothing is drawn before `draw`.

// ratio, least: pixels by those of the style sheet, each way; slow, fast: ms until a picture is done, from which on fewer
// pixels are drawn, and up to which more; farShare: of the distance from which cameras draw wheels with fewer corners.
const QUALITIES = {
  high: { antialias: true, ratio: 2, least: 0.75, slow: 40, fast: 0, farShare: 1 },
  low: { antialias: false, ratio: 0.8, least: 0.5, slow: 44, fast: 24, farShare: 0.2 }, // 20 pictures a second: 50 ms for all
};
const RATIO_STEP = 0.85;
const LEAST_WATCH_MS = 40; // two pictures of a display
const JUDGED = 8; // pictures that are measured before the number of pixels changes
const SOFTWARE = /SwiftShader|llvmpipe|Software|Basic Render/i;
const FRAME_PX = 3; // around mirrors
const LIGHT_NAMES = { default: "day" };

class View3D {
  /**
   * options: weather, the name of a weather of a scenario or of a light ("dusk", "fog"), default: the scene's;
   * quality, "high" or "low" (for processors: fewer pixels, without smooth edges), default: by what draws.
   * Throws Error without WebGL 2.
   */
  constructor(canvas, scene, { weather, quality } = {}) {
    this.canvas = canvas;
    this.scene = scene;
    this.rendererName = findRenderer();
    this.qualityName = quality ?? (SOFTWARE.test(this.rendererName) ? "low" : "high");
    this.quality = QUALITIES[this.qualityName];
    this.ratio = this.findMostRatio();
    this.times = [];
    this.renderer = makeRenderer(canvas, this.quality);
    this.renderer.autoClear = false;
    this.uniforms = buildUniforms();
    this.world = new THREE.Scene();
    this.world.matrixAutoUpdate = false;
    const maker = new MaterialMaker(scene, this.uniforms, this.qualityName);
    this.materials = makeMaterials(maker);
    const meshes = buildStaticMeshes(scene, this.materials);
    this.terrain = buildTerrain(scene, this.materials);
    this.world.add(...meshes, this.terrain, this.makeSky());
    this.users = new RoadUserLayer(scene, this.materials, this.world, this.quality.farShare);
    this.effects = new EffectLayer(maker, this.world);
    this.overlays = new OverlayLayer(scene, maker, this.world);
    this.cameras = new CameraSet(scene, new Walls(scene));
    this.pose = { x: 0, y: 0, yaw: 0, mode: "chase" };
    this.setWeather(weather ?? scene.light);
    this.resize(canvas.clientWidth || canvas.width, canvas.clientHeight || canvas.height);
  }

  makeSky() {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
    const sky = new THREE.Mesh(geometry, this.materials.sky);
    sky.frustumCulled = false;
    sky.renderOrder = ORDER.sky;
    return sky;
  }

  /** Changes the light: the weather of a scenario, or the name of a light. */
  setWeather(name) {
    const light = this.scene.lights[LIGHT_NAMES[name] ?? name];
    if (!light) throw new Error(`View3D: unknown weather ${name}; there are ${Object.keys(this.scene.lights).join(", ")}`);
    this.light = light;
    const u = this.uniforms;
    for (const colour of ["sun", "ambient", "horizon", "zenith"]) u[colour].value.fromArray(light[colour]);
    const level = Math.sqrt(1 - light.elevation ** 2);
    u.toSun.value.set(0.6 * level, -0.8 * level, light.elevation); // as `camera_renderer` has it
    u.fog.value = light.fog_per_m;
    u.wet.value = light.wet;
    u.lamps.value = light.lamps ? 1 : 0;
  }

  /** Puts a road user there: model and paint of `describe_road_user`, size [length, width, height]. */
  place(index, model, paint, size, x, y, yaw, lamps = 0) {
    this.users.place(index, model, paint, size, x, y, yaw, lamps);
  }

  remove(index) {
    this.users.remove(index);
  }

  /** SUMO's letters by traffic light; lights that are not named stay as they are. */
  setSignals(states) {
    this.users.setSignals(states);
  }

  setOverlays(overlays) {
    this.overlays.set(overlays);
  }

  /**
   * Where the picture is taken: x, y, yaw of the followed car, its index `own`, and mode: "driver", "mirrors" (driver with
   * mirrors), "chase", "top", "four". Optional: glance [rad to the left], height of "top" [m], north (of "top": up).
   */
  look(pose) {
    this.pose = pose;
  }

  /** Size of the canvas [px of the style sheet]. */
  resize(width, height) {
    this.cssSize = [width, height];
    this.renderer.setPixelRatio(Math.min(this.ratio, this.findMostRatio()));
    this.renderer.setSize(Math.max(width, 1), Math.max(height, 1), false);
    this.width = this.renderer.domElement.width;
    this.height = this.renderer.domElement.height;
  }

  /** Draws all pictures of the mode. seconds: time of blinking lamps and rain. */
  draw(seconds = performance.now() / 1000) {
    this.begun = performance.now();
    const { uniforms: u, pose } = this;
    u.seconds.value = seconds;
    const [cos, sin] = [Math.cos(pose.yaw), Math.sin(pose.yaw)];
    u.beamFrom.value.set(pose.x, pose.y, 0, this.light.lamps ? 1 : 0);
    u.beamAlong.value.set(cos, sin);
    this.info = { calls: 0, triangles: 0 };
    for (const camera of this.cameras.arrange(pose, this.width, this.height)) this.drawPicture(camera);
    const gl = this.renderer.getContext();
    if (this.fence) gl.deleteSync(this.fence);
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  /** Whether the last picture is drawn to its end: drawing before that builds a queue, and shows what is long past. */
  isReady() {
    const gl = this.renderer.getContext();
    const now = performance.now();
    const isWatched = now - this.asked < LEAST_WATCH_MS; // else it may have been done long before
    this.asked = now;
    if (!this.fence) return true;
    if (gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED) return false;
    gl.deleteSync(this.fence);
    this.fence = undefined;
    if (isWatched) this.judge(now - this.begun);
    return true;
  }

  findMostRatio() {
    return Math.min(globalThis.devicePixelRatio || 1, this.quality.ratio);
  }

  /** Fewer pixels while pictures take too long, of quality "low" more again when there is time. */
  judge(ms) {
    const { least, slow, fast } = this.quality;
    this.times.push(ms);
    if (this.times.length < JUDGED) return;
    const median = this.times.sort((a, b) => a - b)[JUDGED >> 1];
    this.times = [];
    const wanted = median > slow ? this.ratio * RATIO_STEP : median < fast ? this.ratio / RATIO_STEP : this.ratio;
    const next = Math.min(Math.max(wanted, least), this.findMostRatio());
    if (next === this.ratio) return;
    this.ratio = next;
    this.resize(...this.cssSize);
  }

  drawPicture(view) {
    const { renderer, uniforms: u } = this;
    const ratio = renderer.getPixelRatio();
    const [left, top, width, height] = this.findPixels(view.rect).map((px) => px / ratio);
    renderer.setScissorTest(true);
    if (view.isMirror) {
      renderer.setScissor(left - FRAME_PX, top - FRAME_PX, width + 2 * FRAME_PX, height + 2 * FRAME_PX);
      renderer.clear(true, false, false);
    }
    renderer.setViewport(left, top, width, height);
    renderer.setScissor(left, top, width, height);
    renderer.clear(false, true, true);
    u.eye.value.set(view.x, view.y, view.z);
    u.rays.value.copy(view.rays);
    this.terrain.position.set(view.x, view.y, 0);
    const side = view.isMirror ? THREE.BackSide : THREE.FrontSide;
    for (const name of ["solid", "facade", "ground", "users"]) this.materials[name].side = side;
    this.effects.begin(this.light, this.light === this.scene.lights.rain);
    this.users.select(view, this.pose.own, this.effects);
    this.effects.finish();
    if (view.isPlain) this.overlays.labels.hide();
    else this.overlays.showLabels(view, this.pose, [width * ratio, height * ratio], ratio);
    renderer.render(this.world, view.camera);
    this.info.calls += renderer.info.render.calls;
    this.info.triangles += renderer.info.render.triangles;
  }

  /** [left, bottom, width, height] in pixels of the canvas, of shares from its upper left corner. */
  findPixels([left, top, width, height]) {
    const [x0, x1] = [left, left + width].map((share) => Math.round(share * this.width));
    const [y0, y1] = [1 - top - height, 1 - top].map((share) => Math.round(share * this.height));
    return [x0, y0, x1 - x0, y1 - y0];
  }

  dispose() {
    this.renderer.dispose();
  }
}

function makeMaterials(maker) {
  return {
    solid: maker.surface({}),
    facade: maker.surface({ FACADE: 1 }),
    ground: maker.surface({ GROUND: 1 }),
    users: maker.make(USER_VERTEX, USER_FRAGMENT),
    sky: maker.make(SKY_VERTEX, SKY_FRAGMENT, {}, { depthWrite: false, side: THREE.DoubleSide }),
  };
}

/** The name of what draws, "" if it is not told. */
function findRenderer() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

function makeRenderer(canvas, { antialias }) {
  const context = canvas.getContext("webgl2", { antialias, alpha: false, stencil: true, powerPreference: "high-performance", preserveDrawingBuffer: false });
  if (!context) throw new Error("This browser has no WebGL 2, which the 3-D view needs; the view from above works without it.");
  return new THREE.WebGLRenderer({ canvas, context, stencil: true });
}
