// Position-based tetrahedra of the neo-Hookean material in plain C++ with OpenMP: the lab's own rows, in the lab's order.
//
// XPBD (Macklin, Mueller, Chentanez, MIG 2016) with one iteration a substep, so that every multiplier starts at 0. With J =
// det F the energy per volume is mu / 2 S + lambda / 2 (J - 1)^2, S = |F|^2 + J^2 - 4 J (Smith, de Goes, Kim, TOG 2018, but
// written as two terms that each vanish at rest): first a step down the gradient of S, then the constraint J - 1.
// Constraints come by colour, in each by runs of `run`, the constraints of which one thread takes one after the other.
// A particle is x, y, z, weight. Values of a constraint: six of the inverse rest edges, upper triangular, by rows; the
// compliances of the two terms, 1 / (mu V) and 1 / (lambda V) [1/J]; J at rest; a damper's time, which is not read.

#include <algorithm>
#include <cstdint>
#include <limits>

// g++ would call some, and hand dozens of numbers over in memory
#define INLINE [[gnu::always_inline]] inline

namespace {

constexpr int kValues = 10;
constexpr int64_t kTogether = 16;  // runs, whose first constraints come first: they do not wait for each other

template <typename Real>
struct Vector {
    Real x, y, z;
    Vector operator-(const Vector &o) const { return {x - o.x, y - o.y, z - o.z}; }
    Vector operator+(const Vector &o) const { return {x + o.x, y + o.y, z + o.z}; }
    Vector operator*(Real s) const { return {x * s, y * s, z * s}; }
};

template <typename Real>
INLINE Real dot(const Vector<Real> &a, const Vector<Real> &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

template <typename Real>
INLINE Vector<Real> cross(const Vector<Real> &a, const Vector<Real> &b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <typename Real>
struct Columns { Vector<Real> a, b, c; };  // of a matrix

// A : B
template <typename Real>
INLINE Real inner(const Columns<Real> &a, const Columns<Real> &b) { return dot(a.a, b.a) + dot(a.b, b.b) + dot(a.c, b.c); }

template <typename Real>
INLINE Columns<Real> cofactor(const Columns<Real> &f) { return {cross(f.b, f.c), cross(f.c, f.a), cross(f.a, f.b)}; }

// F = E B, E's columns the edges from the first corner, B by rows; of displacements in place of places its change
template <typename Real>
INLINE Columns<Real> gradient(const Vector<Real> *p, const Real *rest) {
    const Vector<Real> e = p[1] - p[0], f = p[2] - p[0], g = p[3] - p[0];
    return {e * rest[0], e * rest[1] + f * rest[3], e * rest[2] + f * rest[4] + g * rest[5]};
}

// What a matrix by F is by the place of each corner
template <typename Real>
INLINE void to_corners(const Columns<Real> &g, const Real *rest, Vector<Real> *at) {
    at[1] = g.a * rest[0] + g.b * rest[1] + g.c * rest[2];
    at[2] = g.b * rest[3] + g.c * rest[4];
    at[3] = g.c * rest[5];
    at[0] = (at[1] + at[2] + at[3]) * Real(-1);
}

// S: along the way D that the impulse R = -dS/dF / 2 moves F, to where S of second order and what R costs are least. S / 2
// has the curvature q along D, taken as no less than that at rest of a way that does not turn.
template <typename Real>
INLINE void shape(Vector<Real> *p, const Real *w, const Real *rest, Real compliance) {
    constexpr Real least = std::numeric_limits<Real>::min() / std::numeric_limits<Real>::epsilon();  // to be divided by
    const Columns<Real> f = gradient(p, rest), h = cofactor(f);
    const Real excess = dot(f.a, h.a) - Real(2);
    const Columns<Real> r{h.a * -excess - f.a, h.b * -excess - f.b, h.c * -excess - f.c};
    Vector<Real> g[4], way[4];
    to_corners(r, rest, g);
    for (int n = 0; n < 4; ++n) way[n] = g[n] * w[n];
    const Real impulse = dot(g[0], way[0]) + dot(g[1], way[1]) + dot(g[2], way[2]) + dot(g[3], way[3]);
    const Columns<Real> d = gradient(way, rest);
    const Real squared = inner(d, d), swelling = inner(h, d);
    const Real second = squared + swelling * swelling + 2 * excess * inner(f, cofactor(d));
    const Real q = second > 2 * squared ? second : 2 * squared;
    const Real x = impulse > least ? impulse / (compliance * impulse + q) : Real(0);
    for (int n = 0; n < 4; ++n) p[n] = p[n] + way[n] * x;
}

// J - rest
template <typename Real>
INLINE void volume(Vector<Real> *p, const Real *w, const Real *rest, Real ratio, Real compliance) {
    const Columns<Real> f = gradient(p, rest), h = cofactor(f);
    Vector<Real> g[4];
    to_corners(h, rest, g);
    const Real weight = w[0] * dot(g[0], g[0]) + w[1] * dot(g[1], g[1]) + w[2] * dot(g[2], g[2]) + w[3] * dot(g[3], g[3]);
    const Real change = weight > 0 ? (ratio - dot(f.a, h.a)) / (weight + compliance) : Real(0);
    for (int n = 0; n < 4; ++n) p[n] = p[n] + g[n] * (w[n] * change);
}

template <typename Real>
INLINE void project(Real *position, const int32_t *corners, const Real *values, Real softness) {
    Vector<Real> p[4];
    Real w[4];
    for (int n = 0; n < 4; ++n) {
        const Real *at = position + 4 * int64_t(corners[n]);
        p[n] = {at[0], at[1], at[2]};
        w[n] = at[3];
    }
    shape(p, w, values, softness * values[6]);
    volume(p, w, values, values[8], softness * values[7]);
    for (int n = 0; n < 4; ++n) {
        Real *at = position + 4 * int64_t(corners[n]);
        at[0] = p[n].x, at[1] = p[n].y, at[2] = p[n].z;
    }
}

template <typename Real>
void advance(int64_t substeps, int64_t particles, int64_t colours, int64_t run, Real *position, Real *velocity,
             Real *before, const int32_t *corners, const Real *values, const int64_t *starts, const double *numbers,
             int threads) {
    const Real h = Real(numbers[0]), gravity = Real(numbers[1]), softness = Real(numbers[2]), rate = Real(numbers[3]);
#pragma omp parallel num_threads(threads)
    for (int64_t substep = 0; substep < substeps; ++substep) {
#pragma omp for schedule(static)
        for (int64_t k = 0; k < particles; ++k) {
            Real *p = position + 4 * k, *b = before + 4 * k, *v = velocity + 4 * k;
            b[0] = p[0], b[1] = p[1], b[2] = p[2];
            if (p[3] == 0) continue;
            p[0] += h * v[0], p[1] += h * (v[1] + h * gravity), p[2] += h * v[2];
        }
        for (int64_t colour = 0; colour < colours; ++colour) {
            const int64_t first = starts[colour], runs = (starts[colour + 1] - first) / run;
#pragma omp for schedule(static)
            for (int64_t block = 0; block < runs; block += kTogether)
                for (int64_t member = 0; member < run; ++member)
                    for (int64_t mine = block; mine < std::min(block + kTogether, runs); ++mine) {
                        const int64_t k = first + mine * run + member;
                        project(position, corners + 4 * k, values + kValues * k, softness);
                    }
        }
#pragma omp for schedule(static)
        for (int64_t k = 0; k < particles; ++k)
            for (int axis = 0; axis < 3; ++axis)
                velocity[4 * k + axis] =
                    position[4 * k + 3] == 0 ? Real(0) : (position[4 * k + axis] - before[4 * k + axis]) * rate;
    }
}

}  // namespace

extern "C" {

void advance_float32(int64_t substeps, int64_t particles, int64_t colours, int64_t run, float *position,
                     float *velocity, float *before, const int32_t *corners, const float *values,
                     const int64_t *starts, const double *numbers, int threads) {
    advance(substeps, particles, colours, run, position, velocity, before, corners, values, starts, numbers, threads);
}

void advance_float64(int64_t substeps, int64_t particles, int64_t colours, int64_t run, double *position,
                     double *velocity, double *before, const int32_t *corners, const double *values,
                     const int64_t *starts, const double *numbers, int threads) {
    advance(substeps, particles, colours, run, position, velocity, before, corners, values, starts, numbers, threads);
}

}
