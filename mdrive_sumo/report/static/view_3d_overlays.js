// What a driver is told beyond what is seen: route, intentions, shared objects, ghosts and labels.

const RIBBON_VERTEX = `
in vec3 position;
in vec4 ribbon;  // metres along it, side from -1 to 1, width [m], opacity
in vec3 colour;
out vec3 vWorld;
out vec4 vRibbon;
flat out vec3 vColour;
void main() {
  vRibbon = ribbon;
  vColour = colour;
  vWorld = position;
#ifdef THROUGH
  gl_Position = projectionMatrix * viewMatrix * vec4(position, 1.0);
#else
  gl_Position = put(position, 0.2);
#endif
}
`;
const RIBBON_FRAGMENT = `
in vec4 vRibbon;
flat in vec3 vColour;
void main() {
  float side = abs(vRibbon.y), along = vRibbon.x;
  float arrow = fract((along + side * vRibbon.z / 2.0) / 5.0);  // arrow heads every 5 m
  float head = smoothstep(0.0, 0.04, arrow) * (1.0 - smoothstep(0.24, 0.28, arrow));
  float edge = 1.0 - smoothstep(0.86, 1.0, side);
  float strength = vRibbon.w * edge * mix(0.42, 0.85, head) * smoothstep(0.0, 1.5, along);
  pixel = vec4(mix(vColour, vec3(1.0), 0.25 * head), strength);
}
`;
const BOX_VERTEX = `
in vec3 position, normal;
in vec4 place, size;
in vec2 turn;
in vec3 paint;
out vec3 vWorld;
out vec2 vFace;
flat out vec4 vPaint;
void main() {
  vec3 at = position * size.xyz;
  vWorld = place.xyz + vec3(turn.x * at.x - turn.y * at.y, turn.y * at.x + turn.x * at.y, at.z);
  vec3 unit = position + vec3(0.5, 0.5, 0.0);
  vFace = abs(normal.x) > 0.5 ? unit.yz : abs(normal.y) > 0.5 ? unit.xz : unit.xy;
  vPaint = vec4(paint, place.w);
  gl_Position = projectionMatrix * viewMatrix * vec4(vWorld, 1.0);
}
`;
const BOX_FRAGMENT = `
in vec2 vFace;
flat in vec4 vPaint;
void main() {
  vec2 fromEdge = min(vFace, 1.0 - vFace) / max(fwidth(vFace), vec2(1e-6));
  float edge = 1.0 - smoothstep(1.0, 2.2, min(fromEdge.x, fromEdge.y));
  pixel = vec4(vPaint.rgb, vPaint.a * mix(0.1, 0.95, edge));
}
`;
const LABEL_VERTEX = `
in vec3 position;
uniform vec3 labelPlace;
uniform vec4 labelSize;  // width and height [px], and those of the picture
out vec3 vWorld;
out vec2 vText;
void main() {
  vWorld = labelPlace;
  vText = position.xy + 0.5;
  gl_Position = projectionMatrix * viewMatrix * vec4(labelPlace, 1.0);
  gl_Position.xy += (position.xy + vec2(0.0, 0.5)) * labelSize.xy / labelSize.zw * 2.0 * gl_Position.w;
}
`;
const LABEL_FRAGMENT = `
in vec2 vText;
uniform sampler2D labelText;
void main() { pixel = texture(labelText, vText); }
`;

const ROUTE = { colour: "#2f8dff", width: 1.3, opacity: 0.8 };
const INTENTION = { colour: "#ffb000", width: 0.6, opacity: 0.8 };
const SHARED_COLOUR = "#ffb000";
const DEFAULT_HEIGHT_M = 1.6;
const GHOST_OPACITY = 0.45;
const MOST_LABELS = 8;
const LABEL_RANGE_M = 90;
const TURN = { window: 22, least: 0.6, ahead: 120, sign: 5 }; // [m], [rad], [m], [m]: a bend that is told, from where, and how high

function parseColour(text) {
  return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255);
}

/** Ribbons along lines, as one mesh. */
class Ribbons {
  constructor(material, order, z) {
    Object.assign(this, { z, geometry: new THREE.BufferGeometry() });
    this.mesh = new THREE.Mesh(this.geometry, material);
    this.mesh.frustumCulled = false;
    this.mesh.matrixAutoUpdate = false;
    this.mesh.renderOrder = order;
    this.mesh.visible = false;
  }

