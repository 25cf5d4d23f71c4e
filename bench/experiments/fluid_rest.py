"""Stillness of water at rest over a minute: `softlab fluids --rest`.

Two scenes, at several spacings, viscosities and substeps, by every scheme: a tank, and a box that repeats, which the water
fills and whose particles are off their lattice by DISTURBANCE. `--peers` adds DFSPH of SPlisHSPlasH in the same tank, without
viscosity, with its own steps. Stored are the largest gain of energy and the largest rms speed in each span of time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from softlab.bench.experiments.fluid_truth.experiment import BESIDE, BESIDE_PEERS, FINDING, LABELS, Run, opened
from softlab.bench.experiments.fluid_truth.scenes import SCHEMES, Setting
from softlab.bench.experiments.fluids import FRAME
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.declaration import Option
from softlab.bench.measure.experiment import source_hash
from softlab.bench.measure.items import Finding, Items
from softlab.bench.measure.tables import columns, print_table
from softlab.bench.store.database import Store
from softlab.bench.store.results import Measure, by_configuration, measures
from softlab.model.base.components import component
from softlab.model.base.digest import source_digest
from softlab.model.base.errors import BackendUnavailable, SoftlabError
from softlab.model.base.table import Table
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene
from softlab.model.tables.parts import Gravity

TANK, BOX = "still tank", "repeating box"
SPACINGS = (0.05, 0.1, 1 / 30)  # m; the first one without viscosity is watched for the whole minute
VISCOSITIES = (0.0, 1.0, 10.0)  # Pa s
SUBSTEPS = (1, 2, 4, 8, 16)  # of a step of FRAME
ITERATIONS = 10
SIDE, DEPTH = 0.4, 0.5  # m, of the tank
ACROSS = 6  # particles along a side of the box: three supports at least
DISTURBANCE = 1e-6  # m, of every coordinate of the box at most
TIMES = (0.5, 1, 2, 4, 6, 8, 10, 15, 20, 30, 40, 50, 60)  # s: the ends of the spans
SHORT, WHOLE = 10, 60  # s
SAMPLE = 15  # steps from one state that is looked at to the next: a quarter of a second
SETTLED = 6  # s, after which water must be still
ENERGY, SPEED = "fluid_rest_energy_until_", "fluid_rest_speed_until_"  # measures, before the end of a span [s]
ENERGY_BOUND, SPEED_BOUND = 1e-3, 0.02  # of g H above the start; of sqrt(g H)
GRAVITY = Gravity().acceleration  # m/s^2
PEER = LABELS["splishsplash_dfsph"]


# ---------------------------------------------------------------------- scenes


def still_tank(scheme: str, substeps: int, spacing: float = SPACINGS[0], viscosity: float = 0.0) -> Scene:
    """Return water between a floor and four walls, on its lattice."""
    walls: Table = {
        name: {"kind": "plane", "thickness": 0.0, "normal": normal, "point": [SIDE * (x < 0) for x in normal]}
        for name, normal in {
            "floor": [0.0, 1.0, 0.0], "left": [1.0, 0.0, 0.0], "right": [-1.0, 0.0, 0.0], "back": [0.0, 0.0, 1.0],
            "front": [0.0, 0.0, -1.0],
        }.items()
    }  # fmt: skip
    water = {"kind": "fluid", "size": [SIDE, DEPTH, SIDE], "rest_distance": spacing, "viscosity": viscosity}
    return Scene({"water": water, **walls, "gravity": {}, "method": _method(scheme, substeps)}, TANK)


def repeating_box(scheme: str, substeps: int, spacing: float = SPACINGS[0], viscosity: float = 0.0) -> Scene:
    """Return water without weight that fills a box whose sides repeat, on its lattice."""
    size = [ACROSS * spacing] * 3
    water = {"kind": "fluid", "size": size, "rest_distance": spacing, "viscosity": viscosity}
    box = {"size": size, "repeats": ["x", "y", "z"]}
    return Scene({"water": water, "domain": box, "method": _method(scheme, substeps)}, BOX)


def _method(scheme: str, substeps: int) -> Table:
    return {"solver": "pbf", "dt": FRAME, "scheme": scheme, "substeps": substeps, "iterations": ITERATIONS}


SCENES = {TANK: still_tank, BOX: repeating_box}


# ---------------------------------------------------------------------- what is measured


def energy(position: np.ndarray, velocity: np.ndarray, gravity: float = GRAVITY) -> float:
    """Return kinetic and potential energy of (particles, 3) arrays [m], [m/s], per mass and over g H of the tank."""
    squares = (np.asarray(velocity, np.float64) ** 2).sum(axis=1)
    height = np.asarray(position, np.float64)[:, 1]
    return float((squares / 2 + gravity * height).mean() / (GRAVITY * DEPTH))


def rms(velocity: np.ndarray) -> float:
    """Return the rms speed of a (particles, 3) array [m/s] over sqrt(g H) of the tank."""
    return float(np.sqrt((np.asarray(velocity, np.float64) ** 2).sum(axis=1).mean() / (GRAVITY * DEPTH)))


def disturb(simulation: Simulation, distance: float) -> None:
    """Move every coordinate of a simulation by up to `distance` [m], the same way each time."""
    start = simulation.state()
    shifts = np.random.default_rng(1).uniform(-distance, distance, start.position.shape)
    simulation.load(replace(start, position=(start.position + shifts).astype(start.position.dtype)))


def watched(simulation: Simulation, gravity: float, seconds: float) -> Measures:
    """Advance a simulation by `seconds`; return the largest gain of energy and rms speed of each span of TIMES."""
    begin = energy(simulation.read("position"), simulation.read("velocity"), gravity)
    numbers: Measures = {}
    samples = 0
    for end in (time for time in TIMES if time <= seconds):
        gains, speeds = [], []
        while (samples + 0.5) * SAMPLE * FRAME < end:
            simulation.advance(SAMPLE)
            samples += 1
            velocity = simulation.read("velocity")
            gains.append(energy(simulation.read("position"), velocity, gravity) - begin)
            speeds.append(rms(velocity))
        numbers |= {f"{ENERGY}{end:g}": (max(gains), "", None), f"{SPEED}{end:g}": (max(speeds), "", None)}
    return numbers


def _measured(run: Run, seconds: float) -> Measures:
    scene = run.setting.scene
    try:
        with ExitStack() as stack:
            simulation = stack.enter_context(opened(run, stack))
            if run.setting.kind == BOX:
                disturb(simulation, DISTURBANCE)
            numbers = watched(simulation, scene.gravity.acceleration if scene.gravity else 0.0, seconds)
            version = None if run.peer is None else run.peer.available()[1]
            return {name: (value, unit, version) for name, (value, unit, _) in numbers.items()}
    except SoftlabError as reason:  # diverged; its process ended
        return {f"{SPEED}{seconds:g}": (None, "", str(reason))}


def settings(quick: bool) -> Iterator[tuple[Setting, float]]:
    """Yield the settings with their duration [s]: the first spacing without viscosity, then all others, fastest first;
    `quick`: only the former, shorter."""
    every = [(spacing, viscosity) for spacing in SPACINGS for viscosity in VISCOSITIES]
    others = sorted(every[1:], key=lambda one: -one[0])
    for spacing, viscosity in every[:1] if quick else [*every[:1], *others]:
        seconds = WHOLE if (spacing, viscosity) == every[0] and not quick else SHORT
        for kind, make in SCENES.items():
            for scheme in SCHEMES:
                for substeps in SUBSTEPS:
                    beside = (kind, scheme, substeps, viscosity) == (TANK, SCHEMES[0], SUBSTEPS[0], 0.0)
                    yield Setting(kind, make(scheme, substeps, spacing, viscosity), beside), seconds


def experiments(store: Store, backends: Sequence[str], quick: bool, peers: bool = False) -> list[Finding]:
    """Return an experiment for each setting, the peer's last, on one thread: no state depends on how many there are.

    Raises BackendUnavailable for a peer that is not here."""
    peer = component(f"{BESIDE}:peer_of", "--peers")("DFSPH") if peers else None
    if peer is not None and not peer.available()[0]:
        missing, _, remedy = peer.available()[1].partition("; ")
        raise BackendUnavailable(missing, remedy)
    all_experiments = []
    for backend in backends:
        sources = f"{source_hash(backend)}-{source_digest(Path(__file__))}"
        every = list(settings(quick))
        runs = [(Run(setting, backend, threads=1), seconds) for setting, seconds in every]
        if peer is not None and peer.backend == backend:
            runs += [(Run(one, backend, peer, threads=1), seconds) for one, seconds in every if one.beside]
        for run, seconds in runs:
            scene = run.setting.scene
            worth = scene.fluid_set.particle_count * scene.method.substeps * round(seconds)
            measure = partial(_measured, run, seconds)
            all_experiments.append(Finding(f"{SPEED}{seconds:g}", run.description, sources, measure, worth))
    return all_experiments


# ---------------------------------------------------------------------- results


@dataclass(frozen=True)
class Still:
    """One setting: `who`: a scheme, or the peer's label; `energy`, `speed`: the maximum in each span, by its end [s],
    over g H and sqrt(g H); `note`: the peer's version, or why there is no result."""

    kind: str
    machine: str
    backend: str
    who: str
    peer: bool
    substeps: int
    spacing: float
    viscosity: float
    energy: dict[float, float]
    speed: dict[float, float]
    note: str | None

    @property
    def gain(self) -> float:
        """The largest gain of energy, over g H."""
        return max(self.energy.values())

    @property
    def late(self) -> float:
        """The largest rms speed from SETTLED on, over sqrt(g H)."""
        return max(value for end, value in self.speed.items() if end > SETTLED)

    @property
    def rests(self) -> bool:
        """True if no energy came from nowhere and the water was still from SETTLED on."""
        return bool(self.speed) and self.gain <= ENERGY_BOUND and self.late <= SPEED_BOUND


