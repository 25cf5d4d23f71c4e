"""Which kernel runs a cloth on the GPU."""

from __future__ import annotations

from typing import Any

from gpu_backend.cloth_block import MOST_THREADS, block_bytes
from gpu_backend.launch import can_capture
from gpu_backend.tile_launch import device_limits
from model.errors import SceneError
from model.scene import Scene

CLOTH_KERNELS = ("one-block", "graph", "launch", "stages")
# One block has one multiprocessor: from some size on its arithmetic takes longer than a captured launch. On an H200, float32,
# 12 springs: 1.46 against 1.94 us a step at 32 x 32; in wind 4.5 against 5.4 at 24 x 24, but 7.2 against 5.5 at 32 x 32.
ONE_BLOCK_MASSES = 1024
ONE_BLOCK_MASSES_IN_WIND = 576


def why_not_one_block(scene: Scene, real: Any, parts: frozenset[str], limits: tuple[int, int] | None = None) -> str:
    """The reason why the kernel `one-block` cannot run the scene, or nothing. `limits`: as `device_limits` gives them."""
    masses = scene.grid.particle_count
    if scene.method.integrator == "rk4":
        return "runs integrators with one force a step, not rk4; use graph"
    if masses > MOST_THREADS:
        return f"holds at most {MOST_THREADS} masses, this sheet has {masses}; use graph"
    needed, most = block_bytes(real, parts, masses), (limits or device_limits())[1]
    if needed > most:
        return f"needs {needed} bytes of shared memory here, a block has {most}; use graph"
    return ""


def default_cloth_kernel(
    scene: Scene, real: Any, parts: frozenset[str], limits: tuple[int, int] | None = None
) -> tuple[str, str]:
    """(kernel, why in a few words) of a cloth that asks for none."""
    most = ONE_BLOCK_MASSES_IN_WIND if "wind" in parts else ONE_BLOCK_MASSES
    if scene.grid.particle_count > most:
        return "graph", f"more than {most} masses keep one multiprocessor busy for longer than a launch takes"
    reason = why_not_one_block(scene, real, parts, limits)
    return ("graph", reason) if reason else ("one-block", "small enough to stay on one multiprocessor")


def cloth_kernel(scene: Scene, real: Any, parts: frozenset[str], asked: str | None) -> str:
    """The kernel asked for, or the backend's own choice. Raises SceneError for one that cannot run the scene."""
    if asked is None:
        return default_cloth_kernel(scene, real, parts)[0] if can_capture() else "launch"
    if asked not in CLOTH_KERNELS:
        raise SceneError("--kernel", asked, f"must be one of {', '.join(CLOTH_KERNELS)} for a cloth on the gpu")
    if asked == "graph" and not can_capture():
        raise SceneError("--kernel", asked, "the CUDA simulator cannot capture graphs; use launch")
    reason = why_not_one_block(scene, real, parts) if asked == "one-block" else ""
    if reason:
        raise SceneError("--kernel", asked, reason)
    return asked
