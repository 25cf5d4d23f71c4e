"""Vertex buffers that a simulation on the GPU writes into by itself: positions and normals never leave the graphics card.

CUDA and OpenGL share the buffers where one GPU does both: a buffer is registered with CUDA once, and for each frame
mapped on the solver's own stream, written to by the solver's kernels, and unmapped. Mapping on that stream orders both
sides: the kernels wait for drawing that still reads the buffer, and the next drawing waits for the kernels. The first
failure is permanent: from then on, states go through host memory, as on the CPU.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from softlab.app.render.vertices import HostVertices
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene

STRAIGHT = "straight from the solver's GPU memory"
FEW_BYTES = (
    2**20
)  # of a plane's positions: sharing a buffer takes 0.35 ms a frame on an H200, the host's way of less is sooner
MAX_DEVICES = 64  # GPUs that one OpenGL context may draw with


class NotShared(Exception):
    """Reason why CUDA cannot write into this context's buffers."""


class CudaVertices(HostVertices):
    """HostVertices that the GPU fills directly where that is possible. Needs the same current OpenGL context in each
    call.

    `transfer`: path of the last state in words and, if a GPU computed it, the reason why it is not direct. `shared`
    False: always through the host (to compare both), as are states of fewer than `few` bytes. A buffer is registered
    only while simulations write into it, because data from the host needs a new store, which is not allowed for a
    registered buffer.
    """

    def __init__(self, scene: Scene):
        super().__init__(scene)
        self.shared = True
        self.few = FEW_BYTES if self.flat else 0
        self._refused = ""
        self._resources: dict[int, object] = {}  # buffer -> what CUDA knows it by

    def straight(self, simulation: Simulation) -> bool:
        """True if simulations on the GPU write directly: the state is not too small, and no attempt has failed."""
        wanted = self.shared and self._position.nbytes >= self.few
        return simulation.backend == "gpu" and wanted and not self._refused

    def upload(self, simulation: Simulation, normals: bool = True, position: np.ndarray | None = None) -> None:
        """Send a state; `position` is not used if the simulation writes by itself."""
        if self.straight(simulation):
            try:
                self._write(simulation, normals)
                self.transfer = STRAIGHT
                return
            except Exception as error:  # drivers fail in many ways; what is wrong with the simulation is raised below
                self._refused = _reason(error)
        self._unregister()
        super().upload(simulation, normals, position)
        indirect = simulation.backend == "gpu" and self._refused
        self.transfer = f"{HostVertices.transfer}: {self._refused}" if indirect else HostVertices.transfer

    def upload_state(self, position: np.ndarray, normals: bool = True, normal: np.ndarray | None = None) -> None:
        """Send a state through the host."""
        self._unregister()
        super().upload_state(position, normals, normal)
        self.transfer = HostVertices.transfer

    def delete(self) -> None:
        """Free the buffers; unregister them from CUDA first."""
        self._unregister()
        super().delete()

    # ------------------------------------------------------------------ sharing

    def _write(self, simulation: Any, normals: bool) -> None:
        """Let the simulation's kernels write into the buffers. Raises NotShared."""
        if not self._resources:
            self._register()
        handle = (
            simulation.stream.handle
        )  # an integer-like object of cuda.bindings, or a ctypes pointer of older versions
        stream = self._runtime.cudaStream_t(int(getattr(handle, "value", handle) or 0))
        targets = {"position": self.position_buffer} | ({"normal": self.normal_buffer} if normals else {})
        for name, buffer in targets.items():
            with self._mapped(buffer, stream) as array:
                simulation.read(name, into=array)

    @cached_property
    def _runtime(self) -> ModuleType:
        return load_runtime()

    def _register(self) -> None:
        from pyglet import gl

        require_same_gpu(self._runtime)
        discard = self._runtime.cudaGraphicsRegisterFlags.cudaGraphicsRegisterFlagsWriteDiscard
        arrays = {self.position_buffer: self._position} | ({} if self.flat else {self.normal_buffer: self._normal})
        for buffer, array in arrays.items():
            self.send(buffer, array, gl.GL_DYNAMIC_COPY)  # a store for what the GPU writes and the GPU draws
            registered = self._runtime.cudaGraphicsGLRegisterBuffer(buffer, int(discard))
            (self._resources[buffer],) = _checked(registered, "sharing a buffer")

    @contextmanager
    def _mapped(self, buffer: int, stream: object) -> Iterator[SimpleNamespace]:
        """Return the buffer as a (particles, dimensions) float32 array of CUDA, for kernels in `stream`."""
        runtime, resource = self._runtime, self._resources[buffer]
        _checked(runtime.cudaGraphicsMapResources(1, resource, stream), "mapping a buffer")
        try:
            pointer, size = _checked(runtime.cudaGraphicsResourceGetMappedPointer(resource), "mapping a buffer")
            if size < self._position.nbytes:
                raise NotShared(f"a mapped buffer has {size} bytes and not {self._position.nbytes}")
            interface = {
                "shape": self._position.shape,
                "typestr": self._position.dtype.str,
                "data": (int(pointer), False),
                "strides": None,
                "version": 3,
            }
            yield SimpleNamespace(__cuda_array_interface__=interface)
        finally:
            unmapped = runtime.cudaGraphicsUnmapResources(1, resource, stream)
        _checked(unmapped, "unmapping a buffer")

    def _unregister(self) -> None:
        """Unregister the buffers from CUDA. Failures are ignored, since the buffers are freed or refilled next."""
        for resource in self._resources.values():
            self._runtime.cudaGraphicsUnregisterResource(resource)
        self._resources.clear()


def load_runtime() -> ModuleType:
    """Import CUDA's runtime. Raises NotShared."""
    from softlab.gpu_backend.core.device import simulated

    if simulated():
        raise NotShared("the CUDA simulator has no GPU memory")
    try:
        from cuda.bindings import runtime
    except ImportError:
        raise NotShared("cuda.bindings is missing (pip install cuda-bindings)") from None
    return runtime


def require_same_gpu(runtime: ModuleType) -> None:
    """Raise NotShared if the GPU that draws is not the one that CUDA uses.

    Drivers that cannot list their devices fail later, when a buffer is registered.
    """
    vendor, renderer = drawn_by()
    if "nvidia" not in vendor.lower():  # CUDA is not even asked about a context it cannot know
        raise NotShared(f"{renderer} draws, not the GPU that computes")
    (device,) = _checked(runtime.cudaGetDevice(), "asking for the GPU")
    status, count, devices = runtime.cudaGLGetDevices(MAX_DEVICES, runtime.cudaGLDeviceList.cudaGLDeviceListAll)
    if int(status) == 0 and count and int(device) not in [int(known) for known in devices[:count]]:
        raise NotShared(f"another GPU draws ({renderer})")


def drawn_by() -> tuple[str, str]:
    """Return (vendor, renderer) of the current OpenGL context, as its driver names them."""
    import pyglet.gl

    context = pyglet.gl.current_context
    assert context is not None, "vertex buffers need a current OpenGL context"
    info = context.get_info()
    return str(info.get_vendor()), str(info.get_renderer())


def _checked(result: tuple[Any, ...], what: str) -> tuple[Any, ...]:
    """Return the results of a call of the runtime, without its status. Raises NotShared."""
    status, *values = result
    if int(status) != 0:
        raise NotShared(f"{what} failed ({getattr(status, 'name', status)})")
    return tuple(values)


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())[:120]
    return text if isinstance(error, NotShared) else f"{type(error).__name__}: {text}"
