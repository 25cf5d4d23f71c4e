"""Stores of made-up measurements for the tests of figures and lab book: shapes of real ones, numbers of none.

Times follow simple laws (a launch or region cost, plus bytes over bandwidth) with a fixed wobble, so that every claim
that the lab book may make can be made to hold, to fail, or to be drowned in spread.
"""

from collections.abc import Callable, Iterable
from itertools import product
from pathlib import Path

import numpy as np

from softlab.bench.experiments.accuracy.experiment import STAGE
from softlab.bench.experiments.accuracy.judgement import ERROR, GROWTH, HALF, UNRESOLVED
from softlab.bench.experiments.accuracy.points import COPY, COST
from softlab.bench.experiments.findings import experiment as findings
from softlab.bench.experiments.findings import steady
from softlab.bench.experiments.stability.experiment import analytic, chain
from softlab.bench.experiments.stability.points import EDGE, LIMIT, OUTCOME, STEP
from softlab.bench.experiments.stability.runs import linear
from softlab.bench.measure.case_timing import FINDINGS
from softlab.bench.measure.costs_timing import QUICKEST
from softlab.bench.peers.registry import OURS, PEERS
from softlab.bench.peers.scenes import SCENES
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration
from softlab.bench.stress.bodies import OFF_LAW, OFF_NEWTON, OUT_OF_SHAPE, PARTING, SPIN_FRACTION
from softlab.bench.stress.body_cases import BODY_CASES
from softlab.bench.stress.piles import BORNE, DEPTH, LOWERED, RATIO, SINKING
from softlab.bench.stress.results import CHECK, CODES, SHAPE, VERDICT
from softlab.bench.stress.shapes import bodies_as_text
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene, load_scene

SIZES = (16, 32, 64, 128, 256, 512)
STEPS = (0.02, 0.01, 0.005, 0.0025)
CPU_RECORD = {
    "cpu": "Made-up CPU", "cores": 2, "caches": {"L1d": 32768, "L2": 1048576, "L3": 33554432}, "memory_gib": 8,
    "system": "Linux", "python": "3.11", "python_build": "CPython 3.11.7", "numba": "0.68.1", "llvmlite": "0.50.0",
    "numpy": "2.4.6", "numba_cuda": None, "gpu": None, "gpu_driver": None, "copy_bandwidth": 2e10,
    "gpu_copy_bandwidth": None, "gpu_launch_seconds": None, "threading_layer": "omp", "wait_policy": "passive",
    "region_seconds": {"1": 8e-7, "2": 1.5e-6, "4": 1.8e-5, "8": 4.3e-5},
    "region_policies": {
        "active": {"1": 8e-7, "2": 1.5e-6, "4": 1.8e-5, "8": 1.6e-4},
        "passive": {"1": 8e-7, "2": 2e-5, "4": 3e-5, "8": 4.3e-5},
    },
    "arithmetic": {"float32": 2e11, "float64": 1e11}, "gpu_arithmetic": None,
}  # fmt: skip
GPU_RECORD = CPU_RECORD | {
    "cores": 16, "numba_cuda": "0.30.4", "gpu": "Made-up GPU", "gpu_count": 1, "gpu_memory_gib": 80,
    "gpu_driver": "580.1", "gpu_copy_bandwidth": 4e12, "gpu_launch_seconds": 9e-6, "copy_bandwidth": 2e11,
    "region_seconds": {"1": 8e-7, "16": 5e-6, "32": 1e-4, "64": 2e-4},
    "region_policies": {"active": {"16": 5e-6, "64": 2e-4}, "passive": {"16": 5e-5, "64": 9e-5}},
    "gpu_arithmetic": {"float32": 6e13, "float64": 3e13},
}  # fmt: skip


def cpu_seconds(record: dict, threads: int, masses: int, precision: str) -> float:
    """A region's cost, and the bytes of a step at 1.5 times the copy bandwidth."""
    item = 8 if precision == "float64" else 4
    return record["region_seconds"][str(threads)] + 8 * item * masses / (1.5 * record["copy_bandwidth"])


