// What light and weather add: shadows below road users, glare of lamps, light on the road, rain.

const EFFECT_VERTEX = `
in vec3 position;
in vec4 place, size;
in vec2 turn;
in vec3 paint;
out vec3 vWorld;
out vec2 vCorner;
flat out vec4 vPaint;
void main() {
  vCorner = position.xy;
  vPaint = vec4(paint, place.w);
#ifdef FACING
  vec3 right = vec3(viewMatrix[0].x, viewMatrix[1].x, viewMatrix[2].x), up = vec3(viewMatrix[0].y, viewMatrix[1].y, viewMatrix[2].y);
  vec3 world = place.xyz + size.x * (position.x * right + position.y * up);
  vWorld = world;
  gl_Position = put(world, -1.0);
#else
  vec2 at = position.xy * size.xy;
  vec3 world = vec3(place.xy + vec2(turn.x * at.x - turn.y * at.y, turn.y * at.x + turn.x * at.y), 0.0);
  vWorld = world;
  gl_Position = put(world, LAYER);
#endif
}
`;

const SHADOW_FRAGMENT = `
in vec2 vCorner;
flat in vec4 vPaint;
void main() {
  vec2 inside = clamp((1.0 - abs(vCorner) * 2.0) * 4.0, 0.0, 1.0);
  pixel = vec4(0.0, 0.0, 0.0, vPaint.a * inside.x * inside.y);
}
`;

const GLOW_FRAGMENT = `
in vec2 vCorner;
flat in vec4 vPaint;
void main() {
  float strength = max(1.0 - 2.0 * length(vCorner), 0.0);
  strength *= strength;
  float clear = exp(-distance(vWorld, eye) * fog);
  pixel = vec4(vPaint.rgb * vPaint.a * strength * clear, 1.0);
}
`;

const POOL_FRAGMENT = `
in vec2 vCorner;
flat in vec4 vPaint;
void main() {
  float along = vCorner.x + 0.5, wide = 0.12 + 0.38 * along;
  float strength = clamp(1.0 - abs(vCorner.y) / wide, 0.0, 1.0) * smoothstep(0.0, 0.12, along) * (1.0 - along) * (1.0 - along);
  pixel = vec4(vPaint.rgb * vPaint.a * strength * exp(-distance(vWorld, eye) * fog), 1.0);
}
`;

const RAIN_VERTEX = `
in vec3 position;  // z below 0: the lower end of a streak
out vec3 vWorld;
void main() {
  const vec3 box = vec3(24.0, 24.0, 12.0);
  vec3 drop = vec3(position.xy, abs(position.z)) - vec3(0.0, 0.0, 9.0 * seconds);  // 9 m/s: large drops (Gunn and Kinzer 1949)
  vWorld = eye + mod(drop - eye, box) - box / 2.0 + vec3(0.0, 0.0, position.z < 0.0 ? 0.0 : 0.35);
  gl_Position = projectionMatrix * viewMatrix * vec4(vWorld, 1.0);
}
`;
const RAIN_FRAGMENT = `
void main() { pixel = vec4(horizon * 1.25, 0.22); }
`;
const RAIN_STREAKS = 900;
const HEADLAMP_PAINT = { red: 1, green: 0.97, blue: 0.88 };
const TAIL_LAMP_PAINT = { red: 1, green: 0.1, blue: 0.06 };
const POOL_M = [30, 9]; // length and width of the light that head lamps of others throw on the road

/** Squares in the plane of an instance. */
function makeQuads(material, order) {
  const part = { colour: [255, 255, 255], material: 0, layer: 0 };
  const positions = [-0.5, -0.5, 0, 0.5, -0.5, 0, 0.5, 0.5, 0, -0.5, -0.5, 0, 0.5, 0.5, 0, -0.5, 0.5, 0];
  return new InstancedModel([{ ...part, positions }], [material], order);
}

