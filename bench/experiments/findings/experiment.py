"""Small experiments behind single sentences of the lab book; each takes seconds, is stored and resumable.

They measure the effect of an explicit damper on velocity Verlet, the resolution of float32, the amplitude that a step
gains or loses by itself, and the cost of `exact` math. Each measure is of one configuration, with the usual description
plus the field `finding` (and the varied quantity). The orders of the integrators and the equation that the hand-out's
step solves come from the runs of bench/experiments/accuracy/experiment.py.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments import discretisation
from softlab.bench.experiments.accuracy.cases import STEP_SIZES
from softlab.bench.experiments.accuracy.judge import distance
from softlab.bench.experiments.accuracy.points import END, SCENES
from softlab.bench.experiments.accuracy.references import references
from softlab.bench.measure.case_timing import Case, StepTimes
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.declaration import WITH_FINDINGS
from softlab.bench.measure.experiment import described, source_hash
from softlab.bench.measure.items import Finding, Item, Items
from softlab.bench.reference import cache
from softlab.bench.reference import mass_spring as reference
from softlab.bench.store.database import Store
from softlab.model.base.digest import source_digest
from softlab.model.base.errors import Diverged
from softlab.model.core.build import build
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.simulation import PRECISIONS, State
from softlab.model.scene.scene import Scene, load_scene

VERSION = 1  # part of every resume key: raise it when an experiment changes
DAMPING, FLOOR, AWAY, DISSIPATION, EXACT = "damping", "floor", "far away", "dissipation", "exact"  # values of `finding`
ERROR = "finding_error"  # spacings; of DAMPING, FLOOR and AWAY
RATE = "finding_rate"  # 1/s; of DISSIPATION
DAMPERS = ("velocity-verlet", reference.EXPLICIT_DAMPING_VERLET)
FLOOR_METHODS = ("velocity-verlet", "rk4")
FLOOR_STEPS = tuple(0.02 / 2**k for k in range(8))  # s
OFFSETS = (0.0, 1e3, 1e4, 1e5)  # m
AWAY_METHODS = ("lab", "velocity-verlet")
AWAY_STEPS, AWAY_DT = 100, 0.01  # s
RATE_STEPS = tuple(0.02 / 2**k for k in range(5))  # s
RATE_COUNT = 64  # steps over which an amplitude is followed
RATE_OPTIONS: dict[str, Any] = {"precision": "float64", "math": "exact", "kernel": "stages"}
EXACT_SIZES = (32, 256, 1024)
EXACT_METHOD = "velocity-verlet"


def items(store: Store, backends: Sequence[str], quick: bool) -> list[Item]:
    """Return all experiments; `quick`: `exact` math is not timed at the largest size, and with fewer repeats."""
    all_items: list[Item] = [*_damping(store), *(e for backend in backends for e in _experiments(store, backend))]
    return all_items + [StepTimes(EXACT, pair, quick) for backend in backends for pair in exact_pairs(backend, quick)]


class Findings(Items):
    """Run the small experiments behind single sentences of the lab book."""

    name, command, doing = "findings", "accuracy", "finding: "
    in_lab, on_workers, extra = True, True, WITH_FINDINGS
    items = staticmethod(items)


def _sources(backend: str | None) -> str:
    judge = source_digest(Path(cache.__file__).parent)
    return f"{judge if backend is None else f'{source_hash(backend)}-{judge}'}-f{VERSION}"


def _experiments(store: Store, backend: str) -> list[Finding]:
    return [*_floor(store, backend), *_far_away(backend), *_dissipation(backend), *discretisation.experiments(backend)]


def _finding(
    name: str,
    finding: str,
    scene: Scene,
    backend: str | None,
    measure: Callable[[], Measures],
    fields: Mapping[str, object],
) -> Finding:
    """Return an experiment that varies these `fields`; `backend` None: it uses the reference alone."""
    return Finding(name, described(scene, backend or "reference", finding, **fields), _sources(backend), measure)


# ---------------------------------------------------------------------- effect of an explicit damper


def _damping(store: Store) -> list[Finding]:
    """Return runs of S2 in NumPy: velocity Verlet with the damper implicit in the second half kick, and with it
    explicit.
    """
    base, experiments = load_scene(SCENES["S2"]), []
    for method, dt in product(DAMPERS, STEP_SIZES[::2]):
        scene = base.replace({"method.integrator": "velocity-verlet", "method.dt": dt})
        measure = partial(_damped_error, store, scene, method)
        experiments.append(_finding(ERROR, DAMPING, scene, None, measure, {"precision": "float64", "scheme": method}))
    return experiments


def _damped_error(store: Store, scene: Scene, method: str) -> Measures:
    right = cache.cached_reference(scene, END, references(store))
    position, _ = reference.simulate(scene, round(END / scene.method.dt), integrator=method)
    return {ERROR: (_error(scene, position, right.position), "spacing", "NumPy reference")}


def _error(scene: Scene, position: np.ndarray, right: np.ndarray) -> float:
    free = ~reference.pinned_mask(scene).reshape(-1)
    return distance(position, right, free, scene.grid.spacing)[0]


# ---------------------------------------------------------------------- resolution of float32


def _floor(store: Store, backend: str) -> list[Finding]:
    """Return runs of S1 at decreasing steps, in both precisions."""
    base, experiments = load_scene(SCENES["S1"]), []
    for precision, method, dt in product(PRECISIONS, FLOOR_METHODS, FLOOR_STEPS):
        scene = base.replace({"method.integrator": method, "method.dt": dt})
        measure = partial(_floor_error, store, scene, backend, precision)
        experiments.append(_finding(ERROR, FLOOR, scene, backend, measure, {"precision": precision}))
    return experiments


def _floor_error(store: Store, scene: Scene, backend: str, precision: str) -> Measures:
    right = cache.cached_reference(scene, END, references(store))
    state = _end(scene, backend, round(END / scene.method.dt), precision, allow_unstable=True)
    error = np.inf if state is None else _error(scene, state.position, right.position)
    return {ERROR: (error, "spacing", None if state else "diverged")}


def _end(
    scene: Scene, backend: str, steps: int, precision: str, initial: State | None = None, allow_unstable: bool = False
) -> State | None:
    """Return the state after `steps`, or None if it diverged."""
    with open_simulation(
        scene, backend, precision=precision, initial=initial, allow_unstable=allow_unstable
    ) as simulation:
        try:
            simulation.advance(steps)
            return simulation.state()
        except Diverged:
            return None


def _far_away(backend: str) -> list[Finding]:
    """Return the runs of B14: a ten-link chain released far from the origin, float32, against itself at the origin in
    float64.
    """
    base = load_scene("lab-grid").replace({"grid.rows": 11, "grid.columns": 1, "grid.pinned": "top"})
    experiments = []
    for method, offset in product(AWAY_METHODS, OFFSETS):
        scene = base.replace({"method.integrator": method, "method.dt": AWAY_DT})
        measure = partial(_away_error, scene, backend, offset)
        experiments.append(_finding(ERROR, AWAY, scene, backend, measure, {"offset": offset}))
    return experiments


def _away_error(scene: Scene, backend: str, offset: float) -> Measures:
    begin = reference.rest(scene).astype(np.float64).reshape(-1, 2)
    exact, _ = reference.simulate(scene, AWAY_STEPS, begin, np.zeros_like(begin))
    shift = np.array([0.0, offset])
    initial = State(begin + shift, np.zeros_like(begin), build(scene).inverse_mass, 0.0, 0)
    state = _end(scene, backend, AWAY_STEPS, "float32", initial)
    assert state is not None
    largest = float(np.abs(state.position.astype(np.float64) - shift - exact).max())
    return {ERROR: (largest / scene.grid.spacing, "spacing", "largest over masses and axes")}


# ---------------------------------------------------------------------- damping of the step itself


def oscillator(method: str, dt: float) -> Scene:
    """Return scene A3: a mass on one undamped spring without rest length, exactly linear with w = sqrt(k/m)."""
    return Scene(
        {
            "grid": {"rows": 2, "columns": 1, "pinned": "top"},
            "springs": {"rest_length": 0.0},
            "method": {"integrator": method, "dt": dt},
        }
    )


def amplitude_rate(positions: np.ndarray, dt: float) -> float:
    """Return the rate [1/s] at which the amplitude of x (samples,), one per step, falls (negative: grows).

    A linear step obeys x'' = s x' - d x exactly, d the squared modulus of its eigenvalues (Prony 1795). s and d are
    fitted by least squares over all steps, each weighted by the inverse of its size.
    """
    now, last, following = positions[1:-1], positions[:-2], positions[2:]
    weight = 1 / np.hypot(now, last)
    matrix = np.stack([now, -last], axis=1) * weight[:, None]
    (_, d), *_ = np.linalg.lstsq(matrix, following * weight, rcond=None)
    return float(-np.log(d) / (2 * dt))


def _dissipation(backend: str) -> list[Finding]:
    """Return one undamped oscillator for every integrator: the rate at which its amplitude changes."""
    return [
        _finding(RATE, DISSIPATION, scene, backend, partial(_rate, scene, backend), RATE_OPTIONS)
        for scene in (oscillator(method, dt) for method, dt in product(INTEGRATORS, RATE_STEPS))
    ]


def _rate(scene: Scene, backend: str) -> Measures:
    begin = np.array([[0.0, 0.0], [0.1, 0.0]])
    initial = State(begin, np.zeros_like(begin), build(scene).inverse_mass, 0.0, 0)
    positions = [0.1]
    with open_simulation(scene, backend, initial=initial, allow_unstable=True, **RATE_OPTIONS) as simulation:
        for _ in range(RATE_COUNT):
            simulation.advance(1)
            positions.append(float(simulation.read("position")[1, 0]))
    return {RATE: (amplitude_rate(np.array(positions), scene.method.dt), "1/s", f"{RATE_COUNT} steps")}


# ---------------------------------------------------------------------- cost of exact math


def exact_pairs(backend: str, quick: bool) -> list[list[Case]]:
    """Return S1 with EXACT_METHOD at several sizes, in `fast` and in `exact` math and both precisions, timed in turn."""
    base, pairs = load_scene(SCENES["S1"]).replace({"method.integrator": EXACT_METHOD}), []
    for n in EXACT_SIZES[:-1] if quick else EXACT_SIZES:
        scene = base.replace({"grid.rows": n, "grid.columns": n})
        descriptions = [
            described(scene, backend, EXACT, precision=precision, math=math)
            for precision, math in product(PRECISIONS, ("fast", "exact"))
        ]
        pairs.append([Case(scene, backend, description, _sources(backend), EXACT) for description in descriptions])
    return pairs
