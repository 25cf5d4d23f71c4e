"""Shaders for scenes in space, GLSL 3.30: lit surfaces, shadows and the ground.

Positions are metres, (particles, 3) float32, in one buffer; normals are in another of the same shape. Every program has
them at the same two attribute locations, so that one vertex array serves all.
"""

from __future__ import annotations

SURFACE_VERTEX = """#version 330 core
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
uniform mat4 transform;
uniform vec3 shift;         // m
out vec3 place;
out vec3 outward;
void main() {
    place = position + shift;
    outward = normal;
    gl_Position = transform * vec4(place, 1.0);
}
"""

# A key light from above, a weak fill light from the other side, and light from all around, more of it from above. The
# key wraps a little around what it shines on: cloth lets some light through.
LIGHT = """
uniform vec3 eye;           // m
uniform vec3 key;           // unit vectors toward the lights
uniform vec3 fill;
uniform float shine;
vec3 facing(vec3 outward, vec3 look) {  // the unit normal of the side that is seen
    float size = length(outward);
    vec3 n = size > 1e-6 ? outward / size : look;
    return gl_FrontFacing ? n : -n;
}
vec3 lit(vec3 colour, vec3 n, vec3 look) {
    float from_key = max((dot(n, key) + 0.25) / 1.25, 0.0);
    float from_fill = max(dot(n, fill), 0.0);
    float from_around = 0.46 + 0.08 * n.y;
    float highlight = shine * pow(max(dot(n, normalize(key + look)), 0.0), 32.0);
    return min(colour * (from_around + 0.60 * from_key + 0.24 * from_fill) + highlight, 1.0);
}
"""

SURFACE_FRAGMENT = (
    """#version 330 core
in vec3 place;
in vec3 outward;
uniform vec3 front;
uniform vec3 back;
out vec4 pixel;
"""
    + LIGHT
    + """
void main() {
    vec3 look = normalize(eye - place);
    pixel = vec4(lit(gl_FrontFacing ? front : back, facing(outward, look), look), 1.0);
}
"""
)

TINTED_VERTEX = SURFACE_VERTEX.replace("uniform mat4", "layout(location = 4) in vec3 colour;\nuniform mat4", 1).replace(
    "out vec3 outward;\nvoid main() {", "out vec3 outward;\nout vec3 tint;\nvoid main() {\n    tint = colour;"
)  # every vertex of a colour of its own
TINTED_FRAGMENT = (
    SURFACE_FRAGMENT.replace("uniform vec3 front;\nuniform vec3 back;", "in vec3 tint;\nuniform float unlit;")
    .replace("gl_FrontFacing ? front : back, facing", "tint, facing")
    .replace("pixel = vec4(lit(", "pixel = vec4(mix(lit(")
    .replace("look), look), 1.0);", "look), look), tint, unlit), 1.0);")
)  # `unlit`, 0 to 1: how little light changes a colour that is a number

LIMITS = 6  # planes that end each other
FADE = (
    f"""
uniform vec4 limits[{LIMITS}];     // planes, normal and distance: what lies behind one is not seen
uniform int limit_count;
"""
    + """
uniform vec3 centre;        // m, of what is seen of the ground
uniform float reach;        // m, where nothing is left of it
float fade(vec3 place) {
    for (int k = 0; k < limit_count; ++k)
        if (dot(limits[k], vec4(place, 1.0)) < -1e-4 * reach) return 0.0;
    return 1.0 - smoothstep(0.25, 1.0, distance(place, centre) / reach);
}
"""
)

SHADOW_VERTEX = """#version 330 core
layout(location = 0) in vec3 position;
uniform mat4 transform;
uniform mat4 flatten;       // along the light into the plane of the ground
uniform vec3 shift;
out vec3 place;
void main() {
    vec4 fallen = flatten * vec4(position + shift, 1.0);
    place = fallen.xyz;
    gl_Position = transform * fallen;
}
"""


def shadow_fragment(inputs: str = "", outside: str = "false") -> str:
    """Return the fragment shader of shadows; more `inputs` decide which fragments are `outside` of the shadow's source."""
    uniforms = "uniform vec3 dark;\nuniform vec3 light;\nout vec4 pixel;\n"
    return f"""#version 330 core
in vec3 place;
{inputs}{uniforms}{FADE}
void main() {{
    float left = fade(place);
    if (left <= 0.0 || {outside}) discard;
    pixel = vec4(mix(light, dark, left), 1.0);
}}
"""


SHADOW_FRAGMENT = shadow_fragment()

GROUND_VERTEX = """#version 330 core
layout(location = 0) in vec3 position;  // corners of a square, -1 to 1, in its plane
uniform mat4 transform;
uniform vec3 centre;
uniform vec3 across;
uniform vec3 along;
uniform float reach;
out vec3 place;
void main() {
    place = centre + reach * (position.x * across + position.y * along);
    gl_Position = transform * vec4(place, 1.0);
}
"""

# Lines a pixel wide; where they would lie closer than a few pixels they fade instead of flickering.
GROUND_FRAGMENT = (
    """#version 330 core
in vec3 place;
uniform vec3 across;
uniform vec3 along;
uniform float spacing;      // m between two lines
uniform vec3 area;
uniform vec3 line;
uniform float cover;        // of the area between the lines, 0 to 1
out vec4 pixel;
"""
    + FADE
    + """
void main() {
    vec2 cell = vec2(dot(place, across), dot(place, along)) / spacing;
    vec2 width = max(fwidth(cell), 1e-6);
    vec2 from = abs(fract(cell - 0.5) - 0.5) / width;
    vec2 ink = clamp(1.2 - from, 0.0, 1.0) * clamp(1.0 - 2.5 * width, 0.0, 1.0);
    float strength = max(ink.x, ink.y);
    float left = fade(place);
    pixel = vec4(mix(area, line, strength), left * mix(cover, 0.8, strength));
}
"""
)
