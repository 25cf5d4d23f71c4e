"""The shaders of masses and springs, in a plane and in space, GLSL 3.30. Surfaces, shadows and the ground: shaders3d.py.

Positions are metres, (particles, dimensions) float32, in one buffer; in a plane OpenGL adds z = 0. The graphics card
computes a spring's strain from its two ends, so that only positions are sent each frame, whatever the number of
springs.
"""

from __future__ import annotations

# `toward`: by so many clip units of depth a vertex is drawn nearer than it is, so that what lies on a surface shows.
VERTEX = """#version 330 core
layout(location = 0) in vec3 position;
uniform mat4 transform;     // metres -> clip coordinates
uniform float point_size;   // pixels; points only
uniform float toward;
out vec3 world;
void main() {
    world = position;
    gl_Position = transform * vec4(position, 1.0);
    gl_Position.z -= toward * gl_Position.w;
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
in vec3 world[];
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

# Lines wider than a pixel do not exist in core OpenGL, so a wide spring is a rectangle in the window. Where a pixel has one
# sample its edges fade, for which it is `soft` pixels wider. One that reaches behind the eye is left out.
WIDE_SPRINGS = (
    """#version 330 core
layout(lines) in;
layout(triangle_strip, max_vertices = 4) out;
in vec3 world[];
uniform vec2 window;        // pixels
uniform float half_width;   // pixels
uniform float soft;         // pixels
out vec3 colour;
out float across;           // pixels from the middle of the line
"""
    + STRAIN_COLOUR
    + """
void main() {
    vec4 first = gl_in[0].gl_Position, second = gl_in[1].gl_Position;
    if (!(first.w > 0.0 && second.w > 0.0)) return;
    colour = strain_colour(distance(world[0], world[1]));
    vec2 along = (second.xy / second.w - first.xy / first.w) * window;
    float size = length(along);
    if (!(size > 0.0)) return;
    float reach = half_width + soft;
    vec2 side = vec2(-along.y, along.x) / size * reach * 2.0 / window;
    for (int k = 0; k < 4; ++k) {
        vec4 end = k < 2 ? first : second;
        float sign = (k % 2 == 0) ? -1.0 : 1.0;
        gl_Position = end + vec4(sign * side * end.w, 0.0, 0.0);
        across = sign * reach;
        EmitVertex();
    }
    EndPrimitive();
}
"""
)

# How much of a pixel is covered shows where pictures are blended: in a plane.
SPRING_FRAGMENT = """#version 330 core
in vec3 colour;
in float across;
uniform float half_width;
out vec4 pixel;
void main() {
    pixel = vec4(colour, clamp(half_width + 0.5 - abs(across), 0.0, 1.0));
}
"""

LINE_FRAGMENT = """#version 330 core
uniform vec3 colour;
out vec4 pixel;
void main() {
    pixel = vec4(colour, 1.0);
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
