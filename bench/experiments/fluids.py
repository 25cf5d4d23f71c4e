"""`softlab fluids`: particles of a fluid per second, and the time of each stage.

A pool of water with a rest distance of 1 cm, at rest between walls and 20 particles deep, with a thousand to ten
million particles. A frame is a step of 1/60 s in two substeps of three iterations, each with its own neighbour search.
Besides whole frames every stage is timed by itself (app/plan/measure.py): the time per particle of sorting, listing,
densities and corrections, and the limits of memory and arithmetic. A cup that pours is timed too, with the place of its
water every half second. On a GPU the frame's kernel fuses the first density with the lists, and the last correction
with the velocities, so that a frame takes less than the sum of the stages. The scheme `divergence-free` is timed in
turn with `macklin`; it has two solves per substep, and an iteration of either counts.
"""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from softlab.app.plan.measure import measure_stages
from softlab.bench.experiments.vessels import basin_area, basin_walls, in_basin, pouring
from softlab.bench.measure import experiment
from softlab.bench.measure.case_timing import Case, Rates, Row, Summary, make_case
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.tables import columns, print_table
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.fluid import passes
from softlab.model.fluid.plan import fluid_plan, neighbours_at_rest, substep_of
from softlab.model.scene.checks.fluids import particle_count
from softlab.model.scene.scene import Scene, load_scene

SCHEMES = ("macklin", "divergence-free")
PHASES, FREE_PHASES = (  # of macklin and divergence-free
    tuple(dict.fromkeys(run.passes[0] for run in passes.runs_of(substep_of(frozenset(parts)), 1)))
    for parts in ((), ("divergence-free",))
)
POOLS = {
    1000: (10, 10, 10),
    8000: (20, 20, 20),
    62720: (56, 20, 56),
    1003520: (224, 20, 224),
}  # particles along x, y, z
LARGE = {10025280: (708, 20, 708)}  # on a GPU
QUICK = (1000, 8000)
POUR = "pour"  # the scene of a cup that pours
IN_CUP, IN_BASIN, LEVEL = "fluid_share_in_the_cup_at", "fluid_share_in_the_basin_at", "fluid_level_over_the_volumes"
DISTANCE = 0.01  # m
FRAME = 1 / 60  # s
SUBSTEPS, ITERATIONS = 2, 3
SCALAR, INDEX, QUAD = 4, 4, 16  # bytes in float32
HALF_H200, STREAM_H200 = 31e12, 4.0e12  # 1/s: half of its peak in float32; bytes/s


def pool(count: int, scheme: str = SCHEMES[0]) -> Scene:
    """Return the pool of that many particles, a key of POOLS or LARGE."""
    nx, ny, nz = (POOLS | LARGE)[count]
    size = [DISTANCE * n for n in (nx, ny, nz)]
    ends = {"left": ([0.0] * 3, [1.0, 0.0, 0.0]), "right": ([size[0], 0.0, 0.0], [-1.0, 0.0, 0.0])}
    ends |= {"back": ([0.0] * 3, [0.0, 0.0, 1.0]), "front": ([0.0, 0.0, size[2]], [0.0, 0.0, -1.0])}
    ends |= {"floor": ([0.0] * 3, [0.0, 1.0, 0.0])}
    walls = {
        name: {"kind": "plane", "point": point, "normal": normal, "thickness": 0.0}
        for name, (point, normal) in ends.items()
    }
    water = {"kind": "fluid", "size": size, "rest_distance": DISTANCE}
    method = {"solver": "pbf", "scheme": scheme, "dt": FRAME, "substeps": SUBSTEPS, "iterations": ITERATIONS}
    return Scene({"water": water, "gravity": {}, **walls, "method": method}, f"a pool of {count} particles")


def count_of(scene: Scene) -> int:
    """Return the number of particles of a pool, without creating them."""
    return particle_count(scene.fluids)


