// The grid in CUDA C++, one thread a mass, one step a launch: what a practised programmer writes first.
// Compiled at run time by cuda_cpp.py, with Real and Pair defined as float and float2, or double and double2.
//
// Blocks of 32 x 8 masses; position and velocity as pairs, one load each; 32-bit indices; each thread gathers the pulls of
// its four neighbours, which its block mostly has in its cache.

struct Constants {
    Real stiffness, stiffness_rest, damping, gravity, dt, half_dt_squared, inverse_dt;
};

__device__ __forceinline__ float inverse_root(float value) { return rsqrtf(value); }
__device__ __forceinline__ double inverse_root(double value) { return rsqrt(value); }

__device__ __forceinline__ void add_pull(const Constants &c, Pair here, Pair neighbour, Real &ax, Real &ay) {
    const Real dx = neighbour.x - here.x, dy = neighbour.y - here.y;
    const Real squared = dx * dx + dy * dy;
    const Real scale = squared > Real(0) ? c.stiffness - c.stiffness_rest * inverse_root(squared) : Real(0);
    ax += scale * dx;
    ay += scale * dy;
}

extern "C" __global__ void __launch_bounds__(256)
grid_step(const Pair *__restrict__ position, const Pair *__restrict__ velocity, Pair *__restrict__ new_position,
          Pair *__restrict__ new_velocity, const unsigned char *__restrict__ pinned_row,
          const unsigned char *__restrict__ pinned, int rows, int columns, Constants c) {
    const int j = blockIdx.x * 32 + threadIdx.x, i = blockIdx.y * 8 + threadIdx.y;
    if (i >= rows || j >= columns) return;
    const int k = i * columns + j;
    const Pair p = position[k], v = velocity[k];
    Real ax = -c.damping * v.x, ay = c.gravity - c.damping * v.y;
    if (j + 1 < columns) add_pull(c, p, position[k + 1], ax, ay);
    if (j > 0) add_pull(c, p, position[k - 1], ax, ay);
    if (i + 1 < rows) add_pull(c, p, position[k + columns], ax, ay);
    if (i > 0) add_pull(c, p, position[k - columns], ax, ay);
    Pair q, w;
    q.x = p.x + v.x * c.dt + ax * c.half_dt_squared;
    q.y = p.y + v.y * c.dt + ay * c.half_dt_squared;
    w.x = (q.x - p.x) * c.inverse_dt;
    w.y = (q.y - p.y) * c.inverse_dt;
    if (pinned_row[i] && pinned[k]) {
        q = p;
        w.x = w.y = Real(0);
    }
    new_position[k] = q;
    new_velocity[k] = w;
}
