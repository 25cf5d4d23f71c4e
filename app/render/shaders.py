"""The shaders of the drawing, GLSL 3.30. Positions are metres, (particles, 2) float32, in one buffer for everything.

A spring's strain is worked out on the graphics card from the two positions it joins: what is sent each frame is the
positions alone, whatever the number of springs.
"""

from __future__ import annotations

VERTEX = """#version 330 core
in vec2 position;
uniform vec2 centre;        // m, the middle of the window
uniform vec2 scale;         // clip units per metre
uniform float point_size;   // pixels; points only
out vec2 world;
void main() {
    world = position;
    gl_Position = vec4((position - centre) * scale, 0.0, 1.0);
    gl_PointSize = point_size;
}
"""

STRAIN_COLOUR = """
uniform float inverse_rest;   // 1/m
uniform float offset;         // 1; 0 where the rest length is 0
uniform float strain_range;
uniform vec3 stops[5];
vec3 strain_colour(float length) {
    float strain = length * inverse_rest - offset;
    float place = (clamp(strain / strain_range, -1.0, 1.0) + 1.0) * 2.0;
    int low = min(int(place), 3);
    return mix(stops[low], stops[low + 1], place - float(low));
}
"""

THIN_SPRINGS = (
    """#version 330 core
layout(lines) in;
layout(line_strip, max_vertices = 2) out;
in vec2 world[];
out vec3 colour;
out float across;
"""
    + STRAIN_COLOUR
    + """
void main() {
    colour = strain_colour(distance(world[0], world[1]));
    for (int k = 0; k < 2; ++k) {
        gl_Position = gl_in[k].gl_Position;
        across = 0.0;
        EmitVertex();
    }
    EndPrimitive();
}
"""
)

# Lines wider than a pixel do not exist in core OpenGL, so a wide spring is a rectangle, with soft edges.
WIDE_SPRINGS = (
    """#version 330 core
layout(lines) in;
layout(triangle_strip, max_vertices = 4) out;
in vec2 world[];
uniform vec2 window;        // pixels
uniform float half_width;   // pixels
out vec3 colour;
out float across;           // pixels from the middle of the line
"""
    + STRAIN_COLOUR
    + """
void main() {
    colour = strain_colour(distance(world[0], world[1]));
    vec2 along = (gl_in[1].gl_Position.xy - gl_in[0].gl_Position.xy) * window;
    float size = length(along);
    if (!(size > 0.0)) return;
    float reach = half_width + 1.0;
    vec2 side = vec2(-along.y, along.x) / size * reach * 2.0 / window;
    for (int k = 0; k < 4; ++k) {
        float sign = (k % 2 == 0) ? -1.0 : 1.0;
        gl_Position = gl_in[k / 2].gl_Position + vec4(sign * side, 0.0, 0.0);
        across = sign * reach;
        EmitVertex();
    }
    EndPrimitive();
}
"""
)

SPRING_FRAGMENT = """#version 330 core
in vec3 colour;
in float across;
uniform float half_width;
out vec4 pixel;
void main() {
    pixel = vec4(colour, clamp(half_width + 0.5 - abs(across), 0.0, 1.0));
}
"""

POINT_FRAGMENT = """#version 330 core
uniform vec3 fill;
uniform vec3 rim;
uniform float point_size;
uniform int square;
uniform int hollow;
out vec4 pixel;
void main() {
    vec2 from = (gl_PointCoord - 0.5) * point_size;
    float radius = square == 1 ? max(abs(from.x), abs(from.y)) : length(from);
    float edge = point_size * 0.5 - radius;
    if (edge < 0.0) discard;
    float inside = clamp(edge - 1.0, 0.0, 1.0);
    if (hollow == 1) {
        if (edge > 3.0) discard;
        pixel = vec4(fill, clamp(edge, 0.0, 1.0));
    } else {
        pixel = vec4(mix(rim, fill, inside), clamp(edge, 0.0, 1.0));
    }
}
"""
