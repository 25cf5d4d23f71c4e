"""XPBD of a sheet in NVIDIA Warp, as its users write it: the lab's constraints in the lab's order.

A launch per colour (Gauss-Seidel), or one over all of them that adds up displacements (Jacobi). Replayed like the grid
(warp_base.py).
"""

# No `from __future__ import annotations`: Warp reads the types of a kernel from its annotations.

from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.bench.peers.base import Opened, SheetConstants
from softlab.bench.peers.warp_base import Replayed, WarpPeer, load_warp, numbers
from softlab.bench.reference.xpbd import of_scene
from softlab.model.position_based.plan import xpbd_parts
from softlab.model.scene.scene import Scene

KINDS = ("structural", "shear", "bending")
KNOWN = frozenset({*KINDS, *(f"{kind}-{word}" for kind in KINDS for word in ("compliance", "damping"))}) | {
    "damping", "gravity", "pins", "gauss-seidel", "jacobi",
}  # fmt: skip
OPTIONS = {"enable_backward": False, "module": "unique", "module_options": {"fast_math": True}}


def xpbd_refusal(scene: Scene) -> str | None:
    """Return why a peer of XPBD on a sheet (springs as constraints, gravity, drag, pins) cannot run the scene."""
    if scene.method.solver != "xpbd":
        return f"it supports only XPBD, not {scene.method.solver}"
    if scene.cloth is None:
        return "it supports only cloth"
    unknown = xpbd_parts(scene) - KNOWN
    return f"it has no {', '.join(sorted(unknown))}" if unknown else None


@cache
def _make_moves(precision: str) -> SimpleNamespace:
    """Make the kernels of masses: `predict`, `displace`, `finish`."""
    wp = load_warp()
    real, vector = numbers(precision, 3)

    @wp.kernel(**OPTIONS)
    def predict(
        position: wp.array(dtype=vector),
        velocity: wp.array(dtype=vector),
        inverse_mass: wp.array(dtype=real),
        drag: real,
        gravity: real,
        h: real,
        before: wp.array(dtype=vector),
    ):
        k = wp.tid()
        p = position[k]
        before[k] = p
        if inverse_mass[k] > real(0.0):
            v = (real(1.0) - h * drag) * velocity[k] + vector(real(0.0), h * gravity, real(0.0))
            position[k] = p + h * v

    @wp.kernel(**OPTIONS)
    def displace(position: wp.array(dtype=vector), displacement: wp.array(dtype=vector)):
        k = wp.tid()
        position[k] = position[k] + displacement[k]
        displacement[k] = vector(real(0.0))

    @wp.kernel(**OPTIONS)
    def finish(
        position: wp.array(dtype=vector), before: wp.array(dtype=vector), h: real, velocity: wp.array(dtype=vector)
    ):
        k = wp.tid()
        velocity[k] = (position[k] - before[k]) / h

    return SimpleNamespace(predict=predict, displace=displace, finish=finish)


@cache
def _make_projections(precision: str) -> SimpleNamespace:
    """Make the kernels of constraints: `project` (Gauss-Seidel), `gather` (Jacobi)."""
    wp = load_warp()
    real, vector = numbers(precision, 3)

    @wp.func
    def change(
        n: int,
        a: int,
        b: int,
        weight: real,
        position: wp.array(dtype=vector),
        before: wp.array(dtype=vector),
        values: wp.array(dtype=vector),
        multipliers: wp.array(dtype=real),
        first: bool,
    ):
        """Return (the change of the multiplier, the direction); `values`: rest length, alpha / h^2, alpha beta / h."""
        offset = position[b] - position[a]
        length = wp.length(offset)
        direction = vector(real(0.0))
        changed = real(0.0)
        if length > real(0.0) and weight > real(0.0):
            direction = offset / length
            value = values[n]
            stretch = length - value[0]
            if value[2] > real(0.0):
                old = before[b] - before[a]  # elongation without a difference of lengths
                stretch += value[2] * wp.dot(offset - old, offset + old) / (length + wp.length(old))
            if not first:
                stretch += value[1] * multipliers[n]
            changed = -stretch / ((real(1.0) + value[2]) * weight + value[1])
        return changed, direction

    @wp.kernel(**OPTIONS)
    def project(
        position: wp.array(dtype=vector),
        before: wp.array(dtype=vector),
        inverse_mass: wp.array(dtype=real),
        ends: wp.array(dtype=wp.vec2i),
        values: wp.array(dtype=vector),
        multipliers: wp.array(dtype=real),
        begin: int,
        first: bool,
    ):
        """Project the constraints of one colour, in place: no two of them share a mass."""
        n = begin + wp.tid()
        a = ends[n][0]
        b = ends[n][1]
        changed, direction = change(
            n, a, b, inverse_mass[a] + inverse_mass[b], position, before, values, multipliers, first
        )
        if first:
            multipliers[n] = changed
        else:
            multipliers[n] += changed
        position[a] = position[a] - inverse_mass[a] * changed * direction
        position[b] = position[b] + inverse_mass[b] * changed * direction

    @wp.kernel(**OPTIONS)
    def gather(
        position: wp.array(dtype=vector),
        before: wp.array(dtype=vector),
        inverse_mass: wp.array(dtype=real),
        ends: wp.array(dtype=wp.vec2i),
        values: wp.array(dtype=vector),
        multipliers: wp.array(dtype=real),
        inverse_valence: wp.array(dtype=real),
        first: bool,
        displacement: wp.array(dtype=vector),
    ):
        """Project all constraints at one position; `inverse_valence`: 1 over the larger valence of the two ends."""
        n = wp.tid()
        a = ends[n][0]
        b = ends[n][1]
        whole, direction = change(
            n, a, b, inverse_mass[a] + inverse_mass[b], position, before, values, multipliers, first
        )
        changed = whole * inverse_valence[n]
        if first:
            multipliers[n] = changed
        else:
            multipliers[n] += changed
        wp.atomic_sub(displacement, a, inverse_mass[a] * changed * direction)
        wp.atomic_add(displacement, b, inverse_mass[b] * changed * direction)

    return SimpleNamespace(project=project, gather=gather)


