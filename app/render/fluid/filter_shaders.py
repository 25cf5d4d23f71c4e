"""The shaders that make a fluid's surface smooth, GLSL 3.30: filters of its depth and of its thickness.

Depth is the distance from the eye along the line of view [m], in 32-bit float; 0: no fluid.
"""

from __future__ import annotations

MOST_TAPS = 48  # pixels to each side that the filter looks, at most

# A bell along one axis, for what has no edges to keep.
BLUR_FRAGMENT = f"""#version 330 core
uniform sampler2D thickness;
uniform sampler2D depth;
uniform ivec2 way;
uniform float reach;        // m
uniform float focal;
out vec4 sum;
void main() {{
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = textureSize(depth, 0) - 1;
    float here = texelFetch(depth, pixel, 0).r;
    sum = vec4(0.0);
    if (here <= 0.0) return;
    float wide = clamp(reach * focal / here, 0.01, {MOST_TAPS}.0), weight = 0.0;
    for (int k = -int(wide); k <= int(wide); k++) {{
        ivec2 there = clamp(pixel + k * way, ivec2(0), last);
        float share = texelFetch(depth, there, 0).r > 0.0 ? exp(-4.5 * float(k * k) / (wide * wide)) : 0.0;
        sum += share * texelFetch(thickness, there, 0);
        weight += share;
    }}
    sum /= weight;
}}
"""

# The depth at a pixel; beside the picture there is no fluid.
AT = """
uniform sampler2D depth;
float at(ivec2 pixel) {
    ivec2 size = textureSize(depth, 0);
    return any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, size)) ? 0.0 : texelFetch(depth, pixel, 0).r;
}
"""

# N. Truong, C. Yuksel, "A Narrow-Range Filter for Screen-Space Fluid Rendering", PACMCGIT 1 (2018), equations 4 to 7, along
# one axis: what is nearer than the range is another surface in front and does not count, nor does its mirror image; what is
# farther counts as if it were a little behind; the range grows with what lies in it.
NARROW_FRAGMENT = f"""#version 330 core
{AT}
uniform ivec2 way;          // (1, 0), (0, 1)
uniform float reach;        // m: the filter's half width
uniform float focal;        // pixels
uniform float range;        // m
uniform float behind;       // m
out float smooth_depth;
void main() {{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float here = at(pixel);
    smooth_depth = here;
    if (here <= 0.0) return;
    float wide = clamp(reach * focal / here, 0.0, {MOST_TAPS}.0);
    int taps = int(ceil(wide));
    float nearest = here - range, farthest = here + range, sum = here, weight = 1.0;
    for (int k = 1; k <= taps; k++) {{
        float one = at(pixel + k * way), other = at(pixel - k * way);
        if (one <= 0.0) one = farthest + 1e9;
        if (other <= 0.0) other = farthest + 1e9;
        if (one < nearest || other < nearest) continue;
        float share = exp(-4.5 * float(k * k) / (wide * wide));
        sum += share * ((one > farthest ? here + behind : one) + (other > farthest ? here + behind : other));
        weight += 2.0 * share;
        if (one <= farthest) {{ nearest = min(nearest, one - range); farthest = max(farthest, one + range); }}
        if (other <= farthest) {{ nearest = min(nearest, other - range); farthest = max(farthest, other + range); }}
    }}
    smooth_depth = sum / weight;
}}
"""

# W. van der Laan, S. Green, M. Sainz, "Screen Space Fluid Rendering with Curvature Flow", I3D 2009: a step against the mean
# curvature; none over edges.
STEP = 0.2  # pixels^2, of curvature flow: explicit diffusion in a plane is stable up to a quarter
CURVATURE_FRAGMENT = (
    "#version 330 core\n"
    + AT
    + """
uniform float focal;
uniform float range;        // m
out float smooth_depth;
void main() {
    ivec2 p = ivec2(gl_FragCoord.xy);
    float here = at(p);
    smooth_depth = here;
    if (here <= 0.0) return;
    float l = at(p - ivec2(1, 0)), r = at(p + ivec2(1, 0)), d = at(p - ivec2(0, 1)), u = at(p + ivec2(0, 1));
    float worst = max(max(abs(l - here), abs(r - here)), max(abs(d - here), abs(u - here)));
    if (worst > range || min(min(l, r), min(d, u)) <= 0.0) return;
    float side = here / focal;  // m, of a pixel there
    vec2 slope = vec2(r - l, u - d) / (2.0 * side);
    float xx = (l + r - 2.0 * here) / (side * side), yy = (d + u - 2.0 * here) / (side * side);
    float xy = (at(p + 1) - at(p + ivec2(1, -1)) - at(p + ivec2(-1, 1)) + at(p - 1)) / (4.0 * side * side);
    float size = 1.0 + dot(slope, slope);
    float curvature = (xx * (1.0 + slope.y * slope.y) + yy * (1.0 + slope.x * slope.x) - 2.0 * xy * slope.x * slope.y)
        / (2.0 * size * sqrt(size));
    smooth_depth = here + STEP * side * side * 2.0 * curvature;
}
""".replace("STEP", str(STEP))
)
