"""Shaders of the light map: bodies flattened along the rays of the sun, and soft rectangles."""

from mdrive_sumo.sensing.camera.shaders import write_head

_MAP = """
uniform vec3 area;    // lower left corner of the map, relative to the scene's origin, and 2 / its side
uniform vec2 slope;   // how far a shadow falls for each metre of height
void put(vec2 ground) { gl_Position = vec4((ground - area.xy) * area.z - 1.0, 0.0, 1.0); }
"""
_SHADOW_VERTEX = """
in vec3 position;
#ifdef INSTANCED
in vec3 place;
in vec2 turn;
in vec3 size;
void main() {
    vec3 v = position * size;
    put(place.xy + vec2(turn.x * v.x - turn.y * v.y, turn.y * v.x + turn.x * v.y) + slope * v.z);
}
#else
void main() { put(position.xy + slope * position.z); }
#endif
"""
_SHADOW_FRAGMENT = """
out vec4 pixel;
void main() { pixel = vec4(1.0, 0.0, 0.0, 0.0); }
"""
_SPOT_VERTEX = """
in vec2 corner;
in vec2 middle;
in vec2 turn;
in vec2 reach;
in vec2 core;
in vec4 gain;
out vec2 v_local;
flat out vec2 v_core;
flat out vec2 v_soft;
flat out vec4 v_gain;
void main() {
    v_local = corner * reach;
    v_core = core;
    v_soft = 1.0 / (reach - core);
    v_gain = gain;
    put(middle + vec2(turn.x * v_local.x - turn.y * v_local.y, turn.y * v_local.x + turn.x * v_local.y));
}
"""
_SPOT_FRAGMENT = """
in vec2 v_local;
flat in vec2 v_core;
flat in vec2 v_soft;
flat in vec4 v_gain;
out vec4 pixel;
void main() {
    vec2 outside = max(abs(v_local) - v_core, 0.0) * v_soft;
    float full = max(1.0 - length(outside), 0.0);
    pixel = v_gain * (full * full);
}
"""


def write_shadow_shaders(instanced: bool) -> tuple[str, str]:
    """Return the sources of the vertex and the fragment shader of bodies that are flattened into the light map."""
    head = write_head(*(["INSTANCED"] if instanced else []))
    return head + _MAP + _SHADOW_VERTEX, head + _SHADOW_FRAGMENT


def write_spot_shaders() -> tuple[str, str]:
    """Return the sources of the vertex and the fragment shader of soft rectangles in the light map."""
    return write_head() + _MAP + _SPOT_VERTEX, write_head() + _SPOT_FRAGMENT
