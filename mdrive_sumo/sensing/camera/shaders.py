"""Shaders of the camera renderer: one program for each kind of image and, in colours, for each surface.

Mesa's software renderer computes both sides of every condition, so what differs between surfaces is chosen when a
program is compiled. Light is computed for corners: every triangle has one normal and one colour.
"""

from mdrive_sumo.sensing.camera.camera_model import ImageKind
from mdrive_sumo.sensing.camera.meshes import Material, Surface

VIEW_BLOCK = """
layout(std140) uniform View {
    mat4 clip;
    vec4 eye;       // relative to the scene's origin
    vec4 ahead;     // optical axis; w: how much darker wet ground is
    vec4 ground;    // of the origin in the world, so that patterns stay where they are; w: exposure
    vec4 to_sun;
    vec4 sun;
    vec4 ambient;
    vec4 horizon;   // already exposed; w: fog in each metre
    vec4 zenith;    // already exposed
    vec4 heading;   // of the head lamps
};
"""
VIEW_FLOATS = 16 + 9 * 4
"""Numbers in the block of uniforms of a view: a matrix, and nine vectors of four."""
_DEFINES = """
#define PAINT {paint}u
#define ROUGH {rough}u
#define HEADLAMP {headlamp}u
#define TAIL_LAMP {tail_lamp}u
#define BRAKE_LAMP {brake_lamp}u
#define SIGNAL {signal}u
#define LEFT_INDICATOR {left_indicator}u
#define RIGHT_INDICATOR {right_indicator}u
""".format(**{material.name.lower(): material.value for material in Material})
_VERTEX_INPUTS = """
in vec3 position;
in vec3 normal;
in vec4 colour;
in uvec4 kind;
#ifdef INSTANCED
in vec3 place;
in vec2 turn;
in vec3 size;
in vec4 paint;
in uvec2 tag;
#endif
"""
_PLACE = """
vec3 rotate(vec3 v) {
#ifdef INSTANCED
    return vec3(turn.x * v.x - turn.y * v.y, turn.y * v.x + turn.x * v.y, v.z);
#else
    return v;
#endif
}
vec3 find_world() {
#ifdef INSTANCED
    return place + rotate(position * size);
#else
    return position;
#endif
}
void put(vec3 world) {
    // Nothing lies below the ground: it is behind all solids, and its upper layers before its lower ones, by constants.
    // Real depths of layers at one height are equal only up to rounding, which grows with the size of triangles.
    gl_Position = clip * vec4(world, 1.0);
    float solid = 0.99 * gl_Position.z - 0.01 * gl_Position.w;
    gl_Position.z = kind.z == 0u ? solid : (0.99 + 0.001 * float(kind.z)) * gl_Position.w - 0.05;
}
"""
_LABEL_VERTEX = """
#if defined(DEPTH)
out float v_depth;
#else
flat out uint v_label;
#endif
void main() {
    vec3 world = find_world();
    put(world);
#if defined(DEPTH)
    v_depth = dot(world - eye.xyz, ahead.xyz);
#elif defined(SEMANTIC)
    v_label = kind.x;
#elif defined(INSTANCED)
    v_label = tag.x;
#else
    v_label = 0u;
#endif
}
"""
_LABEL_FRAGMENT = """
#if defined(DEPTH)
in float v_depth;
out float pixel;
void main() { pixel = v_depth; }
#else
flat in uint v_label;
out uint pixel;
void main() { pixel = v_label; }
#endif
"""
_RGB_VERTEX = """
out vec3 v_offset;
flat out vec3 v_shown;   // by sun, sky and its own lamp
flat out vec3 v_lit;     // by the head lamps, where they shine brightest
#if defined(FACADE_SURFACE)
out vec2 v_wall;         // place on the wall [panes]
flat out vec3 v_glass;
#elif defined(STRIPES_SURFACE)
out float v_stripe;
flat out vec3 v_light;
#endif
#ifdef INSTANCED
vec3 find_glow() {
    uint lit = tag.y, material = kind.y;
    if (material == SIGNAL) return paint.rgb;
    if (material == BRAKE_LAMP) return (lit & 1u) != 0u ? vec3(1.0, 0.13, 0.08) : vec3(0.0);
    if (material == LEFT_INDICATOR) return (lit & 2u) != 0u ? vec3(1.0, 0.62, 0.06) : vec3(0.0);
    if (material == RIGHT_INDICATOR) return (lit & 4u) != 0u ? vec3(1.0, 0.62, 0.06) : vec3(0.0);
#ifdef LAMPS
    if (material == HEADLAMP) return vec3(1.0, 0.98, 0.9);
    if (material == TAIL_LAMP) return (lit & 1u) != 0u ? vec3(1.0, 0.13, 0.08) : vec3(0.6, 0.05, 0.04);
#else
    if (material == TAIL_LAMP) return (lit & 1u) != 0u ? vec3(1.0, 0.13, 0.08) : vec3(0.0);
#endif
    return vec3(0.0);
}
#endif
void main() {
    vec3 world = find_world(), base = colour.rgb;
#ifdef INSTANCED
    vec3 facing = normalize(rotate(normal / size));
    if (kind.y == PAINT || kind.y == SIGNAL) base = paint.rgb;
#else
    vec3 facing = normal;
#endif
    put(world);
    v_offset = world - eye.xyz;
    vec3 light = ambient.rgb + sun.rgb * max(dot(facing, to_sun.xyz), 0.0) + 0.12 * ambient.rgb * facing.z;
    light *= ground.w;
    if (kind.y == ROUGH) base *= 1.0 - ahead.w;
    v_shown = base * light;
    v_lit = base * ground.w * vec3(0.75, 0.73, 0.66);
#ifdef INSTANCED
    vec3 glow = find_glow();
    if (glow.r > 0.0) {
        v_shown = glow * ground.w;
        v_lit = vec3(0.0);
    }
#endif
#if defined(FACADE_SURFACE)
    v_wall = vec2(dot(world.xy, vec2(-facing.y, facing.x)) / 3.0, world.z / 3.3);
    v_glass = vec3(0.25, 0.31, 0.38) * light;
#elif defined(STRIPES_SURFACE)
    v_stripe = (world.x + world.y + world.z) * 1.6;
    v_light = light;
#endif
}
"""
_RGB_FRAGMENT = """
in vec3 v_offset;
flat in vec3 v_shown;
flat in vec3 v_lit;
#if defined(FACADE_SURFACE)
in vec2 v_wall;
flat in vec3 v_glass;
#elif defined(STRIPES_SURFACE)
in float v_stripe;
flat in vec3 v_light;
#endif
out vec4 pixel;
// Noise of a cell (Jimenez 2014, "Next generation post processing in Call of Duty").
float vary(vec2 at) {
    return fract(52.9829189 * fract(dot(floor(at), vec2(0.06711056, 0.00583715))));
}
float find_beam(float away) {
    float ahead_m = dot(v_offset.xy, heading.xy), aside_m = abs(v_offset.x * heading.y - v_offset.y * heading.x);
    float cone = clamp(1.3 - aside_m / max(0.35 * ahead_m + 1.5, 0.1), 0.0, 1.0), near = max(1.0 - away / 110.0, 0.0);
    near *= near;
    return ahead_m > 0.0 ? cone * near * near : 0.0;
}
void main() {
    float away = length(v_offset);
    vec3 seen = v_shown;
#ifdef LAMPS
    seen += v_lit * find_beam(away);
#endif
#if defined(ROUGH_SURFACE)
    vec2 at = v_offset.xy + (eye.xy + ground.xy);
    seen *= 0.94 + 0.1 * vary(at * 0.31) + 0.14 * (vary(at * 5.0) - 0.5) * max(1.0 - away / 60.0, 0.0);
#elif defined(FACADE_SURFACE)
    vec2 pane = abs(fract(v_wall) - vec2(0.5, 0.575));
    vec3 glass = v_glass;
#ifdef LAMPS
    glass += vary(v_wall + 37.0) > 0.65 ? vec3(0.5, 0.4, 0.2) * ground.w : vec3(0.0);
#endif
    seen = max(pane.x - 0.22, pane.y - 0.225) < 0.0 ? glass : seen;
#elif defined(STRIPES_SURFACE)
    vec3 paint = fract(v_stripe) < 0.5 ? vec3(0.85, 0.2, 0.16) : vec3(0.92);
#ifdef LAMPS
    seen = paint * (v_light + find_beam(away) * ground.w);
#else
    seen = paint * v_light;
#endif
#endif
    float clear = max(1.0 - away * horizon.w, 0.0);  // (1 - x / 16)^16 is nearly exp(-x), and needs no table
    clear *= clear;
    clear *= clear;
    clear *= clear;
    clear *= clear;
    pixel = vec4(mix(horizon.rgb, seen, clear), 1.0);
}
"""
FOG_STEPS = 16
"""The fragment shader's power: its fog is that of the exponential divided by this."""
_SKY_VERTEX = """
uniform mat3 rays;
in vec2 corner;
out vec3 v_ray;
void main() {
    v_ray = rays * vec3(1.0, corner);
    gl_Position = vec4(corner, 1.0, 1.0);
}
"""
_SKY_FRAGMENT = """
in vec3 v_ray;
out vec4 pixel;
void main() {
    float up = clamp(v_ray.z * 2.2 * inversesqrt(dot(v_ray, v_ray)), 0.0, 1.0);
    pixel = vec4(mix(horizon.rgb, zenith.rgb, sqrt(up)), 1.0);
}
"""


def write_shaders(kind: ImageKind, surface: Surface, instanced: bool, lamps: bool) -> tuple[str, str]:
    """Return the sources of the vertex and the fragment shader. lamps: whether head lamps light a picture."""
    is_rgb = kind is ImageKind.RGB
    names = [f"{surface.name}_SURFACE", *(["LAMPS"] if lamps else [])] if is_rgb else [kind.name]
    head = "#version 330\n" + "".join(f"#define {name}\n" for name in (*names, *(["INSTANCED"] if instanced else [])))
    vertex = _DEFINES + VIEW_BLOCK + _VERTEX_INPUTS + _PLACE + (_RGB_VERTEX if is_rgb else _LABEL_VERTEX)
    return head + vertex, head + VIEW_BLOCK + (_RGB_FRAGMENT if is_rgb else _LABEL_FRAGMENT)


def write_sky_shaders() -> tuple[str, str]:
    """Return the sources of the vertex and the fragment shader of the sky."""
    head = "#version 330\n" + VIEW_BLOCK
    return head + _SKY_VERTEX, head + _SKY_FRAGMENT
