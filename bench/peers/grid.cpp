// The grid in C++ with OpenMP: the bar for the lab's CPU kernels. Compiled at run time by cpp_openmp.py.
//
// Structure of arrays, each spring once per row pass: the pulls along a row go into a row buffer, the pulls from the row
// below are carried to the next row. Two drivers around one row function:
//   plain    one step a pass over the grid, one band of rows a thread, `parallel for` in every step
//   blocked  several time levels a pass: columns in tiles, rows streamed through three-row rings, one for each level, that
//            stay in cache; what a band or tile needs of its neighbours it computes itself
//
// A state is (4, rows, columns): x, y, vx, vy. `constants`: stiffness / mass, the same times the rest length, damping /
// mass, gravity along +y, dt, dt^2 / 2.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>
#include <omp.h>

namespace {

using Index = std::int64_t;
constexpr int FIELDS = 4;
constexpr Index PADDING = 32;  // elements between two rows that different threads write

template <class Real> struct Grid {
    Index rows, columns;
    Real stiffness, stiffness_rest, damping, gravity, dt, half_dt_squared;
    const Index *pin_start, *pin_column;  // (rows + 1): where the pins of a row begin; their columns
};

// Rows of x, y, vx, vy, so that [j] is column j of the grid.
template <class Real> struct Row {
    Real *__restrict x, *__restrict y, *__restrict vx, *__restrict vy;
};

template <class Real> inline Real spring_scale(Real dx, Real dy, Real stiffness, Real stiffness_rest) {
    const Real squared = dx * dx + dy * dy;
    return squared > 0 ? stiffness - stiffness_rest * (1 / std::sqrt(squared)) : Real(0);
}

// Pull on the masses of `row` from those of `below`, columns [first, last).
template <class Real>
void pull_down(const Grid<Real> &grid, const Row<Real> row, const Row<Real> below, Index first, Index last,
               Real *__restrict pull_x, Real *__restrict pull_y) {
    const Real stiffness = grid.stiffness, stiffness_rest = grid.stiffness_rest;
#pragma omp simd
    for (Index j = first; j < last; ++j) {
        const Real dx = below.x[j] - row.x[j], dy = below.y[j] - row.y[j];
        const Real scale = spring_scale(dx, dy, stiffness, stiffness_rest);
        pull_x[j] = scale * dx;
        pull_y[j] = scale * dy;
    }
}

template <class Real> struct Scratch {
    Real *along_x, *along_y;         // pull between columns j - 1 and j
    Real *down_x[2], *down_y[2];     // pull from below, of this row and of the one above, in turn
};

// One step of row i, columns [first, last), from `row` (and `below`) into `out`.
template <class Real>
void advance_row(const Grid<Real> &grid, Index i, const Row<Real> row, const Row<Real> below, const Row<Real> out,
                 Index first, Index last, const Scratch<Real> &scratch) {
    const Real stiffness = grid.stiffness, stiffness_rest = grid.stiffness_rest;
    Real *__restrict along_x = scratch.along_x, *__restrict along_y = scratch.along_y;
    Real *__restrict down_x = scratch.down_x[i & 1], *__restrict down_y = scratch.down_y[i & 1];
    const Real *__restrict up_x = scratch.down_x[~i & 1], *__restrict up_y = scratch.down_y[~i & 1];
    const Index inner_first = std::max<Index>(first, 1), inner_last = std::min(last + 1, grid.columns);
#pragma omp simd
    for (Index j = inner_first; j < inner_last; ++j) {
        const Real dx = row.x[j] - row.x[j - 1], dy = row.y[j] - row.y[j - 1];
        const Real scale = spring_scale(dx, dy, stiffness, stiffness_rest);
        along_x[j] = scale * dx;
        along_y[j] = scale * dy;
    }
    if (first == 0) along_x[0] = along_y[0] = 0;
    if (last == grid.columns) along_x[last] = along_y[last] = 0;
    if (i < grid.rows - 1) {
        pull_down(grid, row, below, first, last, down_x, down_y);
    } else {
        std::fill(down_x + first, down_x + last, Real(0));
        std::fill(down_y + first, down_y + last, Real(0));
    }
    const Real damping = grid.damping, gravity = grid.gravity, dt = grid.dt, half = grid.half_dt_squared;
    const Real inverse_dt = 1 / dt;
#pragma omp simd
    for (Index j = first; j < last; ++j) {
        const Real ax = (along_x[j + 1] - along_x[j]) + (down_x[j] - up_x[j]) - damping * row.vx[j];
        const Real x = row.x[j] + row.vx[j] * dt + ax * half;
        out.x[j] = x;
        out.vx[j] = (x - row.x[j]) * inverse_dt;
    }
#pragma omp simd
    for (Index j = first; j < last; ++j) {
        const Real ay = (along_y[j + 1] - along_y[j]) + (down_y[j] - up_y[j]) + gravity - damping * row.vy[j];
        const Real y = row.y[j] + row.vy[j] * dt + ay * half;
        out.y[j] = y;
        out.vy[j] = (y - row.y[j]) * inverse_dt;
    }
    for (Index k = grid.pin_start[i]; k < grid.pin_start[i + 1]; ++k) {
        const Index j = grid.pin_column[k];
        if (first <= j && j < last) {
            out.x[j] = row.x[j];
            out.y[j] = row.y[j];
            out.vx[j] = out.vy[j] = 0;
        }
    }
}

template <class Real> Row<Real> row_of(const Grid<Real> &grid, Real *state, Index i) {
    const Index field = grid.rows * grid.columns;
    Real *row = state + i * grid.columns;
    return {row, row + field, row + 2 * field, row + 3 * field};
}

// The buffers of a thread: six rows of pulls a level, shifted so that [j] is column j from `base` on.
template <class Real> Scratch<Real> scratch_of(Real *memory, Index width, Index base) {
    Real *row = memory - base;
    return {row, row + width, {row + 2 * width, row + 3 * width}, {row + 4 * width, row + 5 * width}};
}

// The pull that row `first` gets from above, before its band begins.
template <class Real>
void begin_rows(const Grid<Real> &grid, Index first_row, const Row<Real> above, const Row<Real> row, Index first,
                Index last, const Scratch<Real> &scratch) {
    Real *up_x = scratch.down_x[~first_row & 1], *up_y = scratch.down_y[~first_row & 1];
    if (first_row > 0) {
        pull_down(grid, above, row, first, last, up_x, up_y);
    } else {
        std::fill(up_x + first, up_x + last, Real(0));
        std::fill(up_y + first, up_y + last, Real(0));
    }
}

template <class Real> int plain(const Grid<Real> &grid, Real *states, int current, Index steps, int threads) {
    const Index size = FIELDS * grid.rows * grid.columns, width = grid.columns + 1 + PADDING;
    const Index bands = std::min<Index>(threads, grid.rows);
    std::vector<Real> memory(bands * 6 * width);
    for (Index step = 0; step < steps; ++step) {
        Real *source = states + current * size, *target = states + (1 - current) * size;
#pragma omp parallel for num_threads(threads) schedule(static, 1)
        for (Index band = 0; band < bands; ++band) {
            const Index first = grid.rows * band / bands, last = grid.rows * (band + 1) / bands;
            const Scratch<Real> scratch = scratch_of(memory.data() + band * 6 * width, width, 0);
            begin_rows(grid, first, row_of(grid, source, first - (first > 0)), row_of(grid, source, first), 0,
                       grid.columns, scratch);
            for (Index i = first; i < last; ++i)
                advance_row(grid, i, row_of(grid, source, i), row_of(grid, source, std::min(i + 1, grid.rows - 1)),
                            row_of(grid, target, i), 0, grid.columns, scratch);
        }
        current = 1 - current;
    }
    return current;
}

// Levels 1 ... levels of rows [first_row, last_row), columns [first_column, last_column), from `source` into `target`.
// Level l computes the rows and columns that the levels after it need: levels - l more on every side inside the grid.
template <class Real>
void stream_tile(const Grid<Real> &grid, Real *source, Real *target, int levels, Index first_row, Index last_row,
                 Index first_column, Index last_column, Real *memory, Index width) {
    const Index base = std::max<Index>(0, first_column - levels);
    const Index ring_size = 3 * FIELDS * width, level_size = ring_size + 6 * width;
    auto ring_row = [&](int level, Index i) -> Row<Real> {  // row i after `level` steps
        if (level == 0) return row_of(grid, source, i);
        if (level == levels) return row_of(grid, target, i);
        Real *row = memory + level * level_size + (i % 3) * FIELDS * width - base;
        return {row, row + width, row + 2 * width, row + 3 * width};
    };
    const Index begin = std::max<Index>(0, first_row - levels + 1);  // the first row of level 1
    for (Index front = begin; front < last_row + levels; ++front) {  // level l does row front - (l - 1)
        for (int level = 1; level <= levels; ++level) {
            const Index more = levels - level, i = front - (level - 1);
            const Index top = std::max<Index>(0, first_row - more), bottom = std::min(grid.rows, last_row + more);
            if (i < top || i >= bottom) continue;
            const Index first = std::max<Index>(0, first_column - more);
            const Index last = std::min(grid.columns, last_column + more);
            const Scratch<Real> scratch = scratch_of(memory + level * level_size + ring_size, width, base);
            const Row<Real> row = ring_row(level - 1, i);
            if (i == top) begin_rows(grid, i, ring_row(level - 1, i - (i > 0)), row, first, last, scratch);
            advance_row(grid, i, row, ring_row(level - 1, std::min(i + 1, grid.rows - 1)), ring_row(level, i), first,
                        last, scratch);
        }
    }
}

template <class Real>
int blocked(const Grid<Real> &grid, Real *states, int current, Index steps, int threads, int most_levels,
            Index tile) {
    const Index size = FIELDS * grid.rows * grid.columns;
    const Index width = std::min(tile, grid.columns) + 2 * most_levels + 1 + PADDING;
    const Index bands = std::min<Index>(threads, grid.rows), tiles = (grid.columns + tile - 1) / tile;
    const Index memory_size = (most_levels + 1) * (3 * FIELDS + 6) * width;
    std::vector<Real> memory(bands * memory_size);
#pragma omp parallel num_threads(threads)
    {
        int now = current;
        for (Index done = 0; done < steps;) {
            const int levels = int(std::min<Index>(most_levels, steps - done));
            Real *source = states + now * size, *target = states + (1 - now) * size;
#pragma omp for schedule(static, 1)  // ends with a barrier: a pass reads what the last one wrote
            for (Index band = 0; band < bands; ++band)
                for (Index k = 0; k < tiles; ++k)
                    stream_tile(grid, source, target, levels, grid.rows * band / bands, grid.rows * (band + 1) / bands,
                                grid.columns * k / tiles, grid.columns * (k + 1) / tiles,
                                memory.data() + band * memory_size, width);
            now = 1 - now;
            done += levels;
        }
    }
    const Index passes = (steps + most_levels - 1) / most_levels;
    return int((current + passes) % 2);
}

template <class Real>
int advance(Index rows, Index columns, Index steps, int current, Real *states, const double *constants,
            const Index *pin_start, const Index *pin_column, int threads, int levels, Index tile) {
    const Grid<Real> grid{rows, columns, Real(constants[0]), Real(constants[1]), Real(constants[2]),
                          Real(constants[3]), Real(constants[4]), Real(constants[5]), pin_start, pin_column};
    if (levels <= 0) return plain(grid, states, current, steps, threads);
    return blocked(grid, states, current, steps, threads, levels, tile);
}

}  // namespace

// `steps` steps from states[current], (2, 4, rows, columns); returns which of the two now holds the state.
// `levels` 0: the plain driver; else the time levels of a pass, and the columns of a `tile`.
extern "C" int advance_float32(Index rows, Index columns, Index steps, int current, float *states,
                               const double *constants, const Index *pin_start, const Index *pin_column, int threads,
                               int levels, Index tile) {
    return advance(rows, columns, steps, current, states, constants, pin_start, pin_column, threads, levels, tile);
}

extern "C" int advance_float64(Index rows, Index columns, Index steps, int current, double *states,
                               const double *constants, const Index *pin_start, const Index *pin_column, int threads,
                               int levels, Index tile) {
    return advance(rows, columns, steps, current, states, constants, pin_start, pin_column, threads, levels, tile);
}
