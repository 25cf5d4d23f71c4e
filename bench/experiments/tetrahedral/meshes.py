"""Error of a tetrahedral mesh with any solver, and damping of the time step: parts of `softlab tetrahedra`.

The mesh: the cantilever of bench/experiments/tetrahedra.py under a small tip load, solved to convergence by finite
elements, with five and six tetrahedra per voxel, 1, 2 and 4 voxels across, at three Poisson's ratios; its sag over the
continuum's (CONTINUUM: 27-node hexahedra, three across). Linear tetrahedra cannot bend, and lock at constant volume.

The step: the same bar without a load, released in the shape of its first bending vibration, a hundredth of its width
out. All solvers but one are implicit Euler: a vibration w loses log(1 + w^2 h^2) / (2 h) of its amplitude per second,
w^2 h / 2 for slow ones, whatever the solver, if its iterations converge. This is numerical damping. A solver that has
not converged is softer, and loses less. With Newton's method of order 2 (model/formulas/elastic/stages.py) the loss is
of order h^3.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import log, log1p, pi
from pathlib import Path

import numpy as np
from rich.console import Console

from softlab.app.driver import open_simulation
from softlab.bench.experiments.bar_strip import follow, returns_measures, swing_of
from softlab.bench.experiments.tetrahedra import FREE, SECTIONS
from softlab.bench.experiments.tetrahedral.cantilever import DENSITY, SECOND, cantilever, setting_of
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.experiment import described
from softlab.bench.measure.items import Finding, Items, cost_sources
from softlab.bench.measure.tables import print_table
from softlab.bench.reference import finite_elements
from softlab.bench.reference.finite_elements import linear_static, mode_shapes, spread_evenly
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure, by_configuration, measures
from softlab.bench.store.schema import Description, tables_by_kind
from softlab.model.base.digest import source_digest
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.formulas.elastic.stages import STAGE
from softlab.model.scene.scene import Scene

MESH, STEP = "tetrahedra: mesh", "tetrahedra: step"  # values of `finding`
PART, TETRAHEDRA = "tetrahedra_mesh_part", "tetrahedra_mesh_count"  # sag over the continuum's
DECAY, LAW, FREQUENCY = "tetrahedra_decay", "tetrahedra_decay_law", "tetrahedra_swing"  # 1/s, 1/s, Hz
CONTINUUM = {0.3: 3.99879e-4, 0.45: 3.9447e-4, 0.499: 3.8831e-4}  # Poisson's ratio -> m
CUTS = (5, 6)  # tetrahedra per voxel
LOAD, YOUNG = 0.01, 1e6  # N at the tip; Pa
SUBSTEPS = (1, 2, 4, 8, 16, 32)  # per frame
OF_SECOND = (1,)  # of order 2; shorter substeps lose less than is measurable
SOLVERS = {"xpbd": 1, "vbd": 100, "newton": 1, SECOND: 1}  # -> iterations
SWING, FRAMES = 1e-3, 96  # m, of the tip; frames that are followed


def mesh_items(store: Store, backends: Sequence[str], quick: bool) -> list[Finding]:
    """Return the experiments on meshes, once, and those on steps for each backend; `quick`: few of both."""
    digest = source_digest(Path(__file__), Path(str(finite_elements.__file__)))
    items = []
    for cut in CUTS:
        for across in SECTIONS[: 2 if quick else 3]:
            for poisson in CONTINUUM:
                scene = bar(across, cut, poisson)
                description = described(scene, "cpu", MESH, precision="float64")
                items.append(Finding(PART, description, f"{digest}-m1", partial(mesh_part, scene)))
    for backend in backends:
        sources = f"{cost_sources(backend, [__file__])}-{digest}"
        for solver, iterations in SOLVERS.items():
            usual = (SUBSTEPS[0], SUBSTEPS[2]) if quick else SUBSTEPS
            for substeps in OF_SECOND if solver == SECOND else usual:
                scene = swinging(solver, substeps, iterations)
                description = described(scene, backend, STEP, precision="float64")
                items.append(Finding(DECAY, description, sources, partial(decay, scene, backend)))
    return items


def bar(across: int, cut: int, poisson: float) -> Scene:
    """Return the cantilever with that many tetrahedra per voxel and that Poisson's ratio."""
    scene = cantilever(across, YOUNG, "xpbd", 1, 1)
    return scene.replace({"beam.tetrahedra": cut, "beam.poisson_ratio": poisson})


