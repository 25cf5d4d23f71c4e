"""A CUDA driver made of NumPy memory and g++: enough of cuda.bindings.driver to run bench/peers/cuda_cpp.py without a
GPU.

The kernel is the real grid.cu, compiled as C++ with loops over blocks and threads. A captured launch only runs when its
graph is launched, as on a device.
"""

import ctypes
import subprocess
from pathlib import Path
from types import SimpleNamespace

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
