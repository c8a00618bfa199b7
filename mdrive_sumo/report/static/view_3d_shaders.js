// Materials of the 3-D view: the colours and the light of `sensing/camera/shaders.py`, for WebGL 2.

const ORDER = { solids: 0, users: 1, ground: 2, terrain: 3, sky: 4, shadows: 5, ribbons: 6, glows: 7, ghosts: 8, overlays: 9, rain: 10, labels: 11 };

const GLSL_HEAD = `
precision highp float;
uniform vec3 eye;
uniform vec4 beamFrom;    // lowest middle point of the own car; w: whether its head lamps shine
uniform vec2 beamAlong;
uniform vec3 toSun, sun, ambient, horizon, zenith;
uniform float fog, wet, lamps, seconds;
`;

const GLSL_PUT = `
uniform mat4 projectionMatrix, viewMatrix, modelMatrix;
// Nothing lies below the ground: it is behind all solids, and its upper layers before its lower ones, by constants.
vec4 put(vec3 world, float layer) {
  vec4 clip = projectionMatrix * viewMatrix * vec4(world, 1.0);
  clip.z = layer < 0.0 ? 0.99 * clip.z - 0.01 * clip.w : (0.99 + 0.001 * layer) * clip.w - 0.05;
  return clip;
}
vec3 findLight(vec3 facing) {
  return ambient + sun * max(dot(facing, toSun), 0.0) + 0.12 * ambient * facing.z;
}
`;

const GLSL_SEEN = `
in vec3 vWorld;
out vec4 pixel;
uniform sampler2D noise;
float findBeam(vec3 world) {
  vec2 step = world.xy - beamFrom.xy;
  float along = dot(step, beamAlong) - 2.0, aside = abs(step.x * beamAlong.y - step.y * beamAlong.x);
  float cone = clamp(1.3 - aside / max(0.35 * along + 1.5, 0.1), 0.0, 1.0);
  float near = max(1.0 - along / 110.0, 0.0);
  return along > 0.0 ? beamFrom.w * cone * near * near * smoothstep(0.0, 4.0, along) : 0.0;
}
vec3 fade(vec3 seen, float away) {
  float clear = max(1.0 - away * fog / 16.0, 0.0);  // (1 - x / 16)^16 is nearly exp(-x), and needs no table
  clear *= clear;
  clear *= clear;
  clear *= clear;
  clear *= clear;
  return mix(horizon, seen, clear);
}
`;

const SURFACE_VERTEX = `
in vec3 position, normal, colour;
in vec2 kind;
out vec3 vWorld;
flat out vec3 vShown, vBase;
flat out float vRough;
#ifdef FACADE
out vec2 vWall;
flat out float vTone;
#endif
void main() {
  vec3 world = (modelMatrix * vec4(position, 1.0)).xyz;
  vWorld = world;
  gl_Position = put(world, kind.y > 0.0 ? kind.y : -1.0);
  vRough = kind.x == ROUGH_MATERIAL ? 1.0 : 0.0;
  vec3 base = colour * (1.0 - wet * vRough);
  vBase = base * vec3(0.75, 0.73, 0.66);
  vShown = base * findLight(normal);
#ifdef FACADE
  vWall = vec2(dot(world.xy, vec2(-normal.y, normal.x)) / 3.0, world.z / 3.3);
  vTone = findLight(normal).g;
#endif
}
`;

