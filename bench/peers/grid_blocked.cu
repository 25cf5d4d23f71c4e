// The grid in CUDA C++ with temporal blocking: several steps between two visits to device memory. float32.
// Compiled at run time by cuda_cpp_blocked.py, with ACROSS, DOWN, WARPS, HALO and BLOCKS (a multiprocessor) defined.
//
// A warp holds a strip of 32 * ACROSS columns and DOWN rows, each lane ACROSS x DOWN masses, all of it in registers; a
// block holds WARPS strips below one another. Left and right neighbours come by shuffles, and each spring along a row is
// computed once, its pull handed to the next lane; springs within a strip are computed once, too. Shared memory has only
// the first and the last row of every strip, twice, so that a step has one barrier.
//
// A tile loses a ring of masses a step, so it carries a halo of HALO rings and owns what lies inside.
//   grid_tiles     up to HALO steps of every tile, from memory to memory
//   grid_resident  all steps; tiles stay on the chip, and after HALO steps blocks exchange borders with their neighbours,
//                  each of which raises a flag: no barrier of the whole grid. All blocks must run at once.

constexpr int LANES = 32, WIDTH = LANES * ACROSS, HEIGHT = WARPS * DOWN;
constexpr int FLAG_STRIDE = 32;      // between two flags: a line of the cache each
constexpr int PATIENCE = 1 << 22;    // looks at a flag, seconds of them, before a block gives up
constexpr unsigned EVERY = 0xffffffffu;
static_assert(ACROSS * DOWN <= 32, "the masses of a lane are bits of a word");

struct Constants {
    float stiffness, stiffness_rest, damping, gravity, dt, half_dt_squared, inverse_dt;
};

struct __align__(8) Pair {
    float x, y;
};

// What a lane holds. `held`: pinned masses and places beyond the grid, a bit each.
struct Masses {
    Pair p[DOWN][ACROSS], v[DOWN][ACROSS];
};

// Where a lane's masses lie, and which springs of its strip end at the grid's edge.
struct Place {
    int i, j;                                      // of its first mass
    int row_first, row_end, column_first, column_end;  // what the block owns
    unsigned held;                                 // pinned, or beyond the grid
    bool special;                                  // of the warp: something is held, or the grid ends in it
};

__device__ __forceinline__ constexpr unsigned bit(int r, int c) { return 1u << (r * ACROSS + c); }

__device__ __forceinline__ Pair pull(const Constants &c, const Pair &here, const Pair &there) {
    const float dx = there.x - here.x, dy = there.y - here.y;
    const float squared = fmaxf(dx * dx + dy * dy, 1e-30f);  // masses in one place do not pull each other
    const float scale = c.stiffness - c.stiffness_rest * rsqrtf(squared);
    return {scale * dx, scale * dy};
}

__device__ __forceinline__ Pair chosen(bool yes, const Pair &pair) { return {yes ? pair.x : 0.0f, yes ? pair.y : 0.0f}; }

// The first and the last rows of all strips, of this step and of the next.
struct __align__(16) Ends {
    Pair row[2][WARPS][2][WIDTH];
};

template <bool Special>
__device__ __forceinline__ void step(Masses &m, const Pair (&above)[ACROSS], const Pair (&below)[ACROSS], bool has_above,
                                     bool has_below, const Place &place, const Constants &k, int rows, int columns) {
    const int lane = threadIdx.x;
    Pair up[ACROSS];
#pragma unroll
    for (int c = 0; c < ACROSS; ++c) up[c] = chosen(has_above, pull(k, above[c], m.p[0][c]));
#pragma unroll
    for (int r = 0; r < DOWN; ++r) {
        const Pair next{__shfl_down_sync(EVERY, m.p[r][0].x, 1), __shfl_down_sync(EVERY, m.p[r][0].y, 1)};
        Pair right[ACROSS], down[ACROSS];
#pragma unroll
        for (int c = 0; c < ACROSS; ++c) {
            right[c] = pull(k, m.p[r][c], c + 1 < ACROSS ? m.p[r][(c + 1) % ACROSS] : next);
            if (c + 1 == ACROSS) right[c] = chosen(lane + 1 < LANES, right[c]);
            if (Special) right[c] = chosen(place.j + c + 1 < columns, right[c]);
            down[c] = pull(k, m.p[r][c], r + 1 < DOWN ? m.p[(r + 1) % DOWN][c] : below[c]);
            if (r + 1 == DOWN) down[c] = chosen(has_below, down[c]);
            if (Special) down[c] = chosen(place.i + r + 1 < rows, down[c]);
        }
        const Pair last{__shfl_up_sync(EVERY, right[ACROSS - 1].x, 1), __shfl_up_sync(EVERY, right[ACROSS - 1].y, 1)};
        Pair left = chosen(lane > 0, last);
#pragma unroll
        for (int c = 0; c < ACROSS; ++c) {
            const Pair p = m.p[r][c], v = m.v[r][c];
            const float ax = (right[c].x - left.x) + (down[c].x - up[c].x) - k.damping * v.x;
            const float ay = (right[c].y - left.y) + (down[c].y - up[c].y) + (k.gravity - k.damping * v.y);
            const Pair q{p.x + v.x * k.dt + ax * k.half_dt_squared, p.y + v.y * k.dt + ay * k.half_dt_squared};
            const Pair w{(q.x - p.x) * k.inverse_dt, (q.y - p.y) * k.inverse_dt};
            const bool stays = Special && (place.held & bit(r, c)) != 0;
            m.p[r][c] = {stays ? p.x : q.x, stays ? p.y : q.y};
            m.v[r][c] = {stays ? 0.0f : w.x, stays ? 0.0f : w.y};
            left = right[c];
            up[c] = down[c];
        }
    }
}

