"""`softlab throughput`: particles of bodies per second; clusters alone, clusters of a grid, and heaps that collide.

`bodies`: blobs of about 280 particles in space, fifty to ten thousand, soft (overlapping clusters) or rigid (one);
`heap`: the same, falling onto each other and the ground, with contacts; `grid`: the lab's grid as jelly, `lattice`: a
cube of it, both by the half-width of their clusters. A frame of a heap, the unit that is timed, is a step of 1/60 s in
two substeps.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rich.console import Console

from softlab.bench.measure.case_timing import Case, RatePoint, Rates, make_case
from softlab.bench.measure.tables import print_table
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure, measures
from softlab.model.base.errors import SceneError
from softlab.model.core.spare import counts
from softlab.model.scene.scene import Scene, load_scene

# the names in the store are those under which the experiment was first written
STAGE = "crowds"  # of the samples
STEP = "crowd_step"  # s: the median of a step
RATE = "crowd_particles_per_second"  # particles x substeps x iterations, 1/s
KERNEL = "crowd_kernel"  # the name of the kernel is stored as the reason
KIND = "crowd_kind"  # the kind is stored as the reason
KINDS = ("soft", "rigid", "heap", "grid", "lattice")
QUICK_KINDS = KINDS[:-1]  # a lattice in space takes longest to compile
BLOB = {"shape": {"name": "blob"}, "particle_spacing": 0.084}  # 281 particles
BLOCKS = {50: (5, 2, 5), 1000: (10, 10, 10), 10000: (25, 16, 25)}  # bodies along x, y, z
ON_CPU = (50, 1000)
QUICK = (50,)
GRIDS, QUICK_GRIDS, LARGE = (64, 256, 1024), (64,), (2048,)
REGIONS = (1, 2, 4)
CUBES, QUICK_CUBES, LARGE_CUBES = (16, 32), (16,), (64,)  # particles along each side
FRAME = 1 / 60  # s
CONTACT = {"sweeps": 3, "separation_speed": 3.0, "maximum_speed": 4.0}  # two fifths of a particle spacing per substep


def bodies(count: int, rigid: bool) -> Scene:
    """Return that many blobs in a block, which fall without contacts."""
    nx, ny, nz = BLOCKS[count]
    body = BLOB | {"kind": "rigid_body" if rigid else "soft_body", "copies": [nx, ny, nz], "apart": [1.0, 1.2, 1.1]}
    return Scene({"blob": body, "gravity": {}, "method": {"solver": "shape-matching", "dt": 0.01}}, f"{count} bodies")


def heap(count: int) -> Scene:
    """Return that many soft blobs that fall into a heap, with contacts; close together, so that they collide at once."""
    nx, ny, nz = BLOCKS[count]
    body = BLOB | {
        "kind": "soft_body", "copies": [nx, ny, nz], "apart": [0.55, 1.0, 0.8], "origin": [0.0, 0.6, 0.0],
    }  # fmt: skip
    plane = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], "static_friction": 0.5, "dynamic_friction": 0.4}
    method = {"solver": "shape-matching", "dt": FRAME, "substeps": 2}
    return Scene(
        {"blob": body, "gravity": {}, "plane": plane, "contact": CONTACT, "method": method}, f"{count} bodies in a heap"
    )


def jelly(size: int, region: int) -> Scene:
    """Return `jelly-grid` with size x size masses, one substep, in windows of that half-width."""
    return load_scene("jelly-grid").replace(
        {"grid.rows": size, "grid.columns": size, "method.substeps": 1, "method.dt": 0.0025, "method.region": region}
    )


def cube(size: int, region: int) -> Scene:
    """Return a cube of jelly of size^3 particles that falls without contacts, in windows of that half-width."""
    box, spacing = {"name": "box", "resolution": 4}, 1 / size
    body = {"kind": "soft_lattice", "shape": box, "particle_spacing": spacing, "region": region}
    return Scene(
        {"cube": body, "gravity": {}, "method": {"solver": "shape-matching", "dt": 0.0025}}, f"{size}^3 lattice"
    )


def kind_of(scene: Scene) -> str:
    """Return the kind of a scene, one of KINDS."""
    kinds = {scene.kinds[name] for name in scene.bodies}
    if not kinds:
        return "grid"
    if "soft_lattice" in kinds:
        return "lattice"
    if scene.contact:
        return "heap"
    return "rigid" if kinds == {"rigid_body"} else "soft"


def groups(
    backends: Sequence[str], quick: bool, precisions: Sequence[str], kinds: Sequence[str] | None = None
) -> list[list[Case]]:
    """Return the groups timed in turn: all cases of a number of bodies, or of a size of the grid, on a backend.

    `kinds`: of KINDS (None: all, or QUICK_KINDS). `quick`: fifty bodies and the smallest grid. Raises SceneError for
    another kind.
    """
    kinds = kinds or (QUICK_KINDS if quick else KINDS)
    for kind in kinds:
        if kind not in KINDS:
            raise SceneError("--kind", kind, f"must be one of {', '.join(KINDS)}")
    all_groups, wanted = [], set(kinds)
    for backend in backends:
        for count in QUICK if quick else ON_CPU if backend == "cpu" else tuple(BLOCKS):
            scenes = [bodies(count, kind == "rigid") for kind in ("soft", "rigid") if kind in wanted]
            scenes += [heap(count)] if "heap" in wanted else []
            all_groups.append([make_case(s, backend, p, f"{count} bodies") for p in precisions for s in scenes])
        sizes = QUICK_GRIDS if quick else (*GRIDS, *(LARGE if backend == "gpu" else ()))
        for size in sizes if "grid" in wanted else ():
            label = f"jelly {size} x {size}"
            all_groups.append([make_case(jelly(size, r), backend, p, label) for p in precisions for r in REGIONS])
        sizes = QUICK_CUBES if quick else (*CUBES, *(LARGE_CUBES if backend == "gpu" else ()))
        for size in sizes if "lattice" in wanted else ():
            label, regions = f"lattice {size}^3", REGIONS[:-1] if size in LARGE_CUBES else REGIONS
            all_groups.append([make_case(cube(size, r), backend, p, label) for p in precisions for r in regions])
    return [group for group in all_groups if group]


def particle_steps(scene: Scene) -> int:
    """Return particles x substeps x iterations per step."""
    return counts(scene).particles * scene.method.substeps * scene.method.iterations


RATES = run_throughput = Rates("throughput", STAGE, STEP, RATE, KERNEL, particle_steps, groups, words={KIND: kind_of})


# ---------------------------------------------------------------------- results from the store


def print_throughput(console: Console, store: Store, machine: str) -> None:
    """Print a table of what was timed on a machine."""
    rows = []
    for p in points(measures(store, machine=machine), every=True):
        width = " x ".join([str(2 * p.region + 1)] * (3 if p.kind == "lattice" else 2)) if p.region else ""
        row = p.kind, p.backend, str(p.bodies or ""), str(p.particles), width, p.kernel
        rows.append((*row, f"{1e6 * p.step:.1f}{'?' * p.incomplete}", f"{p.rate / 1e6:.1f}"))
    heads = "kind", "backend", "bodies", "particles", "clusters", "kernel", "step / us", "million / s"
    print_table(
        console, heads, rows, "million / s: particles times substeps; ?: incomplete; softlab figures draws them"
    )


@dataclass(frozen=True)
class ThroughputPoint(RatePoint):
    """Result of a `kind`: particles, bodies (0: a grid), and the half-width of a grid's or a lattice's clusters, else
    0.
    """

    kind: str
    particles: int
    bodies: int
    region: int


def region_of(scene: Scene) -> int:
    """Return the half-width of the windows of a grid or a lattice, else 0."""
    lattices = [getattr(body, "region", 0) for body in scene.bodies.values()]
    return max(lattices, default=scene.method.region)


def points(stored: Iterable[Measure], every: bool = False) -> list[ThroughputPoint]:
    """Return the points from the measures, smallest first; with `every`, incomplete ones too."""
    throughput_points = []
    for by_name, scene, point in RATES.results(stored, every):
        method, bodies_ = scene.method, scene.bodies.values()
        particles = round(point.rate * point.step / method.substeps / method.iterations)
        throughput_points.append(
            ThroughputPoint(
                **vars(point), kind=by_name[KIND].reason or "", particles=particles, region=region_of(scene),
                bodies=sum(body.count for body in bodies_),
            )
        )  # fmt: skip
    return sorted(throughput_points, key=lambda p: (p.particles, p.backend, p.kind, p.region))
