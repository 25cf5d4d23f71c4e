"""The shaders of a fluid's particles in a plane, GLSL 3.30."""

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
