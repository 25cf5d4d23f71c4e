"""A CUDA driver made of NumPy memory and g++: enough of cuda.bindings.driver to run bench/peers/cuda_cpp.py without a
GPU.

The kernel is the real grid.cu, compiled as C++ with loops over blocks and threads. A captured launch only runs when its
graph is launched, as on a device. Kernels whose threads shuffle, meet at barriers and wait for other blocks' flags
(grid_blocked.cu) have each thread as a coroutine (ucontext): all blocks run at once, as a cooperative launch has it, and who
must wait lets the others run.
"""

import ctypes
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

SHIM = """
#include <cmath>
struct float2 { float x, y; };
struct double2 { double x, y; };
struct Place { int x, y; };
static Place threadIdx, blockIdx;
static inline float rsqrtf(float value) { return 1 / std::sqrt(value); }
static inline double rsqrt(double value) { return 1 / std::sqrt(value); }
#define __global__
#define __device__
#define __forceinline__ inline
#define __launch_bounds__(threads)
#include "grid.cu"
extern "C" void run(int across, int down, int columns, int rows, void **a) {
    for (blockIdx.y = 0; blockIdx.y < down; ++blockIdx.y)
        for (blockIdx.x = 0; blockIdx.x < across; ++blockIdx.x)
            for (threadIdx.y = 0; threadIdx.y < rows; ++threadIdx.y)
                for (threadIdx.x = 0; threadIdx.x < columns; ++threadIdx.x)
                    grid_step(*(const Pair **)a[0], *(const Pair **)a[1], *(Pair **)a[2], *(Pair **)a[3],
                              *(const unsigned char **)a[4], *(const unsigned char **)a[5], *(int *)a[6], *(int *)a[7],
                              *(Constants *)a[8]);
}
"""


