// The cloth in CUDA C++, one thread a mass, one step a launch: what a practised programmer writes first.
// Compiled at run time by cuda_cpp_cloth.py, with Real defined as float or double, and DAMPED where springs have dampers.
//
// Blocks of 32 x 8 masses; position and velocity as four numbers, 16 bytes a load; the fourth of a position tells pinned
// masses; each thread gathers the pulls of its up to twelve neighbours, which its block mostly has in its cache.
// Semi-implicit Euler.

struct __align__(16) Quad {
    Real x, y, z, w;
};

struct Spring {
    Real stiffness, stiffness_rest, damping;
};

struct Constants {
    Spring structural, shear, bending;
    Real damping, gravity, dt;
};

struct Sheet {
    const Quad *__restrict__ position, *__restrict__ velocity;
    int rows, columns;
};

__device__ __forceinline__ float inverse_root(float value) { return rsqrtf(value); }
__device__ __forceinline__ double inverse_root(double value) { return rsqrt(value); }

__device__ __forceinline__ void add_pull(const Sheet &s, const Spring &c, int i, int j, const Quad &p, const Quad &v,
                                         Quad &a) {
    if (i < 0 || i >= s.rows || j < 0 || j >= s.columns) return;
    const int k = i * s.columns + j;
    const Quad q = s.position[k];
    const Real dx = q.x - p.x, dy = q.y - p.y, dz = q.z - p.z;
    const Real squared = dx * dx + dy * dy + dz * dz;
    const Real inverse = squared > Real(0) ? inverse_root(squared) : Real(0);
    Real scale = c.stiffness - c.stiffness_rest * inverse;
#ifdef DAMPED
    const Quad w = s.velocity[k];
    scale += c.damping * ((w.x - v.x) * dx + (w.y - v.y) * dy + (w.z - v.z) * dz) * inverse * inverse;
#endif
    a.x += scale * dx;
    a.y += scale * dy;
    a.z += scale * dz;
}

extern "C" __global__ void __launch_bounds__(256)
cloth_step(const Quad *__restrict__ position, const Quad *__restrict__ velocity, Quad *__restrict__ new_position,
           Quad *__restrict__ new_velocity, int rows, int columns, Constants c) {
    const int j = blockIdx.x * 32 + threadIdx.x, i = blockIdx.y * 8 + threadIdx.y;
    if (i >= rows || j >= columns) return;
    const int k = i * columns + j;
    const Quad p = position[k], v = velocity[k];
    const Sheet s{position, velocity, rows, columns};
    Quad a{-c.damping * v.x, c.gravity - c.damping * v.y, -c.damping * v.z, Real(0)};
    for (int way = -1; way <= 1; way += 2) {
        add_pull(s, c.structural, i, j + way, p, v, a);
        add_pull(s, c.structural, i + way, j, p, v, a);
        add_pull(s, c.shear, i + way, j - 1, p, v, a);
        add_pull(s, c.shear, i + way, j + 1, p, v, a);
        add_pull(s, c.bending, i, j + 2 * way, p, v, a);
        add_pull(s, c.bending, i + 2 * way, j, p, v, a);
    }
    Quad w{v.x + a.x * c.dt, v.y + a.y * c.dt, v.z + a.z * c.dt, Real(0)};
    Quad q{p.x + w.x * c.dt, p.y + w.y * c.dt, p.z + w.z * c.dt, p.w};
    if (p.w != Real(0)) {
        q = p;
        w.x = w.y = w.z = Real(0);
    }
    new_position[k] = q;
    new_velocity[k] = w;
}
