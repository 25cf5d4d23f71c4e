"""Position-based dynamics on CPU threads: XPBD and PBD, for grids and cloths.

Two kernels: `stages` (stage by stage over the whole sheet, the teaching version) and `fused`, which goes down the rows
once per iteration (xpbd/seidel.py, xpbd/jacobi_kernel.py). In `exact` math both give the same bits, for any number of
threads.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate
from typing import Any

import numba
import numpy as np

from softlab.cpu_backend.contact.self_contact import Contacts
from softlab.cpu_backend.core.layout import Layout, aligned_zeros, block_of, plain
from softlab.cpu_backend.core.normals import make_normals
from softlab.cpu_backend.core.scratch import scratch_width, triples_of
from softlab.cpu_backend.core.simulation import RowsSimulation, chosen_kernel
from softlab.cpu_backend.core.steps import Steps
from softlab.cpu_backend.xpbd.forces import WIND_PARTS, has_forces
from softlab.cpu_backend.xpbd.jacobi import displacement_triples
from softlab.cpu_backend.xpbd.jacobi_kernel import make_jacobi_advance
from softlab.cpu_backend.xpbd.layout import PLACES, Combed, classes_of, combed
from softlab.cpu_backend.xpbd.schedule import most_bands, schedule
from softlab.cpu_backend.xpbd.seidel import make_seidel_advance
from softlab.cpu_backend.xpbd.stages import bind_position_stages
from softlab.cpu_backend.xpbd.tables import Tables
from softlab.cpu_backend.xpbd.walk import Sheet, keeps_velocity
from softlab.model.base.errors import SceneError
from softlab.model.contact.cloth_parameters import collider_numbers
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.position_based.plan import FAMILIES, JACOBI, xpbd_plan
from softlab.model.scene.scene import Scene

NOT_YET = ("motion",)
ROWS_OF_BAND = 2  # minimum in the Jacobi orderings: the rows that a constraint spans
UNREACHED = 1e18  # m: maximum distance for a missing attachment


def choose_kernel(wanted: str | None) -> str:
    """Return the kernel `wanted`, or `fused`. Raises SceneError for any other."""
    return chosen_kernel(wanted, "a position-based solver")


def contact_kernel(scene: Scene, wanted: str | None) -> str | None:
    """Return the kernel of a cloth with self-contact, None for other scenes. Raises SceneError for `fused`.

    Contacts span the whole sheet; they are searched and projected between walks down its rows.
    """
    if scene.self_collision is None:
        return None
    if wanted == "fused":
        raise SceneError("--kernel", wanted, "does not support self_collision; use --kernel stages")
    return "stages"


class PositionBased(RowsSimulation):
    """Position-based sheets; model/core/simulation.py defines the contract. `threads`: `1x`, `2x`, `4x` or a number."""

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        for name, kind in scene.kinds.items():
            if kind in NOT_YET:
                raise SceneError(
                    f"{name}.kind", kind, "is not supported by the position-based solvers on the cpu; leave it out"
                )
        super().__init__(scene, options, threads)
        self.kernel = contact_kernel(scene, options.kernel) or choose_kernel(options.kernel)
        self.plan = xpbd_plan(scene, options.live)
        self.integers = self._seeds()
        self._set_colliders(collider_numbers(scene, self.real))
        self.tables = Tables(scene, self.body, self.real, self.plan.parts)
        self.attachments = self._attachments()
        self._current = 0
        self._set_pins()
        self._executor = self._staged() if self.kernel == "stages" else self._fused()
        self._snapshot = np.zeros(self._layout.size, self.real)
        self.reset()

    def _attachments(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (anchors, maximum distances [m]), each (anchors per mass, rows, columns): particles, and how far the
        mass may be from them. A mass with fewer anchors repeats its nearest one."""
        part, body = self.scene.attachments, self.body
        if part is None or "attachments" not in self.plan.parts:
            nothing = np.zeros((0, body.rows, body.columns))
            return nothing.astype(np.int32), nothing.astype(self.real)
        from softlab.model.position_based.attachments import sheet_reaches

        anchor, max_distance = sheet_reaches(self.scene, body, self.real)
        shape = (part.anchors, body.rows, body.columns)
        return np.ascontiguousarray(anchor.T, np.int32).reshape(shape), np.ascontiguousarray(max_distance.T).reshape(
            shape
        )

    # ------------------------------------------------------------------ kernels

    def _staged(self) -> Executor:
        rows, columns, axes = self.body.rows, self.body.columns, self.scene.dimensions
        self._layout: Layout = plain(rows, columns, 2 * axes)
        self._states = aligned_zeros(self._layout.size, self.real)
        self._bands = min(self.threads, rows)
        if self.scene.self_collision:
            weights = self.tables.weights[self.tables.weight_row].reshape(-1)
            self.contacts = Contacts(self.scene, self.body, self.real, self.options.math, self._bands, weights)
        return Executor(self.plan, bind_position_stages(self))

    def _fused(self) -> Executor:
        """Make the memory, its tables, and the bounds of bands."""
        parts, rows, axes = self.plan.parts, self.body.rows, self.scene.dimensions
        layout = combed(rows, self.body.columns, classes_of(parts), self.real, 2 * axes)
        self._layout = layout
        if parts & JACOBI:
            self._bands = min(self.threads, max(1, rows // ROWS_OF_BAND))
            self._bounds = np.array([rows * k // self._bands for k in range(self._bands + 1)], np.int64)
        else:
            self._bands = min(self.threads, most_bands(rows, "bending" in parts))
            self._steps, self._starts, self._bounds = schedule(rows, self._bands, "bending" in parts)
        self._reserve(layout)
        self._fill_weights(layout)
        self._fill_attachments(layout)
        self._fill_reciprocals()
        return Executor(self.plan, {}, self._advance)

    def _reserve(self, layout: Combed) -> None:
        """Allocate the parts of memory consecutively (PLACES)."""
        parts, axes, plane = self.plan.parts, self.scene.dimensions, layout.plane
        block, method = block_of(self.real), self.scene.method
        triples = triples_of(parts & WIND_PARTS)["count"]
        smooth = layout.classes * layout.blocks * block
        width = scratch_width(smooth, self.real)
        natural = Layout(layout.rows, layout.columns, smooth + block, layout.rows * (smooth + block) + block, 2 * axes)
        self._natural = natural.integers()
        has_wind, several = "wind" in parts, method.iterations > 1
        scratch = (3 * triples * width + layout.stride + block) if has_wind else 0
        if parts & JACOBI:
            scratch = max(scratch, 3 * displacement_triples(parts)["count"] * width)
        rows = len(self.tables.weights), self._different_reciprocals(), len(self.tables.valences()[0])
        sizes = {
            "state": layout.size,
            "before": axes * plane if keeps_velocity(parts) else 0,
            "acceleration": axes * plane if has_forces(parts) else 0,
            "other": layout.size if parts & JACOBI else 0,
            "multipliers": len(FAMILIES) * plane * (1 + bool(parts & JACOBI)) if several else 0,
            "weights": rows[0] * layout.stride,
            "reciprocals": rows[1] * layout.stride,
            "valences": rows[2] * layout.stride,
            "reach": plane * len(self.attachments[1]),
            "pins": 3 * len(self.body.pinned),
            "natural": natural.size if has_wind else 0,
            "scratch": self._bands * scratch if parts & JACOBI else 0,
            "wind_scratch": self._bands * scratch if has_wind else 0,
            "room": 8 * plane,  # pointers to rows that are never read may lie behind the end
        }
        sizes = {name: -(-size // block) * block for name, size in sizes.items()}
        self._at = dict(zip(sizes, accumulate([0, *sizes.values()]), strict=False))
        if not keeps_velocity(parts):
            self._at["before"] = axes * plane  # where the velocities are
        self._memory = aligned_zeros(sum(sizes.values()), self.real)
        self._states = self._memory[: layout.size]
        known = self._at | {
            "rows": layout.rows, "columns": layout.columns, "stride": layout.stride, "plane": plane,
            "class_stride": layout.class_stride, "blocks": layout.blocks, "pin_count": len(self.body.pinned),
            "anchors": len(self.attachments[1]), "scratch_size": scratch, "scratch_width": width,
        }  # fmt: skip
        self._places = np.array([known[name] for name in PLACES], np.int64)

    def _different_reciprocals(self) -> int:
        return len(self.tables.reciprocals(self.record)[0])

    def _part(self, name: str, rows: np.ndarray) -> int:
        """Write rows (n, stride) to the start of a part of memory."""
        start = self._at[name]
        self._memory[start : start + rows.size] = rows.reshape(-1)
        return start

    def _fill_weights(self, layout: Combed) -> None:
        tables = self.tables
        self._row_places = np.zeros((2 + len(FAMILIES), layout.rows), np.int64)
        self._row_uneven = tables.uneven.copy()
        start = self._part("weights", layout.combed_rows(tables.weights))
        self._row_places[0] = start + tables.weight_row * layout.stride
        rows, number = tables.valences()
        self._row_places[1] = self._part("valences", layout.combed_rows(rows)) + number * layout.stride

    def _fill_attachments(self, layout: Combed) -> None:
        anchor, max_distance = self.attachments
        self._anchors = np.zeros(max(1, len(anchor) * layout.plane), np.int32)
        for k in range(len(anchor)):
            among = np.searchsorted(self.body.pinned, anchor[k]).astype(np.int32)
            size = layout.rows * layout.stride
            self._anchors[k * layout.plane :][:size] = layout.combed_rows(among).reshape(-1)
            start = self._at["reach"] + k * layout.plane
            self._memory[start : start + size] = layout.combed_rows(max_distance[k], UNREACHED).reshape(-1)

    def _fill_reciprocals(self) -> None:
        layout: Any = self._layout
        rows, number = self.tables.reciprocals(self.record)
        self._row_places[2:] = self._part("reciprocals", layout.combed_rows(rows)) + number * layout.stride

    def _variant(self) -> tuple[object, ...]:
        """Return the variant of the kernels of make_seidel_advance and make_jacobi_advance."""
        several = self.scene.method.iterations > 1
        return self.real, self.options.math, self.scene.dimensions, self.plan.parts, several

    def _arguments(self, step: int, steps: int) -> tuple[object, ...]:
        """Return the arguments of such a kernel for `steps` steps from number `step` on."""
        method, bounds = self.scene.method, (self._bounds,)
        order = bounds if self.plan.parts & JACOBI else (self._steps, self._starts, *bounds)
        sheet = Sheet(
            self._memory, self._places, self.parameters, self.integers, self.bodies, self.kinds, self._row_places,
            self._row_uneven, self._anchors,
        )  # fmt: skip
        return self._bands, Steps(steps, step, method.substeps, method.iterations), *order, self._natural, sheet

    def _advance(self, step: int, steps: int) -> None:
        make: Callable = make_jacobi_advance if self.plan.parts & JACOBI else make_seidel_advance
        make(*self._variant())(*self._arguments(step, steps))

    # ------------------------------------------------------------------ the contract

    def _parameters_changed(self) -> None:
        super()._parameters_changed()
        if self.scene.self_collision:
            self.contacts.change(self.scene)
        if self.kernel != "stages":
            self._fill_reciprocals()

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        if not isinstance(self._layout, Combed):
            return super()._upload(position, velocity)
        axes, shape = self.scene.dimensions, (self.scene.dimensions, self.body.rows, self.body.columns)
        self._memory[: self._layout.size] = 0
        self._layout.put(self._flat, 0, position.T.reshape(shape))
        self._layout.put(self._flat, axes, velocity.T.reshape(shape))
        self._part("pins", position[self.body.pinned].T)

    def _first_diverged(self) -> int:
        if not isinstance(self._layout, Combed):
            return super()._first_diverged()
        numba.set_num_threads(self.threads)
        worst, classes = -1, self._layout.classes
        for k, part in enumerate(self._layout.by_class(self._flat)):
            self._first_diverged_kernel(part, self.real(self._bound), self._centre.astype(self.real), self._bad)
            for row in np.flatnonzero(self._bad >= 0)[:1]:
                bad = int(row * self.body.columns + self._bad[row] * classes + k)
                worst = bad if worst < 0 else min(worst, bad)
        return worst

    def _read_normal(self, into: Any) -> Any:
        out = np.empty((self.body.rows * self.body.columns, 3), self.real)
        numba.set_num_threads(self.threads)
        make_normals(self.real)(self.current, out)
        if into is None:
            return out
        into[...] = out
        return into
