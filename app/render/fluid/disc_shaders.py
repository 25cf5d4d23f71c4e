"""The shaders of a fluid in a plane, GLSL 3.30: its particles as discs, and its surface as a level of a smooth field."""

from __future__ import annotations

# A particle in a plane: a disc with an edge that fades within a pixel.
DISC_VERTEX = """#version 330 core
layout(location = 0) in vec2 position;  // m
layout(location = 4) in vec4 look;      // colour, radius [m]
uniform mat4 transform;
uniform float pixels;       // a metre has
out vec2 corner;
out vec3 colour;
out float soft;
void main() {
    corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    float radius = max(look.a, 0.75 / pixels);
    soft = 1.0 / (radius * pixels);
    corner *= 1.0 + soft;
    colour = look.rgb;
    gl_Position = transform * vec4(position + radius * corner, 0.0, 1.0);
}
"""

DISC_FRAGMENT = """#version 330 core
in vec2 corner;
in vec3 colour;
in float soft;
out vec4 pixel;
void main() {
    float cover = clamp((1.0 - length(corner)) / soft + 0.5, 0.0, 1.0);
    if (cover <= 0.0) discard;
    pixel = vec4(colour, cover);
}
"""

# A square about the support of a particle's kernel.
FIELD_VERTEX = """#version 330 core
layout(location = 0) in vec2 position;  // m
layout(location = 4) in vec4 look;      // colour, radius [m]
uniform mat4 transform;
uniform float support;      // m
out vec2 corner;            // over the support
out vec3 colour;
void main() {
    corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    colour = look.rgb;
    gl_Position = transform * vec4(position + support * corner, 0.0, 1.0);
}
"""

# M. Mueller, D. Charypar, M. Gross, "Particle-Based Fluid Simulation for Interactive Applications", SCA 2003: the kernel
# (1 - q^2)^3 of their equation 20, times what makes the sum 1 in a fluid at rest.
FIELD_FRAGMENT = """#version 330 core
in vec2 corner;
in vec3 colour;
uniform float peak;
out vec4 sum;               // colour times the field, the field
void main() {
    float inside = max(1.0 - dot(corner, corner), 0.0);
    float value = peak * inside * inside * inside;
    sum = vec4(value * colour, value);
}
"""

LEVEL_VERTEX = """#version 330 core
out vec2 place;             // 0 to 1 over the picture
void main() {
    place = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0;
    gl_Position = vec4(place * 2.0 - 1.0, 0.0, 1.0);
}
"""

# There is fluid where the field exceeds a level; the edge fades within a pixel.
LEVEL_FRAGMENT = """#version 330 core
in vec2 place;
uniform sampler2D field;
uniform float level;
out vec4 pixel;
void main() {
    vec4 sum = texture(field, place);
    float cover = clamp((sum.a - level) / max(fwidth(sum.a), 1e-6) + 0.5, 0.0, 1.0);
    if (cover <= 0.0) discard;
    pixel = vec4(sum.rgb / sum.a, cover);
}
"""