def rows(stored: Iterable[Measure]) -> list[Still]:
    """Return every setting that was watched: kinds, spacings, viscosities, peers last, schemes, substeps in order."""
    result = []
    kinds = {FINDING + kind: kind for kind in SCENES}
    for numbers in by_configuration(m for m in stored if m.description.get("finding") in kinds):
        some = next(iter(numbers.values()))
        scene, peer = Scene.stored(some.description["scene"]), some.description.get("peer")
        (water,) = scene.fluids.values()
        spans = {
            start: {float(name.removeprefix(start)): m.value for name, m in numbers.items() if name.startswith(start)}
            for start in (ENERGY, SPEED)
        }
        ordered = {start: {k: v for k, v in sorted(of.items()) if v is not None} for start, of in spans.items()}
        result.append(Still(
            kinds[some.description["finding"]], some.machine, some.description["backend"],
            PEER if peer else scene.method.scheme, bool(peer), scene.method.substeps, water.rest_distance,
            water.viscosity, ordered[ENERGY], ordered[SPEED], some.reason,
        ))  # fmt: skip
    order, whos = list(SCENES), [*SCHEMES, PEER]
    return sorted(
        result, key=lambda r: (order.index(r.kind), r.backend, -r.spacing, r.viscosity, whos.index(r.who), r.substeps)
    )


