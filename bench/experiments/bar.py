"""`softlab bar`: one body by every method, to measure each method's effective material, and laws of bodies.

A strip of the lab's grid under all three solvers (bench/experiments/bar_strip.py) and bars of jelly and of tetrahedra
of the same material (bench/experiments/bar_body.py): sag, first frequency and resistance to shear, each against the
spacing, the substeps of a frame and the size of the clusters, one at a time; and the laws of
bench/experiments/body_laws.py. All in float64 and exact math, whose results do not depend on the backend, so that
differences are due to the method. Stored, resumable.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from softlab.bench.experiments import bar_body, bar_strip, body_laws
from softlab.bench.experiments.bar_body import bar, measured_tetrahedra, stand, sway, tetrahedra
from softlab.bench.experiments.bar_strip import ACROSS, FREQUENCY, SAG, bend, hang, method_of, strip, swing
from softlab.bench.experiments.body_laws import ANGULAR_MOMENTUM, DROP, ENERGY, FLIGHT, SPIN, law_scene, measure_law
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.experiment import described, source_hash
from softlab.bench.measure.items import Finding
from softlab.bench.store.database import Store
from softlab.model.base.digest import source_digest
from softlab.model.scene.scene import Scene

VERSION = 1  # part of every resume key: raise it when an experiment changes
STRIP, BODY, LAW, ELEMENTS = "bar: strip", "bar: body", "bar: law", "bar: tetrahedra"  # values of `finding`
SOLVERS = {  # name -> solver, iterations
    "mass-spring": ("mass-spring", 1),
    "xpbd": ("xpbd", 1),
    "xpbd, converged": ("xpbd", 32),
    "shape-matching": ("shape-matching", 1),
}
TETRAHEDRA = {"tetrahedra, xpbd": ("xpbd", 1), "tetrahedra, newton": ("newton", 1)}  # the same, for tetrahedra
VOXELS, SOME_VOXELS = (4, 8, 16), 8  # along the bar of tetrahedra
LINKS = (8, 16, 32, 64)  # along the strip
SUBSTEPS = (1, 2, 4, 8, 16)  # per frame
REGIONS = (1, 2, 3, 4)
LAYERS = (8, 16, 24, 32)  # of particles along the jelly bar
OVERLAPS = (1.0, 1.25, 1.5, 2.0)  # cluster_radius over cluster_spacing
# the fixed values while another one is varied
SOME_LINKS, SOME_LAYERS, SOME_OVERLAP, FINEST = 16, 16, 1.25, SUBSTEPS[-1]
QUICK = {8, 16, 1, 4, 2, 1.25}  # values that `quick` uses, except for REGIONS
QUICK_REGIONS = REGIONS[:2]  # each is machine code of its own
LAWS = {SPIN: ANGULAR_MOMENTUM, FLIGHT: ANGULAR_MOMENTUM, DROP: ENERGY}
LAW_SUBSTEPS = (1, 4, 16)


def items(store: Store, backends: Sequence[str], quick: bool) -> list[Finding]:
    """Return all experiments; `quick`: few values of each parameter."""
    return [one for backend in backends for one in experiments(backend, quick)]


def experiments(backend: str, quick: bool = False) -> list[Finding]:
    """Return all experiments of a backend: strips, jelly bars, tetrahedra, laws."""
    files_digest = source_digest(*(Path(str(module.__file__)) for module in (bar_strip, bar_body, body_laws)))
    sources = f"{source_hash(backend)}-{files_digest}-b{VERSION}"
    all_experiments = [*_strips(backend, sources, quick), *_bodies(backend, sources, quick)]
    return [*all_experiments, *_tetrahedra(backend, sources, quick), *_laws(backend, sources, quick)]


def _experiment(
    name: str,
    scene: Scene,
    backend: str,
    sources: str,
    finding: str,
    run: Callable[[], Measures],
    fields: dict[str, object],
) -> Finding:
    fields = {"precision": "float64", "math": "exact"} | fields
    return Finding(name, described(scene, backend, finding, **fields), sources, run)


def _subset(values: Sequence[float], quick: bool) -> list[float]:
    return [value for value in values if not quick or value in QUICK]


def settings(quick: bool = False) -> Iterator[tuple[str, int, int, int]]:
    """Yield (name of SOLVERS, links, substeps, region) of every strip, each once."""
    for name in SOLVERS:
        yield from dict.fromkeys(
            [
                *((name, int(links), FINEST, 1) for links in _subset(LINKS, quick)),
                *((name, SOME_LINKS, int(substeps), 1) for substeps in _subset(SUBSTEPS, quick)),
            ]
        )
    for region in QUICK_REGIONS if quick else REGIONS:
        if region > 1:
            for links in _subset(LINKS, quick):
                yield "shape-matching", int(links), FINEST, region


def _strips(backend: str, sources: str, quick: bool) -> list[Finding]:
    runs = []
    loads = {SAG: hang, FREQUENCY: swing, ACROSS: bend}
    for name, links, substeps, region in settings(quick):
        solver, iterations = SOLVERS[name]
        method = method_of(solver, substeps, iterations, region)
        fields = {"solver": name, "links": links, "substeps": substeps, "region": region}
        for load, run in loads.items():
            if load == ACROSS and (quick or name == "xpbd, converged"):
                continue
            scene = strip(links, method, load)
            measure = partial(run, scene, backend)
            runs.append(_experiment(load, scene, backend, sources, STRIP, measure, fields | {"load": load}))
    return runs


def bodies(quick: bool = False) -> list[tuple[int, float, int]]:
    """Return (layers, overlap, substeps) of every jelly bar, each once."""
    bars = [
        *((SOME_LAYERS, overlap, FINEST) for overlap in _subset(OVERLAPS, quick)),
        *((int(layers), SOME_OVERLAP, FINEST) for layers in _subset(LAYERS, quick)),
        *((SOME_LAYERS, SOME_OVERLAP, int(substeps)) for substeps in _subset(SUBSTEPS, quick)),
    ]
    return list(dict.fromkeys(bars))


def _bodies(backend: str, sources: str, quick: bool) -> list[Finding]:
    runs = []
    for layers, overlap, substeps in bodies(quick):
        fields = {"layers": layers, "overlap": overlap, "substeps": substeps}
        lying, standing = (bar(layers, overlap, substeps, up) for up in (False, True))
        swings, stands = partial(sway, lying, backend, layers, overlap), partial(stand, standing, backend)
        runs.append(_experiment(FREQUENCY, lying, backend, sources, BODY, swings, fields | {"load": FREQUENCY}))
        runs.append(_experiment(SAG, standing, backend, sources, BODY, stands, fields | {"load": SAG}))
    return runs


def of_tetrahedra(quick: bool = False) -> list[tuple[str, int, int]]:
    """Return (name of TETRAHEDRA, voxels, substeps) of every bar of tetrahedra, each once."""
    sizes = [SOME_VOXELS] if quick else VOXELS
    bars = [(name, voxels, FINEST) for name in TETRAHEDRA for voxels in sizes]
    bars += [(name, SOME_VOXELS, int(substeps)) for name in TETRAHEDRA for substeps in _subset(SUBSTEPS, quick)]
    return list(dict.fromkeys(bars))


def _tetrahedra(backend: str, sources: str, quick: bool) -> list[Finding]:
    """Return the experiments of all loads.

    Across, the rest state of Newton's method does not depend on the number of substeps, so one is enough.
    """
    runs = []
    for name, voxels, substeps in of_tetrahedra(quick):
        solver, iterations = TETRAHEDRA[name]
        for load in (SAG, FREQUENCY, ACROSS):
            if load == ACROSS and (quick or substeps < FINEST):
                continue
            few = 1 if (load, solver) == (ACROSS, "newton") else substeps
            scene = tetrahedra(voxels, solver, iterations, few, load)
            fields = {"solver": name, "layers": voxels, "substeps": substeps, "region": 1}
            run = partial(measured_tetrahedra, scene, backend, load)
            runs.append(_experiment(load, scene, backend, sources, ELEMENTS, run, fields | {"load": load}))
    return runs


def _laws(backend: str, sources: str, quick: bool) -> list[Finding]:
    runs = []
    for law, name in LAWS.items():
        for substeps in _subset(LAW_SUBSTEPS, quick):
            scene = law_scene(law, int(substeps))
            for precision in ("float64", "float32") if law == DROP and not quick else ("float64",):
                measure = partial(measure_law, law, scene, backend, precision)
                fields = {"law": law, "substeps": int(substeps), "precision": precision}
                runs.append(_experiment(name, scene, backend, sources, LAW, measure, fields))
    return runs