const SURFACE_FRAGMENT = `
flat in vec3 vShown, vBase;
flat in float vRough;
// Noise of a cell (Jimenez 2014, "Next generation post processing in Call of Duty").
float vary(vec2 at) {
  return fract(52.9829189 * fract(dot(floor(at), vec2(0.06711056, 0.00583715))));
}
#ifdef FACADE
in vec2 vWall;
flat in float vTone;
float findPane(vec2 wall) {
#ifdef LOW
  vec2 pane = abs(fract(wall) - vec2(0.5, 0.575));
  return max(pane.x - 0.22, pane.y - 0.225) < 0.0 ? 1.0 : 0.0;
#else
  vec2 at = abs(fract(wall) - vec2(0.5, 0.575)), soft = fwidth(wall) + 0.001;
  vec2 inside = clamp((vec2(0.22, 0.225) - at) / soft + 0.5, 0.0, 1.0);
  float near = clamp(0.5 / max(soft.x, soft.y) - 0.5, 0.0, 1.0);  // farther, a mean of wall and windows
  return mix(0.2, inside.x * inside.y, near);
#endif
}
#endif
void main() {
  float away = distance(vWorld, eye);
  vec3 seen = vShown;
  if (lamps > 0.0) seen += vBase * findBeam(vWorld);
#if defined(GROUND) && defined(LOW)
  seen *= 1.0 + vRough * 0.16 * (vary(vWorld.xy * 3.0) - 0.5) * max(1.0 - away / 40.0, 0.0);
#elif defined(GROUND)
  float fine = texture(noise, vWorld.xy * 0.11).r, coarse = texture(noise, vWorld.yx * 0.013).r;
  seen *= 1.0 + vRough * (0.42 * (fine - 0.5) + 0.3 * (coarse - 0.5));
#endif
#ifdef FACADE
  vec3 glass = vec3(0.25, 0.31, 0.38) * vTone;
#ifndef LOW
  glass *= 0.8 + 0.4 * vary(vWall + 11.0);
#endif
  if (lamps > 0.0 && vary(vWall + 37.0) > 0.7) glass += vec3(0.5, 0.4, 0.2) * (0.6 + 0.4 * vary(vWall + 5.0));
  seen *= 0.82 + 0.18 * smoothstep(0.0, 1.1, vWall.y);
  seen = mix(seen, glass, findPane(vWall));
#endif
  pixel = vec4(fade(seen, away), 1.0);
}
`;

const USER_VERTEX = `
in vec3 position, normal, colour;
in vec2 kind;
in vec4 place, size;   // place: x, y, z [m], opacity; size: length, width, height [m], lamps
in vec2 turn;
in vec3 paint;
out vec3 vWorld;
flat out vec3 vShown, vBase;
flat out float vStripes, vOpacity;
vec3 rotate(vec3 v) {
  return vec3(turn.x * v.x - turn.y * v.y, turn.y * v.x + turn.x * v.y, v.z);
}
bool isLit(float lamp) {
  return mod(floor(size.w / lamp), 2.0) > 0.5;
}
vec3 findGlow(float material) {
  bool blinks = fract(seconds * 1.5) < 0.5;  // 90 a minute, the middle of what UN Regulation 48, 6.5.9 allows
  if (material == SIGNAL_MATERIAL) return paint;
  if (material == BRAKE_LAMP_MATERIAL) return isLit(1.0) ? vec3(1.0, 0.13, 0.08) : vec3(0.0);
  if (material == LEFT_INDICATOR_MATERIAL) return isLit(2.0) && blinks ? vec3(1.0, 0.62, 0.06) : vec3(0.0);
  if (material == RIGHT_INDICATOR_MATERIAL) return isLit(4.0) && blinks ? vec3(1.0, 0.62, 0.06) : vec3(0.0);
  if (material == HEADLAMP_MATERIAL) return lamps * vec3(1.0, 0.98, 0.9);
  if (material == TAIL_LAMP_MATERIAL) return isLit(1.0) ? vec3(1.0, 0.13, 0.08) : lamps * vec3(0.6, 0.05, 0.04);
  return vec3(0.0);
}
void main() {
  vec3 facing = normalize(rotate(normal / size.xyz));
  // A part lies 1 mm above the part before it: number plates are in the plane of what they are fixed to.
  vec3 world = place.xyz + rotate(position * size.xyz) + 0.001 * kind.y * facing;
  vWorld = world;
  gl_Position = put(world, -1.0);
  vec3 base = kind.x == PAINT_MATERIAL || kind.x == SIGNAL_MATERIAL ? paint : colour;
  vShown = base * findLight(facing);
  vBase = base * vec3(0.75, 0.73, 0.66);
  vec3 glow = findGlow(kind.x);
  if (glow.r > 0.0) {
    vShown = glow;
    vBase = vec3(0.0);
  }
  vStripes = kind.x == STRIPES_MATERIAL ? 1.0 : 0.0;
  vOpacity = place.w;
}
`;