__device__ __forceinline__ void run(int steps, int &parity, Masses &m, Ends &ends, const Place &place,
                                    const Constants &k, int rows, int columns) {
    const int warp = threadIdx.y, column = threadIdx.x * ACROSS;
    const bool has_above = warp > 0, has_below = warp + 1 < WARPS;
    for (int n = 0; n < steps; ++n) {
        Pair *first = ends.row[parity][warp][0] + column, *last = ends.row[parity][warp][1] + column;
#pragma unroll
        for (int c = 0; c < ACROSS; ++c) {
            first[c] = m.p[0][c];
            last[c] = m.p[DOWN - 1][c];
        }
        __syncthreads();
        const Pair *over = ends.row[parity][has_above ? warp - 1 : 0][1] + column;
        const Pair *under = ends.row[parity][has_below ? warp + 1 : WARPS - 1][0] + column;
        Pair above[ACROSS], below[ACROSS];
#pragma unroll
        for (int c = 0; c < ACROSS; ++c) {
            above[c] = over[c];
            below[c] = under[c];
        }
        if (place.special) {
            step<true>(m, above, below, has_above, has_below, place, k, rows, columns);
        } else {
            step<false>(m, above, below, has_above, has_below, place, k, rows, columns);
        }
        parity ^= 1;
    }
}

// (start, first and end of what is owned) of tile `index` of `count` along an axis of `masses`
__device__ __forceinline__ int axis(int index, int count, int masses, int size, int &first, int &end) {
    const int start = index * (size - 2 * HALO);
    first = index > 0 ? start + HALO : 0;
    end = index + 1 < count ? start + size - HALO : masses;
    return start;
}

__device__ __forceinline__ Place read(Masses &m, const Pair *__restrict__ position, const Pair *__restrict__ velocity,
                                      const unsigned char *__restrict__ pinned, int rows, int columns) {
    Place place;
    place.i = axis(blockIdx.y, gridDim.y, rows, HEIGHT, place.row_first, place.row_end) + threadIdx.y * DOWN;
    place.j = axis(blockIdx.x, gridDim.x, columns, WIDTH, place.column_first, place.column_end) + threadIdx.x * ACROSS;
    place.held = 0;
#pragma unroll
    for (int r = 0; r < DOWN; ++r) {
#pragma unroll
        for (int c = 0; c < ACROSS; ++c) {
            const bool inside = place.i + r < rows && place.j + c < columns;
            const int n = (place.i + r) * columns + place.j + c;
            m.p[r][c] = inside ? position[n] : Pair{0.0f, 0.0f};
            m.v[r][c] = inside ? velocity[n] : Pair{0.0f, 0.0f};
            if (!inside || pinned[n] != 0) place.held |= bit(r, c);
        }
    }
    const bool ends_here = place.i + DOWN >= rows || place.j + ACROSS >= columns;
    place.special = __any_sync(EVERY, ends_here || place.held != 0);
    return place;
}

// The masses of the lane within these rows and columns.
__device__ __forceinline__ unsigned bits_within(const Place &place, int row_first, int row_end, int column_first,
                                                int column_end) {
    unsigned bits = 0;
#pragma unroll
    for (int r = 0; r < DOWN; ++r) {
#pragma unroll
        for (int c = 0; c < ACROSS; ++c) {
            const int i = place.i + r, j = place.j + c;
            if (i >= row_first && i < row_end && j >= column_first && j < column_end) bits |= bit(r, c);
        }
    }
    return bits;
}

__device__ __forceinline__ void write(const Masses &m, const Place &place, unsigned mine, Pair *__restrict__ position,
                                      Pair *__restrict__ velocity, int columns) {
#pragma unroll
    for (int r = 0; r < DOWN; ++r) {
#pragma unroll
        for (int c = 0; c < ACROSS; ++c) {
            const int n = (place.i + r) * columns + place.j + c;
            if (mine & bit(r, c)) {
                position[n] = m.p[r][c];
                velocity[n] = m.v[r][c];
            }
        }
    }
}

