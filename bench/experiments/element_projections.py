"""`softlab projections --tetrahedra`: tetrahedra per second that the position-based solver projects.

A projection is one tetrahedron, both its constraints, in one iteration; the whole step is timed, as for sheets
(projections.py). The scene is a bar fixed at one end, in voxels of five tetrahedra, swept voxel by voxel or, as a free
mesh requires, tetrahedron by tetrahedron in greedy colours: from 400 to a million and more, on a CPU too, and 266 000
with 100 sweeps per frame. The bar of 12 800 with 100 substeps per frame is that of M. Macklin et al., "Small Steps in
Physics Simulation", SCA 2019: 6 ms on an RTX 2080 Ti.

Lower bounds of the cost of a tetrahedron: `operations`, and `moved_bytes` if a cache keeps nothing from one colour to
the next.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
from rich.console import Console

from softlab.bench.measure.case_timing import Case, Rates, make_case
from softlab.bench.measure.declaration import Option
from softlab.bench.measure.tables import columns, print_table
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.model.base.table import Table
from softlab.model.core.options import PRECISIONS
from softlab.model.formulas.constraints import tetrahedron
from softlab.model.scene.scene import Scene

BARS = {
    400: (20, 2, 2),
    3200: (40, 4, 4),
    12800: (40, 8, 8),
    102400: (80, 16, 16),
}  # tetrahedra: voxels along each axis
QUICK_BARS = (400, 3200)
SWEPT = {266000: (76, 28, 25)}  # as many substeps as small bars; like LARGE and FREE never in a quick run
FREE = (1036800,)  # of LARGE on a CPU: one material
LARGE = {1036800: (96, 48, 45), 4096000: (128, 80, 80)}  # on a GPU
MOST_FREE = 1036800  # greedy colours of larger bars take minutes to compute
SWEEPS = ("voxels", "tetrahedra")
MATERIALS, QUICK_MATERIALS = ("fixed-corotated", "neo-hookean"), ("neo-hookean",)
SMALL_STEPS, FEW, SMALL = 100, 10, 12800  # substeps per frame: of bars of up to SMALL tetrahedra, and of larger ones
FRAME = 1 / 60  # s
# corners of a tetrahedron, bytes of an index; corners and tetrahedra of a voxel
CORNERS, INDEX, VOXEL_CORNERS, PER_VOXEL = 4, 4, 8, 5
VALUES = tetrahedron.COUNT - 1  # without the damper's value, which is not read
HALF_H200, STREAM_H200 = 33e12, 4.0e12  # 1/s: half of its peak in float32; bytes/s


def bar(count: int, sweep: str, material: str) -> Scene:
    """Return the bar of that many tetrahedra, a key of BARS, SWEPT or LARGE."""
    sides = (BARS | SWEPT | LARGE)[count]
    body: Table = {
        "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.1 * n for n in sides]}, "edge": 0.1,
        "young_modulus": 1e5, "poisson_ratio": 0.4, "material": material, "pinned": ["left"], "sweep": sweep,
    }  # fmt: skip
    method = {"solver": "xpbd", "dt": FRAME, "substeps": SMALL_STEPS if count <= SMALL or count in SWEPT else FEW}
    return Scene({"bar": body, "gravity": {}, "method": method}, f"a bar of {count} tetrahedra")


def count_of(scene: Scene) -> int:
    """Return the number of tetrahedra of this bar."""
    bar = scene.tetrahedra["bar"]
    assert bar.shape is not None
    sides, edge = bar.shape.sides, bar.edge
    return PER_VOXEL * int(np.prod(np.round(np.array(sides) / edge)))


def moved_bytes(sweep: str, precision: str) -> float:
    """Return the bytes that a tetrahedron moves.

    Its indices and values are read; positions and weights, four numbers per corner, are read and written. A voxel's
    eight corners count once, for all of its tetrahedra.
    """
    item = np.dtype(PRECISIONS[precision]).itemsize
    corners = VOXEL_CORNERS / PER_VOXEL if sweep == "voxels" else CORNERS
    return corners * INDEX + VALUES * item + corners * 2 * 4 * item


def operations(material: str, precision: str) -> int:
    """Return the floating-point operations of a tetrahedron."""
    item = np.dtype(PRECISIONS[precision]).itemsize
    return tetrahedron.operations(tetrahedron.MATERIALS.index(material), item)


class ElementProjections(Rates):
    """Measure how many tetrahedra per second the position-based solver projects."""

    name, command, stage = "projections", "projections", "tetrahedra_projections"
    switch = Option("--tetrahedra", "Measure bars of tetrahedra instead of sheets.", bool)
    step, rate = "tetrahedra_projection_step", "tetrahedra_projections_per_second"
    kernel = "tetrahedra_projection_kernel"
    fields = {
        "tetrahedra": lambda row: count_of(row.scene),
        "material": lambda row: row.scene.tetrahedra["bar"].material,
        "sweep": lambda row: row.scene.tetrahedra["bar"].sweep,
        "substeps": lambda row: row.scene.method.substeps,
    }
    order = ("backend", "tetrahedra", "precision", "material", "sweep")

    def work(self, scene: Scene) -> float:
        """Return the number of projections per step."""
        return count_of(scene) * scene.method.substeps * scene.method.iterations

    def groups(self, backends: Sequence[str], quick: bool, precisions: Sequence[str]) -> list[list[Case]]:
        """Return the groups timed in turn: all cases of a bar on a backend. `quick`: two bars, one material."""
        all_groups = []
        for backend in backends:
            large = LARGE if backend == "gpu" else FREE
            for count in QUICK_BARS if quick else (*BARS, *SWEPT, *large):
                scenes = [
                    bar(count, sweep, material)
                    for material in (QUICK_MATERIALS if quick or (backend == "cpu" and count in FREE) else MATERIALS)
                    for sweep in (SWEEPS if count <= MOST_FREE else SWEEPS[:1])
                ]
                all_groups.append([make_case(s, backend, p, f"{count} tetrahedra") for p in precisions for s in scenes])
        return all_groups

    def show(self, console: Console, store: Store, machine: str) -> None:
        """Print a table of what was timed on a machine."""
        rows, speeds = [], copied(store, machine)
        for p in self.rows(measures(store, machine=machine)):
            moved, done = moved_bytes(p.sweep, p.precision), operations(p.material, p.precision)
            limit = speeds.get(p.backend)
            rows.append((
                str(p.tetrahedra), p.material, p.sweep, f"{p.backend}, {p.kernel}", f"{1e3 * p.step:.3g}", str(p.substeps),
                f"{p.rate / 1e6:.4g}", f"{moved * p.rate / 1e9:.3g}", f"{moved * p.rate / limit:.0%}" if limit else "-",
                f"{done * p.rate / 1e9:.3g}",
            ))  # fmt: skip
        heads = columns(
            ("tetrahedra", "material", "sweep", "kernel"),
            ("step, ms", "substeps", "million / s", "GB / s", "of memory", "Gflop / s"),
        )
        limits = []
        for sweep in SWEEPS:
            by_memory = STREAM_H200 / moved_bytes(sweep, "float32") / 1e9
            limits.append(f"{by_memory:.0f} of {sweep}")
        by_work = ", ".join(f"{HALF_H200 / operations(m, 'float32') / 1e9:.0f} ({m})" for m in MATERIALS)
        print_table(
            console, heads, rows,
            "million / s: tetrahedra projected; GB / s, Gflop / s: what they read, write and compute at that rate; of "
            "memory: of the copy bandwidth measured here, over which a cache serves them. An H200's "
            f"limits in float32, billion/s: by memory {', '.join(limits)}, by half its arithmetic {by_work}",
        )  # fmt: skip


def copied(store: Store, machine: str) -> dict[str, float]:
    """Return backend -> copy bandwidth of a machine [B/s], where it was measured."""
    rows = store.query("SELECT record FROM machine WHERE key = ?", (machine,))
    record = json.loads(rows[0][0]) if rows else {}
    bandwidths = {"cpu": record.get("copy_bandwidth"), "gpu": record.get("gpu_copy_bandwidth")}
    return {backend: float(speed) for backend, speed in bandwidths.items() if speed}