const USER_FRAGMENT = `
flat in vec3 vShown, vBase;
flat in float vStripes, vOpacity;
void main() {
  float away = distance(vWorld, eye);
  vec3 seen = vShown;
  if (lamps > 0.0) seen += vBase * findBeam(vWorld);
  if (vStripes > 0.5) seen *= fract((vWorld.x + vWorld.y + vWorld.z) * 1.6) < 0.5 ? vec3(0.92, 0.22, 0.17) : vec3(1.0);
  pixel = vec4(fade(seen, away), vOpacity);
}
`;

const SKY_VERTEX = `
in vec3 position;
uniform mat3 rays;
out vec3 vWorld;
void main() {
  vWorld = rays * vec3(1.0, position.xy);
  gl_Position = vec4(position.xy, 1.0, 1.0);
}
`;

const SKY_FRAGMENT = `
void main() {
  vec3 ray = normalize(vWorld);
  float up = clamp(ray.z * 2.2, 0.0, 1.0);
  vec3 seen = mix(horizon, zenith, sqrt(up));
#ifndef LOW
  float glare = max(dot(ray, toSun), 0.0);
  seen += sun * (0.25 * pow(glare, 24.0) + smoothstep(0.9994, 0.9998, glare)) * exp(-600.0 * fog);
#endif
  pixel = vec4(seen, 1.0);
}
`;

/** Uniforms that all materials share, by the names of the shaders. */
function buildUniforms() {
  const vector = () => ({ value: new THREE.Vector3() });
  const number = () => ({ value: 0 });
  return {
    eye: vector(), toSun: vector(), sun: vector(), ambient: vector(), horizon: vector(), zenith: vector(),
    fog: number(), wet: number(), lamps: number(), seconds: number(),
    beamFrom: { value: new THREE.Vector4() }, beamAlong: { value: new THREE.Vector2(1, 0) },
    rays: { value: new THREE.Matrix3() }, noise: { value: buildNoise() },
  };
}

/** Makes the materials of the view; their shaders know the numbers of `meshes.Material`. */
class MaterialMaker {
  constructor(scene, uniforms, quality) {
    this.uniforms = uniforms;
    const numbers = Object.entries(scene.materials);
    this.common = quality === "low" ? { LOW: 1 } : {};
    this.numbers = Object.fromEntries(numbers.map(([name, number]) => [`${name.toUpperCase()}_MATERIAL`, `${number}.0`]));
  }

  make(vertex, fragment, defines = {}, options = {}) {
    return new THREE.RawShaderMaterial({
      glslVersion: THREE.GLSL3,
      uniforms: this.uniforms,
      defines: { ...this.numbers, ...this.common, ...defines },
      vertexShader: GLSL_HEAD + GLSL_PUT + vertex,
      fragmentShader: GLSL_HEAD + GLSL_SEEN + fragment,
      ...options,
    });
  }

  surface(defines) {
    return this.make(SURFACE_VERTEX, SURFACE_FRAGMENT, defines);
  }
}

/** A tile of smooth noise that repeats: what passes by shows a driver the own speed. Same numbers every time. */
function buildNoise() {
  const side = 128;
  const texels = new Uint8Array(side * side);
  let state = 12345;
  for (let i = 0; i < texels.length; i++) {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0; // Numerical Recipes' generator
    texels[i] = state >>> 24;
  }
  const texture = new THREE.DataTexture(texels, side, side, THREE.RedFormat);
  texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
  texture.magFilter = THREE.LinearFilter;
  texture.minFilter = THREE.LinearMipmapLinearFilter;
  texture.generateMipmaps = true;
  texture.unpackAlignment = 1;
  texture.needsUpdate = true;
  return texture;
}
