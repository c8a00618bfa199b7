// The packed scene of `report/scene_3d.py`, unpacked, and its meshes. Lengths in m, relative to the scene's origin; z up.

const CHUNK_M = 128; // side of the squares by which triangles are drawn or left out

/** Unpacks what `pack_scene` wrote: header, parts of the static scene, and models in unit boxes. */
async function decodeScene(buffer) {
  const isPacked = new DataView(buffer).getUint16(0) === 0x1f8b; // else a server's header has made the browser unpack it
  const stream = isPacked && new Blob([buffer]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = stream ? await new Response(stream).arrayBuffer() : buffer;
  const size = new DataView(bytes).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, size)));
  const tables = readTables(bytes, 4 + size, header.tables);
  const { steps_per_m: steps } = header;
  const parts = readParts(header.parts, tables.vertices, tables.corners, steps);
  const counts = Object.entries(header.models.parts);
  const modelParts = readParts(counts.flatMap(([, list]) => list), tables.model_vertices, tables.model_corners, header.models.steps);
  const models = Object.fromEntries(counts.map(([name, list]) => [name, modelParts.splice(0, list.length)]));
  return { ...header, parts, models };
}

/** int32 tables whose rows are stored as steps. */
function readTables(bytes, begin, shapes) {
  const tables = {};
  for (const [name, columns, size] of shapes) {
    const values = new Int32Array(bytes.slice(begin, begin + 4 * size));
    for (let i = 0; i < size; i++) if (i % columns) values[i] += values[i - 1];
    tables[name] = values;
    begin += 4 * size;
  }
  return tables;
}

/** [{ colour, material, layer, positions }]: positions of three corners for each triangle. */
function readParts(counts, vertices, corners, steps) {
  const total = vertices.length / 3;
  let [firstVertex, firstCorner] = [0, 0];
  return counts.map(([red, green, blue, material, layer, vertexCount, cornerCount]) => {
    const positions = new Float32Array(3 * cornerCount);
    let newest = -1;
    for (let i = 0; i < cornerCount; i++) {
      const back = corners[firstCorner + i];
      const vertex = firstVertex + newest + 1 - back;
      if (back === 0) newest++;
      for (let axis = 0; axis < 3; axis++) positions[3 * i + axis] = vertices[axis * total + vertex] / steps;
    }
    firstVertex += vertexCount;
    firstCorner += cornerCount;
    return { colour: [red, green, blue], material, layer, positions };
  });
}

/** Triangles that become one geometry. */
class MeshBuilder {
  constructor() {
    Object.assign(this, { positions: [], normals: [], colours: [], kinds: [] });
  }

  /** Adds a triangle of a part: its corners begin at `at` in the part's positions. */
  add({ colour, material, layer, positions }, at) {
    const normal = findNormal(positions, at);
    for (let corner = 0; corner < 3; corner++) {
      for (let axis = 0; axis < 3; axis++) this.positions.push(positions[at + 3 * corner + axis]);
      this.normals.push(...normal);
      this.colours.push(...colour);
      this.kinds.push(material, layer);
    }
  }

  /** Puts the attributes into a geometry. */
  fill(geometry) {
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(this.positions), 3));
    geometry.setAttribute("normal", new THREE.BufferAttribute(new Float32Array(this.normals), 3));
    geometry.setAttribute("colour", new THREE.BufferAttribute(new Uint8Array(this.colours), 3, true));
    geometry.setAttribute("kind", new THREE.BufferAttribute(new Uint8Array(this.kinds), 2));
    return geometry;
  }
}

function findNormal(p, i) {
  const [ax, ay, az] = [p[i + 3] - p[i], p[i + 4] - p[i + 1], p[i + 5] - p[i + 2]];
  const [bx, by, bz] = [p[i + 6] - p[i], p[i + 7] - p[i + 1], p[i + 8] - p[i + 2]];
  const normal = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
  const size = Math.hypot(...normal) || 1;
  return normal.map((value) => value / size);
}

