"""Shape matching of a grid: against the NumPy reference, among its kernels, and by the laws that it keeps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.reference import shape_matching as reference
from softlab.model.assets.clusters import Clusters, matching_factor
from softlab.model.assets.lattice import matching_axis
from softlab.model.base.errors import InputError
from softlab.model.core.simulation import State
from softlab.model.core.stability.springs import matching_stiffness
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.shape_matching.matching import lattice_clusters

STEPS = 7
POKE = (20, (0.1, 0.2))


def jelly(rows: int = 11, columns: int = 9, **changes: Any) -> Scene:
    """The catalogue's jelly grid, small; changes with `__` for the dot of a path."""
    fields = {"grid.rows": rows, "grid.columns": columns, "method.substeps": 1}
    return load_scene("jelly-grid").replace(
        fields | {path.replace("__", "."): value for path, value in changes.items()}
    )


def everything(region: int, substeps: int, iterations: int) -> Scene:
    method = {"method__region": region, "method__substeps": substeps, "method__iterations": iterations}
    return jelly(perturbation__amplitude=0.1, external__magnitude=0.02, **method)


def free(rows: int, columns: int, **changes: Any) -> Scene:
    """Without pins, gravity and dampers."""
    still = {"grid__pinned": "none", "gravity__enabled": False, "damping__coefficient": 0.0}
    return jelly(rows, columns, **(still | changes))


def end_state(
    scene: Scene, backend: str = "cpu", poked: bool = False, start: State | None = None, **options: Any
) -> State:
    options = {"precision": "float64", "math": "exact"} | options
    if backend == "cpu":
        options.setdefault("threads", 1)
    steps = options.pop("steps", STEPS)
    with open_simulation(scene, backend, live=("poke",) if poked else (), initial=start, **options) as simulation:
        if poked:
            simulation.poke(*POKE)
        simulation.advance(steps // 2)
        simulation.advance(steps - steps // 2)
        return simulation.state()


def start(scene: Scene, position: np.ndarray, velocity: np.ndarray | None = None) -> State:
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1, kernel="stages") as simulation:
        inverse_mass = simulation.body.inverse_mass
    return State(position, np.zeros_like(position) if velocity is None else velocity, inverse_mass, 0.0, 0)


@pytest.mark.parametrize("kernel", ["stages", "fused"])
@pytest.mark.parametrize("region,substeps,iterations", [(1, 1, 1), (1, 2, 3), (2, 1, 2), (4, 1, 1)])
def test_against_the_reference(kernel: str, region: int, substeps: int, iterations: int) -> None:
    """Coordinates of 10 m, some 20 operations a member of a window: 1e4 roundings of 1e-15 m at most in STEPS steps."""
    scene = everything(region, substeps, iterations)
    position, velocity = reference.simulate(scene, STEPS, poke=(POKE[0], np.array(POKE[1])))
    state = end_state(scene, poked=True, kernel=kernel)
    assert np.abs(state.position - position).max() < 1e-11
    assert np.abs(state.velocity - velocity).max() < 1e-11 * substeps / scene.method.dt
    single = end_state(scene, poked=True, kernel=kernel, precision="float32", math="fast")
    assert np.abs(single.position - position).max() < 1e-11 * 2.0**29


@pytest.mark.parametrize("rows,columns", [(1, 1), (1, 7), (7, 1), (2, 2), (3, 17), (16, 16)])
def test_small_and_narrow_grids(rows: int, columns: int) -> None:
    """Windows larger than the grid, single rows, a single mass."""
    scene = jelly(rows, columns, method__region=3, grid__pinned="none", perturbation__amplitude=0.1)
    position, _ = reference.simulate(scene, STEPS)
    for kernel in ("stages", "fused"):
        assert np.abs(end_state(scene, kernel=kernel, threads=2).position - position).max() < 1e-11


def test_tables_are_those_of_the_clusters() -> None:
    """Shares, masses and centres of the windows are products of a row's and a column's."""
    scene = jelly(5, 7, method__region=2)
    clusters = lattice_clusters(scene)
    rows, columns = matching_axis(5, 2), matching_axis(7, 2)
    shares = np.outer(rows.weight, columns.weight).ravel()
    assert clusters.weights == pytest.approx(shares[clusters.indices], rel=1e-12)
    inverse = np.outer(rows.inverse_mass, columns.inverse_mass).ravel()
    assert clusters.cluster_mass * inverse == pytest.approx(scene.grid.mass, rel=1e-12)
    place = np.stack(np.meshgrid(np.arange(7) + columns.centre, -np.arange(5) - rows.centre), axis=-1).reshape(-1, 2)
    assert clusters.rest_centre == pytest.approx(place, abs=1e-12)
    assert np.add.reduceat(clusters.masses[:, None] * clusters.rest, clusters.offsets[:-1]) == pytest.approx(
        0, abs=1e-15
    )


@pytest.mark.parametrize("iterations", [1, 2, 5])
def test_a_stretch_decays_as_a_step_of_implicit_euler_says(iterations: int) -> None:
    """One cluster (four windows of the same four masses): e' = (1 - a)(2 e - e_before), a = w^2 h^2 / (1 + w^2 h^2), so that
    its envelope falls by sqrt(1 - a) a step (NUMERICS A10), for any number of iterations."""
    scene = free(2, 2, method__iterations=iterations)
    rest = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, -1.0], [1.0, -1.0]])
    centre = rest.mean(axis=0)
    a = matching_factor(matching_stiffness(scene), scene.method.dt, 1)
    before = now = 0.1
    for _ in range(STEPS):
        before, now = now, (1 - a) * (2 * now - before)
    state = end_state(scene, start=start(scene, centre + (rest - centre) * [1.1, 1.0]))
    stretch = np.ptp(state.position[:, 0]) - 1
    assert stretch == pytest.approx(now, abs=1e-12)


