"""`softlab throughput`: particles of bodies per second; clusters alone, clusters of a grid, and heaps that collide.

`bodies`: blobs of about 280 particles in space, fifty to ten thousand, soft (overlapping clusters) or rigid (one);
`heap`: the same, falling onto each other and the ground, with contacts; `grid`: the lab's grid as jelly, `lattice`: a
cube of it, both by the half-width of their clusters. A frame of a heap, the unit that is timed, is a step of 1/60 s in
two substeps.
"""

from __future__ import annotations

from collections.abc import Sequence

from softlab.bench.measure import words
from softlab.bench.measure.case_timing import Case, Rates, Row, make_case
from softlab.bench.measure.declaration import PRECISION, Lines, Option, Part, Sentence
from softlab.model.core.spare import counts
from softlab.model.scene.scene import Scene, load_scene

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
    """Return that many blobs in a block, falling without contacts."""
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


def region_of(scene: Scene) -> int:
    """Return the half-width of the windows of a grid or a lattice, else 0."""
    lattices = [getattr(body, "region", 0) for body in scene.bodies.values()]
    return max(lattices, default=scene.method.region)


# ---------------------------------------------------------------------- sentences


def heaps(rows: Sequence[Row]) -> Part | None:
    """Frames per second of heaps that collide, the smallest and the largest."""
    of_kind = [row for row in rows if row.kind == "heap"]
    ends = of_kind[:: max(1, len(of_kind) - 1)]
    texts = [
        f"{words.count(row.bodies)} bodies of {words.count(row.particles)} particles do "
        f"{words.number(1 / row.step)} frames a second"
        for row in ends
    ]
    return (words.listed(texts), {str(row.bodies): 1 / row.step for row in ends}) if ends else None


def clusters(rows: Sequence[Row]) -> Part | None:
    """Time of a step of bodies without contacts: the cost of clusters."""
    steps = {row.kind: row.step for row in rows if row.bodies == 50 and row.kind in ("soft", "rigid")}
    if len(steps) < 2:
        return None
    return f"{words.seconds(steps['rigid'])} as rigid ones and {words.seconds(steps['soft'])} as soft ones", steps


def contacts(rows: Sequence[Row]) -> Part | None:
    """Cost of contacts: a substep of a heap over one of the same bodies without contacts."""
    free = {row.bodies: row.rate for row in rows if row.kind == "soft"}
    ratios = {r.bodies: free[r.bodies] / r.rate for r in rows if r.kind == "heap" and r.bodies in free}
    if not ratios:
        return None
    span = sorted({min(ratios.values()), max(ratios.values())})
    return " to ".join(map(words.times, span)), {str(bodies): ratio for bodies, ratio in ratios.items()}


# ---------------------------------------------------------------------- the experiment