/** Meshes of what stands still, by surface and square, so that what is out of sight is left out. */
function buildStaticMeshes(scene, materials) {
  const builders = new Map();
  const { facade } = scene.materials;
  for (const part of scene.parts) {
    const surface = part.layer > 0 ? "ground" : part.material === facade ? "facade" : "solid";
    for (let at = 0; at < part.positions.length; at += 9) {
      const [x, y] = [0, 1].map((axis) => part.positions[at + axis] + part.positions[at + axis + 3] + part.positions[at + axis + 6]);
      const key = `${surface} ${Math.floor(x / 3 / CHUNK_M)} ${Math.floor(y / 3 / CHUNK_M)}`;
      if (!builders.has(key)) builders.set(key, { surface, builder: new MeshBuilder() });
      builders.get(key).builder.add(part, at);
    }
  }
  return [...builders.values()].map(({ surface, builder }) => {
    const geometry = builder.fill(new THREE.BufferGeometry());
    geometry.computeBoundingSphere();
    const mesh = new THREE.Mesh(geometry, materials[surface]);
    mesh.renderOrder = surface === "ground" ? ORDER.ground : ORDER.solids;
    mesh.matrixAutoUpdate = false;
    return mesh;
  });
}

/** A square of grass below everything, which follows the camera. */
function buildTerrain(scene, materials) {
  const edges = [-1200, -200, -30, 30, 200, 1200]; // small triangles near the camera, as in `camera_renderer.TERRAIN_M`
  const builder = new MeshBuilder();
  for (let i = 0; i < 5; i++) {
    for (let j = 0; j < 5; j++) {
      const [west, east, south, north] = [edges[i], edges[i + 1], edges[j], edges[j + 1]];
      const positions = [west, south, 0, east, south, 0, east, north, 0, west, south, 0, east, north, 0, west, north, 0];
      const part = { colour: scene.terrain, material: scene.materials.rough, layer: 6, positions };
      builder.add(part, 0);
      builder.add(part, 9);
    }
  }
  const mesh = new THREE.Mesh(builder.fill(new THREE.BufferGeometry()), materials.ground);
  mesh.frustumCulled = false;
  mesh.renderOrder = ORDER.terrain;
  return mesh;
}

/** Walls as segments [x0, y0, x1, y1], by squares: where a camera behind a car may not go. */
class Walls {
  constructor(scene) {
    this.cells = new Map();
    for (const part of scene.parts) {
      if (part.material !== scene.materials.facade) continue;
      for (let at = 0; at < part.positions.length; at += 9) this.addFoot(part.positions, at);
    }
  }

  addFoot(p, at) {
    const low = [0, 3, 6].filter((corner) => p[at + corner + 2] === 0);
    if (low.length !== 2) return;
    const segment = low.flatMap((corner) => [p[at + corner], p[at + corner + 1]]);
    for (const key of this.listCells(...segment)) {
      if (!this.cells.has(key)) this.cells.set(key, []);
      this.cells.get(key).push(segment);
    }
  }

  *listCells(x0, y0, x1, y1) {
    const [west, east] = [Math.min(x0, x1), Math.max(x0, x1)].map((x) => Math.floor(x / WALL_CELL_M));
    const [south, north] = [Math.min(y0, y1), Math.max(y0, y1)].map((y) => Math.floor(y / WALL_CELL_M));
    for (let i = west; i <= east; i++) for (let j = south; j <= north; j++) yield `${i} ${j}`;
  }

  /** The share in (0, 1] of the way from one point to another up to the first wall. */
  findFree(x0, y0, x1, y1) {
    let free = 1;
    for (const key of this.listCells(x0, y0, x1, y1)) {
      for (const [ax, ay, bx, by] of this.cells.get(key) ?? []) {
        const [dx, dy, ex, ey] = [x1 - x0, y1 - y0, bx - ax, by - ay];
        const across = dx * ey - dy * ex;
        if (across === 0) continue;
        const share = ((ax - x0) * ey - (ay - y0) * ex) / across;
        const along = ((ax - x0) * dy - (ay - y0) * dx) / across;
        if (share > 0 && share < free && along >= 0 && along <= 1) free = share;
      }
    }
    return free;
  }
}

const WALL_CELL_M = 32;