@pytest.mark.parametrize("region,iterations", [(1, 1), (1, 3), (3, 2)])
def test_momentum_is_kept(region: int, iterations: int) -> None:
    """Split masses: what one cluster gives a mass, others of the cluster pay for. From rest, so that the angular momentum's
    arms are those of the prediction in the first iteration; linear momentum in any."""
    scene = free(7, 6, method__region=region, method__iterations=iterations)
    random = np.random.default_rng(3)
    position = lattice_clusters(scene).position + random.normal(0, 0.2, (42, 2))
    state = end_state(scene, start=start(scene, position), steps=1)
    speed = np.abs(state.velocity).max()
    assert speed > 1
    assert np.abs(state.velocity.sum(axis=0)).max() < 1e-12 * speed * 42
    if iterations == 1:
        turning = np.cross(
            np.column_stack([state.position, np.zeros(42)]), np.column_stack([state.velocity, np.zeros(42)])
        )
        assert np.abs(turning.sum(axis=0)).max() < 1e-12 * speed * 42 * 6


def test_a_rigid_cluster_loses_spin_by_its_law() -> None:
    """NUMERICS A8: an angle D per substep becomes atan2(sin D, 2 - cos D); a grid of one cluster, as good as rigid."""
    scene = free(3, 3, method__region=2, springs__stiffness=1e14)
    rest = lattice_clusters(scene).position
    arm, omega, h = rest - rest.mean(axis=0), 2 * np.pi, scene.method.dt
    state = end_state(scene, start=start(scene, rest, omega * np.stack([-arm[:, 1], arm[:, 0]], axis=1)), steps=50)
    angle, total = np.arctan(omega * h), 0.0
    for n in range(50):
        angle = angle if n == 0 else np.arctan2(np.sin(angle), 2 - np.cos(angle))
        total += angle
    now = state.position - state.position.mean(axis=0)
    turn = np.arctan2((arm[:, 0] * now[:, 1] - arm[:, 1] * now[:, 0]).sum(), (arm * now).sum())
    assert turn == pytest.approx((total + np.pi) % (2 * np.pi) - np.pi, abs=1e-9)


def test_its_error_is_of_first_order_in_the_substep() -> None:
    """Halving the substep halves what is left: observed orders within 0.15 of 1, of 8 to 32 against 512 substeps."""
    scene = jelly(6, 6, perturbation__amplitude=0.05)
    finest, errors = reference.simulate(scene.replace({"method.substeps": 512}), 10)[0], []
    for substeps in (8, 16, 32):
        with open_simulation(
            scene.replace({"method.substeps": substeps}), "cpu", precision="float64", math="exact", threads=1
        ) as simulation:
            simulation.advance(10)
            errors.append(np.abs(simulation.state().position - finest).max())
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 1).max() < 0.15, (errors, orders)