  /** lines: [{ points: [[x, y], ...], colour, width, opacity }]. */
  set(lines) {
    const usable = lines.filter(({ points }) => points.length > 1);
    const corners = usable.reduce((sum, { points }) => sum + 6 * (points.length - 1), 0);
    this.mesh.visible = corners > 0;
    if (!corners) return;
    if (!this.room || this.room < corners) this.makeRoom(Math.max(2 * corners, 600));
    this.at = 0;
    for (const line of usable) this.add(line);
    for (const name of ["position", "ribbon", "colour"]) this.geometry.attributes[name].needsUpdate = true;
    this.geometry.setDrawRange(0, corners);
  }

  makeRoom(corners) {
    this.room = corners;
    this.geometry.dispose();
    for (const [name, size] of [["position", 3], ["ribbon", 4], ["colour", 3]]) {
      const attribute = new THREE.BufferAttribute(new Float32Array(size * corners), size);
      attribute.setUsage(THREE.DynamicDrawUsage);
      this.geometry.setAttribute(name, attribute);
    }
  }

  add({ points, colour, width, opacity }) {
    const rgb = parseColour(colour);
    const sides = points.map((point, i) => {
      const [before, after] = [points[Math.max(i - 1, 0)], points[Math.min(i + 1, points.length - 1)]];
      const [dx, dy] = [after[0] - before[0], after[1] - before[1]];
      const size = Math.hypot(dx, dy) || 1;
      return [(-dy / size) * (width / 2), (dx / size) * (width / 2)];
    });
    let along = 0;
    for (let i = 1; i < points.length; i++) {
      const next = along + Math.hypot(points[i][0] - points[i - 1][0], points[i][1] - points[i - 1][1]);
      const corner = (j, side) => this.put(points[j], sides[j], side, j === i ? next : along, width, opacity, rgb);
      corner(i - 1, 1);
      corner(i - 1, -1);
      corner(i, -1);
      corner(i - 1, 1);
      corner(i, -1);
      corner(i, 1);
      along = next;
    }
  }

  put([x, y], [sx, sy], side, along, width, opacity, rgb) {
    const { position, ribbon, colour } = this.geometry.attributes;
    position.array.set([x + side * sx, y + side * sy, this.z], 3 * this.at);
    ribbon.array.set([along, side, width, opacity], 4 * this.at);
    colour.array.set(rgb, 3 * this.at++);
  }
}

/** Texts above places, of one size on the screen; the nearest ones only. */
class Labels3D {
  constructor(maker, group) {
    Object.assign(this, { maker, group, pool: [], textures: new Map() });
    this.geometry = new THREE.BufferGeometry();
    const corners = new Float32Array([-0.5, -0.5, 0, 0.5, -0.5, 0, 0.5, 0.5, 0, -0.5, -0.5, 0, 0.5, 0.5, 0, -0.5, 0.5, 0]);
    this.geometry.setAttribute("position", new THREE.BufferAttribute(corners, 3));
  }

  /** labels: [{ text, colour, x, y, z, large? }]; size of the picture [px], pixels of a px of the style sheet. */
  show(labels, view, [width, height], ratio) {
    const near = labels.map((label) => ({ ...label, away: view.distance(label) })).filter((label) => label.large || label.away < LABEL_RANGE_M);
    near.sort((a, b) => a.away - b.away);
    const shown = near.slice(0, MOST_LABELS);
    while (this.pool.length < shown.length) this.pool.push(this.makeMesh());
    this.pool.forEach((mesh, i) => {
      mesh.visible = i < shown.length;
      if (!mesh.visible) return;
      const { x, y, z } = shown[i];
      const { texture, size } = this.getTexture(shown[i], ratio);
      const { labelPlace, labelSize, labelText } = mesh.material.uniforms;
      labelPlace.value.set(x, y, z);
      labelSize.value.set(...size, width, height);
      labelText.value = texture;
    });
  }

  hide() {
    for (const mesh of this.pool) mesh.visible = false;
  }

