"""Which kernel runs a cloth on the GPU."""

from __future__ import annotations

from typing import Any

from gpu_backend.cloth_block import MOST_THREADS, block_bytes
from gpu_backend.launch import can_capture
from gpu_backend.tile_launch import device_limits
from model.errors import SceneError
from model.scene import Scene

CLOTH_KERNELS = ("one-block", "graph", "launch", "stages")
# One block has one multiprocessor: from some size on its arithmetic takes longer than a captured launch. An estimate.
ONE_BLOCK_MASSES = 256


def why_not_one_block(scene: Scene, real: Any, parts: frozenset[str]) -> str:
    """The reason why the kernel `one-block` cannot run the scene, or nothing."""
    masses = scene.grid.particle_count
    if scene.method.integrator == "rk4":
        return "runs integrators with one force a step, not rk4; use graph"
    if masses > MOST_THREADS:
        return f"holds at most {MOST_THREADS} masses, this sheet has {masses}; use graph"
    needed, most = block_bytes(real, parts, masses), device_limits()[1]
    if needed > most:
        return f"needs {needed} bytes of shared memory here, a block has {most}; use graph"
    return ""


def cloth_kernel(scene: Scene, real: Any, parts: frozenset[str], asked: str | None) -> str:
    """The kernel asked for, or the backend's own choice. Raises SceneError for one that cannot run the scene."""
    if asked is None:
        if not can_capture():
            return "launch"
        small = scene.grid.particle_count <= ONE_BLOCK_MASSES and not why_not_one_block(scene, real, parts)
        return "one-block" if small else "graph"
    if asked not in CLOTH_KERNELS:
        raise SceneError("--kernel", asked, f"must be one of {', '.join(CLOTH_KERNELS)} for a cloth on the gpu")
    if asked == "graph" and not can_capture():
        raise SceneError("--kernel", asked, "the CUDA simulator cannot capture graphs; use launch")
    reason = why_not_one_block(scene, real, parts) if asked == "one-block" else ""
    if reason:
        raise SceneError("--kernel", asked, reason)
    return asked