def gpu_seconds(record: dict, masses: int, precision: str) -> float:
    """A launch inside a graph, and the bytes of a step at 0.8 times the copy bandwidth."""
    item = 8 if precision == "float64" else 4
    return 2e-6 + 8 * item * masses / (0.8 * record["gpu_copy_bandwidth"])


KERNELS = {  # backend -> kernel -> (seconds a step by itself, share of the copy bandwidth, most masses)
    "cpu": {
        "stages": (2e-4, 0.2, 2**20), "fused": (1.5e-6, 0.8, 2**30), "tiled": (4e-6, 1.6, 2**30),
        "team": (8e-7, 0.8, 2**14),
    },
    "gpu": {
        "stages": (2e-4, 0.2, 2**30), "launch": (3.5e-5, 0.8, 2**30), "graph": (1.3e-6, 0.8, 2**30),
        "one-block": (5e-7, 4.0, 1024), "resident": (7e-7, 4.0, 2**18), "tiles": (2e-6, 1.7, 2**30),
    },
}  # fmt: skip
WATTS = 400.0


def kernel_seconds(record: dict, backend: str, kernel: str, masses: int, precision: str) -> float:
    """A cost per step, and the bytes of one step per pass at a share of the copy bandwidth."""
    alone, share, _ = KERNELS[backend][kernel]
    item = 8 if precision == "float64" else 4
    bandwidth = record["gpu_copy_bandwidth" if backend == "gpu" else "copy_bandwidth"]
    return alone + 8 * item * masses / (share * bandwidth)


