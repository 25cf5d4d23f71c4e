"""The table of scenes whose states must have the same bits: on any threads, by every kernel, in the CUDA simulator and on
a GPU, and from a state on the way. Here: solids and worlds; bits_sheets.py: sheets and fluids.

test_bits.py, test_bits_gpu.py and simulator/laws/test_simulated_bits.py have the checks. Scenes are those of each
family's tests, with every part that the family has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import beside_scenes
import bodies_scenes
import newton_scenes
import numpy as np
import surface_scenes
import tetrahedra_scenes
import vbd_scenes
import wet_scenes
import world_scenes
from bits_row import CPU, GPU, LAUNCHED, ONE, PRECISIONS, SIMULATOR, STAGES, Row
from bits_sheets import SHEETS_AND_FLUIDS
from kinematic_scenes import BAR, CLAMP, CUBE, ENDS, HOOK, LOOSE, SOLVERS, kinematic_scene
from meeting_bodies import meeting, smooth
from mesh_scenes import PARTS as MESHES
from mesh_scenes import POKE as MESH_POKE
from mesh_scenes import mesh_scene
from mesh_scenes import moving as moving_mesh
from rebound_scenes import among_soft_ones, dropped
from test_friction_couples import KINDS, impact
from test_matching import POKE as GRID_POKE
from test_matching import everything as matched_grid
from test_matching import jelly
from test_vbd_contact import on_slope, pair, rest_of

from softlab.bench.experiments import body_scenes
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

# ---------------------------------------------------------------------- tetrahedra

SIMULATED = {
    "everything": ("float32",), "damped": ("float64",), "corotated": ("float64",), "damped blocks": ("float32",),
    "damped hookean": ("float64",), "hookean once": ("float32",), "hookean voxels": ("float32",), "once": ("float32",),
    "free": ("float32",), "voxels": ("float32",),
}  # fmt: skip
SLOW = LOOSE | {"origin": [0.0, 0.5, 0.0], "velocity": [1.0, 0.5, 0.2], "mass_damping": 3.0, "mass_ratio": 1.5}
SLEEPING = {"solver": "xpbd", "dt": 0.01, "substeps": 2, "sleeping_speed": 0.05}
NEAR: dict[str, Any] = {
    "body": vbd_scenes.BODY,
    "second": vbd_scenes.FREE | {"origin": [0.22, 0.03, 0.01], "velocity": [-1.0, 0.0, 0.2], "spin": [0.0] * 3},
    "contact": {"distance": 0.03, "static_friction": 0.3, "dynamic_friction": 0.2},
}  # fmt: skip


def tetrahedra() -> Iterator[Row]:
    of = tetrahedra_scenes
    for name in of.PARTS:
        usual = {CPU: ("float64",) if name == "everything" else (), SIMULATOR: SIMULATED.get(name, ())}
        more = ("graph",) if name in of.LAUNCHED else ("graph", "resident")
        yield Row(
            f"xpbd {name}", partial(of.tetrahedra_scene, name), {CPU: 2, SIMULATOR: 1, GPU: 20}, of.moving, more=more,
            usual=usual,
        )  # fmt: skip
    for solver in SOLVERS:
        kernels, damper = (ONE, {"bar": BAR | {"damping": 0.02}}) if solver == "newton" else (LAUNCHED, {})
        driven = damper | {"slow": SLOW, **ENDS}
        steps = {CPU: 3, SIMULATOR: 2, GPU: 20}
        usual = {CPU: ("float32",) if solver == "xpbd" else ()}
        yield Row(f"{solver} driven", partial(kinematic_scene, solver, **driven), steps, kernels=kernels, usual=usual)
        held = {"bar": LOOSE, "cube": CUBE, "hook": HOOK | {"compliance": 1e-4 * (solver == "newton")}, "clamp": CLAMP}
        scene, usual = partial(kinematic_scene, solver, **held), {CPU: ("float64",) if solver == "xpbd" else ()}
        yield Row(f"{solver} attached", scene, steps, kernels=kernels, usual=usual)
    slabs = {SIMULATOR: ("float32",)}
    for layers in (2, 4, 6):
        scene, kernels = of.slab_scene, (f"resident:{layers}",)
        yield Row(f"xpbd slabs of {layers}", scene, {SIMULATOR: 2}, of.moving, kernels=kernels, usual=slabs)
    for name, changes in (
        ("damped", {"damping": 0.02}), ("hookean", {"material": "neo-hookean"}),
        ("corotated", {"tetrahedra": 6, "material": "corotated"}),
    ):  # fmt: skip
        scene, usual = partial(of.slab_scene, **changes), {SIMULATOR: ("float64",)}
        yield Row(f"xpbd slabs {name}", scene, {SIMULATOR: 2}, of.moving, kernels=("resident",), usual=usual)
    every = partial(of.tetrahedra_scene, "everything once")
    yield Row("xpbd slabs everything", every, {SIMULATOR: 2}, of.moving, kernels=("resident",), usual=slabs)
    few = partial(of.moving, apart=1e-3)
    for across, kernels in ((8, ("resident:2", "resident:4", "resident:14")), (4, ("resident:40",))):
        scene = partial(of.cantilever, 40, across)  # 20, 10, 3 blocks and one, over thousands of meetings
        yield Row(f"xpbd slabs across {across}", scene, {GPU: 8}, few, kernels=kernels, more=())
    scene = partial(of.cantilever, 12, 2, 4, damping=0.02)
    yield Row("xpbd slabs damped on a GPU", scene, {GPU: 5}, of.moving, kernels=("resident:2",), more=())
    slow = LOOSE | {"origin": [0.0, 0.5, 0.0]}
    tables = {"gravity": {"acceleration": 2.0}, "method": SLEEPING, "slow": slow}
    scene, steps = partial(kinematic_scene, "xpbd", **tables), {CPU: 3, SIMULATOR: 2, GPU: 60}
    yield Row("xpbd sleeping", scene, steps, usual={CPU: ("float64",), SIMULATOR: ("float32",)})


def by_vertices() -> Iterator[Row]:
    of, steps = vbd_scenes, {CPU: 2, SIMULATOR: 1, GPU: 20}
    usual = {CPU: PRECISIONS, SIMULATOR: ("float32",)}
    yield Row("vbd everything", lambda: Scene(of.EVERYTHING), steps, of.moving, usual=usual)
    alone = {SIMULATOR: ("float64",)}
    yield Row("vbd alone", partial(of.vbd_scene, of.BODY, iterations=1), steps, of.moving, usual=alone)
    fast = of.METHOD | {"substeps": 2, "iterations": 3, "chebyshev": 0.8}
    yield Row(
        "vbd meeting", lambda: Scene(NEAR | {"method": fast}), steps, of.moving, usual={SIMULATOR: ("float32",)},
        without=lambda: Scene(NEAR | {"method": fast | {"chebyshev": 0.0}}),
    )  # fmt: skip
    resting = {CPU: 4, GPU: 20}
    yield Row("vbd slope", lambda: on_slope(20.0)[0], resting, rest_of, usual={CPU: ("float64",)})
    yield Row("vbd pair", pair, resting, rest_of)
    yield Row("vbd pair accelerated", lambda: pair().replace({"method.chebyshev": 0.8}), {GPU: 20}, rest_of)


def newton() -> Iterator[Row]:
    of, steps = newton_scenes, {CPU: 2, SIMULATOR: 2, GPU: 20}
    simulated = "fixed-corotated", "corotated", "neo-hookean", "damped"
    for name in (*simulated, "no Poisson", "everything"):
        where = steps if name in simulated else {GPU: 20}
        usual = {CPU: ("float64",)} if name == "damped" else {}
        yield Row(f"newton {name}", partial(of.newton_scene, name), where, of.shaken, kernels=ONE, usual=usual)
    for name, scene in (("damped", partial(of.newton_scene, "damped")), ("bar", partial(of.bar, 4))):
        yield Row(
            f"newton second order {name}", lambda scene=scene: scene().replace({"method.order": 2}),
            {CPU: 2, SIMULATOR: 2, GPU: 5} if name == "damped" else {GPU: 5}, of.shaken, kernels=ONE,
            usual={SIMULATOR: ("float32",)},
        )  # fmt: skip
    yield Row("newton groups", of.groups_and_bodies, {SIMULATOR: 1, GPU: 20}, of.shaken, kernels=ONE)
    yield Row("newton long", partial(of.bar, 2, damping=0.01), {GPU: 20}, of.shaken, kernels=ONE)
    for across, count in ((4, 5), (8, 2)):
        for material, damping in (("fixed-corotated", 0.01), ("neo-hookean", 0.01), ("fixed-corotated", 0.0)):
            scene = partial(of.bar, across, material=material, damping=damping)
            yield Row(f"newton bar {across} {material} {damping}", scene, {GPU: count}, of.shaken, kernels=ONE)


def surfaces() -> Iterator[Row]:
    three, begin = surface_scenes.three, surface_scenes.crumpled_state
    smooth_ones = partial(three, static_friction=0.0, dynamic_friction=0.0)
    usual = {CPU: ("float32",), SIMULATOR: PRECISIONS}
    yield Row("surfaces", three, {CPU: 2, SIMULATOR: 1, GPU: 30}, begin, without=smooth_ones, usual=usual)
    yield Row("smooth surfaces", smooth_ones, {SIMULATOR: 1}, begin, usual={SIMULATOR: ("float64",)})
    of = beside_scenes
    for name, make, precision in (("on a cloth", of.on_cloth, "float32"), ("tied", of.tied, "float64")):
        usual = {SIMULATOR: (precision,)}
        yield Row(
            f"tetrahedra {name}", make, {CPU: 2, SIMULATOR: 1, GPU: 20}, of.crumpled_state, usual=usual,
            without=partial(make, contact=None),
        )  # fmt: skip


def worlds() -> Iterator[Row]:
    of = world_scenes
    simulated = {"jelly on a cloth": ("float64",), of.BY_VERTICES: ("float32",)}
    for name in of.PARTS:
        steps = {CPU: 3, SIMULATOR: 2 if name == "two on a pinned block" else 1, GPU: 20}  # until they meet
        yield Row(
            f"world {name}", partial(of.world_scene, name), steps, of.moving,
            on_cpu=STAGES, usual={SIMULATOR: simulated.get(name, ())},
            without=partial(of.world_scene, name, contact=None),
        )  # fmt: skip
    for name in wet_scenes.PARTS:
        yield Row(
            f"wet {name}", partial(wet_scenes.wet_scene, name), {CPU: 2, SIMULATOR: 1, GPU: 20},
            partial(of.moving, apart=0.001), on_cpu=STAGES,
        )  # fmt: skip


# ---------------------------------------------------------------------- bodies of clusters, grids, meshes


def bodies() -> Iterator[Row]:
    of = bodies_scenes
    few, usual = {SIMULATOR: ("float32",)}, {CPU: ("float64",), SIMULATOR: ("float32",)}
    plastic = ("plastic_threshold", "plastic_creep", "plastic_limit")

    def falling(make: Callable[[], Scene]) -> Scene:
        """The same without its ground."""
        return make().replace({"plane.point": of.AWAY["point"]})

    yield Row(
        "bodies", of.everything, {CPU: 5, SIMULATOR: 5, GPU: 41}, poke=of.POKE, usual=usual,
        without=partial(falling, of.everything),
    )  # fmt: skip
    yield Row("three substeps of bodies", partial(of.everything, 3, 2), {GPU: 41}, poke=of.POKE)
    yield Row("linked", of.hung, {CPU: 5, GPU: 41}, poke=of.POKE)
    yield Row("linked once", partial(of.hung, 1, 2), {SIMULATOR: 2}, poke=of.POKE, usual=few)
    yield Row(
        "of all materials", of.of_all_materials, {CPU: 5, SIMULATOR: 3, GPU: 41}, poke=of.POKE, usual=usual,
        without=partial(of.of_all_materials, plastic),
    )  # fmt: skip
    for left_out in (("cluster_damping",), ("linear", "cluster_damping"), ("linear",), plastic):
        scene = partial(of.of_all_materials, left_out)
        yield Row(f"without {' '.join(left_out)}", scene, {SIMULATOR: 3, GPU: 41}, poke=of.POKE, kernels=("launch",))
    yield Row("lattices", of.blocks, {CPU: 5, GPU: 21}, poke=of.POKE, without=partial(falling, of.blocks))
    dt = ("dt", "method.dt", 0.02)
    for name, scene, steps, reads in (
        ("bodies", partial(of.everything, 1, 1), 5, ("rotation", "centre")),
        ("all materials", of.of_all_materials, 5, ("rotation", "centre", "deformation", "plastic")),
        ("lattices", partial(of.blocks, 1, 1, (3, 2, 2), 1), 3, ("rotation", "centre", "deformation")),
        ("meeting", partial(meeting, 1, 1), 4, ()),
    ):  # fmt: skip
        yield Row(
            f"new step of {name}", scene, {SIMULATOR: steps, GPU: 60}, later=(dt,), kernels=("launch",), reads=reads,
            usual={SIMULATOR: ("float64",)},
        )  # fmt: skip
    yield Row(
        "without a volume", partial(of.by_hand, of.degenerate()), {SIMULATOR: 2, GPU: 10}, pushed, kernels=("launch",)
    )
    fallen = partial(
        of.bodies_scene, plane={"point": [0.0, 0.0, 0.0], "thickness": 0.05}, contact={}, method=of.method(2, 1, 1 / 60),
        body=of.block((4, 4, 4), 1, copies=(2, 2, 1), apart=(0.3, 0.41, 0.0), spare=1, origin=[0.0, 0.2, 0.0]),
    )  # fmt: skip
    yield Row("lattices that meet", fallen, {GPU: 60})
    soft = {"cluster_stiffness": 4000.0}
    aside = of.block((2, 3, 1), 1, origin=[0.06, 0.29, 0.02], velocity=[0.5, -4.0, 0.0], **soft)
    rough, smooth_ones = (
        partial(
            of.bodies_scene, one=of.block((2, 3, 1), 1, **soft), other=aside, gravity=0.0, method=of.method(2, 1),
            contact={"static_friction": friction, "dynamic_friction": friction},
        )
        for friction in (0.5, 0.0)
    )  # fmt: skip
    yield Row("friction on lattices", rough, {SIMULATOR: 2}, without=smooth_ones, usual={SIMULATOR: ("float32",)})
    for substeps, counts, region, where in (
        (1, (4, 3, 3), 1, {SIMULATOR: 2}),
        (1, (3, 4, 1), 2, {SIMULATOR: 2}),
        (1, (2, 2, 4), 1, {SIMULATOR: 2}),
        (3, (3, 9, 2), 3, {GPU: 21}),
        (3, (17, 11, 33), 4, {GPU: 21}),
    ):
        name = f"lattices of {'x'.join(map(str, counts))}"
        usual = {SIMULATOR: ("float64",) if counts == (2, 2, 4) else ("float32",)}
        yield Row(name, partial(of.blocks, substeps, 2, counts, region), where, poke=of.POKE, usual=usual)
    for region, substeps, iterations, where in (
        *((2, 2, count, {CPU: 7}) for count in (1, 2, 3, 4)), (1, 1, 1, {SIMULATOR: 7}), (2, 1, 2, {SIMULATOR: 7}),
        (1, 2, 3, {SIMULATOR: 7}),
    ):  # fmt: skip
        scene = partial(matched_grid, region, substeps, iterations)
        yield Row(f"matching {region} {substeps} {iterations}", scene, where, poke=GRID_POKE)
    whole = partial(jelly, 2, 3, method__region=3, grid__pinned="none", perturbation__amplitude=0.1)
    yield Row(
        "matching larger than the grid", whole, {SIMULATOR: 7}, kernels=("launch",), usual={SIMULATOR: ("float64",)}
    )
    for region, substeps, iterations in ((1, 1, 1), (1, 2, 3), (3, 2, 2)):
        scene = partial(wide_grid, region, substeps, iterations)
        yield Row(f"matching wide {region} {substeps} {iterations}", scene, {GPU: 100}, poke=GRID_POKE)
    for name in (*MESHES, "held"):
        usual = {CPU: ("float64",), SIMULATOR: ("float32",)} if name == "held" else {}
        usual |= {SIMULATOR: ("float64",)} if name in ("distances", "volume", "everything") else {}
        usual |= {SIMULATOR: ("float32",)} if name in ("bare", "isometric") else {}
        yield Row(
            f"mesh {name}", partial(mesh_scene, name), {CPU: 4, SIMULATOR: 2, GPU: 40}, moving_mesh, poke=MESH_POKE,
            usual=usual,
        )  # fmt: skip


def pushed(scene: Scene) -> State:
    """Its start, with every particle moved."""
    position = scene.body_set.position
    return bodies_scenes.start(scene, position + np.random.default_rng(2).normal(0, 0.03, position.shape))


def wide_grid(region: int, substeps: int, iterations: int) -> Scene:
    return matched_grid(region, substeps, iterations).replace({"grid.rows": 70, "grid.columns": 45})


HILLS = {
    "shape": {"name": "terrain", "resolution": 2}, "origin": [0.1, 0.05, -0.2], "angle": 10.0, "axis": [1.0, 0.0, 0.5],
    "velocity": [0.3, 0.5, 0.0], "spin": [0.2, 0.9, -0.3], "thickness": 0.08, "static_friction": 0.5,
    "dynamic_friction": 0.4,
}  # fmt: skip
HARD = {"restitution": 0.7, "thickness": 0.05, "static_friction": 0.3, "dynamic_friction": 0.2}
COLLIDERS = {
    "plane": HARD | {"point": [0.0, 0.15, 0.0], "normal": [0.2, 1.0, 0.1]},
    "sphere": HARD | {"center": [-0.2, 0.1, 0.0], "radius": 0.2},
    "capsule": HARD | {"start": [0.2, 0.2, -0.2], "end": [0.4, 0.25, 0.2], "radius": 0.05},
    "box": HARD | {"center": [0.0, 0.1, 0.2], "half_size": [0.1, 0.1, 0.1]},
    "mesh_collider": HILLS | {"restitution": 0.4},
}  # fmt: skip
BEAM = {"shape": {"name": "box", "resolution": 4, "sides": [0.3, 0.2, 0.2]}, "particle_spacing": 0.1}
COUPLES = {"rigid": ["rigid_body"] * 2, "soft": ["soft_body"] * 2, "both": ["rigid_body", "soft_body"]}


def touching() -> Iterator[Row]:
    """Bodies of clusters against colliders and each other."""
    of, solved = bodies_scenes, bodies_scenes.method(2, 1)
    bar = of.BAR | {"velocity": [1.0, -6.0, 0.5], "origin": [0.0, 0.4, 0.0]}
    on_hills = of.bodies_scene(bar=bar, mesh_collider=HILLS, method=solved)
    yield Row(
        "on a mesh", lambda: on_hills, {SIMULATOR: 5, GPU: 40}, usual={SIMULATOR: ("float32",)},
        without=lambda: on_hills.replace({"mesh_collider.origin": [0.0, -50.0, 0.0]}),
    )  # fmt: skip
    off_all = of.bodies_scene(bar=bar, method=solved, **COLLIDERS)
    for name in COLLIDERS:  # something bounces off each of them
        yield Row(
            f"off a {name}", lambda: off_all, {SIMULATOR: 5} | ({GPU: 40} if name == "plane" else {}),
            without=lambda name=name: off_all.replace({f"{name}.restitution": 0.0}),
        )  # fmt: skip
    coming = {"origin": [0.05, 0.2, 0.03], "velocity": [0.5, -2.0, 0.0]}
    for name, kinds in COUPLES.items():
        one, other = (BEAM | {"kind": kind} for kind in kinds)
        scene = of.bodies_scene(one=one, other=other | coming, contact={}, method=of.method(2, 2))
        yield Row(
            f"couples {name}", lambda scene=scene: scene, {SIMULATOR: 2, GPU: 40},
            without=lambda scene=scene: scene.replace({"contact.static_friction": 1e-30, "contact.dynamic_friction": 0.0}),
            usual={SIMULATOR: PRECISIONS if name == "both" else ("float32",)},
        )  # fmt: skip
    yield from bouncing()


def bouncing() -> Iterator[Row]:
    few = {SIMULATOR: ("float32",)}
    yield Row("meeting", meeting, {CPU: 8, GPU: 60}, poke=bodies_scenes.POKE)
    yield Row("meeting once", partial(meeting, 2, 1), {SIMULATOR: 2}, usual={SIMULATOR: ("float64",)})
    yield Row("a crowd", partial(meeting, 2, 1, copies=15, sweeps=1), {GPU: 30})  # the table's sums take several chunks
    yield Row("many meet", partial(meeting, 1, 1, copies=3, sweeps=1), {GPU: 60})
    yield Row("crowded", partial(meeting, 2, 1, copies=2), {CPU: 2}, usual={CPU: ("float32",)})
    yield Row("smooth", partial(smooth, 1, 2), {SIMULATOR: 2, GPU: 60})
    bounces = partial(meeting, restitution=0.6)
    yield Row("bounces", bounces, {CPU: 8, GPU: 40}, poke=bodies_scenes.POKE, without=meeting)
    for kind in KINDS:
        yield Row(f"impact {kind}", partial(impact, kind, 0.5, 2), {CPU: 1}, usual={CPU: ("float64",)})
    yield Row("bounces once", partial(meeting, 2, 1, restitution=0.7), {SIMULATOR: 4}, usual=few)
    damped = meeting(1, 1, restitution=0.7).replace({"soft.cluster_damping": 4.0})
    yield Row("bounces damped", lambda: damped, {SIMULATOR: 4}, kernels=("launch",))
    alike = smooth(2, 1).replace({"contact.restitution": 1.0})
    yield Row("bounces alike", lambda: alike, {SIMULATOR: 3}, kernels=("launch",))
    floor = {"static_friction": 0.3, "dynamic_friction": 0.2}
    rebound = partial(dropped, 0.7, angle=40.0, height=0.4, speed=4.0, **floor)
    yield Row("rebound", rebound, {CPU: 20, SIMULATOR: 6, GPU: 40}, usual=few)
    yield Row("rebound among soft ones", among_soft_ones, {SIMULATOR: 4, GPU: 40})


def worst() -> Iterator[Row]:
    """Hard cases of bodies."""
    of, kernels = body_scenes, ("launch",)
    for how in ("into a point", "mirrored"):
        squashed = partial(of.meeting, body=of.SOFT)
        begin = partial(of.changed, change=of.CHANGED[how])
        yield Row(f"worst {how}", squashed, {GPU: 200}, begin, kernels=kernels)
    for name, scene, steps in (
        ("shot", partial(of.shot, 0.125, of.BRICK, 25.0, 0.03), 200), ("stack", partial(of.stack, 4), 100),
        ("inside", partial(of.inside_each_other, of.SOFT, of.BRICK, (0.02, 0.1, 0.03)), 100),
        ("heap", partial(of.heap, 8, 4), 200),
    ):  # fmt: skip
        yield Row(f"worst {name}", scene, {GPU: steps}, kernels=kernels)


FAMILIES = tetrahedra, by_vertices, newton, surfaces, worlds, bodies, touching, worst
ROWS: tuple[Row, ...] = (*(row for family in FAMILIES for row in family()), *SHEETS_AND_FLUIDS)
