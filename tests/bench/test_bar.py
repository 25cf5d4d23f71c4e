"""Every method, one body: the bars against closed forms of each method, laws of bodies, the store, figures and sentences."""

from __future__ import annotations

import io
from math import inf, pi

import numpy as np
import pytest
from rich.console import Console

from softlab.bench.experiments import bar as job
from softlab.bench.experiments.bar import FINEST, TETRAHEDRA, experiments
from softlab.bench.experiments.bar_body import (
    CLUSTERS,
    LENGTH,
    LEVER_ARM,
    SPEED,
    bar,
    measured_tetrahedra,
    sampled,
    sway,
    tetrahedra,
)
from softlab.bench.experiments.bar_rows import BarMaterial, print_bar
from softlab.bench.experiments.bar_strip import (
    ACROSS,
    DECAY,
    FRAME,
    FREQUENCY,
    REFUSED,
    SAG,
    beam_tip,
    bend,
    chain_frequency,
    chain_of_clusters,
    chain_sag,
    hang,
    implicit_frequency,
    method_of,
    returns_measures,
    rod_frequency,
    rod_sag,
    strip,
    swing,
    swing_of,
    verlet_frequency,
)
from softlab.bench.experiments.body_laws import (
    ANGULAR_MOMENTUM,
    DROP,
    ENERGY,
    FLIGHT,
    MOMENTUM,
    SPIN,
    STILL,
    law_scene,
    measure_law,
    spin_left,
)
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.assets.clusters import matching_factor
from softlab.model.base.errors import Diverged

FEW = 8  # links


def value(found, name: str) -> float:
    return found[name][0]


# ---------------------------------------------------------------------- the bars


@pytest.mark.parametrize(
    "solver,iterations,discrete", [("mass-spring", 1, verlet_frequency), ("xpbd", 32, implicit_frequency)]
)
def test_springs_are_a_chain(solver: str, iterations: int, discrete, backend: str) -> None:
    """Sag m g / k (1 + ... + n), and the chain's frequency as the step changes it. At rest to e^-30; 32 sweeps leave 1e-12,
    and a linear recurrence of 97 samples of 1e-2 m, rounded to 1e-16 m, its root to some 100 x 1e-14."""
    method = method_of(solver, FINEST, iterations)
    assert value(hang(strip(FEW, method), backend), SAG) == pytest.approx(chain_sag(FEW), rel=1e-10)
    found = swing(strip(FEW, method, FREQUENCY), backend)
    exact = discrete(chain_frequency(FEW), FRAME / FINEST)
    assert value(found, FREQUENCY) == pytest.approx(exact, rel=1e-10)
    # implicit Euler shrinks by (1 + w^2 h^2)^(-1/2) a step, Verlet does not
    h, w = FRAME / FINEST, 2 * pi * chain_frequency(FEW)
    rate = 0.0 if solver == "mass-spring" else np.log1p(w**2 * h**2) / (2 * h)
    assert value(found, DECAY) == pytest.approx(rate, abs=1e-8)


@pytest.mark.parametrize("region", [1, 2])
def test_windows_are_the_linear_system_of_their_clusters(region: int, backend: str) -> None:
    """Sags to what e^-30 leaves; a swing let go as a chain's is not quite one mode: of 1 % and 6 % others, squared."""
    method = method_of("shape-matching", FINEST, region=region)
    sag, frequency = chain_of_clusters(strip(FEW, method))
    assert value(hang(strip(FEW, method), backend), SAG) == pytest.approx(sag, rel=1e-9)
    assert value(swing(strip(FEW, method, FREQUENCY), backend), FREQUENCY) == pytest.approx(
        frequency, rel=1e-4 if region == 1 else 4e-3
    )
    assert sag > rod_sag() and frequency < rod_frequency()