class Maker:
    """Fills one store with what one machine might have measured."""

    def __init__(self, store: Store, record: dict, key: str, wobble: float = 0.02):
        self.store, self.record, self.wobble = store, record, wobble
        label = f"{record['cpu']}, {record['cores']} cores; {record['gpu'] or 'no GPU'}"
        store.add_machine(key, label, record)
        self.run = store.start_run(key, "softlab sweep", "abc123def456")
        self.sources = "sources"

    def timing(
        self, shape: tuple[int, int], seconds: float, *, suspect: str | None = None, error: float = 1e-5,
        of: Scene | None = None, **how,
    ):  # fmt: skip
        """Three repeats of a configuration (of the hand-out's grid, or `of` a scene), with its error."""
        rows, columns = shape
        scene = of or load_scene("lab-grid").replace({"grid.rows": rows, "grid.columns": columns})
        description = configuration(scene, **how)
        for factor in (1, 1 + self.wobble, 1 - self.wobble):
            self.store.add_sample(self.run, description, self.sources, 1000 * factor * seconds, 1000, suspect=suspect)
        self.store.add_measure(self.run, description, self.sources, "error", error, "spacing", "made up")
        return description

    def sweep(self, sizes: Iterable[int] = SIZES, law: Callable = cpu_seconds, *, graphics: bool = True) -> None:
        """Squares, and a 1:4, a 4:1 and an odd grid, of every backend that the record has."""
        shapes = [(n, n) for n in sizes] + [(32, 128), (128, 32), (100, 100)]
        cores = self.record["cores"]
        for precision in ("float32", "float64"):
            for shape in shapes:
                masses = shape[0] * shape[1]
                for drawn in (False, True) if graphics else (False,):
                    picture = 2e-4 + 4e-9 * masses if drawn else 0.0
                    for threads in (cores, 2 * cores, 4 * cores):
                        seconds = law(self.record, threads, masses, precision) + picture
                        how = {"backend": "cpu", "threads": threads, "layer": "omp", "wait_policy": "passive"}
                        self.timing(shape, seconds, precision=precision, graphics=drawn, **how)
                    if self.record["gpu"]:
                        seconds = gpu_seconds(self.record, masses, precision) + picture
                        self.timing(shape, seconds, precision=precision, graphics=drawn, backend="gpu")

    def ladder(self, sizes: Iterable[int] = SIZES, *, joules: bool = True) -> None:
        """Every kernel at square sizes: times, the backend's own choice (the fastest), and the GPU's joules; starts."""
        cores = self.record["cores"]
        for backend in ("cpu", "gpu") if self.record["gpu"] else ("cpu",):
            host = {"layer": "omp", "wait_policy": "passive"} if backend == "cpu" else {}
            for n, precision in ((n, p) for n in sizes for p in ("float32", "float64")):
                able = [name for name, (_, _, most) in KERNELS[backend].items() if n * n <= most]
                seconds = {name: kernel_seconds(self.record, backend, name, n * n, precision) for name in able}
                for name in able:
                    threads = {"threads": cores} if backend == "cpu" else {}
                    made = self.timing(
                        (n, n), seconds[name], backend=backend, kernel=name, precision=precision, **host, **threads
                    )
                    chosen = float(seconds[name] == min(seconds.values()))
                    self.store.add_measure(self.run, made, "sources", "default", chosen, "", "made up")
                    if joules and backend == "gpu" and precision == "float32":
                        steps = round(0.5 / seconds[name])
                        took = steps * seconds[name]
                        self.store.add_sample(
                            self.run, made, "sources", took, steps, stage="energy", joules=WATTS * took
                        )
                    if backend == "cpu" and precision == "float32" and n <= 128 and name != "stages":
                        for factor in (2, 4):
                            cost = self.record["region_seconds"][str(factor * cores)]
                            slow = cost if name != "team" else cost / 10
                            self.timing((n, n), seconds[name] + slow, backend=backend, kernel=name,
                                        threads=factor * cores, **host)  # fmt: skip
            threads = {"threads": cores} if backend == "cpu" else {}
            start = configuration(load_scene("lab-grid"), backend=backend, **host, **threads)
            for name, value in (("start_seconds_cold", 4.3), ("start_seconds_warm", 1.1)):
                self.store.add_measure(self.run, start, "sources", name, value, "s", "made up")

    def beside(self, sizes: Iterable[int] = SIZES) -> None:
        """The lab and every peer of its backends on squares of the grid and of cloth, in one run: each peer twice as slow as
        the one before."""
        backends = ("cpu", "gpu") if self.record["gpu"] else ("cpu",)
        for backend, word in product(backends, ("grid", "cloth")):
            threads = {"threads": self.record["cores"], "wait_policy": "passive"} if backend == "cpu" else {}
            known = [peer for peer in PEERS if peer.backend == backend and word in peer.scenes]
            peers = [OURS, *(peer.name for peer in known)]
            for n in sizes:
                kernel = "fused" if backend == "cpu" else "graph"
                seconds = kernel_seconds(self.record, backend, kernel, n * n, "float32")
                scene = SCENES[word].make(n, n)
                for k, peer in enumerate(peers):
                    self.timing((n, n), 2**k * seconds, of=scene, backend=backend, peer=peer, **threads)

    def accuracy(self) -> None:
        """Both scenes, four integrators and one that diverges, at four step sizes."""
        laws = {  # error at 10 ms, order, force evaluations
            "lab": (0.3, 0, 1), "semi-implicit-euler": (1e-2, 1, 1),
            "velocity-verlet": (5e-4, 2, 1), "rk4": (2e-5, 4, 4),
        }  # fmt: skip
        backends = ["cpu", *(["gpu"] if self.record["gpu"] else [])]
        for scene_name in ("lab-curtain", "lab-hammock"):
            for precision, floor in (("float32", 5e-5), ("float64", 0.0)):
                for backend in backends:
                    for integrator, (error, order, forces) in laws.items():
                        for dt in STEPS:
                            reached = max(error * (dt / 0.01) ** order, floor)
                            cost = forces * (2e-5 if backend == "cpu" else 2e-6) / dt
                            half = error / 20 * dt / 0.01 if integrator == "lab" else None
                            self.point(scene_name, integrator, dt, reached, cost, half, precision, backend)
                    for dt in STEPS:
                        self.point(scene_name, "explicit-euler", dt, float("inf"), 2e-5 / dt, None, precision, backend)

    def stability(self) -> None:
        """A coarse map, where what is over 1.2 times its limit diverges, and edges a thousandth under the analytic one."""
        curtain = load_scene("lab-curtain").replace({"grid.rows": 8, "grid.columns": 8})
        for backend in ["cpu", *(["gpu"] if self.record["gpu"] else [])]:
            for name in INTEGRATORS:
                for stiffness, damping in ((1.0, 0.03), (10.0, 0.03), (10.0, 0.0)):
                    at = {"springs.stiffness": stiffness, "damping.coefficient": damping, "method.integrator": name}
                    for dt in (0.001, 0.01, 0.1):
                        scene = curtain.replace(at | {"method.dt": dt})
                        lost = dt > 1.2 * stability_limit(scene)
                        code = 3.0 if lost else 0.0 if damping else 1.0
                        numbers = {STEP: 90.0} if lost else {}
                        self.numbers(scene, backend, numbers | {OUTCOME: code})
                    for net in (linear(curtain.replace(at)), chain(damping).replace({"method.integrator": name})):
                        limit = analytic(net)
                        if limit > 0:
                            self.numbers(net, backend, {EDGE: 0.999 * limit, LIMIT: limit})

    def findings(self) -> None:
        """Dampers of order 2 and 1, a floor of float32, errors that grow with the offset, one rate, and exact math a
        quarter slower."""
        curtain = load_scene("lab-curtain")
        for scheme, order in zip(findings.DAMPERS, (2, 1), strict=True):
            for dt in STEPS:
                self.finding(curtain, findings.DAMPING, dt, findings.ERROR, 1e-3 * (dt / 0.01) ** order, scheme=scheme)
        for precision, rounding in (("float32", 1e-5), ("float64", 0.0)):
            for dt in findings.FLOOR_STEPS:
                value = 1e-4 * (dt / 0.01) ** 4 + rounding * 0.01 / dt
                self.finding(curtain, findings.FLOOR, dt, findings.ERROR, value, integrator="rk4", precision=precision)
        for integrator, factor in (("lab", 1e-5), ("velocity-verlet", 1e-7)):
            for offset in findings.OFFSETS:
                value = factor * (1 + offset / 100)
                self.finding(curtain, findings.AWAY, 0.01, findings.ERROR, value, integrator=integrator, offset=offset)
        for integrator, rate in (("lab", 0.0), ("rk4", 1e-3), ("taylor", -2.0)):
            for dt in findings.RATE_STEPS:
                self.finding(curtain, findings.DISSIPATION, dt, findings.RATE, rate, integrator=integrator)
        for backend in ["cpu", *(["gpu"] if self.record["gpu"] else [])]:
            for n in findings.EXACT_SIZES:
                scene = curtain.replace({"grid.rows": n, "grid.columns": n})
                for math, seconds in (("fast", 1e-5), ("exact", 1.25e-5)):
                    description = findings.described(scene, backend, findings.EXACT, math=math)
                    for factor in (1, 1 + self.wobble, 1 - self.wobble):
                        self.store.add_sample(
                            self.run, description, "sources", 1000 * factor * seconds, 1000, stage=FINDINGS
                        )

    def steady(self) -> None:
        """Steps that cost 4 % more at rest; runs with 1 ms of launch and copy on the GPU, otherwise ten times as fast."""
        curtain = load_scene("lab-curtain")
        for backend, step in (("cpu", 1e-5), *([("gpu", 1e-6)] if self.record["gpu"] else [])):
            told = {"precision": "float32"}
            for dt, state in product(STEPS, ("start", "rest")):
                scene = curtain.replace({"method.dt": dt})
                description = findings.described(scene, backend, steady.STEADY, state=state, **told)
                value = step * (1.04 if state == "rest" else 1.0)
                self.store.add_measure(self.run, description, "sources", QUICKEST, value, "s", "made up")
            for steps in steady.LENGTHS:
                description = findings.described(curtain, backend, steady.LENGTH, steps=steps, **told)
                value = step + (1e-3 / steps if backend == "gpu" else 0.0)
                self.store.add_measure(self.run, description, "sources", QUICKEST, value, "s", "made up")

    def hard_bodies(self, failing: str = "") -> None:
        """Every hard case of bodies passes, at a tenth of its bound, but `failing`; a fifth of the spin is lost."""
        names = {
            "S7": (OFF_LAW, SPIN_FRACTION, OFF_NEWTON), "A10": (OUT_OF_SHAPE,), "B17": (PARTING,),
            "B18": (SINKING, LOWERED, BORNE, DEPTH, RATIO),
        }  # fmt: skip
        position = np.random.default_rng(1).uniform(-1, 1, (10, 3))
        for backend in ["cpu", *(["gpu"] if self.record["gpu"] else [])]:
            for case, precision in ((case, p) for case in BODY_CASES for p in ("float64", "float32")):
                told = configuration(case.base(), backend=backend, precision=precision) | {"hard": case.name}
                entries = []
                for place, name in enumerate(names.get(case.row, ("made up",))):
                    value = {SPIN_FRACTION: 0.8, OFF_LAW: 0.1 if precision == "float32" else 1e-9}.get(name, 0.01)
                    entries.append((f"{CHECK}{place:02d} {name}", value, "< 0.1" if place == 0 else ""))
                if case.row != "B20":
                    entries.append((SHAPE, None, bodies_as_text(position, np.repeat([0, 1], 5))))
                verdict = "fail" if case.name == failing else "pass"
                for name, value, reason in [*entries, (VERDICT, CODES[verdict], "")]:
                    self.store.add_measure(self.run, told, "sources", name, value, "", reason)

    def finding(self, scene, name, dt, measure, value, integrator="velocity-verlet", **how) -> None:
        """One measure of a finding."""
        changed = scene.replace({"method.integrator": integrator, "method.dt": dt})
        self.store.add_measure(
            self.run, findings.described(changed, "cpu", name, **how), "sources", measure, value, "", "made up"
        )

    def numbers(self, scene, backend, numbers) -> None:
        """Measures of a scene in float64."""
        threads = 1 if backend == "cpu" else None
        description = configuration(scene, backend=backend, threads=threads, precision="float64")
        for name, value in numbers.items():
            self.store.add_measure(self.run, description, "sources", name, value, "", "made up")

    def point(self, scene_name, integrator, dt, error, cost, half, precision, backend, **how) -> None:
        """One accuracy run."""
        scene = load_scene(scene_name).replace({"method.integrator": integrator, "method.dt": dt})
        self.point_of(scene, error, cost, half, precision, backend, **how)

    def point_of(self, scene, error, cost, half=None, precision="float64", backend="cpu", unresolved=None) -> None:
        """The same of any scene."""
        dt = scene.method.dt
        threads = self.record["cores"] if backend == "cpu" else None
        description = configuration(scene, backend=backend, threads=threads, precision=precision)
        names = {ERROR: error, HALF: half, COST: cost, COPY: 2e-5, GROWTH: 0.09, UNRESOLVED: unresolved}
        for name, value in names.items():
            if value is not None:
                self.store.add_measure(self.run, description, "sources", name, value, "", "made up")
        for factor in (1, 1 + self.wobble, 1 - self.wobble) if cost else ():
            self.store.add_sample(self.run, description, "sources", 100 * factor * cost * dt, 100, stage=STAGE)


def cpu_store(path: str | Path = ":memory:", **options) -> Store:
    """A machine without a GPU: sweep and accuracy."""
    store = Store(path)
    maker = Maker(store, CPU_RECORD, "cpu000000000", **options)
    with store.transaction():
        maker.sweep()
        maker.ladder()
        maker.beside()
        maker.accuracy()
        maker.stability()
        maker.findings()
        maker.steady()
    return store


def gpu_store(path: str | Path = ":memory:", **options) -> Store:
    """A machine with a GPU: sweep to larger sizes, and accuracy."""
    store = Store(path)
    maker = Maker(store, GPU_RECORD, "gpu000000000", **options)
    with store.transaction():
        maker.sweep((*SIZES, 1024, 2048, 4096))
        maker.ladder((*SIZES, 1024, 2048, 4096))
        maker.beside()
        maker.accuracy()
        maker.stability()
        maker.findings()
        maker.steady()
    return store
