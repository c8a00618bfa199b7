"""Shaders of the camera renderer: one program for each kind of image and, in colours, for each surface.

Mesa's software renderer computes both sides of every condition, so what differs between surfaces is chosen when a
program is compiled. Light is computed for corners: every triangle has one normal and one colour.
"""

from typing import NamedTuple

from mdrive_sumo.sensing.camera.camera_model import ImageKind
from mdrive_sumo.sensing.camera.meshes import FIRST_GROUND, Material, Surface

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
    vec4 map;       // xy: corner of the light map, from the origin; z: 1 / its side; w: light below a street lamp
};
"""
VIEW_FLOATS = 16 + 10 * 4
"""Numbers in the block of uniforms of a view: a matrix, and ten vectors of four."""
_DEFINES = """
#define PAINT {paint}u
#define STREET_LAMP {street_lamp}u
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
in vec4 shade;
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
vec3 move_limb(vec3 v) {
#ifdef INSTANCED
    if (kind.w == 0u || shade.z == 0.0) return v;
    float swing = abs(fract(shade.z) * 4.0 - 2.0) - 1.0;
    if (kind.w == 2u || kind.w == 3u) swing = -swing;
    v.x += swing * (kind.w < 3u ? 0.45 * max(0.5 - v.z, 0.0) / 0.5 : 0.35 * max(0.8 - v.z, 0.0) / 0.35);
#endif
    return v;
}
vec3 find_world() {
#ifdef INSTANCED
    vec3 world = place + rotate(move_limb(position) * size);
#ifdef MIRRORED
    world.z = -world.z;
#endif
    return world;
#else
    return position;
#endif
}
void put(vec3 world) {
    // Nothing lies below the ground: it is behind all solids, and its upper layers before its lower ones, by constants.
    // Real depths of layers at one height are equal only up to rounding, which grows with the size of triangles.
    gl_Position = clip * vec4(world, 1.0);
    float solid = 0.99 * gl_Position.z - 0.01 * gl_Position.w;
#ifdef MIRRORED
    // Between all solids and all layers of the ground.
    gl_Position.z = 0.985 * gl_Position.w - 0.05 + 0.002 * (gl_Position.z - gl_Position.w);
    return;
#endif
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
_AIR = """
float find_beam(vec3 offset, float away) {
    float ahead_m = dot(offset.xy, heading.xy), aside_m = abs(offset.x * heading.y - offset.y * heading.x);
    float cone = clamp(1.3 - aside_m / max(0.35 * ahead_m + 1.5, 0.1), 0.0, 1.0), near = max(1.0 - away / 110.0, 0.0);
    near *= near;
    return ahead_m > 0.0 ? cone * near * near : 0.0;
}
// Share of light that wet ground mirrors: the more the flatter it is seen (Fresnel; here of a rough surface, by eye).
float find_mirrored(float away) {
    float flat_view = max(1.0 - 1.6 * eye.z / away, 0.0);
    return 0.06 + 0.5 * flat_view * flat_view;
}
vec3 fade(vec3 seen, float away) {
    float clear = max(1.0 - away * horizon.w, 0.0);  // (1 - x / 16)^16 is nearly exp(-x), and needs no table
    clear *= clear;
    clear *= clear;
    clear *= clear;
    clear *= clear;
    return mix(horizon.rgb, seen, clear);
}
"""
_RGB_VERTEX = """
#if defined(PLAIN_SURFACE)
out vec3 v_seen;         // bodies are small: their corners are enough
#ifdef MIRRORED
out float v_share;
#endif
vec3 v_offset, v_shown, v_lit;
#else
out vec3 v_offset;
flat out vec3 v_shown;   // by sun, sky and its own lamp; of the ground its colour
flat out vec3 v_lit;     // by the head lamps, where they shine brightest
#endif
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
    float sunny = max(dot(facing, to_sun.xyz), 0.0);
#ifdef INSTANCED
    sunny -= sunny * shade.x;
#endif
    vec3 light = ambient.rgb + sun.rgb * sunny + 0.12 * ambient.rgb * facing.z;
#if defined(INSTANCED) && defined(LAMPS)
    light += (shade.y * map.w * (0.6 + 0.4 * facing.z)) * vec3(1.0, 0.84, 0.58);
#endif
    light *= ground.w;
#ifdef GROUND
    v_shown = base * (ground.w - ground.w * ahead.w);
#else
    v_shown = base * light;
#endif
    v_lit = base * ground.w * vec3(0.75, 0.73, 0.66);
#if defined(LAMPS) && !defined(INSTANCED)
    if (kind.y == STREET_LAMP && map.w > 0.0) {
        v_shown = vec3(1.0, 0.9, 0.68) * ground.w;
        v_lit = vec3(0.0);
    }
#endif
#ifdef INSTANCED
    vec3 glow = find_glow();
    if (glow.r > 0.0) {
        v_shown = glow * ground.w;
        v_lit = vec3(0.0);
    }
#endif
#if defined(PLAIN_SURFACE)
    float away = gl_Position.w;
#ifdef LAMPS
    v_shown += v_lit * find_beam(v_offset, away);
#endif
    v_seen = fade(v_shown, away);
#ifdef MIRRORED
    v_share = 1.4 * find_mirrored(away) * clamp(1.0 + 0.3 * world.z, 0.0, 1.0);  // rough ground: less of what is high
#endif
#elif defined(FACADE_SURFACE)
    v_wall = vec2(dot(world.xy, vec2(-facing.y, facing.x)) / 3.0, world.z / 3.3);
    v_glass = vec3(0.25, 0.31, 0.38) * light;
#elif defined(STRIPES_SURFACE)
    v_stripe = (world.x + world.y + world.z) * 1.6;
    v_light = light;
#endif
}
"""
_RGB_FRAGMENT = """
out vec4 pixel;
#if defined(PLAIN_SURFACE)
in vec3 v_seen;
#ifdef MIRRORED
in float v_share;
void main() { pixel = vec4(v_seen, v_share); }
#else
void main() { pixel = vec4(v_seen, 1.0); }
#endif
#else
uniform sampler2D light_map;
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
// Noise of a cell (Jimenez 2014, "Next generation post processing in Call of Duty").
float vary(vec2 at) {
    return fract(52.9829189 * fract(dot(floor(at), vec2(0.06711056, 0.00583715))));
}
void main() {
    float away = 1.0 / gl_FragCoord.w;  // depth: a root costs more than it shows
    vec3 seen = v_shown;
#if defined(GROUND)
    vec2 at = v_offset.xy + eye.xy;
    vec4 fallen = texture(light_map, (at - map.xy) * map.z);
    vec3 light = ambient.rgb * (1.12 - fallen.g) + sun.rgb * (to_sun.z - to_sun.z * fallen.r);
#ifdef LAMPS
    light += find_beam(v_offset, away) * vec3(0.75, 0.73, 0.66) + (fallen.b * map.w) * vec3(1.0, 0.84, 0.58);
#endif
    seen *= light;
#elif defined(LAMPS)
    seen += v_lit * find_beam(v_offset, away);
#endif
#if defined(ROUGH_SURFACE)
    at += ground.xy;
    seen *= 0.82 + 0.36 * fallen.a + 0.12 * (vary(at * 11.0) - 0.5) * max(1.0 - away / 30.0, 0.0);
#elif defined(FACADE_SURFACE)
#ifdef LAMPS
    vec2 foot = v_offset.xy + (eye.xy - map.xy);
    float below = texture(light_map, foot * map.z).b * max(1.0 - (v_offset.z + eye.z) / 9.0, 0.0);
    seen += v_lit * (below * map.w);
#endif
    vec2 pane = abs(fract(v_wall) - vec2(0.5, 0.575));
    float room = vary(v_wall + 37.0), frame = max(pane.x - 0.22, pane.y - 0.225);
    vec3 glass = v_glass * (0.75 + 0.5 * room);
#ifdef LAMPS
    glass += room > 0.65 ? vec3(0.5, 0.4, 0.2) * ((2.2 * room - 0.9) * ground.w) : vec3(0.0);
#endif
    float course = fract(v_wall.y * 22.0) < 0.16 ? 0.9 : 1.0;  // bricks from close by
    seen *= mix(1.0, course, max(1.0 - away / 25.0, 0.0)) * (v_wall.y < 0.16 ? 0.72 : 1.0);
    seen = frame < 0.0 ? glass : frame < 0.025 ? seen * 1.12 : seen;
#elif defined(STRIPES_SURFACE)
    vec3 paint = fract(v_stripe) < 0.5 ? vec3(0.85, 0.2, 0.16) : vec3(0.92);
#ifdef LAMPS
    seen = paint * (v_light + find_beam(v_offset, away) * ground.w);
#else
    seen = paint * v_light;
#endif
#endif
    seen = fade(seen, away);
#if defined(GROUND) && defined(WET)
    seen = mix(seen, horizon.rgb, find_mirrored(away) * (0.55 + 0.9 * fallen.a));
#endif
    pixel = vec4(seen, 1.0);
#ifdef MIRRORED
    pixel.a = find_mirrored(away);
#endif
}
#endif
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


class Look(NamedTuple):
    """What else decides how a surface is drawn in colours."""

    has_lamps: bool = False
    """Head lamps light the picture."""
    is_wet: bool = False
    is_mirrored: bool = False
    """It is seen in wet ground."""


PLAIN_LOOK = Look()


def write_shaders(kind: ImageKind, surface: Surface, instanced: bool, look: Look) -> tuple[str, str]:
    """Return the sources of the vertex and the fragment shader."""
    is_rgb = kind is ImageKind.RGB
    options = {"INSTANCED": instanced}
    if is_rgb:
        options |= {"LAMPS": look.has_lamps, "WET": look.is_wet, "MIRRORED": look.is_mirrored}
        options["GROUND"] = surface >= FIRST_GROUND
    names = (name for name, is_on in options.items() if is_on)
    head = write_head(f"{surface.name}_SURFACE" if is_rgb else kind.name, *names)
    vertex = _DEFINES + VIEW_BLOCK + _VERTEX_INPUTS + _PLACE + (_AIR + _RGB_VERTEX if is_rgb else _LABEL_VERTEX)
    return head + vertex, head + VIEW_BLOCK + (_AIR + _RGB_FRAGMENT if is_rgb else _LABEL_FRAGMENT)


def write_sky_shaders() -> tuple[str, str]:
    """Return the sources of the vertex and the fragment shader of the sky."""
    head = write_head() + VIEW_BLOCK
    return head + _SKY_VERTEX, head + _SKY_FRAGMENT


def write_head(*names: str) -> str:
    """Return the first lines of a shader, which define names."""
    return "#version 330\n" + "".join(f"#define {name}\n" for name in names)