def mesh_part(scene: Scene) -> Measures:
    """Measure PART: the exact sag of a scene's mesh under LOAD, spread evenly over its end, over the continuum's."""
    mesh, part = scene.tetrahedra_set, scene.tetrahedra_set.parts[0]
    fixed = np.zeros(mesh.particle_count, bool)
    fixed[mesh.pinned_vertices] = True
    end = mesh.position[:, 0] > mesh.position[:, 0].max() - 1e-9
    force = spread_evenly(mesh.position, mesh.tetrahedra, end, (0.0, -LOAD, 0.0))
    moved = linear_static(mesh.position, mesh.tetrahedra, part.young_modulus, part.poisson_ratio, fixed, force)
    work = float((force * moved).sum()) / LOAD  # the sag, weighted like the load
    return {
        TETRAHEDRA: (float(len(mesh.tetrahedra)), "", None),
        PART: (work / CONTINUUM[part.poisson_ratio], "", "of 27-node hexahedra's sag"),
    }


def swinging(solver: str, substeps: int, iterations: int) -> Scene:
    """Return the coarsest bar without a load and practically without a brake."""
    scene = cantilever(1, YOUNG, solver, substeps, iterations)
    assert scene.damping is not None
    return scene.replace({"gravity.enabled": False, "damping.coefficient": FREE * scene.damping.coefficient})


def first_mode(scene: Scene) -> tuple[float, np.ndarray]:
    """Return (frequency [Hz], shape (particles, 3), 1 at the tip) of its slowest bending vibration, masses lumped."""
    mesh = scene.tetrahedra_set
    fixed = np.zeros(mesh.particle_count, bool)
    fixed[mesh.pinned_vertices] = True
    part = mesh.parts[0]
    some, shapes = mode_shapes(
        mesh.position, mesh.tetrahedra, part.young_modulus, part.poisson_ratio, DENSITY, fixed, 2
    )  # fmt: skip
    shape = shapes[0] / np.abs(shapes[0]).max()  # a square section has two equal modes, in any plane
    return float(some[0]), shape


def law(frequency: float, h: float, order: int = 1) -> float:
    """Return the loss of a vibration's amplitude [1/s] by implicit Euler in steps of h [s], or two stages (`order` 2).

    It is -log |R(i w h)| / h, with R(z) = 1 / (1 - z), or (1 + (1 - 2 g) z) / (1 - g z)^2 with g = STAGE.
    """
    z = 2 * pi * frequency * h
    if order == 1:
        return log(1 + z**2) / (2 * h)
    # 2 g^2 = (1 - 2 g)^2, so that there is no cancellation
    return log1p((STAGE * z) ** 4 / (1 + ((1 - 2 * STAGE) * z) ** 2)) / (2 * h)


@returns_measures(LAW, FREQUENCY, DECAY)
def decay(scene: Scene, backend: str) -> Measures:
    """Measure DECAY of the first mode, with the LAW's value, and its FREQUENCY."""
    frequency, shape = first_mode(scene)
    rest = scene.tetrahedra_set.position
    begin = State(rest + SWING * shape, np.zeros_like(rest), build(scene).inverse_mass, 0.0, 0)
    with open_simulation(scene, backend, initial=begin, precision="float64") as simulation:
        seen, lost = swing_of(follow(simulation, shape, FRAMES), scene.method.dt)
    h = scene.method.dt / scene.method.substeps
    return {
        LAW: (law(frequency, h, scene.method.order), "1/s", f"of {frequency:.4g} Hz"),
        FREQUENCY: (seen, "Hz", None),
        DECAY: (lost, "1/s", None),
    }


