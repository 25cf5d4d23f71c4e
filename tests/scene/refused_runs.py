"""The table of calls that are refused: how a scene runs, how it is shared, what functions are given; and the words of the
message. test_refused.py has the check; kernel_scenes.py has the kernels of a GPU."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import newton_scenes
import numpy as np
import test_ranks as grids
import test_shared_bodies as bodies
import test_shared_fluid as fluids
import test_shared_tetrahedra as tetrahedra
from bodies_scenes import BRICK, bodies_scene
from closed_meshes import ball
from cloth_solve import cloth
from contact_scenes import folded
from meshes import sheet
from refused_scenes import GRID, XPBD, Case, changed
from shares import shared
from test_implicit import STIFF, method
from test_tetrahedra_report import told
from world_scenes import world_scene

from softlab.app.driver import open_simulation
from softlab.app.plan.report import plan_report
from softlab.bench.reference import mass_spring, xpbd
from softlab.cpu_backend.domains.in_threads import run_in_threads
from softlab.cpu_backend.domains.ranks import on_ranks
from softlab.model.assets.soft_body import SoftBody
from softlab.model.core.options import Options
from softlab.model.core.sharing.decomposition import Stencil, decompose
from softlab.model.core.stability.limit import Net, largest_frequency, scene_frequency, scene_net
from softlab.model.domains import partitioned
from softlab.model.domains.slabs import slabs_at_start
from softlab.model.geometry.edges import mesh_edges
from softlab.model.geometry.geodesic import mesh_attachments, sheet_attachments
from softlab.model.geometry.mesh import triangle_mesh
from softlab.model.geometry.tetrahedra.voxels import voxel_mesh
from softlab.model.position_based.mesh_constraints import constraint_sets, tetrahedra_within
from softlab.model.scene.scene import Scene, load_scene


def kernels() -> Iterator[Case]:
    def opened(make: Any, **how: Any) -> Any:
        return lambda: open_simulation(make(), "cpu", **how)

    yield opened(folded, kernel="fused"), 'use kernel="stages"'
    yield opened(partial(newton_scenes.bar, 2), kernel="stages"), "fused"
    yield opened(partial(cloth, 4, 4, **STIFF, **method(0.01)), kernel="stages"), "fused for implicit-euler"
    yield opened(partial(world_scene, "jelly on a block"), kernel="fused"), "one of stages for a world on the cpu"
    yield opened(partial(bodies_scene, brick=BRICK), kernel="resident"), "fused, stages for bodies"
    yield opened(lambda: newton_scenes.newton_scene("damped").replace({"method.order": 2}), live=("targets",)), "smooth"
    yield partial(plan_report, load_scene("lab-grid"), backends=("tpu",)), r"^backend = "
    yield partial(plan_report, load_scene("lab-grid"), "half"), r"^precision = "


def shares() -> Iterator[Case]:
    def ranks(scene: Any, count: int = 2, every: int | None = None, **options: Any) -> Any:
        def program(ranks: Any) -> Any:
            ranks.count = count
            return on_ranks(scene(), Options(**options), ranks, 1, every)

        return lambda: run_in_threads(max(1, count), program, patience=5)

    for name, words, changes in (
        ("cloth-mesh", "a position-based mesh is not supported", {}),
        ("cloth-flamenco", "pins anywhere", {}),
        ("cloth-self", "anywhere in the whole cloth collide", {}),
        ("jelly-block", "1 body is never cut; use 1", {}),
        ("dam-break", "thinner than their halo", {}),
        ("fem-cantilever", "use at most 1", {"method__iterations": 20}),
        ("cloth-twist", "moves pins", {}),
        ("cloth-hanging", "run the scene on one", {"external__magnitude": 0.1}),
        ("cloth-hanging", "at once", {"method__integrator": "implicit-euler"}),
    ):
        yield ranks(changed(name, **changes)), words
    hanging = changed("cloth-hanging", cloth__rows=17, cloth__columns=5)
    yield ranks(hanging, live=frozenset({"poke"})), "poke"
    yield partial(shared, grids.scene_of("lab", rows=4), 5, 1), "at most 4"
    pair = partial(bodies.scene_of, "soft", "rigid")
    yield ranks(partial(pair, contact={})), "lets bodies collide"
    yield ranks(pair, 4), "at most 3; use fewer"
    yield ranks(partial(bodies.scene_of, "clay"), 2), "1 body is never cut; use 1"
    yield ranks(partial(bodies.scene_of, "soft"), 0), "at least 1"
    yield ranks(partial(bodies.scene_of, "soft"), every=4), "bodies send nothing"
    spring = {"kind": "attachment", "body": "hookean", "vertices": "left", "compliance": 1e-4, "to": "six"}
    mesh = {"shape": "sheet", "rows": 2, "columns": 2, "spacing": 0.1, "density": 0.5}
    newton = 'scene.replace.*"method.solver": "xpbd"'
    for more, words in (
        ({"contact": {}}, "lets bodies collide"),
        ({"method": tetrahedra.METHOD | {"solver": "newton"}}, newton),
        ({"tie": spring}, "uses springs"),
        ({"external": {"magnitude": 1.0}}, "a random number for each vertex"),
        ({"mesh": mesh, "structural": {"stiffness": 10.0}}, "a cloth beside bodies"),
    ):
        yield ranks(partial(tetrahedra.scene_of, "hookean", "six", **more)), words
    yield ranks(tetrahedra.scene_of, live=frozenset({"targets"})), "targets"
    for count, changes, words in (
        (8, {}, "beyond its neighbours.*use at most 5"),
        (1000, {}, "use at most 5"),
        (2, {"method__iterations": 20}, "use at most 1"),
        (2, {"method__solver": "newton"}, newton),
        (2, {"external__magnitude": 1.0}, "a random number for each vertex"),
    ):
        scene = changed("fem-cantilever", **changes)
        yield lambda scene=scene, count=count: partitioned.partitions(scene(), count, None, "--ranks"), words
    for name, changes, count, words in (
        ("column", {}, 2, "thinner than their halo"),
        ("dam-break", {"method__scheme": "divergence-free"}, 2, "use macklin"),
        ("fountain", {}, 2, "not supported on several"),
        ("taylor-green", {}, 2, "periodic along every axis"),
        ("dam-break", {}, 0, "at least 1"),
        ("dam-break", {}, 100_000, "use fewer"),
    ):
        scene = changed(name, **changes)
        yield lambda scene=scene, count=count: slabs_at_start(scene(), count, None, "--ranks"), words
    yield lambda: slabs_at_start(fluids.dam(), 2, 4, "--ranks"), "each substep"
    for rows, count in ((3, 4), (1, 2), (16, 17)):
        yield partial(decompose, rows, 5, count, Stencil()), f"at most {rows}"
    for count, steps in ((0, None), (-1, None), (2, 0), (2, -3)):
        yield partial(decompose, 16, 5, count, Stencil(), steps), "at least 1"


def numbers() -> Iterator[Case]:
    net = Net(np.array([[0, 1]]), np.array([-1.0]), np.ones(2))
    yield partial(largest_frequency, net), r"stiffness = -1\.0: must be finite"
    sheets: dict[str, dict[str, Any]] = {
        "springs.stiffness": {"springs": {"stiffness": 1e308}, "grid": GRID["grid"] | {"mass": 1e-3}},
        "springs.stiffness_ratio": {"springs": {"stiffness_ratio": 1.7e308, "stiffness": 10.0}, **GRID},
        "bending.stiffness": {"cloth": {"rows": 4, "columns": 4}, "structural": {}, "bending": {"stiffness": 1.7e308}},
    }
    for field, tables in sheets.items():
        yield lambda tables=tables: scene_net(Scene(tables)), rf"{field} = .*too large for these masses"
    light = changed("lab-grid", grid__pinned="top-corners", grid__mass=1e-310)
    yield lambda: scene_frequency(light()), r"grid\.mass = 1e-310"
    for scene in (changed("lab-curtain", external__magnitude=0.1), partial(cloth, 2, 2, external={"magnitude": 0.1})):
        yield lambda scene=scene: mass_spring.converged(scene(), 1.0), "external"
    yield partial(xpbd.simulate, load_scene("lab-grid"), 1, ordering="random"), "ordering"


def meshes() -> Iterator[Case]:
    position, triangles = sheet(2, 2)
    edges = mesh_edges(4, triangles)
    for count in (0, -1, 65):
        yield partial(sheet_attachments, position, np.array([0]), count), "count"
        yield partial(mesh_attachments, position, edges, np.array([0]), count), "count"
    for parameters, words in (
        ({"edge": 0.0}, "edge = 0.0: must be a number greater than 0 and at most 1e"),
        ({"edge": float("nan")}, "edge = nan"),
        ({"edge": 1e300}, "edge = 1e.300: must be"),
        ({"voxels": 0}, "voxels = 0: must be 1 to"),
        ({"voxels": 1 << 30}, "voxels = .*must be 1 to"),
        ({"edge": 1e-3, "voxels": 3}, "give voxels or edge"),
        ({"per_voxel": 4}, "must be 5 or 6"),
        ({"edge": 1e-4}, "edge = 0.0001: makes about .* voxels, which take .* of memory.* make them larger"),
        ({"voxels": 100_000}, "voxels = 100000: makes about .* of memory.* take fewer"),
        ({"edge": 1e-8}, "edge = 1e-08: makes .* voxels along an axis"),
        ({"edge": 1e-12}, "edge = 1e-12: makes voxels .* move the mesh to the origin"),
    ):
        yield partial(voxel_mesh, ball(), **parameters), words
    yield partial(told, ball(), density=-1.0), r"density = -1.*kg/m\^3"
    yield partial(SoftBody.from_mesh, ball()), "particle_spacing: must be given"
    corners, faces = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 1e-7]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    flat = {"mesh": {"shape": "sheet", "rows": 3, "columns": 3}, "volume": {}, **XPBD}
    yield lambda: constraint_sets(Scene(flat)), "volume: needs a closed mesh; this one has 1 rim"
    yield partial(tetrahedra_within, triangle_mesh(np.array(corners), np.array(faces))), "nothing lies inside"


ALL: tuple[Case, ...] = (*kernels(), *shares(), *numbers(), *meshes())
