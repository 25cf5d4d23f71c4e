"""The shaders of bodies, GLSL 3.30: particles as spheres, skins that follow their clusters, and the shadows of both.

Lighting and the fading of the ground come from app/render/shaders3d.py.
"""

from __future__ import annotations

from softlab.app.render.shaders3d import LIGHT, SHADOW_FRAGMENT, shadow_fragment

# A square that covers the sphere as the eye sees it: through its centre, across the line of sight, and as much larger than
# the sphere as rays that touch it lie outside its middle.
SPHERE_VERTEX = """#version 330 core
layout(location = 0) in vec3 position;  // m, of this sphere
layout(location = 4) in vec4 look;      // colour, radius [m]
uniform mat4 transform;
uniform vec3 eye;
uniform vec3 upward;                    // of the camera
uniform float size;                     // of what is drawn of the radius
out vec3 place;
flat out vec3 centre;
flat out vec3 colour;
flat out float radius;
void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    vec3 toward = eye - position;
    float away = dot(toward, toward);
    centre = position;
    colour = look.rgb;
    radius = size * look.a;
    vec3 across = normalize(cross(upward, toward)), up = normalize(cross(toward, across));
    float half_side = radius * sqrt(away / max(away - radius * radius, 1e-4 * away)) * 1.05;
    place = position + half_side * (corner.x * across + corner.y * up);
    gl_Position = transform * vec4(place, 1.0);
}
"""

# `alpha` says how much of the pixel is covered, for alpha to coverage; a target of one sample a pixel takes half or more.
SPHERE_FRAGMENT = (
    """#version 330 core
in vec3 place;
flat in vec3 centre;
flat in vec3 colour;
flat in float radius;
uniform mat4 transform;
uniform float least;        // of the coverage
out vec4 pixel;
"""
    + LIGHT
    + """
void main() {
    vec3 ray = normalize(place - eye), from = eye - centre;
    float middle = dot(from, ray);
    vec3 nearest = from - middle * ray;
    float past = length(nearest) / radius;
    float cover = clamp((1.0 - past) / max(fwidth(past), 1e-6) + 0.5, 0.0, 1.0);
    if (cover <= least) discard;
    float depth = radius * sqrt(max(1.0 - past * past, 0.0));
    vec3 hit = nearest - depth * ray;
    vec4 clip = transform * vec4(centre + hit, 1.0);
    gl_FragDepth = clamp(0.5 + 0.5 * clip.z / clip.w, 0.0, 1.0);
    pixel = vec4(lit(colour, normalize(hit), -ray), cover);
}
"""
)

# The shadow of a sphere is that of its disc across the light.
SPHERE_SHADOW_VERTEX = """#version 330 core
layout(location = 0) in vec3 position;
layout(location = 4) in vec4 look;
uniform mat4 transform;
uniform mat4 flatten;
uniform float size;         // of what is drawn of the radius
uniform vec3 side;          // unit vectors across the light
uniform vec3 other;
out vec3 place;
out vec2 corner;
void main() {
    corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    vec4 fallen = flatten * vec4(position + size * look.a * (corner.x * side + corner.y * other), 1.0);
    place = fallen.xyz;
    gl_Position = transform * fallen;
}
"""

SPHERE_SHADOW_FRAGMENT = shadow_fragment("in vec2 corner;\n", "dot(corner, corner) > 1.0")

# A vertex is the weighted mean of where four clusters take it (linear blend skinning, model/assets/skin.py). A cluster is
# three texels, the rows of its (3, 4) matrix, ACROSS of them a row of the texture; copies of a body follow each other.
ACROSS = 256
SKINNING = """#version 330 core
layout(location = 0) in vec3 position;  // m, of the mesh at rest
layout(location = 1) in vec3 normal;
layout(location = 2) in ivec4 cluster;
layout(location = 3) in vec4 weight;
uniform mat4 transform;
uniform sampler2D clusters;
uniform int first;          // cluster of the first copy
uniform int each;           // clusters a copy
vec4 rows[3];
vec3 cofactors[3];          // of normals: a rotation's are its own rows
void take_rows() {
    for (int row = 0; row < 3; ++row) {
        rows[row] = vec4(0.0);
        cofactors[row] = vec3(0.0);
    }
    for (int k = 0; k < 4; ++k) {
        int number = first + gl_InstanceID * each + cluster[k];
        ivec2 texel = ivec2(3 * (number % ACROSS), number / ACROSS);
        vec4 own[3];
        for (int row = 0; row < 3; ++row) own[row] = texelFetch(clusters, texel + ivec2(row, 0), 0);
        for (int row = 0; row < 3; ++row) {
            rows[row] += weight[k] * own[row];
            cofactors[row] += weight[k] * cross(own[(row + 1) % 3].xyz, own[(row + 2) % 3].xyz);
        }
    }
}
vec3 taken(vec4 point) {
    return vec3(dot(rows[0], point), dot(rows[1], point), dot(rows[2], point));
}
""".replace("ACROSS", str(ACROSS))

SKIN_VERTEX = (
    SKINNING
    + """
uniform vec3 palette[COLOURS];
uniform int copy;           // the first copy's number
out vec3 place;
out vec3 outward;
flat out vec3 colour;
void main() {
    take_rows();
    place = taken(vec4(position, 1.0));
    outward = vec3(dot(cofactors[0], normal), dot(cofactors[1], normal), dot(cofactors[2], normal));
    colour = palette[(copy + gl_InstanceID) % COLOURS];
    gl_Position = transform * vec4(place, 1.0);
}
"""
)

SKIN_FRAGMENT = (
    """#version 330 core
in vec3 place;
in vec3 outward;
flat in vec3 colour;
uniform float cover;        // below 1 it is seen through, less so where it is seen from the side
out vec4 pixel;
"""
    + LIGHT
    + """
void main() {
    vec3 look = normalize(eye - place), n = facing(outward, look);
    float opaque = cover < 1.0 ? mix(0.75, cover, clamp(dot(n, look), 0.0, 1.0)) : 1.0;
    pixel = vec4(lit(gl_FrontFacing ? colour : 0.7 * colour, n, look), opaque);
}
"""
)

SKIN_SHADOW_VERTEX = (
    SKINNING
    + """
uniform mat4 flatten;
out vec3 place;
void main() {
    take_rows();
    vec4 fallen = flatten * vec4(taken(vec4(position, 1.0)), 1.0);
    place = fallen.xyz;
    gl_Position = transform * fallen;
}
"""
)

SKIN_SHADOW_FRAGMENT = SHADOW_FRAGMENT
