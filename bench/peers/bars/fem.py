"""Bar of tetrahedra by Warp's finite-element toolkit, warp.fem, written like elasticity in its examples.

Implicit Euler of the lab's `neo-hookean` material on linear tetrahedra with lumped masses: one Newton step of the exact
tangent per substep, by conjugate gradients with a diagonal preconditioner, with as many substeps as the lab's own
Newton method in the scene. The toolkit assembles a sparse matrix again in every substep, through Python, so its steps
cannot be captured in a graph.
"""

# No `from __future__ import annotations`: Warp reads the types of a kernel from its annotations.

from functools import cache
from typing import Any

import numpy as np

from softlab.bench.peers.bars.tip import BARS, NEAR, lame_of, tetrahedra_refusal
from softlab.bench.peers.base import Opened, PeerError
from softlab.bench.peers.warp_base import WarpPeer, load_warp
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene

TOLERANCE = 1e-4  # of conjugate gradients, relative to the right-hand side: that of its examples


@cache
def _load() -> tuple[Any, Any, Any]:
    """Return warp.fem, warp.sparse, warp.optim.linear."""
    load_warp()
    try:
        import warp.fem as fem
        import warp.optim.linear as linear
        import warp.sparse as sparse
    except Exception as error:  # the exceptions of a broken installation are not documented
        raise PeerError(f"warp.fem cannot be loaded ({error})") from None
    return fem, sparse, linear


@cache
def _make_forms() -> tuple[Any, Any]:
    """Make (the force, the stiffness) as integrands of a displacement."""
    wp = load_warp()
    fem = _load()[0]

    @wp.func
    def cofactor(a: wp.mat33):
        first = wp.vec3(a[0, 0], a[1, 0], a[2, 0])
        second = wp.vec3(a[0, 1], a[1, 1], a[2, 1])
        third = wp.vec3(a[0, 2], a[1, 2], a[2, 2])
        return wp.matrix_from_cols(wp.cross(second, third), wp.cross(third, first), wp.cross(first, second))

    @fem.integrand
    def force(s: fem.Sample, now: fem.Field, v: fem.Field, mu: float, lam: float):
        gradient = wp.identity(n=3, dtype=float) + fem.grad(now, s)
        swell = (lam + mu) * (wp.determinant(gradient) - 1.0) - mu
        return -wp.ddot(fem.grad(v, s), mu * gradient + swell * cofactor(gradient))

    @fem.integrand
    def stiffness(s: fem.Sample, now: fem.Field, u: fem.Field, v: fem.Field, mu: float, lam: float):
        gradient = wp.identity(n=3, dtype=float) + fem.grad(now, s)
        change = fem.grad(u, s)
        swell = (lam + mu) * (wp.determinant(gradient) - 1.0) - mu
        along = cofactor(gradient)
        cofactor_change = cofactor(gradient + change) - along - cofactor(change)  # cofactors are quadratic
        stress = mu * change + (lam + mu) * wp.ddot(along, change) * along + swell * cofactor_change
        return wp.ddot(fem.grad(v, s), stress)

    return force, stiffness


@cache
def _make_kernels() -> tuple[Any, Any, Any]:
    wp = load_warp()

    @wp.kernel(enable_backward=False, module="unique")
    def aim_at(u: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), gravity: wp.vec3, h: float,
               free: wp.array(dtype=float), aim: wp.array(dtype=wp.vec3)):  # fmt: skip
        k = wp.tid()
        aim[k] = u[k] + free[k] * (h * v[k] + h * h * gravity)

    @wp.kernel(enable_backward=False, module="unique")
    def add_inertia(u: wp.array(dtype=wp.vec3), aim: wp.array(dtype=wp.vec3), weight: wp.array(dtype=float),
                    force: wp.array(dtype=wp.vec3)):  # fmt: skip
        k = wp.tid()
        force[k] = force[k] - weight[k] * (u[k] - aim[k])

    @wp.kernel(enable_backward=False, module="unique")
    def move(step: wp.array(dtype=wp.vec3), free: wp.array(dtype=float), h: float, before: wp.array(dtype=wp.vec3),
             u: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3)):  # fmt: skip
        k = wp.tid()
        u[k] = u[k] + free[k] * step[k]
        v[k] = (u[k] - before[k]) / h

    return aim_at, add_inertia, move