def moved_bytes(phase: str, neighbours: float) -> float:
    """Return the bytes per particle with that many `neighbours` in float32, if only neighbours' positions are cached.

    There is one cell for every six particles.
    """
    return {
        passes.PREDICT: 4 * QUAD + INDEX,
        passes.SORT: 8 * QUAD + (2 + 3 + 1 + 4) * INDEX + 24 / 6,
        passes.FIND: QUAD + 2 * INDEX + 3 * SCALAR + 2 * SCALAR + neighbours * INDEX,
        passes.DENSITY: QUAD + INDEX + 3 * SCALAR + 4 * SCALAR + neighbours * INDEX,
        passes.CORRECT: 3 * QUAD + INDEX + 3 * SCALAR + neighbours * INDEX,
        passes.UPDATE: 5 * QUAD,
        passes.LIMIT: 3 * QUAD,
        passes.GATHER: QUAD,
        passes.SURVEY: 2 * QUAD + INDEX + 3 * SCALAR + 2 * SCALAR + neighbours * INDEX,
        passes.RELAX: 2 * QUAD + INDEX + 3 * SCALAR + 7 * SCALAR + neighbours * INDEX,
        passes.PUSH_APART: 4 * QUAD + INDEX + 3 * SCALAR + neighbours * INDEX,
        passes.TAKE_UP: 4 * QUAD,
        passes.ACCELERATE: 3 * QUAD + INDEX,
        passes.FORESEE: 2 * QUAD + INDEX + 3 * SCALAR + 2 * SCALAR + neighbours * INDEX,
        passes.MOVE: 5 * QUAD + 3 * SCALAR,
    }[phase]


def operations(scene: Scene, phase: str) -> int:
    """Return the floating-point operations of a stage per particle."""
    return next(stage.operations for stage in fluid_plan(scene).root.stages() if stage.name == phase)


def phase_name(phase: str) -> str:
    """Return the name of the measure of a stage's time [s]."""
    return f"fluid_stage_{phase.replace(' ', '_')}"


def poured(case: Case) -> Measures:
    """Return the measures of a cup that pours.

    They are the fractions of its water in the cup and in the basin against time, and the final level of the water over
    the one that follows from its volume and the basin's area.
    """
    numbers: Measures = {}
    scene = case.scene
    for time, cup, basin, places in pouring(scene, case.backend, case.precision):
        position = places
        at = f"{time:.1f}_s"
        numbers |= {f"{IN_CUP}_{at}": (cup, "", "in the cup"), f"{IN_BASIN}_{at}": (basin, "", "in the basin")}
    lying = position[in_basin(scene, position)]
    level = len(lying) * scene.fluid_set.lattice.volume / basin_area(scene, basin_walls(scene)[0].thickness)
    return numbers | {LEVEL: (2 * float(lying[:, 1].mean()) / level, "", "twice the mean height")}


def phase_times(case: Case) -> Measures:
    """Return the time [s] of each stage of a substep.

    Of a stage that a substep has several times it is the time of the last one, since a solve's first iteration may do
    less.
    """
    iterations = 2 if case.scene.method.scheme == "divergence-free" else 1
    scene = case.scene.replace({"method.dt": FRAME / SUBSTEPS, "method.substeps": 1, "method.iterations": iterations})
    times = measure_stages(scene, case.backend, case.precision)
    stages = fluid_plan(scene).root.stages()
    return {phase_name(s.name): (taken, "s", "alone") for s, taken in zip(stages, times.seconds, strict=False)}


def _phases(row: Row) -> dict[str, float]:
    names = {phase_name(phase): phase for phase in (*PHASES, *FREE_PHASES)}
    return {names[name]: one.value or 0.0 for name, one in row.measures.items() if name in names}


def _fractions(row: Row) -> dict[str, float]:
    cup = (IN_CUP, IN_BASIN, LEVEL)
    return {name: one.value or 0.0 for name, one in row.measures.items() if name.startswith(cup)}