# ---------------------------------------------------------------------- results from the store


@dataclass(frozen=True)
class Mesh:
    """`cut` tetrahedra per voxel, `across` voxels: `count` tetrahedra, whose sag is `part` of the continuum's."""

    cut: int
    across: int
    poisson: float
    count: int
    part: float


@dataclass(frozen=True)
class Step:
    """Substeps of `h` [s]: loss of amplitude `decay` [1/s], that of its scheme `law`, and `frequency` [Hz]."""

    backend: str
    solver: str
    h: float
    decay: float
    law: float
    frequency: float


def _by_finding(stored: Iterable[Measure], finding: str) -> Iterator[tuple[Description, dict[str, float]]]:
    for numbers in by_configuration(m for m in stored if m.description.get("finding") == finding):
        description = next(iter(numbers.values())).description
        yield description, {name: one.value for name, one in numbers.items() if one.value is not None}


def meshes(stored: Iterable[Measure]) -> list[Mesh]:
    """Return the meshes from the measures: by cut, Poisson's ratio and voxels."""
    all_meshes = []
    for description, value in _by_finding(stored, MESH):
        body = tables_by_kind(description["scene"])["tetrahedral_body"]
        if PART in value and TETRAHEDRA in value:
            across = round(body["shape"]["sides"][1] / body["edge"])
            cut = body.get("tetrahedra", CUTS[0])
            all_meshes.append(Mesh(cut, across, body["poisson_ratio"], round(value[TETRAHEDRA]), value[PART]))
    return sorted(all_meshes, key=lambda m: (m.cut, m.poisson, m.across))


def steps(stored: Iterable[Measure]) -> list[Step]:
    """Return the steps from the measures, long ones last."""
    all_steps = []
    for description, value in _by_finding(stored, STEP):
        method = tables_by_kind(description["scene"])["method"]
        if value.keys() >= {DECAY, LAW, FREQUENCY}:
            solver = setting_of(method)
            h = method["dt"] / method["substeps"]
            all_steps.append(Step(description["backend"], solver, h, value[DECAY], value[LAW], value[FREQUENCY]))
    return sorted(all_steps, key=lambda s: (s.backend, s.solver, s.h))


def print_meshes(console: Console, store: Store, machine: str) -> None:
    """Print two tables of what was measured on a machine: meshes, a line per cut and Poisson's ratio; and steps."""
    stored = list(measures(store, machine=machine))
    all_meshes = meshes(stored)
    sizes = sorted({mesh.across for mesh in all_meshes})
    lines = []
    for cut, poisson in dict.fromkeys((mesh.cut, mesh.poisson) for mesh in all_meshes):
        by_size = {m.across: m for m in all_meshes if (m.cut, m.poisson) == (cut, poisson)}
        parts = [f"{by_size[n].part:.3f} ({by_size[n].count})" if n in by_size else "-" for n in sizes]
        lines.append((str(cut), f"{poisson:g}", *parts))
    if lines:
        heads = ("cut", "nu", *(f"{n} across" for n in sizes))
        print_table(console, heads, lines, "sag under a tip load, solved to the end, over the continuum's (tetrahedra)")
    lines = [
        (s.solver, s.backend, f"{1e3 * s.h:.3g}", f"{s.decay:.3g}", f"{s.law:.3g}", f"{s.frequency:.4g}")
        for s in steps(stored)
    ]  # fmt: skip
    if lines:
        heads = ("solver", "backend", "substep / ms", "lost a second", "by its law", "swings / Hz")
        print_table(console, heads, lines, "of the amplitude of a bar's first vibration, which nothing damps")


class Meshes(Items):
    """Measure the error of a mesh of tetrahedra with any solver, and the damping of its time steps."""

    name, command = "meshes of tetrahedra", "tetrahedra"
    in_lab = True
    items = staticmethod(mesh_items)
    show = staticmethod(print_meshes)
