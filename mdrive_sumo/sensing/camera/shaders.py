"""Shaders of the camera renderer: one vertex shader, and a fragment shader for each kind of image."""

from mdrive_sumo.sensing.camera.camera_model import FAR_M, ImageKind

_VERTEX = """
#version 330
uniform mat4 clip;
uniform vec3 eye;
uniform vec3 ahead;
in vec3 position;
in vec3 normal;
in vec4 colour;
in uvec4 kind;
#ifdef INSTANCED
in vec3 place;
in vec2 turn;
in vec3 size;
in vec4 paint;
in uint tag;
#endif
out vec3 v_world;
out vec3 v_normal;
out vec3 v_colour;
out float v_depth;
flat out uvec2 v_kind;
flat out uint v_tag;
void main() {
#ifdef INSTANCED
    vec3 scaled = position * size, bent = normal / size;
    v_world = place + vec3(turn.x * scaled.x - turn.y * scaled.y, turn.y * scaled.x + turn.x * scaled.y, scaled.z);
    v_normal = vec3(turn.x * bent.x - turn.y * bent.y, turn.y * bent.x + turn.x * bent.y, bent.z);
    v_colour = (kind.y == 1u || kind.y == 6u) ? paint.rgb : colour.rgb;
    v_tag = tag;
#else
    v_world = position;
    v_normal = normal;
    v_colour = colour.rgb;
    v_tag = 0u;
#endif
    v_kind = kind.xy;
    v_depth = dot(v_world - eye, ahead);
    gl_Position = clip * vec4(v_world, 1.0);
}
"""
_INPUTS = """
#version 330
in vec3 v_world;
in vec3 v_normal;
in vec3 v_colour;
in float v_depth;
flat in uvec2 v_kind;
flat in uint v_tag;
"""
_RGB = """
uniform vec3 eye;
uniform vec3 ground;  // of the origin in the world, so that patterns stay where they are
uniform vec2 heading;
uniform vec3 to_sun;
uniform vec3 sun;
uniform vec3 ambient;
uniform vec3 horizon;
uniform float fog_per_m;
uniform float lamps;
uniform float wet;
uniform float exposure;
out vec4 pixel;
float vary(vec2 at) {
    uvec2 cell = uvec2(ivec2(floor(at)));
    uint bits = cell.x * 1664525u + cell.y * 1013904223u;
    bits = (bits ^ (bits >> 15)) * 2246822519u;
    return float((bits >> 9) & 1023u) / 1023.0;
}
void main() {
    vec3 normal = normalize(v_normal), offset = v_world - eye, base = v_colour;
    float away = length(offset);
    uint material = v_kind.y;
    if (material == 3u) {
        vec2 at = v_world.xy + ground.xy;
        float grain = away < 60.0 ? mix(vary(at * 5.0), 0.5, away / 60.0) : 0.5;
        base *= (0.9 + 0.12 * grain + 0.08 * vary(at * 0.12)) * (1.0 - wet);
    } else if (material == 2u) {
        float along = dot(v_world.xy, vec2(-normal.y, normal.x));
        vec2 pane = fract(vec2(along / 3.0, v_world.z / 3.3));
        bool window = pane.x > 0.28 && pane.x < 0.72 && pane.y > 0.35 && pane.y < 0.8;
        base = window ? mix(vec3(0.25, 0.31, 0.38), vec3(1.0, 0.85, 0.5), lamps * 0.7 * step_lit(along)) : base;
    } else if (material == 7u) {
        base = fract((v_world.x + v_world.y + v_world.z) * 1.6) < 0.5 ? vec3(0.85, 0.2, 0.16) : vec3(0.92);
    }
    vec3 light = ambient + sun * max(dot(normal, to_sun), 0.0) + 0.12 * ambient * normal.z;
    if (lamps > 0.0) {
        float ahead_m = dot(offset.xy, heading), aside_m = abs(offset.x * heading.y - offset.y * heading.x);
        float cone = clamp(1.3 - aside_m / max(0.35 * ahead_m + 1.5, 0.1), 0.0, 1.0);
        light += lamps * vec3(0.75, 0.73, 0.66) * cone * exp(-away / 26.0) * step(0.0, ahead_m);
    }
    vec3 seen = base * light;
    if (material == 6u) seen = base;
    if (material == 4u && lamps > 0.0) seen = vec3(1.0, 0.98, 0.9);
    if (material == 5u && lamps > 0.0) seen = vec3(0.85, 0.08, 0.06);
    seen = mix(horizon, seen, exp(-fog_per_m * away));
    pixel = vec4(clamp(seen * exposure, 0.0, 1.0), 1.0);
}
"""
_LIT = """
float step_lit(float along) {
    return fract(sin(floor(along / 3.0) * 12.9898) * 43758.5453) > 0.6 ? 1.0 : 0.0;
}
"""
_OUTPUT = {
    ImageKind.SEMANTIC: "out uint pixel;\nvoid main() { pixel = v_kind.x; }\n",
    ImageKind.INSTANCE: "out uint pixel;\nvoid main() { pixel = v_tag; }\n",
    ImageKind.DEPTH: f"out float pixel;\nvoid main() {{ pixel = min(v_depth, {FAR_M}); }}\n",
}
SKY_VERTEX = """
#version 330
uniform mat3 rays;
in vec2 corner;
out vec3 v_ray;
void main() {
    v_ray = rays * vec3(1.0, corner);
    gl_Position = vec4(corner, 1.0, 1.0);
}
"""
SKY_FRAGMENT = """
#version 330
uniform vec3 zenith;
uniform vec3 horizon;
uniform float exposure;
in vec3 v_ray;
out vec4 pixel;
void main() {
    float up = clamp(normalize(v_ray).z * 2.2, 0.0, 1.0);
    pixel = vec4(clamp(mix(horizon, zenith, sqrt(up)) * exposure, 0.0, 1.0), 1.0);
}
"""


def write_vertex_shader(instanced: bool) -> str:
    """Return the source of the vertex shader, for instances of a model or for a static mesh."""
    return _VERTEX.strip().replace("#version 330", "#version 330\n#define INSTANCED" if instanced else "#version 330")


def write_fragment_shader(kind: ImageKind) -> str:
    """Return the source of the fragment shader of a kind of image."""
    body = _RGB.replace("void main", _LIT + "void main", 1) if kind is ImageKind.RGB else _OUTPUT[kind]
    return _INPUTS.strip() + "\n" + body