  makeMesh() {
    const own = { labelPlace: { value: new THREE.Vector3() }, labelSize: { value: new THREE.Vector4() }, labelText: { value: null } };
    const options = { transparent: true, depthTest: false, depthWrite: false, side: THREE.DoubleSide };
    const material = this.maker.make(LABEL_VERTEX, LABEL_FRAGMENT, {}, { ...options, uniforms: { ...this.maker.uniforms, ...own } });
    const mesh = new THREE.Mesh(this.geometry, material);
    mesh.frustumCulled = false;
    mesh.renderOrder = ORDER.labels;
    this.group.add(mesh);
    return mesh;
  }

  getTexture({ text, colour, large }, ratio) {
    const key = `${text}\n${colour}\n${ratio}\n${large}`;
    if (!this.textures.has(key)) {
      if (this.textures.size > 64) this.forget();
      this.textures.set(key, paintLabel(text, colour, ratio * (large ? 2.2 : 1)));
    }
    return this.textures.get(key);
  }

  forget() {
    for (const { texture } of this.textures.values()) texture.dispose();
    this.textures.clear();
  }
}

function paintLabel(text, colour, ratio) {
  const canvas = document.createElement("canvas");
  const font = `600 ${13 * ratio}px system-ui, sans-serif`;
  let ctx = canvas.getContext("2d");
  ctx.font = font;
  [canvas.width, canvas.height] = [Math.ceil(ctx.measureText(text).width + 14 * ratio), Math.ceil(21 * ratio)];
  ctx = canvas.getContext("2d");
  ctx.fillStyle = "rgba(14, 18, 24, 0.78)";
  ctx.beginPath();
  ctx.roundRect(0, 0, canvas.width, canvas.height, 5 * ratio);
  ctx.fill();
  ctx.font = font;
  ctx.textBaseline = "middle";
  ctx.textAlign = "center";
  ctx.fillStyle = colour;
  ctx.fillText(text, canvas.width / 2, canvas.height / 2 + ratio / 2);
  const texture = new THREE.CanvasTexture(canvas);
  texture.minFilter = texture.magFilter = THREE.LinearFilter;
  texture.generateMipmaps = false;
  return { texture, size: [canvas.width, canvas.height] };
}

/** Bends of a route that a driver is told of: [{ at, x, y, turn }], `at` in metres along the route. */
function findTurns(points) {
  const along = [0];
  for (let i = 1; i < points.length; i++) along.push(along[i - 1] + Math.hypot(points[i][0] - points[i - 1][0], points[i][1] - points[i - 1][1]));
  const heading = (i) => Math.atan2(points[i + 1][1] - points[i][1], points[i + 1][0] - points[i][0]);
  const turns = [];
  for (let i = 0; i + 2 < points.length; i++) {
    let j = i + 1;
    while (j + 2 < points.length && along[j] - along[i] < TURN.window) j++;
    const change = wrapped(heading(j) - heading(i));
    if (Math.abs(change) < TURN.least) continue;
    let middle = i;
    while (Math.abs(wrapped(heading(middle) - heading(i))) < Math.abs(change) / 2) middle++;
    turns.push({ at: along[middle], x: points[middle][0], y: points[middle][1], turn: change > 0 ? "left" : "right" });
    while (i + 2 < points.length && along[i] < along[j]) i++;
  }
  return { turns, along };
}

function wrapped(angle) {
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}

class OverlayLayer {
  constructor(scene, maker, group) {
    const through = { transparent: true, depthTest: false, depthWrite: false, side: THREE.DoubleSide };
    this.shown = { route: [], shared: [], intentions: [], ghosts: [] };
    this.route = new Ribbons(maker.make(RIBBON_VERTEX, RIBBON_FRAGMENT, {}, { ...through, depthTest: true }), ORDER.ribbons, 0);
    this.intentions = new Ribbons(maker.make(RIBBON_VERTEX, RIBBON_FRAGMENT, { THROUGH: 1 }, through), ORDER.overlays, 0.05);
    this.boxes = new InstancedModel([unitBox()], [maker.make(BOX_VERTEX, BOX_FRAGMENT, {}, through)], ORDER.overlays);
    const ghost = maker.make(USER_VERTEX, USER_FRAGMENT, {}, { transparent: true });
    this.ghostModels = new Map();
    for (const [name, parts] of Object.entries(scene.models)) this.ghostModels.set(name, new InstancedModel(parts, [ghost], ORDER.ghosts));
    this.labels = new Labels3D(maker, group);
    const ghosts = [...this.ghostModels.values()].flatMap((model) => model.meshes);
    group.add(this.route.mesh, this.intentions.mesh, ...this.boxes.meshes, ...ghosts);
    this.boxes.finish();
    this.setGhosts([]);
    Object.assign(this, { turns: [], sharedLabels: [], ghostLabels: [], intentionLabels: [] });
  }

