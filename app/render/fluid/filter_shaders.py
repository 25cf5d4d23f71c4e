"""The shaders that make a fluid's surface smooth, GLSL 3.30: filters of its depth and of its thickness.

Depth is the distance from the eye along the line of view [m], in 32-bit float; 0: no fluid.
"""

from __future__ import annotations

from math import pi

MOST_PIXELS = 96.0  # that filters look to each side, at most
BELL_SAMPLES = 8  # of a bell, to each side
LEVEL = 0.42  # of the bell over what is covered, where the outline is; 0.5 at a straight edge
STEEPNESS = 0.39  # of that bell across a straight edge at the level, times its width
BESIDE = 2.0  # standard deviations: how far aside a pixel of an outline finds whether it belongs to a drop or a body
DROP, BODY = 0.5, 1.0  # of the largest bell there: 0.34 in a ball of 0.9 standard deviations, 0.57 in a row of them
RIM = 1.33  # standard deviations that the edge of a slanted plane is behind the mean: of half a bell
PAIRS = 32  # of pixels that a pass of the narrow-range filter reads along its axis


# A bell along one axis, in steps of some pixels where a particle is large, for what has no edges to keep.
BLUR_FRAGMENT = f"""#version 330 core
uniform sampler2D thickness;
uniform sampler2D depth;
uniform ivec2 axis;
uniform float half_width;        // m
uniform float focal;
out vec4 sum;
void main() {{
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = textureSize(depth, 0) - 1;
    float here = texelFetch(depth, pixel, 0).r, weight = 0.0;
    sum = vec4(0.0);
    if (here <= 0.0) return;
    float wide = min(half_width * focal / here, {MOST_PIXELS});
    int taps = clamp(int(ceil(wide)), 1, {BELL_SAMPLES});
    for (int k = -taps; k <= taps; k++) {{
        float part = float(k) / float(taps);
        vec4 there = texelFetch(thickness, clamp(pixel + int(round(part * wide)) * axis, ivec2(0), last), 0);
        float share = there.a > 0.0 ? exp(-4.5 * part * part) : 0.0;
        sum += share * there;
        weight += share;
    }}
    sum /= max(weight, 1e-9);
}}
"""

# The outline of what is covered, in cells of some pixels: first means over every second of them, of coverage, of depth and
# of its square where it is covered ...
GATHER_FRAGMENT = """#version 330 core
uniform sampler2D depth;
uniform int cell;           // pixels
out vec4 sum;
void main() {
    ivec2 first = ivec2(gl_FragCoord.xy) * cell, last = textureSize(depth, 0) - 1;
    sum = vec4(0.0);
    for (int i = 0; i < cell; i += 2)
        for (int j = 0; j < cell; j += 2) {
            float there = texelFetch(depth, min(first + ivec2(i, j), last), 0).r;
            sum += vec4(sign(there), there, there * there, 1.0);
        }
    sum /= sum.a;
}
"""

# ... then a bell over them, along one axis and along the other ...
BELL_FRAGMENT = """#version 330 core
uniform sampler2D cells;
uniform ivec2 axis;
uniform ivec2 last;         // cell
uniform float wide;         // cells: standard deviation
out vec4 sum;
vec4 at(int aside) { return texelFetch(cells, clamp(ivec2(gl_FragCoord.xy) + aside * axis, ivec2(0), last), 0); }
void main() {
    float share = 1.0, less = exp(-0.5 / (wide * wide)), faster = less * less, weight = 1.0;
    sum = at(0);
    for (int k = 1; float(k) <= 2.0 * wide; k++, less *= faster) {
        share *= less;  // exp(-k^2 / (2 wide^2))
        sum += share * (at(k) + at(-k));
        weight += 2.0 * share;
    }
    sum /= weight;
}
"""

