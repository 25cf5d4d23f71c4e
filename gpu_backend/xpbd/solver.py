"""Position-based dynamics (XPBD, PBD) of a grid or a cloth on CUDA, the state on the device throughout.

M. Macklin, M. Mueller, N. Chentanez, "XPBD: Position-Based Simulation of Compliant Constrained Dynamics", MIG 2016,
algorithm 1, in substeps (M. Macklin et al., "Small Steps in Physics Simulation", SCA 2019). A substep: `begin` predicts
positions, `iterations` times all constraints are projected (colour by colour, or all at once for Jacobi) and then the
long-range attachments, `end` computes velocities from positions, and collisions.

Kernels, by speed: `stages` (stage by stage), `launch` (the substep above, one launch per colour), `graph` (the same
captured as a CUDA graph; the kernel of a cloth with self-contact), `tiled` (a launch does all colours of some
iterations, tile by tile, in a graph) and `one-block` (a small sheet in one block, many steps per launch);
xpbd/choice.py chooses one. In `exact` math all give the same bits as the CPU.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.self_contact import Contacts, contact_bytes
from softlab.gpu_backend.core.device import DeviceArray, simulated
from softlab.gpu_backend.core.launch import Graphs, can_capture
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.sheet import BLOCK, make_cloth_tools
from softlab.gpu_backend.core.substeps import SubstepSimulation
from softlab.gpu_backend.position_based.constraints import compliant
from softlab.gpu_backend.position_based.kernels import (
    blocks_over,
    compact_shape,
    make_attach,
    make_begin,
    make_colour,
    make_end,
    make_jacobi,
    make_plane_tools,
    multiplier_planes,
)
from softlab.gpu_backend.xpbd.choice import xpbd_kernel
from softlab.gpu_backend.xpbd.launch import BlockLauncher, TiledLauncher
from softlab.gpu_backend.xpbd.stages import bind_xpbd_stages
from softlab.model.base.components import named
from softlab.model.base.errors import SceneError
from softlab.model.contact.cloth_parameters import collider_numbers
from softlab.model.core.families import family_of
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.position_based.attachments import sheet_reaches
from softlab.model.position_based.plan import colour_order, families
from softlab.model.scene.scene import Scene

NOT_YET = ("motion", "mesh")


class PositionBased(SubstepSimulation):
    """Position-based sheets on CUDA; model/core/simulation.py defines the contract. `threads`: threads per block."""

    def __init__(self, scene: Scene, options: Options):
        for name, kind in scene.kinds.items():
            if kind in NOT_YET:
                raise SceneError(
                    f"{name}.kind", kind, "is not known to the position-based solvers on the gpu; leave it out"
                )
        super().__init__(scene, options)
        self.plan = family_of(scene).plan(scene, options.live)
        self._chosen = xpbd_kernel(scene, self.real, self.plan.parts, options.kernel)
        self.kernel = self._chosen.kernel
        tile = self._chosen.tile
        self.threads = tile.threads if tile else BLOCK[0] * BLOCK[1]
        self._require_space()
        self._start()

    def _require_space(self) -> None:
        rows, columns = self.body.rows, self.body.columns
        sheet = "cloth" if self.scene.cloth else "grid"
        scalars = 9 * SIZE + 2 * multiplier_planes(self.plan.parts)  # arrays, including those of the stages
        item = np.dtype(self.real).itemsize
        needed = scalars * self.particle_count * item
        if self.scene.self_collision:
            needed += contact_bytes(self.particle_count, item)
        self._require_memory(needed, f"{sheet}.rows x {sheet}.columns", f"{rows} x {columns}")
        self._require_rows(sheet)

    # ------------------------------------------------------------------ arrays

    def _allocate(self) -> None:
        scene = self.scene
        self._allocate_quads(collider_numbers(scene, self.real))
        self.scratch = self.new_array()
        inverse, mass = self.body.inverse_mass, scene.grid.mass  # their product may be 1 minus rounding
        self._weight = np.where(inverse == 1 / mass, 1.0, inverse * mass).astype(self.real)
        clusters = family_of(scene).clusters.get(self.backend)  # in place of constraints
        self.matching = (
            named(clusters)(scene, self.real, self.options.math, self._grid, self.stream) if clusters else None
        )
        self.contacts = None
        if scene.self_collision:
            self.contacts = Contacts(scene, self.body, self.real, self.options.math, self._weight, self.stream)
        planes = multiplier_planes(self.plan.parts)
        self.multipliers = self.zeros(max(1, planes * self.particle_count), self.real)
        self.attachments = 0  # per mass
        self.anchors, self.reaches = self.on_device(np.zeros(1, np.int32)), self.on_device(np.zeros(1, self.real))
        if "attachments" in self.plan.parts:
            self._allocate_attachments()

    def _allocate_attachments(self) -> None:
        """Allocate (particles, count) anchors and maximum distances; a mass with fewer anchors repeats the nearest."""
        attachments = self.scene.attachments
        assert attachments is not None
        anchor, max_distance = sheet_reaches(self.scene, self.body, self.real)
        self.attachments = attachments.anchors
        self.anchors = self.on_device(np.ascontiguousarray(anchor, np.int32).reshape(-1))
        self.reaches = self.on_device(np.ascontiguousarray(max_distance).reshape(-1))

    # ------------------------------------------------------------------ kernels

    def _build(self) -> None:
        """Compile and load every kernel, by running it once on arrays that `reset` then overwrites."""
        self._tools = make_cloth_tools(self.real)
        if self.scene.dimensions == 2:
            self._tools = SimpleNamespace(**vars(self._tools) | vars(make_plane_tools(self.real)))
        self._block = BlockLauncher(self, self._chosen) if self.kernel == "one-block" else None
        self._tiled = TiledLauncher(self, self._chosen) if self.kernel == "tiled" else None
        if self._block is None and self._tiled is None:
            self._make_passes()
        if self.kernel == "stages":
            self._executor = Executor(self.plan, bind_xpbd_stages(self))
            return
        self._executor = Executor(self.plan, {}, self._advance_steps)
        if not simulated():
            self._upload(self.body.position, self.body.velocity)  # masses at one position would all be in contact
            self._advance_steps(0, 1)
            cuda.synchronize()
        if self.kernel in ("graph", "tiled") and can_capture():
            self._graphs = Graphs(self.stream, self._launch, self._count_on)

    def _make_passes(self) -> None:
        variant, axes = (self.real, self.options.math, self.plan.parts), self.scene.dimensions
        self._begin, self._end = make_begin(*variant, axes), make_end(*variant, axes)
        self._attach = make_attach(self.real, self.options.math)
        self._gauss_seidel = "gauss-seidel" in self.plan.parts
        soft = [family for family in families(self.plan.parts) if compliant(self.plan.parts, family)]
        self._colours = []
        if self.matching:
            return
        if not self._gauss_seidel:
            self._jacobi = make_jacobi(*variant, axes)
            return
        for family, colour in colour_order(self.plan.parts):
            blocks = blocks_over(*compact_shape(family, self.body.rows, self.body.columns))
            kernel = make_colour(*variant, family, colour, axes)
            plane = soft.index(family) if family in soft else 0
            self._colours.append((kernel, (blocks, BLOCK, self.stream), np.int32(plane)))

    def project_colour(self, entry: int, before: DeviceArray, position: DeviceArray, fresh: bool) -> None:
        """Project the constraints of one colour; `fresh`: in a substep's first iteration."""
        kernel, launch, plane = self._colours[entry]
        kernel[launch](position, before, self.multipliers, plane, np.int32(fresh), self.record, *self.shape)

    def project_all(self, before: DeviceArray, position: DeviceArray, target: DeviceArray, fresh: bool) -> None:
        """Do one Jacobi iteration from `position` to `target`."""
        self._jacobi[self._grid](
            position, before, target, self.multipliers, np.int32(fresh), self.record, *self.shape
        )  # fmt: skip

    def attach(self, before: DeviceArray, position: DeviceArray) -> None:
        if self.attachments:
            self._attach[self._flat](position, before, self.anchors, self.reaches, np.int32(self.attachments))

    # ------------------------------------------------------------------ a step

    def _substep(self, place: int, substep: int) -> None:
        """Launch one substep, from the current buffers into the others; `place`: of the step after the counter."""
        if self._tiled is not None:
            self._tiled.substep(place, substep)
            return
        before, velocity = self.position[self._current], self.velocity[self._current]
        self._current = 1 - self._current
        target, new_velocity = self.position[self._current], self.velocity[self._current]
        time = self._counter, np.int64(place), np.int64(self.scene.method.substeps), np.int64(substep)
        iterations = self.scene.method.iterations
        jacobi = not self._gauss_seidel and bool(families(self.plan.parts))
        turns = (jacobi or self.matching is not None) and iterations % 2 == 1  # so that the last one ends in `target`
        now, other = (self.scratch, target) if turns else (target, self.scratch)
        self._begin[self._grid](before, velocity, now, self.record, self.integers, *time, *self.shape)
        if self.contacts:
            self.contacts.find(before, now)
        for iteration in range(iterations):
            if jacobi:
                self.project_all(before, now, other, iteration == 0)
                now, other = other, now
            if self.matching:
                self.matching.match(now)
                self.matching.move(now, other, self.record)
                now, other = other, now
            for entry in range(len(self._colours)):
                self.project_colour(entry, before, now, iteration == 0)
            self.attach(before, now)
            if self.contacts:
                self.contacts.project(before, now)
        self._end[self._flat](before, now, new_velocity, self.record, self.bodies, self.integers, *time)

    @property
    def _launches(self) -> int:
        """Number of launches of a step."""
        method = self.scene.method
        if self._tiled is not None:
            return method.substeps * self._tiled.launches
        iteration = self.matching.launches if self.matching else max(1, len(self._colours)) + (self.attachments > 0)
        if self.contacts:
            return method.substeps * (
                2 + self.contacts.finding + method.iterations * (iteration + self.contacts.projecting)
            )
        return method.substeps * (2 + method.iterations * iteration)

    def _advance_steps(self, step: int, steps: int) -> None:
        if self._block is None:
            super()._advance_steps(step, steps)
            return
        self._set_counter(step)
        self._block.advance(steps)

    # ------------------------------------------------------------------ the contract

    def _parameters_changed(self) -> None:
        if self.contacts:
            self.contacts.change(self.scene)
        super()._parameters_changed()