SHARED = "__shared__ Ends ends;"
BLOCKS_SHIM = r"""
#include <cmath>
#include <cstring>
#include <csetjmp>
#include <memory>
#include <vector>
#include <ucontext.h>

#define SIMULATED
#define __global__
#define __device__
#define __forceinline__ inline
#define __launch_bounds__(threads, blocks)
#define __align__(bytes) alignas(bytes)
#define __restrict__
struct float4 { float x, y, z, w; };
struct Index { int x, y; };
static Index threadIdx, blockIdx, gridDim;
using std::min;
static inline float rsqrtf(float value) { return 1 / std::sqrt(value); }
static inline float4 make_float4(float x, float y, float z, float w) { return {x, y, z, w}; }

constexpr int WARP = 32, STACK = 1 << 16;
struct Meeting { int arrived = 0, number = 0; };
struct Thread {
    ucontext_t context;
    jmp_buf place;
    std::unique_ptr<char[]> stack;
    Index thread, block;
    int turn = 0;
    bool begun = false, done = false;
};
struct Block { Meeting barrier; std::vector<Meeting> warps; std::vector<float> words; std::vector<char> shared; };
static std::vector<Thread> threads;
static std::vector<Block> blocks;
static jmp_buf scheduler;  // jumps, since changing contexts asks the operating system each time
static int current, threads_a_block;

static Block &mine() { return blocks[current / threads_a_block]; }
static void yield() {
    Thread &thread = threads[current];
    if (!_setjmp(thread.place)) _longjmp(scheduler, 1);
    threadIdx = threads[current].thread, blockIdx = threads[current].block;
}
static void meet(Meeting &meeting, int count) {
    const int number = meeting.number;
    if (++meeting.arrived == count) {
        meeting.arrived = 0;
        ++meeting.number;
    }
    while (meeting.number == number) yield();
}
static void __syncthreads() { meet(mine().barrier, threads_a_block); }
static float from_lane(float value, int lane, int other) {
    Thread &thread = threads[current];
    float *words = mine().words.data() + (threadIdx.y * 2 + (thread.turn++ & 1)) * WARP;
    words[lane] = value;
    meet(mine().warps[threadIdx.y], WARP);
    return words[other < 0 || other >= WARP ? lane : other];
}
static float __shfl_down_sync(unsigned, float value, int by) { return from_lane(value, threadIdx.x, threadIdx.x + by); }
static float __shfl_up_sync(unsigned, float value, int by) { return from_lane(value, threadIdx.x, threadIdx.x - by); }
static bool __any_sync(unsigned, bool value) {
    bool any = false;
    for (int by = 0; by < WARP; ++by) any |= from_lane(value, threadIdx.x, (threadIdx.x + by) % WARP) != 0;
    return any;
}
static void __stcg(float4 *place, const float4 &value) { *place = value; }
static float4 __ldcg(const float4 *place) { return *place; }
static void raise_flag(int *flag, int value) { *flag = value; }
static int read_flag(const int *flag) {
    yield();
    return *flag;
}
template <class Kept> static Kept &of_block() {
    std::vector<char> &shared = mine().shared;
    if (shared.empty()) shared.resize(sizeof(Kept));
    return *reinterpret_cast<Kept *>(shared.data());
}
#include "source.cu"

static void **arguments;
static bool cooperative;
static void entry() {
    threadIdx = threads[current].thread, blockIdx = threads[current].block;
    void **a = arguments;
#define COMMON *(const Pair **)a[0], *(const Pair **)a[1], *(Pair **)a[2], *(Pair **)a[3], \
    *(const unsigned char **)a[4], *(int *)a[5], *(int *)a[6], *(int *)a[7], *(Constants *)a[8]
    if (cooperative) {
        grid_resident(COMMON, *(float4 **)a[9], *(int **)a[10], *(int **)a[11], *(int *)a[12]);
    } else {
        grid_tiles(COMMON);
    }
    threads[current].done = true;
    _longjmp(scheduler, 1);
}

extern "C" void run(int across, int down, int lanes, int warps, void **a, int together) {
    arguments = a, cooperative = together, gridDim = {across, down}, threads_a_block = lanes * warps;
    threads = std::vector<Thread>(across * down * threads_a_block);
    blocks = std::vector<Block>(across * down);
    for (Block &block : blocks) {
        block.warps.resize(warps);
        block.words.resize(warps * 2 * WARP);
    }
    for (size_t n = 0; n < threads.size(); ++n) {
        const int block = n / threads_a_block, place = n % threads_a_block;
        Thread &thread = threads[n];
        thread.stack.reset(new char[STACK]);
        thread.thread = {place % lanes, place / lanes}, thread.block = {block % across, block / across};
        getcontext(&thread.context);
        thread.context.uc_stack.ss_sp = thread.stack.get(), thread.context.uc_stack.ss_size = STACK;
        thread.context.uc_link = nullptr;
        makecontext(&thread.context, entry, 0);
    }
    static size_t n, left;  // kept through jumps
    for (left = threads.size(); left > 0;) {
        left = 0;
        for (n = 0; n < threads.size(); ++n) {
            Thread &thread = threads[n];
            if (thread.done) continue;
            current = n, ++left;
            threadIdx = thread.thread, blockIdx = thread.block;
            if (_setjmp(scheduler)) continue;
            if (thread.begun) _longjmp(thread.place, 1);
            thread.begun = true;
            setcontext(&thread.context);
        }
    }
}
"""


def compile_for_host(
    source: Path, types: tuple[str, ...], folder: Path, compiler: str, shim_text: str = SHIM
) -> ctypes.CDLL:
    """grid.cu with its loops, or another source with `shim_text`, as a library."""
    shim, library = folder / "shim.cpp", folder / f"{types[1].partition('=')[2]}.so"
    shim.write_text(shim_text, encoding="utf-8")
    command = [compiler, "-O1", "-shared", "-fPIC", *types, f"-I{source.parent}", str(shim), "-o", str(library)]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(library))


