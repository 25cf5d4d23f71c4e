"""A force of a contributor's own: all particles are drawn sideways. One entry, before the solvers are imported; the grid,
the cloth, XPBD on sheets and meshes, and bodies take it up, on both backends (CUDA's by its simulator), plain and fused.

Prints a line of JSON for each run: how far particles moved [m], and whether its bits are the CPU's. See test_toys.py.
"""

import json

import numpy as np

from softlab.model.base.variant import FEATURE, formula
from softlab.model.core import own_forces

LEAN, STEPS, DT = 0.75, 6, 0.0078125  # m/s^2, and s: sums of products of these are exact


@formula
def lean(k, parameters, integers, step):
    return (parameters.lean, 0.0) if FEATURE.axes == 2 else (parameters.lean, 0.0, 0.0)


def values(scene, poke, axes):
    """Forces are told over the unit of mass that a scene's solvers use, grid.mass; all particles here weigh the same."""
    from softlab.model.core.build import build

    return {"lean": LEAN / (float(build(scene).inverse_mass.max()) * scene.grid.mass)}


METHOD = {"dt": DT, "integrator": "semi-implicit-euler"}
XPBD = {"solver": "xpbd", "dt": DT, "substeps": 1, "iterations": 2}
SHEET = {"rows": 4, "columns": 5, "spacing": 0.5, "pinned": "none"}
SCENES = {
    "grid": {"grid": SHEET, "springs": {"rest_length": 0.5}, "method": METHOD},
    "cloth": {"cloth": SHEET, "structural": {"stiffness": 10.0}, "method": METHOD},
    "xpbd grid": {"grid": SHEET, "springs": {"rest_length": 0.5}, "method": XPBD},
    "xpbd cloth": {"cloth": SHEET, "structural": {}, "method": XPBD},
    "mesh": {"mesh": {"shape": "sheet", "rows": 3, "columns": 4, "spacing": 0.5}, "structural": {}, "method": XPBD},
    "body": {
        "bar": {"kind": "soft_body", "shape": {"name": "beam"}, "particle_spacing": 0.25},
        "method": {"solver": "shape-matching", "dt": DT, "substeps": 1, "iterations": 1},
    },
}


def runs(tables):
    """Iterate over (simulation, its name, same(position): True if these are the bits of the first run) of all kernels of a
    scene."""
    import quicker  # the simulator without what costs most of its time

    from softlab.app.driver import open_simulation
    from softlab.model.scene.scene import Scene

    quicker.install()
    scene, first = Scene(tables), []

    def same(position):
        first.append(position)
        return np.array_equal(position, first[0])

    for backend in ("cpu", "gpu"):
        for kernel in (None, "stages"):
            options = {"threads": 2} if backend == "cpu" else {}
            with open_simulation(scene, backend, math="exact", kernel=kernel, **options) as simulation:
                yield simulation, f"{', '.join(tables)}, {backend}, {kernel}", same


def main() -> None:
    own_forces.PARTICLE_FORCES += (
        own_forces.OwnForce("lean", "lean", lambda scene, live: True, lean, ("lean",), values, "lean"),
    )
    for name, tables in SCENES.items():
        for simulation, run, same in runs(tables):
            assert simulation.plan.has("lean") or "mesh" in name, name
            before = simulation.read("position")
            simulation.advance(STEPS)
            moved = simulation.read("position") - before
            result = {"least": float(moved[:, 0].min()), "most": float(moved[:, 0].max())}
            result |= {"aside": float(np.abs(moved[:, 1:]).max()), "same": same(simulation.read("position"))}
            print(json.dumps({"run": run, **result}))


if __name__ == "__main__":
    main()