extern "C" __global__ void __launch_bounds__(LANES * WARPS, BLOCKS)
grid_tiles(const Pair *__restrict__ position, const Pair *__restrict__ velocity, Pair *__restrict__ new_position,
           Pair *__restrict__ new_velocity, const unsigned char *__restrict__ pinned, int rows, int columns, int steps,
           Constants k) {
    __shared__ Ends ends;
    Masses m;
    const Place place = read(m, position, velocity, pinned, rows, columns);
    int parity = 0;
    run(steps, parity, m, ends, place, k, rows, columns);
    const unsigned mine = bits_within(place, place.row_first, place.row_end, place.column_first, place.column_end);
    write(m, place, mine, new_position, new_velocity, columns);
}

// ---------------------------------------------------------------------- blocks that stay

#ifndef SIMULATED
__device__ __forceinline__ void raise_flag(int *flag, int value) {
    asm volatile("st.release.gpu.global.s32 [%0], %1;" ::"l"(flag), "r"(value) : "memory");
}
__device__ __forceinline__ int read_flag(const int *flag) {
    int value;
    asm volatile("ld.acquire.gpu.global.s32 %0, [%1];" : "=r"(value) : "l"(flag) : "memory");
    return value;
}
#endif

// Threads 0 to 7 of the block each wait for the flag of one neighbour.
__device__ __forceinline__ void wait_for_neighbours(int *flags, int *failed, int wanted) {
    const int number = threadIdx.y * LANES + threadIdx.x;
    if (number >= 8) return;
    const int turn = number + (number > 3);  // 0 ... 8 without 4, which is the block itself
    const int down = int(blockIdx.y) + turn / 3 - 1, across = int(blockIdx.x) + turn % 3 - 1;
    if (down < 0 || down >= int(gridDim.y) || across < 0 || across >= int(gridDim.x)) return;
    const int *flag = flags + (down * int(gridDim.x) + across) * FLAG_STRIDE;
    int looks = 0;
    while (read_flag(flag) - wanted < 0) {
        if (++looks > PATIENCE || ((looks & 1023) == 0 && read_flag(failed) != 0)) {
            raise_flag(failed, 1);
            return;
        }
    }
}

// `border` (2, rows * columns): x, y, vx, vy of the masses near the edges of tiles, two exchanges in turn: a block writes
// border n + 2 only after its neighbours' flags n + 1, which they raised after they had read border n. Flags count on
// from `epoch`.
extern "C" __global__ void __launch_bounds__(LANES * WARPS, BLOCKS)
grid_resident(const Pair *__restrict__ position, const Pair *__restrict__ velocity, Pair *__restrict__ new_position,
              Pair *__restrict__ new_velocity, const unsigned char *__restrict__ pinned, int rows, int columns,
              int steps, Constants k, float4 *border, int *flags, int *failed, int epoch) {
    __shared__ Ends ends;
    Masses m;
    const Place place = read(m, position, velocity, pinned, rows, columns);
    const unsigned mine = bits_within(place, place.row_first, place.row_end, place.column_first, place.column_end);
    const unsigned outside = bits_within(place, 0, rows, 0, columns) & ~mine;
    const unsigned inner = bits_within(place, place.row_first > 0 ? place.row_first + HALO : 0,
                                       place.row_end < rows ? place.row_end - HALO : rows,
                                       place.column_first > 0 ? place.column_first + HALO : 0,
                                       place.column_end < columns ? place.column_end - HALO : columns);
    const unsigned near_edge = mine & ~inner;
    const int block = blockIdx.y * gridDim.x + blockIdx.x;
    const int masses = rows * columns;
    int parity = 0, offset = 0;
    for (int done = 0;;) {
        const int now = min(HALO, steps - done);
        run(now, parity, m, ends, place, k, rows, columns);
        done += now;
        if (done >= steps) break;
        ++epoch;
        if (near_edge != 0) {
#pragma unroll
            for (int r = 0; r < DOWN; ++r) {
#pragma unroll
                for (int c = 0; c < ACROSS; ++c)
                    if (near_edge & bit(r, c))
                        __stcg(border + offset + (place.i + r) * columns + place.j + c,
                               make_float4(m.p[r][c].x, m.p[r][c].y, m.v[r][c].x, m.v[r][c].y));
            }
        }
        __syncthreads();
        if (threadIdx.x == 0 && threadIdx.y == 0) raise_flag(flags + block * FLAG_STRIDE, epoch);
        wait_for_neighbours(flags, failed, epoch);
        __syncthreads();
        if (outside != 0) {
#pragma unroll
            for (int r = 0; r < DOWN; ++r) {
#pragma unroll
                for (int c = 0; c < ACROSS; ++c)
                    if (outside & bit(r, c)) {
                        const float4 f = __ldcg(border + offset + (place.i + r) * columns + place.j + c);
                        m.p[r][c] = {f.x, f.y};
                        m.v[r][c] = {f.z, f.w};
                    }
            }
        }
        offset = masses - offset;
    }
    write(m, place, mine, new_position, new_velocity, columns);
}