def test_springs_do_not_resist_shear_and_clusters_do(backend: str) -> None:
    """Springs hang from their pins, 1 % of the load's sag or less from straight down; clusters bend as a beam does, softer
    by what the edges cut off their windows: at most as much as those are of the strip, 2 of 2 rows."""
    for solver in ("mass-spring", "xpbd"):
        assert value(bend(strip(FEW, method_of(solver, FINEST), ACROSS), backend), ACROSS) == pytest.approx(
            LENGTH, abs=0.01
        )
    bent = value(bend(strip(FEW, method_of("shape-matching", FINEST), ACROSS), backend), ACROSS)
    assert beam_tip() < bent < 2 * beam_tip()


def test_a_jelly_bar_swings_as_its_clusters_say(backend: str) -> None:
    """The eigenvalue e of what clusters pull back, by differences, in substeps of h: z^2 = (1 - b e)(2 z - 1). Of a rod's
    mode others of the bar's have 14 %, squared 2 %, which blurs it."""
    scene, layers, overlap = bar(FEW, 1.25, FINEST), FEW, 1.25
    clusters, at = scene.body_set.clusters, scene.body_set.position

    def pull(position: np.ndarray) -> np.ndarray:
        found = np.zeros_like(position)
        ways = position[clusters.indices] - clusters.goals(position)
        np.add.at(found, clusters.indices, clusters.weights[:, None] * ways)
        return found.ravel()

    step = 1e-5 * np.eye(at.size).reshape(at.size, -1, 3)
    matrix = np.stack([(pull(at + one) - pull(at - one)) / 2e-5 for one in step], axis=1)
    values, modes = np.linalg.eig(matrix)
    shape = np.zeros_like(at)
    shape[:, 0] = np.sin(pi * at[:, 0] / LENGTH)
    e = values[np.argmax(np.abs(np.linalg.solve(modes, shape.ravel())))].real
    h = FRAME / FINEST
    b = matching_factor(clusters.stiffness[0], h, 1)
    found = sway(scene, backend, layers, overlap)
    assert value(found, FREQUENCY) == pytest.approx(np.arccos(np.sqrt(1 - b * e)) / (2 * pi * h), rel=0.02)
    # one material: drawn out evenly it stores M c^2 e^2 / 2, less what askew clusters spare by turning
    stored = clusters.energy(at * [1 + 1e-3, 1, 1]) / (0.5 * clusters.mass.sum() * SPEED**2 * 1e-6)
    assert 0.99 < stored < 1 + 1e-6
    assert value(found, LEVER_ARM) * np.sqrt(clusters.stiffness[0]) == pytest.approx(SPEED)
    assert value(found, CLUSTERS) == len(clusters.indices) / len(at)


def test_bars_of_any_spacing_are_one_material() -> None:
    for links in (8, 64):
        scene = strip(links, method_of("mass-spring", FINEST))
        d = scene.grid.spacing
        assert d * np.sqrt(scene.springs.stiffness / scene.grid.mass) == pytest.approx(SPEED)
        assert (scene.grid.rows - 1) * d == LENGTH and scene.grid.columns * d == pytest.approx(0.25)
    assert sampled(16, 1.5)["cluster_radius"] == pytest.approx(1.5 * sampled(16, 1.5)["cluster_spacing"])


def test_a_damped_swing_by_hand() -> None:
    """x = e^(-0.3 t) cos(2 pi 1.7 t), every 0.01 s."""
    t = 0.01 * np.arange(60)
    assert swing_of(np.exp(-0.3 * t) * np.cos(2 * pi * 1.7 * t), 0.01) == pytest.approx((1.7, 0.3), rel=1e-9)


def test_what_is_refused_or_diverges_has_a_reason() -> None:
    found = hang(strip(FEW, method_of("mass-spring", 1)), "cpu")
    assert np.isnan(value(found, SAG)) and found[SAG][2].startswith(REFUSED)

    def diverging():
        raise Diverged(3, 1, 0.01, 0.02)

    assert value(returns_measures(SAG)(diverging)(), SAG) == inf