class WarpFem(WarpPeer):
    """Linear tetrahedra of the toolkit, one Newton step per substep."""

    kind, title = "warp_fem", "Warp FEM"
    precisions = ("float32",)
    scenes = tuple(BARS)

    def __init__(self, backend: str):
        super().__init__(backend)
        self.label = "Warp FEM, Newton's method"

    def refusal(self, scene: Scene) -> str | None:
        return tetrahedra_refusal(scene)

    def bound(self, scene: Scene, precision: str) -> float:
        return NEAR

    def opened(self, scene: Scene, precision: str) -> Opened:
        return _Body(scene, self.backend)


class _Body(Opened):
    kernel = "assembled from Python"

    def __init__(self, scene: Scene, backend: str):
        wp = self._wp = load_warp()
        fem, sparse, _ = _load()
        self.threads = 1 if backend == "cpu" else None
        self._device = wp.get_device("cpu" if backend == "cpu" else "cuda:0")
        tetrahedra_set, body = scene.tetrahedra_set, build(scene)
        self._rest, self._count = tetrahedra_set.position.astype(np.float32), tetrahedra_set.particle_count
        self._substeps, self._h = scene.method.substeps, scene.method.dt / scene.method.substeps
        down = scene.gravity.acceleration if scene.gravity is not None and scene.gravity.enabled else 0.0
        self._gravity = wp.vec3(0.0, -down, 0.0)
        self._lame = dict(zip(("mu", "lam"), lame_of(scene), strict=True))
        weight = tetrahedra_set.masses / self._h**2
        fixed = np.zeros(self._count)
        fixed[tetrahedra_set.pinned_vertices] = 1.0
        with wp.ScopedDevice(self._device):
            mesh = fem.Tetmesh(
                wp.array(tetrahedra_set.tetrahedra.astype(np.int32), dtype=int), wp.array(self._rest, dtype=wp.vec3)
            )
            space = fem.make_polynomial_space(mesh, degree=1, dtype=wp.vec3)  # its nodes are the vertices of the mesh
            domain = fem.Cells(mesh)
            self._field = space.make_field()
            self._test = fem.make_test(space=space, domain=domain)
            self._trial = fem.make_trial(space=space, domain=domain)
            self._weight, self._free = wp.array(weight, dtype=float), wp.array(1.0 - fixed, dtype=float)
            self._inertia, self._fixed = (
                sparse.bsr_diag(wp.array(values[:, None, None] * np.eye(3), dtype=wp.mat33))
                for values in (weight, fixed)
            )
            self._velocity, self._aim = wp.zeros(self._count, dtype=wp.vec3), wp.zeros(self._count, dtype=wp.vec3)
        self.load(body.position, body.velocity)

    def advance(self, steps: int) -> None:
        with self._wp.ScopedDevice(self._device):
            for _ in range(steps * self._substeps):
                self._substep()

    def _substep(self) -> None:
        wp, (fem, sparse, linear) = self._wp, _load()
        (force_form, stiffness_form), (aim_at, add_inertia, move) = _make_forms(), _make_kernels()
        now, n = self._field.dof_values, self._count
        wp.launch(aim_at, dim=n, inputs=[now, self._velocity, self._gravity, self._h, self._free], outputs=[self._aim])
        fields = {"now": self._field, "v": self._test}
        matrix = fem.integrate(
            stiffness_form, fields=fields | {"u": self._trial}, values=self._lame, output_dtype=float
        )
        force = fem.integrate(force_form, fields=fields, values=self._lame, output_dtype=wp.vec3)
        sparse.bsr_axpy(self._inertia, matrix)
        wp.launch(add_inertia, dim=n, inputs=[now, self._aim, self._weight], outputs=[force])
        fem.project_linear_system(matrix, force, self._fixed, None, normalize_projector=False)
        step = wp.zeros(n, dtype=wp.vec3)
        linear.cg(matrix, force, step, tol=TOLERANCE, M=linear.preconditioner(matrix, "diag"))
        before = wp.clone(now)
        wp.launch(move, dim=n, inputs=[step, self._free, self._h, before], outputs=[now, self._velocity])

    def synchronize(self) -> None:
        if self.threads is None:
            self._wp.synchronize_device(self._device)

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._field.dof_values.assign((np.asarray(position) - self._rest).astype(np.float32))
        self._velocity.assign(np.ascontiguousarray(velocity, np.float32))

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        return self._rest + self._field.dof_values.numpy(), self._velocity.numpy().copy()