  set(overlays) {
    const { shown } = this;
    for (const name of Object.keys(overlays)) if (!(name in shown)) throw new Error(`View3D.setOverlays: unknown overlay ${name}`);
    const setters = { route: this.setRoute, shared: this.setShared, intentions: this.setIntentions, ghosts: this.setGhosts };
    for (const [name, value] of Object.entries(overlays)) {
      if (value === shown[name]) continue;
      shown[name] = value;
      setters[name].call(this, value ?? []);
    }
  }

  setRoute(points) {
    this.route.set([{ points, ...ROUTE }]);
    Object.assign(this, points.length > 2 ? findTurns(points) : { turns: [] });
    this.points = points;
  }

  setIntentions(list) {
    this.intentions.set(list.map(({ path, colour }) => ({ ...INTENTION, points: path, ...(colour && { colour }) })));
    this.intentionLabels = list.filter(({ from, path }) => from && path.length).map(({ from, path, colour }) => {
      const [x, y] = path.at(-1);
      return { text: from, colour: colour ?? INTENTION.colour, x, y, z: 0.3 };
    });
  }

  setShared(list) {
    this.boxes.clear();
    this.sharedLabels = [];
    for (const { x, y, yaw, length, width, height = DEFAULT_HEIGHT_M, from, colour = SHARED_COLOUR } of list) {
      const [red, green, blue] = parseColour(colour);
      this.boxes.add({ x, y, z: 0, cos: Math.cos(yaw), sin: Math.sin(yaw), length, width, height, lamps: 0, red, green, blue });
      if (from) this.sharedLabels.push({ text: from, colour, x, y, z: height + 0.3 });
    }
    this.boxes.finish();
  }

  setGhosts(list) {
    for (const model of this.ghostModels.values()) model.clear();
    this.ghostLabels = [];
    for (const { model, paint, size, x, y, yaw, label } of list) {
      const [length, width, height] = size;
      const [red, green, blue] = paint.map((value) => value / 255);
      const place = { x, y, z: 0, cos: Math.cos(yaw), sin: Math.sin(yaw), length, width, height, lamps: 0, red, green, blue };
      this.ghostModels.get(model).add(place, GHOST_OPACITY);
      if (label) this.ghostLabels.push({ text: label, colour: "#ffffff", x, y, z: height + 0.3 });
    }
    for (const model of this.ghostModels.values()) model.finish();
  }

  /** Labels of a picture; mirrors and images of cameras have none. */
  showLabels(view, pose, size, ratio) {
    this.labels.show([...this.listTurns(pose), ...this.sharedLabels, ...this.ghostLabels, ...this.intentionLabels], view, size, ratio);
  }

  /** The next bend of the route, if it is near: an arrow above the road. */
  listTurns({ x, y }) {
    if (!this.turns.length) return [];
    let nearest = 0;
    let least = Infinity;
    this.points.forEach(([px, py], i) => {
      const away = Math.hypot(px - x, py - y);
      if (away < least) [least, nearest] = [away, i];
    });
    const next = this.turns.find(({ at }) => at > this.along[nearest]);
    if (!next || next.at - this.along[nearest] > TURN.ahead) return [];
    return [{ text: next.turn === "left" ? "\u21b0" : "\u21b1", colour: "#7db8ff", x: next.x, y: next.y, z: TURN.sign, large: true }];
  }
}

function unitBox() {
  const positions = [];
  const face = (a, b, c, d) => positions.push(...a, ...b, ...c, ...a, ...c, ...d);
  const h = 0.5;
  const [a, b, c, d] = [[-h, -h, 0], [h, -h, 0], [h, h, 0], [-h, h, 0]];
  const [e, f, g, k] = [a, b, c, d].map(([x, y]) => [x, y, 1]);
  face(e, f, g, k);
  face(a, b, f, e);
  face(b, c, g, f);
  face(c, d, k, g);
  face(d, a, e, k);
  return { colour: [255, 255, 255], material: 0, layer: 0, positions };
}