# ---------------------------------------------------------------------- laws


def test_bodies_keep_their_laws(backend: str) -> None:
    """Spin by its law to the roundings of 480 substeps, each of which changes the later ones; momentum of 480 x 256
    particles' sums; rest."""
    spun = measure_law(SPIN, law_scene(SPIN, 4), backend)
    assert value(spun, ANGULAR_MOMENTUM) == pytest.approx(spin_left(4), abs=480**2 * 1e-15)
    assert value(spun, ANGULAR_MOMENTUM) == pytest.approx(
        1 / np.sqrt(1 + (2 * pi) ** 2 * FRAME / 4 * 2), rel=0.01
    )  # the law of rigid.py
    thrown = measure_law(FLIGHT, law_scene(FLIGHT, 4), backend)
    assert value(thrown, MOMENTUM) < 480 * 256 * 2.0**-53
    assert 0.5 < value(thrown, ANGULAR_MOMENTUM) < 1
    for precision in ("float64", "float32"):
        assert value(measure_law(DROP, law_scene(DROP, 4), backend, precision), ENERGY) < STILL


@pytest.mark.parametrize("name", TETRAHEDRA)
def test_tetrahedra_are_a_rod_and_lock_as_beams(name: str) -> None:
    """Young's modulus and density alone: a rod's sag and frequency to 1 %, the latter less what implicit Euler takes; four
    voxels long and one across it bends by a third of a beam."""
    solver, iterations = TETRAHEDRA[name]
    found = {
        load: value(measured_tetrahedra(tetrahedra(4, solver, iterations, FINEST, load), "cpu", load), load)
        for load in (SAG, FREQUENCY)
    }
    assert found[SAG] == pytest.approx(rod_sag(), rel=0.005)
    assert found[FREQUENCY] == pytest.approx(implicit_frequency(rod_frequency(), FRAME / FINEST), rel=0.012)
    one = {"xpbd": FINEST, "newton": 1}[solver]
    across = measured_tetrahedra(tetrahedra(4, solver, iterations, one, ACROSS), "cpu", ACROSS)
    assert value(across, ACROSS) == pytest.approx(0.341 * beam_tip(), rel=0.005)


# ---------------------------------------------------------------------- the store


def test_quick_is_a_part_of_the_whole() -> None:
    whole, quick = ({str(e.description) for e in experiments("cpu", few)} for few in (False, True))
    assert quick < whole and len(whole) == len(experiments("cpu"))


def test_nothing_is_measured_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job, "LAWS", {SPIN: ANGULAR_MOMENTUM})
    monkeypatch.setattr(job, "SOLVERS", {"mass-spring": ("mass-spring", 1)})
    monkeypatch.setattr(job, "settings", lambda quick: [("mass-spring", FEW, FINEST, 1), ("mass-spring", FEW, 1, 1)])
    monkeypatch.setattr(job, "bodies", lambda quick: [])
    monkeypatch.setattr(job, "of_tetrahedra", lambda quick: [])
    with Store(":memory:") as store:
        first = BarMaterial()(store, quick=True, backends=["cpu"], progress=False)
        again = BarMaterial()(store, quick=True, backends=["cpu"], progress=False)
        assert (first.measured, first.stored) == (4 + 3, 0)
        assert (again.measured, again.stored, again.run) == (0, 7, "")
        refused = [m for m in measures(store, SAG) if m.value is None]
        assert len(refused) == 1 and refused[0].reason is not None and "stability limit" in refused[0].reason
        console = Console(width=80, record=True, file=io.StringIO())
        print_bar(console, store, again.machine)
        printed = console.export_text()
        (sag,) = (m.value for m in measures(store, SAG) if m.value is not None)
        assert f"{sag / rod_sag():.3f}" in printed and "stability limit" in printed and "…" not in printed
