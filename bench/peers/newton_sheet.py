"""Sheet of springs in Newton (newton-physics on GitHub, `pip install newton`), an engine of NVIDIA and others on Warp.

Its solvers semi-implicit Euler, XPBD and VBD get the lab's masses and springs and nothing else.

- Semi-implicit Euler does the lab's own step: for a cloth as it is, for the hand-out's grid with doubled masses and half of
  gravity (docs/method/cases.md, Facts). The lab's bound applies.
- XPBD and VBD approach implicit Euler's step of the same springs: more iterations, less error. XPBD adds up the full
  corrections of all springs of a mass at once, unweighted, so that it grows without bound with stiff springs or long steps.
  Both are compared with the lab's converged implicit Euler; their distance from it is reported with their time.

Newton has no air drag on particles; where a scene has one, a kernel of ours adds it to its external forces, as its
users do. VBD gets its colours: its own colouring (ModelBuilder.color) supports triangles and tetrahedra, not springs.
"""

# No `from __future__ import annotations`: Warp reads the types of a kernel from its annotations.

import math
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np

from softlab.bench.peers.base import Opened, PeerError, SheetConstants, grid_refusal
from softlab.bench.peers.cuda_cpp_cloth import cloth_refusal
from softlab.bench.peers.lab_xpbd import APPROACHES, IMPLICIT, implicit_refusal
from softlab.bench.peers.warp_base import Replayed, WarpPeer, load_warp
from softlab.bench.reference.xpbd import of_scene
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene

MOST_SPRINGS = 4_000_000  # its model is made of Python lists
REMEDY = "pip install 'soft-body-lab[peers]'"
FromNewton = Any  # a builder, model, state or contacts of the package, whose types are unknown without it
Motion = tuple[np.ndarray, np.ndarray]  # positions [m] and velocities [m/s] of all particles


@cache
def load_newton() -> ModuleType:
    """Return the package. Raises PeerError if it is not installed."""
    load_warp()
    try:
        import newton
    except Exception as error:  # the exceptions of a broken installation are not documented
        raise PeerError(f"Newton cannot be loaded ({error}); {REMEDY}") from None
    return newton


@cache
def _make_drag() -> Any:
    wp = load_warp()

    @wp.kernel(enable_backward=False, module="unique")
    def drag(velocity: wp.array(dtype=wp.vec3), coefficient: float, force: wp.array(dtype=wp.vec3)):
        k = wp.tid()
        force[k] = -coefficient * velocity[k]

    return drag


class Newton(WarpPeer):
    """One solver of Newton; `solver`: its class there; `iterations`: None if it has none."""

    precisions = ("float32",)
    solver: str

    def __init__(self, backend: str, iterations: int | None = None):
        super().__init__(backend)
        self.iterations = iterations
        if iterations is not None:
            self.name = f"{self.kind}_{iterations}_{backend}"
            self.label = f"{self.title}, {iterations} iterations"

    def available(self) -> tuple[bool, str]:
        able, text = super().available()
        if not able:
            return able, text
        try:
            return True, f"Newton {load_newton().__version__} on {text}"
        except PeerError as error:
            return False, str(error)

    def refusal(self, scene: Scene) -> str | None:
        reason = self.scene_refusal(scene)
        each = 2 if scene.springs is not None else 6 if scene.cloth is not None else 0
        if reason is None and each * scene.grid.particle_count > MOST_SPRINGS:
            return "building its model from Python lists would take minutes"
        return reason

    def scene_refusal(self, scene: Scene) -> str | None:
        """Return the reason like `refusal`, at any size."""
        return implicit_refusal(scene)

    def opened(self, scene: Scene, precision: str) -> Opened:
        return _Sheet(scene, self.solver, self.backend, self.iterations)


class NewtonSemiImplicit(Newton):
    kind, title, solver = "newton", "Newton", "SolverSemiImplicit"
    scenes = ("grid", "cloth")

    def scene_refusal(self, scene: Scene) -> str | None:
        return grid_refusal(scene) if scene.springs is not None else cloth_refusal(scene)


class NewtonXpbd(Newton):
    kind, title, solver = "newton_xpbd", "Newton XPBD", "SolverXPBD"
    scenes = IMPLICIT

    def bound(self, scene: Scene, precision: str) -> float:
        return APPROACHES


class NewtonVbd(Newton):
    kind, title, solver = "newton_vbd", "Newton VBD", "SolverVBD"
    scenes = IMPLICIT

    def bound(self, scene: Scene, precision: str) -> float:
        return APPROACHES


