"""CUDA's sharing of OpenGL buffers without a GPU, for tests: what a simulation writes into a mapped buffer lies in host
memory until it is unmapped, and then in OpenGL's buffer. Every call is recorded, and any can be made to fail."""

from __future__ import annotations

import ctypes
from enum import IntEnum
from types import SimpleNamespace
from typing import Any

import numpy as np
from fake_cloth import FakeCloth

from softlab.model.core.simulation import Options
from softlab.model.scene.scene import Scene


class Status(IntEnum):
    cudaSuccess = 0
    cudaErrorInvalidDevice = 101
    cudaErrorUnknown = 999


class FakeRuntime:
    """`calls`: (what, buffer, ...) in order. `fails`: name of a call -> (from which time on it fails, its status)."""

    cudaGraphicsRegisterFlags = SimpleNamespace(cudaGraphicsRegisterFlagsWriteDiscard=2)
    cudaGLDeviceList = SimpleNamespace(cudaGLDeviceListAll=1)

    def __init__(self, devices: tuple[int, ...] = (0,), size: int | None = None, **fails: tuple[int, Status]):
        self.devices, self.size, self.fails = devices, size, fails
        self.calls: list[tuple[Any, ...]] = []
        self.counts: dict[str, int] = {}
        self.registered: set[int] = set()
        self.memory: dict[int, np.ndarray] = {}  # of the mapped buffers

    def _status(self, name: str) -> Status:
        self.counts[name] = self.counts.get(name, 0) + 1
        first, status = self.fails.get(name, (0, Status.cudaSuccess))
        return status if first and self.counts[name] >= first else Status.cudaSuccess

    @staticmethod
    def cudaStream_t(handle: int) -> int:
        return handle

    def cudaGetDevice(self) -> tuple[Any, ...]:
        status = self._status("get_device")
        return status, (None if status else 0)

    def cudaGLGetDevices(self, most: int, which: int) -> tuple[Any, ...]:
        status = self._status("gl_devices")
        if status:
            return status, None, None
        return status, len(self.devices), [*self.devices, *[0] * (most - len(self.devices))]

    def cudaGraphicsGLRegisterBuffer(self, buffer: int, flags: int) -> tuple[Any, ...]:
        status = self._status("register")
        if status:
            return status, None
        assert flags == 2 and alive(buffer) and buffer not in self.registered
        self.registered.add(buffer)
        self.calls.append(("register", buffer))
        return status, buffer

    def cudaGraphicsMapResources(self, count: int, resource: int, stream: int) -> tuple[Any, ...]:
        assert count == 1 and resource in self.registered and resource not in self.memory
        status = self._status("map")
        if not status:
            self.memory[resource] = np.full(store_bytes(resource) // 4, np.nan, np.float32)
            self.calls.append(("map", resource, stream))
        return (status,)

    def cudaGraphicsResourceGetMappedPointer(self, resource: int) -> tuple[Any, ...]:
        status = self._status("pointer")
        if status:
            return status, None, None
        memory = self.memory[resource]
        return status, memory.ctypes.data, memory.nbytes if self.size is None else self.size

    def cudaGraphicsUnmapResources(self, count: int, resource: int, stream: int) -> tuple[Any, ...]:
        memory = self.memory.pop(resource)
        send(resource, memory)
        self.calls.append(("unmap", resource, stream))
        return (self._status("unmap"),)

    def cudaGraphicsUnregisterResource(self, resource: int) -> tuple[Any, ...]:
        assert alive(resource) and resource not in self.memory  # OpenGL still has it, CUDA does not work with it
        self.registered.remove(resource)
        self.calls.append(("unregister", resource))
        return (self._status("unregister"),)


class GpuCloth(FakeCloth):
    """A cloth that says it is on the GPU, and writes into what CUDA would give it; reads are among the runtime's calls."""

    backend = "gpu"

    def __init__(self, scene: Scene, runtime: FakeRuntime, precision: str = "float32", stream: int = 77):
        super().__init__(scene, Options(precision, live=frozenset({"gravity", "poke", "dt"})))
        self.runtime = runtime
        self.stream = SimpleNamespace(handle=stream)

    def _into(self, name: str, into: Any) -> Any:
        if not hasattr(into, "__cuda_array_interface__"):
            return into
        self.runtime.calls.append((name,))
        told = into.__cuda_array_interface__
        assert told["typestr"] == "<f4" and told["strides"] is None and not told["data"][1]
        count = int(np.prod(told["shape"]))
        flat = np.ctypeslib.as_array(ctypes.cast(told["data"][0], ctypes.POINTER(ctypes.c_float)), (count,))
        return flat.reshape(told["shape"])

    def _read_position(self, into: Any) -> Any:
        return super()._read_position(self._into("position", into))

    def _read_normal(self, into: Any) -> Any:
        return super()._read_normal(self._into("normal", into))


# ---------------------------------------------------------------------- what OpenGL's buffers hold


def alive(buffer: int) -> bool:
    """Whether OpenGL has this buffer."""
    from pyglet import gl

    return bool(gl.glIsBuffer(buffer))


def store_bytes(buffer: int) -> int:
    """The size of a buffer's store."""
    from pyglet import gl

    size = gl.GLint()
    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, buffer)
    gl.glGetBufferParameteriv(gl.GL_ARRAY_BUFFER, gl.GL_BUFFER_SIZE, size)
    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)
    return int(size.value)


def send(buffer: int, data: np.ndarray) -> None:
    """Into the store that the buffer has."""
    from pyglet import gl

    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, buffer)
    gl.glBufferSubData(gl.GL_ARRAY_BUFFER, 0, data.nbytes, data.ctypes.data_as(ctypes.c_void_p))
    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)


def held(buffer: int, dimensions: int = 3) -> np.ndarray:
    """(vertices, dimensions) float32: what the buffer holds, as OpenGL reads it back."""
    from pyglet import gl

    data = np.empty((store_bytes(buffer) // (4 * dimensions), dimensions), np.float32)
    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, buffer)
    gl.glGetBufferSubData(gl.GL_ARRAY_BUFFER, 0, data.nbytes, data.ctypes.data_as(ctypes.c_void_p))
    gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)
    return data
