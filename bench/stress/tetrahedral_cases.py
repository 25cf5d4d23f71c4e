"""Hard cases of tetrahedra; bench/stress/tetrahedra.py has their laws.

The scenes are made by code, because a flat or inverted start has no field in a scene.
"""

from __future__ import annotations

from functools import partial

from softlab.bench.experiments.accuracy.methods import TETRAHEDRAL
from softlab.bench.experiments.tetrahedral.cantilever import cantilever
from softlab.bench.stress import tetrahedra
from softlab.bench.stress.case import HardCase
from softlab.model.base.table import Table
from softlab.model.scene.scene import Scene

FRAME = 1 / 60  # s
BUDGETS: dict[str, tuple[int, int]] = {"xpbd gauss-seidel": (20, 1), "vbd": (4, 20), "newton": (4, 2)}  # per frame
LOCKED = BUDGETS | {"xpbd gauss-seidel": (60, 2)}  # at nu 0.499, 20 substeps of one sweep leave inverted tetrahedra
FEWEST = dict.fromkeys(TETRAHEDRAL, (1, 1))
CUBE = {"shape": {"name": "box", "sides": [0.3, 0.3, 0.3]}, "edge": 0.1, "young_modulus": 1e5, "poisson_ratio": 0.3,
        "damping": 0.02}  # fmt: skip
BLOCK = {"shape": {"name": "box", "sides": [0.4, 0.4, 0.4]}, "edge": 0.1, "young_modulus": 1e6, "poisson_ratio": 0.499,
         "pinned": ["bottom", "top"]}  # fmt: skip
BAR = {"shape": {"name": "box", "sides": [1.0, 0.2, 0.2]}, "edge": 0.1, "young_modulus": 1e7, "poisson_ratio": 0.3,
       "pinned": ["left"]}  # fmt: skip
FLYING = {"shape": {"name": "box", "sides": [0.6, 0.3, 0.2]}, "edge": 0.1, "young_modulus": 1e6, "poisson_ratio": 0.3,
          "velocity": [1.0, 2.0, 0.0], "spin": [0.0, 0.0, 6.283185307179586]}  # fmt: skip
# reason of a known failure of A8
SWEPT = "only where the energy is least do a tetrahedron's forces add up to none: what sweeps leave undone is a force on all"


def scene(body: Table, braked: float = 0.0) -> Scene:
    """Return a scene with one body, without gravity; `braked` [N s/m]: damping of each particle."""
    tables: Table = {"body": {"kind": "tetrahedral_body"} | body, "method": {"solver": "xpbd", "dt": FRAME}}
    return Scene(tables | ({"damping": {"coefficient": braked}} if braked else {}))


def locking_bar() -> Scene:
    """Return the cantilever of `softlab tetrahedra`, two voxels across."""
    return cantilever(2, tetrahedra.YOUNG, "xpbd", 1, 1).replace({"beam.poisson_ratio": tetrahedra.LOCKING})


def tetrahedral_budget(case: HardCase, method: str) -> dict[str, object]:
    """Return the fields of a scene that select a method of TETRAHEDRAL."""
    substeps, iterations = {"B22": LOCKED, "B23": FEWEST}.get(case.row, BUDGETS)[method]
    return {
        "method.solver": method.split()[0], "method.substeps": substeps, "method.iterations": iterations
    }  # fmt: skip


TETRAHEDRAL_CASES = (
    *(
        HardCase(f"B21 {how}", title, partial(scene, CUBE, 0.05), tetrahedra.recovers(how), methods=TETRAHEDRAL)
        for how, title in (("flat", "a cube without volume"), ("inside out", "turned inside out"),
                           ("random", "its vertices anywhere"))
    ),
    HardCase("B22", "squashed to half at nu 0.499", partial(scene, BLOCK, 2.0), tetrahedra.squashed, methods=TETRAHEDRAL),
    HardCase("B22 voxels", "squashed, by voxels", partial(scene, BLOCK | {"volume": "voxels"}, 2.0),
             tetrahedra.squashed_voxels, methods=TETRAHEDRAL[:1], tetrahedral=True),
    HardCase("B22 bar", "a bar at nu 0.499", locking_bar, tetrahedra.sags_without_shrinking, methods=TETRAHEDRAL),
    HardCase("B23 bar", "a poke, and one iteration", partial(scene, BAR), tetrahedra.one_iteration, methods=TETRAHEDRAL),
    HardCase("A8 tumbling", "a body that flies and turns", partial(scene, FLYING), tetrahedra.tumbles, methods=TETRAHEDRAL,
             known={("vbd", "float64"): SWEPT}),
)  # fmt: skip