def _lattice_colours(rows: int, columns: int) -> list[np.ndarray]:
    """Return nine groups of particles, no two of one within two rows and columns of each other, so without springs."""
    i, j = np.divmod(np.arange(rows * columns), columns)
    return [members for n in range(9) if len(members := np.flatnonzero(3 * (i % 3) + j % 3 == n))]


class Model(Replayed):
    """Replayed steps of a model of Newton, by one of its solvers: two states in turn, particles unless overridden."""

    _substeps = 1  # per step, each of `_h` [s]
    _h: float
    _contacts: FromNewton = None
    _dimensions = 3

    def _begin(self, model: FromNewton, solver: str, start: Motion, how: dict[str, int | None]) -> None:
        """Make the solver, without the options that are None, and capture its steps from `start`."""
        self._model, self._control = model, model.control()
        chosen = {name: value for name, value in how.items() if value is not None}
        self._solver = getattr(load_newton().solvers, solver)(model, **chosen)
        self._states = [model.state(), model.state()]
        self.load(*start)
        self._step()  # loads the kernels: no module may be loaded while a graph is captured
        self._current = 0
        self._capture()
        self.load(*start)

    def _builder(self, gravity: float) -> FromNewton:
        """Return a builder of models, with gravity along +y [m/s^2]."""
        newton = load_newton()
        return newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(0.0, gravity, 0.0))

    def _finalized(self, builder: FromNewton) -> FromNewton:
        """Return a model of particles that neither collide nor are slowed down."""
        model = builder.finalize(device=self._device)
        model.particle_grid = None
        model.particle_max_velocity = math.inf
        return model

    def _in_space(self, array: np.ndarray) -> np.ndarray:
        """Return the array as (particles, 3) float32."""
        space = np.zeros((len(array), 3), np.float32)
        space[:, : array.shape[1]] = array
        return space

    def _prepare(self, state: FromNewton) -> None:
        """Set the external forces of a substep."""
        state.clear_forces()

    def _step(self) -> None:
        for _ in range(self._substeps):
            old, new = self._states[self._current], self._states[1 - self._current]
            self._prepare(old)
            self._solver.step(old, new, self._control, self._contacts, self._h)
            self._current = 1 - self._current

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._current = 0
        for state in self._states:
            state.particle_q.assign(self._in_space(position))
            state.particle_qd.assign(self._in_space(velocity))
        self.synchronize()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        self.synchronize()
        state = self._states[self._current]
        position, velocity = (
            array.numpy()[:, : self._dimensions].copy() for array in (state.particle_q, state.particle_qd)
        )
        return position, velocity

    def close(self) -> None:
        super().close()
        self._states = []


class _Sheet(Model):
    chunks = (16, 4, 2)  # a step has up to some hundred launches; Warp's cloth has 16 per frame

    def __init__(self, scene: Scene, solver: str, backend: str, iterations: int | None):
        super().__init__(backend)
        constants = self.constants = SheetConstants(scene, "float32")
        doubled = 2 if scene.springs is not None else 1  # masses of the hand-out's step, under half of gravity
        self._h, self._drag = scene.method.dt, constants.drag * scene.grid.mass
        self._dimensions = constants.position.shape[1]
        model = self._build(scene, scene.grid.mass * doubled, constants.gravity / doubled)
        self._begin(model, solver, (constants.position, constants.velocity), {"iterations": iterations})

    def _build(self, scene: Scene, mass: float, gravity: float) -> FromNewton:
        constants, springs, body = self.constants, of_scene(scene), build(scene)
        builder = self._builder(gravity)
        builder.add_particles(
            pos=self._in_space(constants.position).tolist(),
            vel=self._in_space(constants.velocity).tolist(),
            mass=np.where(constants.inverse_mass > 0, mass, 0.0).tolist(),
            radius=[0.0] * constants.count,
        )
        # like add_spring for one spring, which would measure the rest lengths at the start
        builder.spring_indices.extend(np.stack([springs.first, springs.second], axis=1).ravel().tolist())
        builder.spring_rest_length.extend(springs.rest_length.tolist())
        builder.spring_stiffness.extend((1 / springs.compliance).tolist())
        builder.spring_damping.extend(springs.damping.tolist())
        builder.spring_control.extend([0.0] * len(springs.first))
        builder.set_coloring(_lattice_colours(body.rows, body.columns))
        return self._finalized(builder)

    def _prepare(self, state: FromNewton) -> None:
        if self._drag <= 0:
            super()._prepare(state)
            return
        self._wp.launch(
            _make_drag(), dim=self.constants.count, inputs=[state.particle_qd, self._drag], outputs=[state.particle_f],
            device=self._device,
        )  # fmt: skip
