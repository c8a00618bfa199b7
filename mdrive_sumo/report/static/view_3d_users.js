// Road users and the lamps of traffic lights as instances of models: one draw call for each model in sight.

const INSTANCE_FLOATS = 13; // place 3, opacity, size 3, lamps, cosine and sine of the yaw, paint 3
const LEAST_ROOM = 64;

/** A model in its unit box, drawn as often as there are instances. */
class InstancedModel {
  constructor(parts, materials, order) {
    const builder = new MeshBuilder();
    parts.forEach((part, number) => {
      for (let at = 0; at < part.positions.length; at += 9) builder.add({ ...part, layer: number }, at);
    });
    this.geometry = builder.fill(new THREE.InstancedBufferGeometry());
    this.meshes = materials.map((material) => {
      const mesh = new THREE.Mesh(this.geometry, material);
      mesh.frustumCulled = false;
      mesh.matrixAutoUpdate = false;
      mesh.renderOrder = order;
      return mesh;
    });
    this.count = 0;
    this.makeRoom(LEAST_ROOM);
  }

  makeRoom(instances) {
    const before = this.values;
    this.values = new Float32Array(INSTANCE_FLOATS * instances);
    if (before) this.values.set(before);
    this.geometry.dispose(); // the buffer of the smaller array
    this.buffer = new THREE.InstancedInterleavedBuffer(this.values, INSTANCE_FLOATS);
    this.buffer.setUsage(THREE.DynamicDrawUsage);
    const columns = { place: [4, 0], size: [4, 4], turn: [2, 8], paint: [3, 10] };
    for (const [name, [count, first]] of Object.entries(columns)) {
      this.geometry.setAttribute(name, new THREE.InterleavedBufferAttribute(this.buffer, count, first));
    }
  }

  clear() {
    this.count = 0;
  }

  add(user, opacity = 1) {
    if (INSTANCE_FLOATS * this.count === this.values.length) this.makeRoom(2 * this.count);
    const { x, y, z, cos, sin, length, width, height, lamps, red, green, blue } = user;
    const { values } = this;
    let at = INSTANCE_FLOATS * this.count++;
    values[at++] = x;
    values[at++] = y;
    values[at++] = z;
    values[at++] = opacity;
    values[at++] = length;
    values[at++] = width;
    values[at++] = height;
    values[at++] = lamps;
    values[at++] = cos;
    values[at++] = sin;
    values[at++] = red;
    values[at++] = green;
    values[at] = blue;
  }

  finish() {
    this.geometry.instanceCount = this.count;
    for (const mesh of this.meshes) mesh.visible = this.count > 0;
    if (this.count) this.buffer.needsUpdate = true;
  }
}

/** All road users, and for each picture those that are in it. */
class RoadUserLayer {
  constructor(scene, materials, group, farShare) {
    this.scene = scene;
    this.farM = farShare * scene.far_m_of_focal; // for each pixel of the focal length
    this.users = new Map(); // index -> road user
    this.models = new Map();
    for (const [name, parts] of Object.entries(scene.models)) {
      const model = new InstancedModel(parts, [materials.users], ORDER.users);
      this.models.set(name, model);
      group.add(...model.meshes);
    }
    this.signals = scene.lamps.names.map((name, i) => this.makeSignal(name, i));
  }

  makeSignal(name, i) {
    const { place, turn, size } = this.scene.lamps;
    const cut = name.lastIndexOf(":");
    const [x, y, base] = place[i];
    const [length, width, height] = size;
    const lamp = { model: "lamp", x, y, z: base, base, cos: turn[i][0], sin: turn[i][1], length, width, height, lamps: 0, radius: 1 };
    return { tls: name.slice(0, cut), index: Number(name.slice(cut + 1)), lit: false, lamp };
  }

  /** states: SUMO's letters by the id of the traffic light. */
  setSignals(states) {
    for (const signal of this.signals) {
      const letters = states[signal.tls];
      if (letters === undefined) continue;
      const look = this.scene.lamps.of_letter[letters[signal.index]];
      signal.lit = Boolean(look);
      if (!look) continue;
      const [height, red, green, blue] = look;
      Object.assign(signal.lamp, { z: signal.lamp.base + height, red: red / 255, green: green / 255, blue: blue / 255 });
    }
  }

  place(index, model, paint, size, x, y, yaw, lamps = 0) {
    let user = this.users.get(index);
    if (!user || user.model !== model) {
      if (!this.models.has(model)) throw new Error(`View3D.place: unknown model ${model}`);
      user = { z: 0, model };
      this.users.set(index, user);
    }
    [user.length, user.width, user.height] = size;
    [user.red, user.green, user.blue] = [paint[0] / 255, paint[1] / 255, paint[2] / 255];
    user.x = x;
    user.y = y;
    user.cos = Math.cos(yaw);
    user.sin = Math.sin(yaw);
    user.lamps = lamps;
    user.radius = Math.hypot(size[0], size[1]) / 2;
  }

  remove(index) {
    this.users.delete(index);
  }

  /** Prepares the instances for a picture, and what they add to it. own: index of the followed road user. */
  select(view, own, effects) {
    for (const model of this.models.values()) model.clear();
    const farM = this.farM * view.focalPx;
    for (const [index, user] of this.users) {
      const isOwn = index === own;
      if ((isOwn && view.hidesOwn) || !view.mayShow(user)) continue;
      const far = view.distance(user) > farM && this.models.get(`far ${user.model}`);
      (far || this.models.get(user.model)).add(user);
      effects.add(user, view, isOwn);
    }
    const lamps = this.models.get("lamp");
    for (const { lit, lamp } of this.signals) if (lit && view.mayShow(lamp)) lamps.add(lamp);
    for (const model of this.models.values()) model.finish();
  }
}