class Fluids(Rates):
    """Measure particles per second of fluids and the time of each stage, or (--truth) their errors, or (--rest) how still
    they stay."""

    name = command = stage = "fluids"
    example = "softlab fluids --quick   (softlab fluids --truth --peers)"
    quick_help = "Only pools of 1000 and 8000 particles, fewer repeats."
    step, kernel = "fluid_step", "fluid_kernel"
    rate = (
        "fluid_particle_iterations_per_second"  # particles x substeps x iterations (of both solves, if there are two)
    )
    fields = {
        "particles": lambda row: count_of(row.scene),
        "scheme": lambda row: row.scene.method.scheme,
        "other_scheme": lambda row: row.scheme != SCHEMES[0],
        "phases": _phases,  # s: times of single stages, by name
        "fractions": _fractions,  # the measures of the cup, by name
    }
    order = ("backend", "precision", "other_scheme", "particles")
    table = {
        "particles": "particles", "scheme": "scheme", "kernel": lambda row: f"{row.backend}, {row.kernel}",
        "precision": "precision", "frame, ms": lambda row: f"{1e3 * row.step:.4g}{'?' * row.incomplete}",
        "million / s": lambda row: f"{row.rate / 1e6:.4g}",
    }  # fmt: skip
    note = (
        "million / s: particles times substeps times iterations (of divergence-free both solves'), searches included; "
        "?: incomplete"
    )

    def work(self, scene: Scene) -> float:
        """Return particles x iterations per frame."""
        solves = 2 if scene.method.scheme == "divergence-free" else 1
        return count_of(scene) * scene.method.substeps * scene.method.iterations * solves

    def groups(self, backends: Sequence[str], quick: bool, precisions: Sequence[str]) -> list[list[Case]]:
        """Return the groups timed in turn: schemes and precisions of a pool on a backend, and of a cup that pours.

        `quick`: two small pools only.
        """
        all_groups = []
        for backend in backends:
            for count in QUICK if quick else (*POOLS, *(LARGE if backend == "gpu" else ())):
                variants = [(scheme, precision) for scheme in SCHEMES for precision in precisions]
                cases = [make_case(pool(count, one), backend, p, f"{count} particles, {one}") for one, p in variants]
                all_groups.append(cases)
            if not quick:
                all_groups.append([make_case(load_scene(POUR), backend, p, "a cup that pours") for p in precisions])
        return all_groups

    def _time(self, store: Store, summary: Summary, group: Sequence[Case], repeats: int) -> None:
        for case in group:
            numbers = poured(case) if case.scene.all_of("mesh_collider") else phase_times(case)
            experiment.store_measures(store, summary.run, case.description, case.sources, numbers)
        super()._time(store, summary, group, repeats)

    def show(self, console: Console, store: Store, machine: str) -> None:
        """Print tables of what was timed on a machine: frames, single stages, and a cup that poured."""
        super().show(console, store, machine)
        timed = self.rows(measures(store, machine=machine), every=True)
        stages: list[tuple[str, ...]] = []
        for p in (p for p in timed if p.phases):  # pools
            scene = pool(p.particles, p.scheme)
            neighbours = neighbours_at_rest(scene)
            for phase, taken in p.phases.items():
                moved, done = moved_bytes(phase, neighbours) * p.particles, operations(scene, phase) * p.particles
                least = max(moved / STREAM_H200, done / HALF_H200)
                stages.append((
                    str(p.particles), p.scheme, p.backend, phase, f"{1e6 * taken:.4g}", f"{1e9 * taken / p.particles:.3g}",
                    f"{moved / taken / 1e9:.3g}", f"{done / taken / 1e9:.3g}", f"{1e6 * least:.3g}",
                ))  # fmt: skip
        numbers = "us", "ns a particle", "GB / s", "Gflop / s", "least on an H200, us"
        heads = columns(("particles", "scheme", "backend", "stage alone"), numbers)
        limits = (
            "least: by 4.0 TB/s measured of memory or 31 TFLOP/s, half of its arithmetic, neighbours' positions cached"
        )
        print_table(console, heads, stages, limits)
        _print_poured(console, timed)


def _print_poured(console: Console, timed: Sequence[Row]) -> None:
    rows: list[tuple[str, ...]] = []
    for p in timed:
        for name, value in p.fractions.items():
            if name.startswith(IN_BASIN):
                at = name.removeprefix(f"{IN_BASIN}_").removesuffix("_s")
                cup = p.fractions[f"{IN_CUP}_{at}_s"]
                rows.append((p.backend, p.precision, at, f"{cup:.4f}", f"{value:.4f}", f"{1 - cup - value:.4f}"))
        if p.fractions:
            rows.append((p.backend, p.precision, "level over the volume's", "", f"{p.fractions[LEVEL]:.4f}", ""))
    if rows:
        heads = columns(("a cup that pours", "precision", "s"), ("in the cup", "in the basin", "elsewhere"))
        print_table(console, heads, rows, "shares of its particles: elsewhere is what falls, or left over a rim")