class Throughput(Rates):
    """Measure particles per second of soft bodies, rigid bodies, colliding heaps and lattices."""

    name = command = "throughput"
    example = "softlab throughput --quick   (softlab throughput --backend cpu --kind heap)"
    quick_help = "Fifty bodies, the smallest grid, no lattice, fewer repeats: under a minute on two cores."
    in_lab = True
    options = {
        "kinds": Option(
            "--kind", "Only soft, rigid, heap, grid or lattice. Repeatable.", values=KINDS, quick=QUICK_KINDS
        ),
        "precisions": PRECISION,
    }
    # the names in the store are those under which the experiment was first written
    stage, step, kernel = "crowds", "crowd_step", "crowd_kernel"
    rate = "crowd_particles_per_second"  # particles x substeps x iterations, 1/s
    words = {"crowd_kind": kind_of}
    fields = {
        "kind": lambda row: row.measures["crowd_kind"].reason or "",
        "particles": lambda row: round(row.rate * row.step / row.scene.method.substeps / row.scene.method.iterations),
        "bodies": lambda row: sum(body.count for body in row.scene.bodies.values()),  # 0: a grid
        "region": lambda row: region_of(row.scene),
        "clusters": lambda row: " x ".join(
            [str(2 * row.region + 1)] * (3 if row.kind == "lattice" else 2 if row.region else 0)
        ),
    }
    order = ("particles", "backend", "kind", "region")
    table = {
        "kind": "kind", "backend": "backend", "bodies": lambda row: str(row.bodies or ""), "particles": "particles",
        "clusters": "clusters", "kernel": "kernel", "step / us": lambda row: f"{1e6 * row.step:.1f}{'?' * row.incomplete}",
        "million / s": lambda row: f"{row.rate / 1e6:.1f}",
    }  # fmt: skip
    note = "million / s: particles times substeps; ?: incomplete; softlab figures draws them"
    figure = Lines(
        title="Particles of bodies a second",
        caption=(
            "Particles times substeps over the time of a step, float32, one iteration: blobs of about 280 particles that "
            "fall freely, as soft and as rigid bodies, or into a heap with contacts; and the lab's grid and a cube by shape "
            "matching, their clusters 3 masses wide (solid), 5 (dashed) or 9 (dotted)."
        ),
        y_label="particles x substeps / s",
        styles={
            "rigid": ("rigid bodies: one cluster", "blue", "o"),
            "soft": ("soft bodies: overlapping clusters", "green", "D"),
            "heap": ("soft bodies in a heap, with contacts", "vermillion", "^"),
            "grid": ("jelly grid, a cluster around every mass", "orange", "s"),
            "lattice": ("jelly cube, a cluster around every mass", "purple", "P"),
        },
        keys=lambda row: (row.kind, row.region),
        dashes={0: "-", 1: "-", 2: "--", 4: ":"},  # by the half-width of a grid's or a cube's clusters
    )
    sentences = {
        "throughput-heaps": Sentence(
            "In a heap, with contacts and two substeps a frame: {}.", heaps, "Heaps of bodies were not timed.",
            form="on {place} {part}", join="; ".join,
        ),
        "throughput-clusters": Sentence(
            "A step of fifty free bodies takes {}.", clusters, "Clusters alone were not timed."
        ),
        "throughput-contacts": Sentence(
            "With contacts a substep takes {} as long as without.", contacts, "What contacts cost was not timed."
        ),
    }  # fmt: skip

    def work(self, scene: Scene) -> float:
        """Return particles x substeps x iterations per step."""
        return counts(scene).particles * scene.method.substeps * scene.method.iterations

    def groups(
        self, backends: Sequence[str], quick: bool, precisions: Sequence[str], kinds: Sequence[str] = KINDS
    ) -> list[list[Case]]:
        """Return the groups timed in turn: all cases of a number of bodies, or of a size of the grid, on a backend.

        `quick`: fifty bodies and the smallest grid.
        """
        all_groups = []
        for backend in backends:
            for count in QUICK if quick else ON_CPU if backend == "cpu" else tuple(BLOCKS):
                scenes = [bodies(count, kind == "rigid") for kind in ("soft", "rigid") if kind in kinds]
                scenes += [heap(count)] if "heap" in kinds else []
                all_groups.append([make_case(s, backend, p, f"{count} bodies") for p in precisions for s in scenes])
            sizes = QUICK_GRIDS if quick else (*GRIDS, *(LARGE if backend == "gpu" else ()))
            for size in sizes if "grid" in kinds else ():
                label = f"jelly {size} x {size}"
                all_groups.append([make_case(jelly(size, r), backend, p, label) for p in precisions for r in REGIONS])
            sizes = QUICK_CUBES if quick else (*CUBES, *(LARGE_CUBES if backend == "gpu" else ()))
            for size in sizes if "lattice" in kinds else ():
                label, regions = f"lattice {size}^3", REGIONS[:-1] if size in LARGE_CUBES else REGIONS
                all_groups.append([make_case(cube(size, r), backend, p, label) for p in precisions for r in regions])
        return [group for group in all_groups if group]