def print_rest(console: Console, store: Store, machine: str) -> None:
    """Print a table of each scene that was watched on a machine."""
    still = rows(measures(store, machine=machine))
    for kind in SCENES:
        lines = [
            (
                r.who, r.backend, "its own" if r.peer else str(r.substeps), f"{100 * r.spacing:g}", f"{r.viscosity:g}",
                f"{max(r.speed):g}", f"{1e3 * r.gain:.2g}", f"{100 * r.late:.2g}", "yes" if r.rests else "no",
            )
            for r in still
            if r.kind == kind and r.speed
        ]  # fmt: skip
        if lines:
            heads = columns(
                ("by", "on", "substeps"),
                ("d / cm", "viscosity / Pa s", "s", "energy gained / 1e-3 g H", f"rms speed after {SETTLED} s / %", "rests"),
            )  # fmt: skip
            below = f"rests: at most {1e3 * ENERGY_BOUND:g} and {100 * SPEED_BOUND:g}; speeds over sqrt(g H), H = {DEPTH:g} m"
            print_table(console, heads, lines, below, title=kind)
    for note in dict.fromkeys(f"{r.who}: {r.note}" for r in still if r.note):
        console.print(note, highlight=False, soft_wrap=True)


class FluidRest(Items):
    """Measure how still water at rest stays."""

    name, command, doing = "fluids: rest", "fluids", "watching: "
    switch = Option(
        "--rest", "Measure energy and rms speed of water at rest over 60 s (--quick: one spacing, 10 s) instead.", bool
    )
    options = {"peers": BESIDE_PEERS}
    items = staticmethod(experiments)
    show = staticmethod(print_rest)
