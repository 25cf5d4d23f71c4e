"""The shaders of a fluid's surface, GLSL 3.30: particles as ellipsoids, normals from their depth, and light.

Depth is the distance from the eye along the line of view [m], in 32-bit float; 0: no fluid. The passes are described in
app/render/fluid/surface.py; the filters that smooth the depth are in app/render/fluid/filter_shaders.py.
"""

from __future__ import annotations

from softlab.app.render.fluid.filter_shaders import AT

# A square across the line of sight that covers the ball about an ellipsoid. `axes` takes the unit ball to the ellipsoid,
# `back` takes it back: the three rows of the inverse.
ELLIPSOID_VERTEX = """#version 330 core
layout(location = 0) in vec3 position;  // m
layout(location = 4) in vec4 look;      // what light the fluid takes away [1/m], the ball's radius [m]
layout(location = 5) in vec3 back_x;
layout(location = 6) in vec3 back_y;
layout(location = 7) in vec3 back_z;
uniform mat4 transform;
uniform vec3 eye;
uniform vec3 upward;
out vec3 place;
flat out vec3 centre;
flat out vec3 taken;
flat out mat3 back;
void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    vec3 toward = eye - position;
    float away = dot(toward, toward), radius = look.a;
    centre = position;
    taken = look.rgb;
    back = transpose(mat3(back_x, back_y, back_z));
    vec3 across = normalize(cross(upward, toward)), up = normalize(cross(toward, across));
    float half_side = radius * sqrt(away / max(away - radius * radius, 1e-4 * away)) * 1.02;
    place = position + half_side * (corner.x * across + corner.y * up);
    gl_Position = transform * vec4(place, 1.0);
}
"""

# Where the line of sight enters and leaves: |back (eye + t ray - centre)| = 1.
INTERSECTION = """
in vec3 place;
flat in vec3 centre;
flat in vec3 taken;
flat in mat3 back;
uniform vec3 eye;
uniform vec3 ahead;         // unit vector, the view direction
vec2 hits(vec3 ray) {        // distances from the eye, x > y: the line does not meet it
    vec3 from = back * (eye - centre), along = back * ray;
    float a = dot(along, along), b = dot(from, along), c = dot(from, from) - 1.0;
    float root = b * b - a * c;
    if (root < 0.0) return vec2(1.0, 0.0);
    root = sqrt(root);
    return vec2(-b - root, -b + root) / a;
}
"""

DEPTH_FRAGMENT = (
    "#version 330 core\n"
    + INTERSECTION
    + """
uniform mat4 transform;
out float depth;
void main() {
    vec3 ray = normalize(place - eye);
    vec2 t = hits(ray);
    if (t.x > t.y || t.x <= 0.0) discard;
    depth = t.x * dot(ray, ahead);
    vec4 clip = transform * vec4(eye + t.x * ray, 1.0);
    gl_FragDepth = 0.5 + 0.5 * clip.z / clip.w;
}
"""
)

# How far away the nearest is that is no fluid [m], along the line of view.
SOLID = """
uniform sampler2D others;   // the depth of the picture without the fluid, as OpenGL keeps it
uniform vec2 planes;        // m: near, far
float solid_at(ivec2 p) {
    float other = 2.0 * texelFetch(others, p, 0).r - 1.0;
    return 2.0 * planes.x * planes.y / (planes.y + planes.x - other * (planes.y - planes.x));
}
float solid() { return solid_at(ivec2(gl_FragCoord.xy)); }
"""

# Summed over the particles behind a pixel that nothing hides: how long the line of sight is inside, and what that takes of
# each colour.
THICKNESS_FRAGMENT = (
    "#version 330 core\n"
    + INTERSECTION
    + SOLID
    + """
out vec4 sum;
void main() {
    vec3 ray = normalize(place - eye);
    vec2 t = hits(ray);
    float end = min(t.y, solid() / dot(ray, ahead));
    if (t.x > t.y || t.x <= 0.0 || t.x > end) discard;
    float inside = OVERLAP * (end - t.x);
    sum = vec4(taken * inside, inside);
}
"""
)

SCREEN_VERTEX = """#version 330 core
void main() {
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}
"""

