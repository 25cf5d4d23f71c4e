"""Launches of the kernel `resident` of tetrahedra: thickness of slabs, device arrays, one launch per set."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.constraints import device_corners
from softlab.gpu_backend.core.device import Arguments, device_limits
from softlab.gpu_backend.core.forces import forces_of
from softlab.gpu_backend.core.launch import prepare
from softlab.gpu_backend.core.messages import message_size
from softlab.gpu_backend.core.quads import pack
from softlab.gpu_backend.tetrahedra.resident import Exchange, Limits, SlabArrays, State, make_tetrahedra_resident
from softlab.gpu_backend.tetrahedra.slabs import MOST_THREADS, Slabs, make_slabs
from softlab.model.base.errors import BackendUnavailable, SceneError
from softlab.model.base.types import Real
from softlab.model.contact.attachments import CORNERS, part_of
from softlab.model.particles.constraints import ConstraintSet, Projection
from softlab.model.position_based.mesh_plan import BODY_DAMPING, TOUCHING
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.constraints import CLOTH, SLEEPING, WHOLE, constraint_sets, tetrahedra_of_sets

RUNS = 1 << 17  # maximum number of voxels of a set that may be divided into slabs

LAUNCHED_ONLY = (
    "wind",
    "motion",
    CLOTH,
    BODY_DAMPING,
    SLEEPING,
    WHOLE,
    TOUCHING,
    *map(part_of, CORNERS),
)  # parts of a plan


def launched_only(scene: Scene, parts: Collection[str]) -> str | None:
    """Return a feature of a scene with such parts that `resident` does not support."""
    if scene.contact is not None:
        return "contacts"
    return next((part for part in LAUNCHED_ONLY if part in parts), None)


def layers_of(kernel: str) -> int | None:
    """Return the layers of a slab, in `resident:4`; None in `resident`. Raises SceneError."""
    _, _, number = kernel.partition(":")
    if kernel == "resident":
        return None
    if not number.isdecimal() or int(number) < 2 or int(number) % 2:
        raise SceneError(
            "--kernel", kernel, "resident, or resident:N for slabs of N layers of voxels, N even and at least 2"
        )
    return int(number)


def chosen_slabs(
    scene: Scene, real: Real, layers: int | None, limits: tuple[int, int] | None = None
) -> list[Slabs]:  # fmt: skip
    """Return the slabs of each set, of `layers` each, or the thinnest that all run at once on this GPU, or on one of
    `limits` (see `device_limits`). Raises SceneError if there are none."""
    tetrahedra_set = scene.tetrahedra_set
    limits = limits or device_limits()
    both = zip(constraint_sets(scene), tetrahedra_of_sets(tetrahedra_set), strict=True)
    return [_slabs(tetrahedra_set, *each, real, layers, limits) for each in both]


def default_slabs(scene: Scene, real: Real, limits: tuple[int, int] | None = None) -> list[Slabs]:
    """Return the slabs with which `resident` is the scene's default; none if it cannot run, or if a block would need
    several turns per colour: launches are as fast then."""
    try:
        slabs = chosen_slabs(scene, real, None, limits)
    except SceneError:
        return []
    return slabs if max(some.widest for some in slabs) <= MOST_THREADS else []


def _slabs(
    tetrahedra_set: Any,
    one: ConstraintSet,
    tetrahedra: np.ndarray,
    real: Real,
    layers: int | None,
    limits: tuple[int, int],
) -> Slabs:
    """Return the slabs of one set. Raises SceneError."""
    most_blocks, most_shared = limits
    asked = "resident" if layers is None else f"resident:{layers}"
    if one.run == 1:
        raise SceneError("--kernel", asked, "takes bodies of voxels, of which some here are not; use graph")
    if len(tetrahedra) > RUNS * one.run:
        raise SceneError("--kernel", asked, f"takes at most {RUNS} voxels; use graph")
    deepest = int(tetrahedra_set.voxel[tetrahedra, 0].max()) + 1
    bodies = len(np.unique(tetrahedra_set.body[tetrahedra]))
    thick = layers or 2
    while True:
        slabs = make_slabs(tetrahedra_set, one, tetrahedra, thick)
        if slabs.count <= most_blocks or layers is not None or thick >= deepest:
            break
        thick += 2 * max(1, round(thick * (slabs.count / most_blocks - 1) / 2))
    if slabs.count > most_blocks:
        raise SceneError(
            "--kernel", asked,
            f"{slabs.count} slabs of {bodies} bodies cannot run at once, of which this GPU takes {most_blocks}; use graph",
        )  # fmt: skip
    if slabs.shared_bytes(real) > most_shared:
        raise SceneError(
            "--kernel", asked,
            f"a slab of {thick} layers needs {slabs.shared_bytes(real)} bytes of shared memory, a block has {most_shared}; "
            "use graph",
        )  # fmt: skip
    return slabs


class ResidentSet:
    """The launches of one set of constraints for a simulation, on its state."""

    def __init__(self, simulation: Any, slabs: Slabs, one: ConstraintSet, projection: Projection):
        self.simulation, self.slabs, self._epoch = simulation, slabs, 0
        real, put = simulation.real, simulation.on_device
        self._kernel = make_tetrahedra_resident(
            real, simulation.options.math, forces_of(simulation.plan.parts), projection
        )
        multipliers = np.zeros(max(1, projection.soft * projection.multipliers * len(one.corners)), real)
        corners = device_corners(projection, slabs.corners, one.run * slabs.starts)
        self._slab_arrays = SlabArrays(
            put(slabs.tables), put(corners), put(pack(one.values[slabs.order].astype(real))), put(multipliers),
            np.int32(slabs.early), np.int32(slabs.colours), np.int32(len(slabs.order)), np.int32(slabs.largest),
        )  # fmt: skip
        self._messages = put(np.zeros(3 * max(1, slabs.borders) * message_size(real), real))
        self._failed = cuda.to_device(np.zeros(1, np.int32), stream=simulation.stream)
        shared = slabs.shared_bytes(real)
        self._grid = slabs.count, slabs.threads, simulation.stream, shared
        prepare(self._kernel, self._arguments(1), shared, cooperative=True)

    def _arguments(self, steps: int) -> Arguments:
        s, method = self.simulation, self.simulation.scene.method
        states = [State(s.position[k], s.velocity[k]) for k in (s._current, 1 - s._current)]
        exchange = Exchange(self._messages, np.int32(self.slabs.borders), np.int32(self._epoch), self._failed)
        limits = Limits(np.int64(steps), np.int64(method.substeps), np.int32(method.iterations))
        return *states, self._slab_arrays, exchange, s.record, s.bodies, s.integers, s._counter, limits

    def launch(self, steps: int) -> None:
        """Launch so many steps, from the current state into the other buffers, which stay the others."""
        self._kernel[self._grid](*self._arguments(steps))
        sweeps = steps * self.simulation.scene.method.substeps * self.simulation.scene.method.iterations
        self._epoch = (self._epoch + sweeps + 2**31) % 2**32 - 2**31  # tags are compared for equality: may wrap around

    def require_exchange(self) -> None:
        """Raise BackendUnavailable if a block timed out waiting for others."""
        if self.simulation.fetch(self._failed) != 0:
            self._failed.copy_to_device(np.zeros(1, np.int32), stream=self.simulation.stream)
            raise BackendUnavailable(
                "the blocks of kernel resident did not run together (is the GPU shared?)", "use --kernel graph"
            )