class FakeDriver:
    """`launches`: how often Python launched a kernel or a graph."""

    CUdevice_attribute = SimpleNamespace(
        CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR=0, CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR=1
    )
    CUstream_flags = SimpleNamespace(CU_STREAM_NON_BLOCKING=1)
    CUstreamCaptureMode = SimpleNamespace(CU_STREAM_CAPTURE_MODE_RELAXED=2)

    def __init__(self, library: ctypes.CDLL):
        self.run = library.run
        self.run.argtypes = [ctypes.c_int] * 4 + [ctypes.c_void_p]
        self.memory: dict[int, np.ndarray] = {}
        self.graphs: dict[int, list[tuple]] = {}
        self.captured: list[tuple] | None = None
        self.launches = 0

    def __getattr__(self, name: str):
        if not name.startswith("cu"):
            raise AttributeError(name)
        return lambda *_: (0, 7)  # done; a handle

    def cuDeviceGetAttribute(self, attribute, _):
        return 0, 9 - 9 * attribute

    def cuMemAlloc(self, size):
        memory = np.zeros(size, np.uint8)
        self.memory[memory.ctypes.data] = memory
        return 0, memory.ctypes.data

    def cuMemFree(self, address):
        del self.memory[address]
        return (0,)

    def cuMemcpyHtoD(self, target, source, size):
        ctypes.memmove(target, source, size)
        return (0,)

    cuMemcpyDtoH = cuMemcpyHtoD

    def cuLaunchKernel(self, _, across, down, deep, columns, rows, thick, shared, stream, arguments, extra):
        launch = (across, down, columns, rows, arguments)
        if self.captured is not None:
            self.captured.append(launch)
        else:
            self.launches += 1
            self.run(*launch)
        return (0,)

    def cuStreamBeginCapture(self, *_):
        self.captured = []
        return (0,)

    def cuStreamEndCapture(self, _):
        graph = len(self.graphs) + 100
        self.graphs[graph], self.captured = self.captured, None
        return 0, graph

    def cuGraphInstantiate(self, graph, _):
        return 0, graph

    def cuGraphLaunch(self, graph, _):
        self.launches += 1
        for launch in self.graphs[graph]:
            self.run(*launch)
        return (0,)


def compile_blocks(source: Path, definitions: tuple[str, ...], folder: Path, compiler: str) -> bytes:
    """The source for one tile, with its scheduler, as a library: its path, as FakeBlocks takes machine code."""
    shim, library = folder / "blocks.cpp", folder / f"blocks{'-'.join(definitions)}.so"
    shim.write_text(BLOCKS_SHIM, encoding="utf-8")
    text = source.read_text(encoding="utf-8")
    assert text.count(SHARED) == 2
    (folder / "source.cu").write_text(text.replace(SHARED, "Ends &ends = of_block<Ends>();"), encoding="utf-8")
    command = [compiler, "-std=c++17", "-O1", "-shared", "-fPIC", *definitions, str(shim), "-o", str(library)]
    subprocess.run(command, check=True)
    return str(library).encode() + b"\0"


class FakeBlocks(FakeDriver):
    """FakeDriver for kernels of whole blocks, cooperative ones too. A module's code is the path of its library."""

    CUdevice_attribute = SimpleNamespace(
        **vars(FakeDriver.CUdevice_attribute), CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT=0
    )

    def __init__(self) -> None:
        super().__init__(SimpleNamespace(run=ctypes.CFUNCTYPE(None)()))  # type: ignore[arg-type]
        self.calls: list[Any] = []

    def cuModuleLoadData(self, address):
        call = ctypes.CDLL(ctypes.string_at(address).decode()).run
        call.argtypes = [ctypes.c_int] * 4 + [ctypes.c_void_p, ctypes.c_int]
        self.calls.append(call)
        return 0, len(self.calls) - 1

    def cuModuleGetFunction(self, module, _):
        return 0, module

    def cuLaunchKernel(self, function, across, down, deep, columns, rows, *more):
        self.run = lambda across, down, columns, rows, arguments: self.calls[function](
            across, down, columns, rows, arguments, 0
        )
        return super().cuLaunchKernel(function, across, down, deep, columns, rows, *more)

    def cuLaunchCooperativeKernel(self, function, across, down, deep, columns, rows, thick, shared, stream, arguments):
        self.launches += 1
        self.calls[function](across, down, columns, rows, arguments, 1)
        return (0,)
