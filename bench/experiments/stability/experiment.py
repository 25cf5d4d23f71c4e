"""Stability of each integrator: outcomes over step size, stiffness and damping, and the edge found by bisection.

The map: an 8 x 8 curtain (hung by its top row, gravity, a small perturbation) is run at every step size and stiffness,
and at every step size and damping, to one of the outcomes of bench/experiments/stability/runs.py. It is compared with
the analytic limit, which holds for any state of the grid; springs near their rest length have a larger limit.

The edges: of the same grid without rest lengths, where the equation is linear and the limit is sharp, and of a chain of
ten links, whose largest frequency is 2 sqrt(k/m) sin((2n-1) pi / (2 (2n+1))).

One opened simulation does all points of an integrator, backend and precision: the varied fields are live.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from softlab.app.driver import open_simulation
from softlab.bench.experiments.accuracy.methods import QUICK_FLOAT32
from softlab.bench.experiments.stability.points import (
    DAMPING,
    EDGE,
    LIMIT,
    OUTCOME,
    STEP,
    STIFFNESS,
    StabilitySummary,
    stability_of,
)
from softlab.bench.experiments.stability.runs import DIVERGED, LIVE, linear, measured_edge, outcome
from softlab.bench.measure import case_timing
from softlab.bench.measure.declaration import Choices, Experiment, Option
from softlab.bench.measure.experiment import Report, source_hash, store_measures
from softlab.bench.measure.gpu import gpu_simulated
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration, measures_of
from softlab.model.core.integrators import INTEGRATORS, damping_rate
from softlab.model.core.simulation import PRECISIONS, Simulation
from softlab.model.core.stability.limit import scene_frequency
from softlab.model.scene.scene import Scene, load_scene

MEANING = 1  # version of what is stored; raise it when the meaning of an outcome or an edge changes
ROWS = COLUMNS = 8
LINKS = 10
EDGE_WORTH = 20  # weight in the progress bar: an edge takes as long as that many points


@dataclass(frozen=True)
class Extent:
    """Values that are run.

    `steps` [s], `stiffnesses` [N/m], `dampings` [N s/m] of the map, those of the grid's edges, and the dampings of the
    chain's.
    """

    steps: tuple[float, ...]
    stiffnesses: tuple[float, ...]
    dampings: tuple[float, ...]
    edge_stiffnesses: tuple[float, ...]
    edge_dampings: tuple[float, ...]
    chain_dampings: tuple[float, ...] = (0.0, DAMPING)


def _decades(first: int, last: int, parts: int) -> tuple[float, ...]:
    """Return 10^first to 10^last, `parts` values per decade, to three digits (so that extents have equal numbers)."""
    return tuple(float(f"{10 ** (k / parts):.3g}") for k in range(first * parts, last * parts + 1))


QUICK = Extent(_decades(-3, -1, 2), (1.0, 10.0, 100.0, 1000.0), (0.0, 0.03, 0.3), (10.0, 1000.0), (0.3,))
FULL = Extent(
    _decades(-4, -1, 4), _decades(0, 3, 2), (0.0, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0), _decades(0, 3, 1),
    (0.0, 0.003, 0.1, 0.3, 1.0),
)  # fmt: skip


@dataclass(frozen=True)
class Case(case_timing.Case):
    """One point of the map, or (`edge`) one limit to search for."""

    edge: bool = False

    @property
    def done(self) -> str:
        """Name of the measure that a finished case has."""
        return EDGE if self.edge else OUTCOME

    @property
    def worth(self) -> int:
        return EDGE_WORTH if self.edge else 1

    @property
    def simulation_kind(self) -> tuple[object, ...]:
        """Key of the cases that share an opened simulation."""
        grid = self.scene.grid
        return self.backend, self.precision, self.scene.method.integrator, self.edge, grid.rows, grid.columns

    def __str__(self) -> str:
        return f"{self.scene.method.integrator} {self.precision} {self.backend}{' edge' if self.edge else ''}"

    def open(self) -> Simulation:
        """Open the simulation on one thread: the grid is tiny, and nothing is timed."""
        return open_simulation(
            self.scene, self.backend, threads=1, precision=self.precision, live=LIVE, allow_unstable=True
        )


def chain(damping: float) -> Scene:
    """Return ten links without rest length, hung at the top, free below: exactly linear."""
    return linear(
        Scene(
            {
                "grid": {"rows": LINKS + 1, "columns": 1, "pinned": "top"},
                "springs": {"stiffness": STIFFNESS, "rest_length": 0.0},
                "damping": {"coefficient": damping},
            },
            "chain",
        )
    )


def cases(extent: Extent, backends: Sequence[str], integrators: Sequence[str] | None = None) -> list[Case]:
    """Return the cases of each backend x precision x integrator (None: all), first the map, then the edges."""
    curtain = load_scene("lab-curtain").replace({"grid.rows": ROWS, "grid.columns": COLUMNS})
    rows = [(k, DAMPING) for k in extent.stiffnesses] + [(STIFFNESS, c) for c in extent.dampings if c != DAMPING]
    edges = [(k, DAMPING) for k in extent.edge_stiffnesses] + [(STIFFNESS, c) for c in extent.edge_dampings]
    selected = []
    for backend in backends:
        sources = f"{source_hash(backend)}-stability{MEANING}"
        for precision in PRECISIONS:
            for name in integrators or INTEGRATORS:
                if extent is QUICK and precision == "float32" and name not in QUICK_FLOAT32:
                    continue
                scenes = []
                for stiffness, damping in rows:
                    at = {"springs.stiffness": stiffness, "damping.coefficient": damping, "method.integrator": name}
                    scenes += [(curtain.replace(at | {"method.dt": dt}), False) for dt in extent.steps]
                nets = [linear(curtain.replace({"springs.stiffness": k, "damping.coefficient": c})) for k, c in edges]
                nets += [chain(c) for c in extent.chain_dampings]
                for net in nets:
                    scene = net.replace({"method.integrator": name})
                    if analytic(scene) > 0:  # otherwise it grows at every step size, and there is no edge
                        scenes.append((scene, True))
                for scene, edge in scenes:
                    threads = 1 if backend == "cpu" else None
                    description = configuration(scene, backend=backend, threads=threads, precision=precision)
                    selected.append(Case(scene, backend, description, sources, name, edge))
    return selected


def analytic(scene: Scene) -> float:
    """Return the limit [s] of a linear net at its own largest frequency."""
    return INTEGRATORS[scene.method.integrator].limit(scene_frequency(scene).estimate, damping_rate(scene))


class Stability(Experiment):
    """Measure the stability limit of every integrator over step size, stiffness and damping."""

    # The points of a quick run are part of the full set. Subsets of integrators are combined in the store.
    name = command = "stability"
    example = "softlab stability --quick   (softlab stability --integrator rk4)"
    quick_help = "A coarser map, fewer limits, less float32."
    on_workers, timed = True, False
    options = {"integrators": Option("--integrator", "Only this integrator. Repeatable.", values=tuple(INTEGRATORS))}
    summary = StabilitySummary

    def plan(self, store: Store, backends: Sequence[str], quick: bool, options: Choices) -> Sequence[Sequence[Case]]:
        """Return the cases of each opened simulation."""
        groups: dict[tuple[object, ...], list[Case]] = {}
        for case in cases(QUICK if quick else FULL, backends, options["integrators"]):
            groups.setdefault(case.simulation_kind, []).append(case)
        return list(groups.values())

    def is_stored(self, store: Store, machine: str, quick: bool, case: Case) -> bool:
        return store.has_measure(case.description, machine, case.sources, case.done)

    def measure(
        self, store: Store, summary: StabilitySummary, quick: bool, group: Sequence[Case], report: Report
    ) -> None:
        """Run the cases of one opened simulation, each stored when it is done."""
        with ExitStack() as stack:
            report(f"{group[0]}: opening", 0)
            simulation = stack.enter_context(group[0].open())
            for case in group:
                report(str(case), 0)
                numbers = _edge_numbers(simulation, case) if case.edge else _map_numbers(simulation, case)
                store_measures(store, summary.run, case.description, case.sources, numbers)
                summary.measured += 1
                report(str(case), case.worth)

    def finish(
        self, store: Store, summary: StabilitySummary, cases: Sequence[Case], options: Choices, progress: bool
    ) -> None:
        stored = measures_of(store, summary.machine, (one.description for one in cases))
        summary.points, summary.edges = stability_of(stored)


run_stability = Stability()


Numbers = dict[str, tuple[float, str, str | None]]


def _map_numbers(simulation: Simulation, case: Case) -> Numbers:
    springs, damping = case.scene.springs, case.scene.damping
    assert springs is not None and damping is not None
    result = outcome(simulation, case.scene.method.dt, springs.stiffness, damping.coefficient)
    numbers: Numbers = {}
    if result.code == DIVERGED and result.step is not None:
        numbers[STEP] = (result.step, "", None)
    # stored last, so that a case with an outcome is complete
    numbers[OUTCOME] = (result.code, "", _marked(case, result.note))
    return numbers


def _edge_numbers(simulation: Simulation, case: Case) -> Numbers:
    simulation.reset()
    for path in ("springs.stiffness", "damping.coefficient"):
        part, _, field = path.partition(".")
        simulation.set(path, getattr(case.scene.parts[part], field))
    limit = analytic(case.scene)
    edge = measured_edge(simulation)
    return {LIMIT: (limit, "s", "at the net's largest frequency"), EDGE: (edge, "s", _marked(case, "by bisection"))}


def _marked(case: Case, note: str) -> str:
    return f"{note}; CUDA simulator, no GPU" if case.backend == "gpu" and gpu_simulated() else note
