// Position-based tetrahedra of the neo-Hookean material in plain C++ with OpenMP: the lab's own rows, in the lab's order.
//
// XPBD (Macklin, Mueller, Chentanez, MIG 2016) with one iteration a substep: C_D = |F|, then C_H = det F - alpha (Macklin,
// Mueller, MIG 2021). Constraints come by colour, in each by runs of `run`, which one thread takes one after the other.
// A particle is x, y, z, weight. Values of a constraint: six of the inverse rest edges, upper triangular, by rows; the
// compliances of C_D and C_H [1/J]; alpha; a damper's time, which is not read.

#include <cmath>
#include <cstdint>

namespace {

constexpr int kValues = 10;

template <typename Real>
struct Vector {
    Real x, y, z;
    Vector operator-(const Vector &o) const { return {x - o.x, y - o.y, z - o.z}; }
    Vector operator+(const Vector &o) const { return {x + o.x, y + o.y, z + o.z}; }
    Vector operator*(Real s) const { return {x * s, y * s, z * s}; }
};

template <typename Real>
Real dot(const Vector<Real> &a, const Vector<Real> &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

template <typename Real>
Vector<Real> cross(const Vector<Real> &a, const Vector<Real> &b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <typename Real>
struct Columns { Vector<Real> a, b, c; };  // of a matrix

// F = D B, D's columns the edges from the first corner, B by rows
template <typename Real>
Columns<Real> gradient(const Vector<Real> *p, const Real *rest) {
    const Vector<Real> e = p[1] - p[0], f = p[2] - p[0], g = p[3] - p[0];
    return {e * rest[0], e * rest[1] + f * rest[3], e * rest[2] + f * rest[4] + g * rest[5]};
}

// One constraint of value `violation` whose derivative by F is `g`.
template <typename Real>
void row(Vector<Real> *p, const Real *w, const Real *rest, Real violation, const Columns<Real> &g, Real compliance) {
    const Vector<Real> gb = g.a * rest[0] + g.b * rest[1] + g.c * rest[2];
    const Vector<Real> gc = g.b * rest[3] + g.c * rest[4];
    const Vector<Real> gd = g.c * rest[5];
    const Vector<Real> ga = (gb + gc + gd) * Real(-1);
    const Real weight = w[0] * dot(ga, ga) + w[1] * dot(gb, gb) + w[2] * dot(gc, gc) + w[3] * dot(gd, gd);
    const Real change = weight > 0 ? -violation / (weight + compliance) : Real(0);
    p[0] = p[0] + ga * (w[0] * change);
    p[1] = p[1] + gb * (w[1] * change);
    p[2] = p[2] + gc * (w[2] * change);
    p[3] = p[3] + gd * (w[3] * change);
}

template <typename Real>
void project(Real *position, const int32_t *corners, const Real *values, Real softness) {
    Vector<Real> p[4];
    Real w[4];
    for (int n = 0; n < 4; ++n) {
        const Real *at = position + 4 * int64_t(corners[n]);
        p[n] = {at[0], at[1], at[2]};
        w[n] = at[3];
    }
    const Columns<Real> f = gradient(p, values);
    const Real squared = dot(f.a, f.a) + dot(f.b, f.b) + dot(f.c, f.c);
    row(p, w, values, squared, f, softness * values[6] * squared);  // both sides of its equation times C_D^2
    const Columns<Real> h = gradient(p, values);
    const Columns<Real> cofactor{cross(h.b, h.c), cross(h.c, h.a), cross(h.a, h.b)};
    row(p, w, values, dot(h.a, cofactor.a) - values[8], cofactor, softness * values[7]);
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
            for (int64_t mine = 0; mine < runs; ++mine)
                for (int64_t k = first + mine * run; k < first + (mine + 1) * run; ++k)
                    project(position, corners + 4 * k, values + kValues * k, softness);
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