# Of the two differences to a pixel's neighbours along an axis mostly the smaller one: it lies on the same surface.
NORMAL = (
    AT
    + """
uniform float focal;
uniform vec2 middle;        // pixels
vec3 seen(vec2 pixel, float far) { return vec3((pixel - middle) * far / focal, -far); }  // m, in the camera's axes
vec3 along(vec2 pixel, vec3 here, ivec2 way) {
    float one = at(ivec2(pixel) + way), other = at(ivec2(pixel) - way);
    vec3 forth = seen(pixel + vec2(way), one) - here, back = here - seen(pixel - vec2(way), other);
    if (one <= 0.0 && other <= 0.0) return vec3(vec2(way), 0.0);
    if (one <= 0.0) return back;
    if (other <= 0.0) return forth;
    float a = forth.z * forth.z + 1e-20, b = back.z * back.z + 1e-20;
    return (b * forth + a * back) / (a + b);
}
vec3 normal_at(vec2 pixel, vec3 here) {
    return normalize(cross(along(pixel, here, ivec2(1, 0)), along(pixel, here, ivec2(0, 1))));
}
"""
)

NORMAL_FRAGMENT = (
    "#version 330 core\n"
    + NORMAL
    + """
out vec4 encoded;            // normal in the camera's axes, depth
void main() {
    float far = at(ivec2(gl_FragCoord.xy));
    encoded = far <= 0.0 ? vec4(0.0) : vec4(normal_at(gl_FragCoord.xy, seen(gl_FragCoord.xy, far)), far);
}
"""
)

# Schlick's reflectance; what is behind, seen through the fluid and moved aside, times Beer and Lambert's law; a sky; the sun.
SHADE_FRAGMENT = (
    "#version 330 core\n"
    + NORMAL
    + SOLID
    + """
uniform sampler2D thickness;
uniform sampler2D outline;  // depth, coverage
uniform sampler2D behind;   // the picture without the fluid
uniform mat3 axes;          // columns: right, up, back, in the world
uniform vec3 key;           // unit vector toward the light, in the world
uniform float edge;         // m: a fluid less far before a solid fades
uniform float bend;         // pixels by which a slope of 1 moves what is seen through a metre of fluid
uniform vec3 zenith;
uniform vec3 horizon;
uniform vec3 floor_colour;
out vec4 pixel;
vec3 sky(vec3 way) {
    float up = way.y;
    return up > 0.0 ? mix(horizon, zenith, pow(up, 0.5)) : mix(horizon, floor_colour, min(-4.0 * up, 1.0));
}
ivec2 open_side(ivec2 p, float far) {  // the neighbour beyond the edge of a solid that hides the fluid at p, or p
    for (int k = 0; k < 4; k++) {
        ivec2 way = k < 2 ? ivec2(2 * k - 1, 0) : ivec2(0, 2 * k - 5);
        if (at(p + way) > 0.0 && solid_at(p + way) > far && solid_at(p - way) <= far) return p + way;
    }
    return p;
}
void main() {
    ivec2 p = ivec2(gl_FragCoord.xy), open = p;
    float far = at(p), part = 1.0;
    if (far <= 0.0) discard;
    if (far > solid()) {        // samples of a pixel at a solid's edge are half of the solid, half of what is behind
        open = open_side(p, far);
        if (open == p) discard;
        part = 0.5;
    }
    vec3 here = seen(gl_FragCoord.xy, far), n = normal_at(gl_FragCoord.xy, here), look = -normalize(here);
    vec4 inside = texelFetch(thickness, open, 0);
    float facing = clamp(dot(n, look), 0.0, 1.0);
    float reflected = 0.02 + 0.98 * pow(1.0 - facing, 5.0);
    vec2 aside = gl_FragCoord.xy - bend * n.xy * min(inside.a, far) * focal / far;
    vec3 through = texture(behind, aside / vec2(textureSize(behind, 0))).rgb * exp(-inside.rgb);
    vec3 mirrored = axes * reflect(-look, n);
    float sun = pow(max(dot(mirrored, key), 0.0), 160.0), bright = 0.45 + 0.55 * max(dot(axes * n, key), 0.0);
    vec3 own = exp(-OPAQUE * inside.rgb / max(max(inside.r, max(inside.g, inside.b)), 1e-9));  // the colour that is left most
    through += SCATTER * bright * own * (1.0 - exp(-inside.rgb));  // part of what does not come through
    vec3 shown = mix(through, sky(mirrored), reflected) + 0.7 * sun;
    float cover = part * texelFetch(outline, open, 0).g * clamp((solid_at(open) - far) / edge, 0.0, 1.0);
    vec3 beside = mix(texelFetch(behind, p, 0).rgb, texelFetch(behind, 2 * p - open, 0).rgb, cover);
    pixel = vec4(mix(beside, shown, cover), 1.0);
}
""".replace("OPAQUE", "2.0").replace("SCATTER", "0.95")
)