class WarpXpbd(WarpPeer):
    """A launch per colour, or one over all constraints with atomic additions."""

    kind, title = "warp_xpbd", "Warp"
    scenes = ("xpbd",)

    def refusal(self, scene: Scene) -> str | None:
        return xpbd_refusal(scene)

    def opened(self, scene: Scene, precision: str) -> Opened:
        return _Xpbd(scene, precision, self.backend)


class _Xpbd(Replayed):
    chunks = (16, 4, 1)  # a step has some hundred launches

    def __init__(self, scene: Scene, precision: str, backend: str):
        super().__init__(backend)
        wp, device = self._wp, self._device
        constants = self.constants = SheetConstants(scene, precision)
        self._method = scene.method
        self._h = scene.method.dt / scene.method.substeps
        real, vector = numbers(precision, 3)
        self._kernels = SimpleNamespace(**vars(_make_moves(precision)), **vars(_make_projections(precision)))
        constraints = of_scene(scene)
        order = np.argsort(constraints.colour, kind="stable")
        alpha = constraints.compliance[order]
        values = np.stack(
            [constraints.rest_length[order], alpha / self._h**2, alpha * constraints.damping[order] / self._h], axis=1
        )
        ends = np.stack([constraints.first[order], constraints.second[order]], axis=1)
        valence = constraints.valence(constants.count)
        self._starts = np.searchsorted(
            constraints.colour[order], np.arange(int(constraints.colour.max(initial=-1)) + 2)
        )
        self._values = wp.array(values.astype(constants.real), dtype=vector, device=device)
        self._ends = wp.array(ends.astype(np.int32), dtype=wp.vec2i, device=device)
        self._inverse_valence = wp.array(
            (1 / valence[ends].max(axis=1, initial=1)).astype(constants.real), dtype=real, device=device
        )
        self._multipliers = wp.zeros(max(1, len(ends)), dtype=real, device=device)
        self._inverse_mass = wp.array(constants.inverse_mass, dtype=real, device=device)
        zeros = {"shape": constants.count, "dtype": vector, "device": device}
        self._position, self._velocity, self._before = (wp.zeros(**zeros) for _ in range(3))
        self._displacement = wp.zeros(**zeros)
        for kernel in vars(self._kernels).values():
            wp.load_module(kernel.module, device=device)  # no module may be loaded while a graph is captured
        self._substep = self._recorded(constants)
        self.load(constants.position, constants.velocity)
        self._capture()
        self.load(constants.position, constants.velocity)

    def _recorded(self, constants: SheetConstants) -> list[Any]:
        """Return the launches of a substep, in order."""
        count, kernels = constants.count, self._kernels

        def record(kernel: Any, size: int, inputs: Sequence[Any]) -> Any:
            return self._wp.launch(kernel, dim=size, inputs=list(inputs), device=self._device, record_cmd=True)

        state = (self._position, self._before, self._inverse_mass, self._ends, self._values, self._multipliers)
        drag, gravity = constants.drag, constants.gravity
        launches = [
            record(
                kernels.predict, count,
                [self._position, self._velocity, self._inverse_mass, drag, gravity, self._h, self._before],
            )
        ]  # fmt: skip
        for first in (True, False):
            if self._method.ordering == "jacobi":
                size = int(self._starts[-1])
                turn = [record(kernels.gather, size, [*state, self._inverse_valence, first, self._displacement])]
                turn.append(record(kernels.displace, count, [self._position, self._displacement]))
            else:
                ranges = zip(self._starts[:-1], self._starts[1:], strict=True)
                turn = [
                    record(kernels.project, int(end - begin), [*state, int(begin), first])
                    for begin, end in ranges
                    if end > begin
                ]
            launches += turn * (1 if first else self._method.iterations - 1)
        return [*launches, record(kernels.finish, count, [self._position, self._before, self._h, self._velocity])]

    def _step(self) -> None:
        for _ in range(self._method.substeps):
            for launch in self._substep:
                launch.launch()

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        for target, array in ((self._position, position), (self._velocity, velocity)):
            target.assign(np.ascontiguousarray(array, self.constants.real))
        self.synchronize()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        self.synchronize()
        return self._position.numpy().copy(), self._velocity.numpy().copy()

    def close(self) -> None:
        super().close()
        self._substep = []