class EffectLayer {
  constructor(maker, group) {
    const blended = { transparent: true, depthWrite: false, side: THREE.DoubleSide };
    const added = { ...blended, blending: THREE.AdditiveBlending };
    this.shadows = makeQuads(maker.make(EFFECT_VERTEX, SHADOW_FRAGMENT, { LAYER: "0.4" }, blended), ORDER.shadows);
    this.pools = makeQuads(maker.make(EFFECT_VERTEX, POOL_FRAGMENT, { LAYER: "0.3" }, added), ORDER.shadows);
    this.glows = makeQuads(maker.make(EFFECT_VERTEX, GLOW_FRAGMENT, { FACING: 1 }, added), ORDER.glows);
    this.rain = makeRain(maker.make(RAIN_VERTEX, RAIN_FRAGMENT, {}, blended));
    group.add(...this.shadows.meshes, ...this.pools.meshes, ...this.glows.meshes, this.rain);
    this.square = { z: 0, lamps: 0, height: 1 };
  }

  begin(light, isRaining) {
    this.light = light;
    this.rain.visible = isRaining;
    for (const layer of [this.shadows, this.pools, this.glows]) layer.clear();
  }

  finish() {
    for (const layer of [this.shadows, this.pools, this.glows]) layer.finish();
  }

  /** What a road user in sight adds to the picture. */
  add(user, view, isOwn) {
    const { light, square } = this;
    Object.assign(square, { x: user.x, y: user.y, z: 0, cos: user.cos, sin: user.sin, length: user.length + 1, width: user.width + 1 });
    this.shadows.add(square, light.sun[0] > 0.1 ? 0.6 : 0.4);
    if (!light.lamps || !HAS_LAMPS.has(user.model)) return;
    if (!isOwn) this.addLamps(user, view);
  }

  addLamps(user, view) {
    const { light, square } = this;
    const isDark = light.ambient[0] < 0.4;
    const ahead = (view.x - user.x) * user.cos + (view.y - user.y) * user.sin;
    const away = view.distance(user);
    if (isDark) {
      const reach = user.length / 2 + POOL_M[0] / 2;
      Object.assign(square, { x: user.x + user.cos * reach, y: user.y + user.sin * reach, length: POOL_M[0], width: POOL_M[1], ...HEADLAMP_PAINT });
      this.pools.add(square, 0.3);
    }
    if (Math.abs(ahead) < user.length / 2) return;
    const isFront = ahead > 0;
    const brakes = user.lamps & 1;
    const facing = Math.abs(ahead) / Math.max(away, 1);
    const strength = (isFront ? 0.9 : brakes ? 0.9 : 0.4) * facing * (isDark ? 1 : 0.5);
    const paint = isFront ? HEADLAMP_PAINT : TAIL_LAMP_PAINT;
    const radius = (isFront ? 0.9 : brakes ? 0.8 : 0.5) + 0.006 * away;
    const along = (isFront ? 1 : -1) * (user.length / 2 + 0.08);
    for (const side of user.width < 1 ? [0] : [-0.36, 0.36]) {
      const across = side * user.width;
      square.x = user.x + user.cos * along - user.sin * across;
      square.y = user.y + user.sin * along + user.cos * across;
      Object.assign(square, { z: 0.7, length: radius, ...paint });
      this.glows.add(square, strength);
    }
    square.z = 0;
  }
}

const HAS_LAMPS = new Set(["car", "van", "truck", "bus", "motorcycle", "cyclist"]);

function makeRain(material) {
  const positions = new Float32Array(6 * RAIN_STREAKS);
  let state = 1;
  const draw = () => (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) / 2 ** 32;
  for (let i = 0; i < RAIN_STREAKS; i++) {
    const [x, y, z] = [24 * draw(), 24 * draw(), 0.01 + 12 * draw()];
    positions.set([x, y, z, x, y, -z], 6 * i);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  const rain = new THREE.LineSegments(geometry, material);
  rain.frustumCulled = false;
  rain.matrixAutoUpdate = false;
  rain.renderOrder = ORDER.rain;
  return rain;
}