# ... and where that of coverage is above a level, there is fluid, as far away as the edge of what is covered about: gaps
# close between the outermost particles, but not between what is one behind another. Particles that stick out of a body of
# fluid are cut at that level; a drop, beside which the bell is low everywhere, stays whole.
OUTLINE_FRAGMENT = f"""#version 330 core
uniform sampler2D depth;
uniform sampler2D cells;
uniform int cell;
uniform ivec2 last;
uniform float wide;         // cells
uniform float apart;        // m: standard deviation of depth of what is too far behind one another
out vec2 outline;           // depth, coverage: it fades within a pixel
vec3 bell_of(ivec2 at) {{ return texelFetch(cells, clamp(at, ivec2(0), last), 0).rgb; }}
vec3 bell(vec2 at) {{
    vec2 part = fract(at);
    ivec2 low = ivec2(floor(at));
    return mix(
        mix(bell_of(low), bell_of(low + ivec2(1, 0)), part.x), mix(bell_of(low + ivec2(0, 1)), bell_of(low + 1), part.x),
        part.y
    );
}}
void main() {{
    ivec2 pixel = ivec2(gl_FragCoord.xy), end = textureSize(depth, 0) - 1;
    vec2 at = gl_FragCoord.xy / float(cell);
    float about = texelFetch(cells, ivec2(at), 0).r, here = texelFetch(depth, pixel, 0).r;
    outline = vec2(here, sign(here));
    if (about <= 0.0 || (about > 0.99 && here > 0.0)) return;
    at -= 0.5;
    vec3 sum = bell(at);
    sum.gb /= max(sum.r, 1e-9);
    float spread = sqrt(max(sum.b - sum.g * sum.g, 0.0));
    float level = {LEVEL} * (here > 0.0 ? 1.0 : max(1.0, spread / apart)), beside = 0.0;
    for (int k = 0; k < 8; k++) {{
        vec2 aside = {BESIDE} * wide * vec2(cos(0.25 * {pi} * float(k)), sin(0.25 * {pi} * float(k)));
        beside = max(beside, bell(at + aside).r);
    }}
    float alone = 1.0 - smoothstep({DROP}, {BODY}, beside), steep = wide * float(cell) / {STEEPNESS};
    float cover = clamp((sum.r - level) * steep + 0.5, 0.0, 1.0), near = 0.0;
    if (here > 0.0 && cover < 1.0) {{
        for (int i = -1; i <= 1; i++)
            for (int j = -1; j <= 1; j++) {{
                float there = texelFetch(depth, clamp(pixel + ivec2(i, j), ivec2(0), end), 0).r;
                near += sign(there) / float(4 << (abs(i) + abs(j)));
            }}
        cover = max(cover, min(near, clamp((sum.r - (1.0 - alone) * level) * steep + 0.5, 0.0, 1.0)));
    }}
    outline = vec2(cover <= 0.0 ? 0.0 : here > 0.0 ? here : sum.g + {RIM} * spread, cover);
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

# N. Truong, C. Yuksel, "A Narrow-Range Filter for Screen-Space Fluid Rendering", PACMCGIT 1 (2018), equations 4 to 7: what is
# nearer than the range is another surface in front and does not count, nor does its mirror image; what is farther counts as
# if it were a little behind; the range grows with what lies in it.
NARROW = f"""#version 330 core
{AT}
uniform float range;        // m
uniform float behind;       // m
out float smooth_depth;
float here, nearest, farthest, sum, weight;
void begin() {{
    here = at(ivec2(gl_FragCoord.xy));
    smooth_depth = sum = here;
    nearest = here - range, farthest = here + range, weight = 1.0;
}}
void take(ivec2 aside, float share) {{
    float one = at(ivec2(gl_FragCoord.xy) + aside), other = at(ivec2(gl_FragCoord.xy) - aside);
    if (one <= 0.0) one = farthest + 1e9;
    if (other <= 0.0) other = farthest + 1e9;
    float counts = min(one, other) < nearest ? 0.0 : share;
    sum += counts * ((one > farthest ? here + behind : one) + (other > farthest ? here + behind : other));
    weight += 2.0 * counts;
    one = counts > 0.0 && one <= farthest ? one : here;  // here they change nothing
    other = counts > 0.0 && other <= farthest ? other : here;
    nearest = min(nearest, min(one, other) - range);
    farthest = max(farthest, max(one, other) + range);
}}
"""

# Along one axis, in steps of some pixels where a particle is large.
NARROW_FRAGMENT = f"""{NARROW}
uniform ivec2 axis;          // (1, 0), (0, 1)
uniform float half_width;        // m: the filter's half width
uniform float focal;        // pixels
void main() {{
    begin();
    if (here <= 0.0) return;
    float wide = min(half_width * focal / here, {MOST_PIXELS});
    int taps = min(int(ceil(wide)), {PAIRS});
    for (int k = 1; k <= taps; k++) {{
        float part = float(k) / float(taps);
        take(int(round(part * wide)) * axis, exp(-4.5 * part * part));
    }}
    smooth_depth = sum / weight;
}}
"""

# All about a pixel: passes along the axes leave streaks along them.
CLEAN_FRAGMENT = f"""{NARROW}
void main() {{
    begin();
    if (here <= 0.0) return;
    for (int j = 1; j <= 2; j++) take(ivec2(0, j), exp(-0.25 * float(j * j)));
    for (int i = 1; i <= 2; i++)
        for (int j = -2; j <= 2; j++) take(ivec2(i, j), exp(-0.25 * float(i * i + j * j)));
    smooth_depth = sum / weight;
}}
"""