@pytest.mark.parametrize("region", [1, 2])
def test_a_hanging_strip_sags_as_one_of_springs(region: int) -> None:
    """One column: no rotation turns, so that rest is a linear system, solved here from the clusters themselves. With
    K x - r = sum share (x - goal) a step rests where h^2 g = b (K (x + h^2 g) - r) on free masses: K x - r = g / w^2 +
    h^2 (g - K g), the weight of w^2 h^2 too much where a load is carried on by many clusters. In a long strip, whose windows
    are mostly whole, short steps make the sag that of springs, within the windows' size over the length."""
    scene = jelly(40, 1, grid__pinned="top", method__region=region)
    clusters, n, h = lattice_clusters(scene), 40, scene.method.dt
    owner, w2 = clusters.owner, matching_stiffness(scene)
    centre = np.zeros((clusters.count, n))
    np.add.at(centre, (owner, clusters.indices), clusters.masses / clusters.cluster_mass[owner])
    matrix, rest = np.zeros((n, n)), np.zeros(n)
    for entry, particle in enumerate(clusters.indices):
        matrix[particle] -= clusters.weights[entry] * centre[owner[entry]]
        matrix[particle, particle] += clusters.weights[entry]
        rest[particle] += clusters.weights[entry] * clusters.rest[entry, 1]
    gravity = np.concatenate([[0.0], np.full(n - 1, -9.81)])

    def at_rest(h: float) -> np.ndarray:
        load = rest + gravity * (1 / w2 + h**2) - h**2 * matrix @ gravity
        return np.concatenate([[0.0], np.linalg.solve(matrix[1:, 1:], load[1:])])

    sag = at_rest(h)
    state = end_state(scene, start=start(scene, np.column_stack([np.zeros(n), sag])), steps=200)
    assert np.abs(state.position[:, 1] - sag).max() < 1e-9
    springs = sum((n - i) * 0.01 * 9.81 / 10 for i in range(1, n))
    assert abs(at_rest(0.0)[-1] + (n - 1) + springs) < 3 * region / n * springs


def test_a_material_does_not_hang_on_the_substeps() -> None:
    """A mode of one cluster swings at w whatever the step (A10): 60 rad/s to 0.2 % at h = 1/6000, for any iterations."""
    for iterations in (1, 4):
        h = 1 / 6000
        share = matching_factor(3600.0, h, 1)
        assert share == pytest.approx(3600 * h**2 / (1 + 3600 * h**2), rel=1e-12)
        split = matching_factor(3600.0, h, iterations)
        assert 1 - (1 - split) ** iterations == pytest.approx(share, rel=1e-12)
        assert np.arccos(np.sqrt(1 - share)) / h == pytest.approx(60, rel=2e-3)
    assert matching_factor(3600.0, 1 / 60, 1) == pytest.approx(0.5)  # w h = 1


def test_one_scene_runs_under_all_three_solvers() -> None:
    """The same pins, gravity and poke."""
    for solver in ("mass-spring", "xpbd", "shape-matching"):
        scene = load_scene("jelly-grid").replace({"grid.rows": 11, "grid.columns": 9, "method.solver": solver})
        with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
            begin = simulation.body.position.copy()
        state = end_state(scene, poked=True)
        assert np.array_equal(state.position[[0, 8]], begin[[0, 8]])
        assert (state.position - begin)[9:, 1].mean() < -9.81 * (STEPS * scene.method.dt) ** 2 / 4  # half of free fall


def clusters_of(**changes: Any) -> Clusters:
    fields = {
        "offsets": np.array([0, 2, 4], np.int32), "indices": np.array([0, 1, 1, 2], np.int32), "coefficients": np.ones(4),
        "stiffness": np.ones(2), "mass": np.ones(3), "position": np.eye(3),
    }  # fmt: skip
    return Clusters(**(fields | changes))


@pytest.mark.parametrize(
    "changes,word",
    [
        ({"offsets": np.array([1, 2, 4])}, "begin with 0"),
        ({"offsets": np.array([], np.int32)}, "begin with nothing"),
        ({"offsets": np.array([0, 3, 2])}, "must not fall"),
        ({"offsets": np.array([0, 2, 5])}, "must end with"),
        ({"indices": np.array([0, 1, 1, 3])}, "particles are 0 to 2"),
        ({"coefficients": np.array([1, 1.1, 1, 1])}, r"\[0, 1\]"),
        ({"coefficients": np.array([1, np.nan, 1, 1])}, r"\[0, 1\]"),
        ({"coefficients": np.ones(3)}, "as many coefficients"),
        ({"stiffness": np.array([1.0, -1.0])}, "at least 0"),
    ],
)
def test_arrays_that_are_no_clusters_are_refused(changes: dict[str, Any], word: str) -> None:
    with pytest.raises(InputError, match=word):
        clusters_of(**changes)


def test_shares_of_a_particle_add_up_to_one() -> None:
    found = clusters_of(coefficients=np.array([1.0, 0.25, 0.75, 0.0]))
    assert found.weights.tolist() == [1.0, 0.25, 0.75, 0.0]
    assert found.orphans.tolist() == [2]
    assert found.of_particle[0].tolist() == [0, 1, 3, 4] and found.of_particle[1].tolist() == [0, 1, 2, 3]
