"""The table of scenes that are refused, by family, and the words of the message. test_refused.py has the check."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import fluid_scenes
import tetrahedra_scenes
import vbd_scenes
import world_scenes
from bodies_scenes import BAR, BRICK, block, bodies_scene
from cloth_scenes import cloth_scene
from contact_scenes import folded
from flow_scenes import TAP
from mesh_scenes import SHEET as MESH
from surface_scenes import box
from test_links import SHEET
from test_matching import jelly
from test_offscreen import SCENE as PICTURED
from test_vbd_contact import pair

from softlab.app.driver import open_simulation
from softlab.model.assets.soft_body import RigidBody
from softlab.model.core.build import build
from softlab.model.geometry.shapes import Shape
from softlab.model.scene.scene import Scene, load_scene

Case = tuple[Callable[[], Any], str]  # what is refused, and a regular expression of the message
Tables = dict[str, Any]
GRID: Tables = {"grid": {"rows": 3, "columns": 3}}
WATER: Tables = {"kind": "fluid", "size": [0.2, 0.2, 0.2]}
TANK: Tables = {"size": [1.0, 1.0, 1.0]}
XPBD: Tables = {"method": {"solver": "xpbd"}}


def changed(name: str, **changes: Any) -> Callable[[], Scene]:
    """A scene of the catalogue with fields changed, `__` for the dot of a path."""
    return lambda: load_scene(name).replace({path.replace("__", "."): value for path, value in changes.items()})


def joined(tables: Mapping[str, Any], rows: Mapping[str, Tables]) -> Iterator[Case]:
    """Words of the message -> what joins the tables of a scene."""
    return ((partial(Scene, {**tables, **more}), words) for words, more in rows.items())


def literal(cases: Iterator[Case]) -> Iterator[Case]:
    """The same with messages that are no regular expressions."""
    return ((make, re.escape(words)) for make, words in cases)


# ---------------------------------------------------------------------- tables


def tables() -> Iterator[Case]:
    yield from joined({}, {
        r"^z = \{'a': 1\}: unknown part": {"z": {"a": 1}},
        r"^z\.kind = 'y': unknown part": {"z": {"kind": "y"}},
        r'^ball = .*: unknown part; give the table kind = "sphere" or': {"ball": {"center": [0.0] * 3, "radius": 1.0}},
        r"^grid = 3: must be a table": {"grid": 3},
    })  # fmt: skip
    part = {
        "part.pinned = 'right': must be a list of words, such as [\"right\"]":
            {"kind": "tetrahedral_body", "shape": {"name": "beam"}, "pinned": "right"},
        "part.shape.sides = 0.4: must be a list of three numbers, such as [0.4, 0.4, 0.4]":
            {"kind": "soft_body", "particle_spacing": 0.1, "shape": {"name": "box", "sides": 0.4}},
        "did you mean part.shape.sides?": {"kind": "soft_body", "particle_spacing": 0.1, "sides": 0.4},
        "name: must be given (star, torus, ": {"kind": "soft_body", "particle_spacing": 0.1, "shape": {"sides": 0.4}},
        "(did you mean left?)": {"kind": "cloth", "rows": 2, "columns": 2, "pinned": "lef"},
        "must be one of none, top,": {"kind": "cloth", "rows": 2, "columns": 2, "pinned": "lef"},
        "such as [0.0, 1.0, 0.0]": {"kind": "fluid", "size": "big"},
        "must be one of sheet (a word, not a table)": {"kind": "mesh", "shape": {"name": "sheet"}},
    }  # fmt: skip
    yield from literal(joined({}, {words: {"part": table} for words, table in part.items()}))
    for scene, field, value, words in (
        ("cloth-flag", "wind.velocity", [1, 2], "wind.velocity = [1, 2]: has too few numbers: must have three"),
        ("cloth-flag", "wind.velocity", [], "too few numbers: must have three"),
        ("cloth-flag", "wind.velocity", [1, 2, 3, 4], "too many numbers: must have three"),
        ("dam-break", "fluid.size", [1], "fluid.size = [1]: has too few numbers: must have two or three"),
        ("dam-break", "fluid.blocks", [{"origin": [0]}], "fluid.blocks.0.origin = [0]: has too few numbers"),
        ("dam-break", "fluid.blocks", [{"": None}], "fluid.blocks.0.: unknown key; known: origin, size"),
        ("dam-break", "fluid.blocks", [{"origin": [0, 0, 0], "siz": [1, 1, 1]}],
         "fluid.blocks.0.siz = [1, 1, 1]: unknown key (did you mean size?)"),
        ("dam-break", "fluid.blocks", [{"origin": [0, 0, 0]}],
         "fluid.blocks.0.size: must be given (m, along x, y and z)"),
        ("dam-break", "fluid.blocks", {"size": 1}, "fluid.blocks = {'size': 1}: must be a list of tables"),
    ):  # fmt: skip
        yield changed(scene, **{field: value}), re.escape(words)
    cameras: dict[str, Tables] = {
        "camera.yaw = 10.0: applies to a scene in space": {"yaw": 10.0},
        "camera.size = -1.0: must be greater than 0": {"size": -1.0},
        "camera.zoom.*unknown key": {"zoom": 1.0}, "camera.pitch = 90.0: must be at most 89": {"pitch": 90.0},
    }  # fmt: skip
    yield from joined(PICTURED.as_dict(), {words: {"camera": table} for words, table in cameras.items()})


# ---------------------------------------------------------------------- sheets


def sheets() -> Iterator[Case]:
    for ratio in (0.5, 0.0, -1.0, float("nan"), float("inf"), "much", True):
        yield changed("lab-grid", springs__stiffness_ratio=ratio), r"springs\.stiffness_ratio"
    stiff = changed("lab-grid", springs__stiffness_ratio=1e38)
    yield lambda: open_simulation(stiff(), allow_unstable=True), r"springs\.stiffness_ratio.*float32"
    yield from joined(MESH, {
        "xpbd or pbd": {"method": {"solver": "mass-spring"}},
        "gauss-seidel": {"method": {"solver": "xpbd", "ordering": "jacobi"}},
        "structural": {"shear": {}},
        "load.* is not supported for a mesh": {"load": {"at": [0, 0], "mass": 1.0}},
        "fold.* is not supported for a mesh": {"fold": {"rows": 2}},
        "at least 0": {"structural": {"compliance": -1.0}},
        "must be 0": {"bending": {"model": "isometric", "damping": 0.1}},
        "distance, isometric or dihedral": {"bending": {"model": "cubic"}},
        "one part of kind .* has 2: mesh, cloth": {"cloth": {"rows": 2, "columns": 2}},
        r"has 2: mesh, flag \(kind cloth\)": {"flag": {"kind": "cloth", "rows": 2, "columns": 2}},
    })  # fmt: skip
    yield changed("cloth-xpbd", bending__model="dihedral"), "applies to a mesh"
    for name in ("cloth", "grid"):
        tables = {name: GRID["grid"], "volume": {}, **XPBD}
        yield partial(Scene, tables), r"^volume\.kind = 'volume': applies to a mesh"
    for region, words in ((0, "at least 1"), (9, "at most 8")):
        yield partial(jelly, method__region=region), words
    yield from (
        (partial(jelly, springs__rest_length=0.0), "rest_length = 0.0: must be greater than 0"),
        (partial(jelly, springs__stiffness_ratio=10.0), "stiffness_ratio = 10.0: must be 1"),
        (partial(jelly, springs__compliance=0.0), "compliance = 0.0: must be greater than 0"),
        (partial(jelly, method__substeps=0), "at least 1"),
        (partial(jelly, attachments__anchors=1), "leave it out"),
        (changed("cloth-hanging", method__solver="shape-matching"), "applies to a grid"),
        (changed("cloth-xpbd", method__sleeping_speed=0.1), "applies to tetrahedral bodies"),
        (changed("lab-grid", method__integrator="implicit-euler"), "applies to a cloth"),
        (changed("lab-grid", method__solver="newton"), "newton"),
        (changed("lab-grid", method__solver="world"), r"method\.solver = 'world': applies to parts of several families"),
        (changed("lab-grid", method__solver="pbf"), r"method\.solver = 'pbf': applies to fluids"),
    )  # fmt: skip


def contacts_and_motions() -> Iterator[Case]:
    for change, words in (
        ({"self_collision.thickness": 0.11}, "at most cloth.spacing, 0.1: neighbours"),
        ({"self_collision.thickness": 0.0}, "greater than 0"),
        ({"self_collision.sweeps": 0}, "at least 1"),
        ({"self_collision.dynamic_friction": 0.5}, "at most static_friction"),
        ({"method.solver": "mass-spring"}, "position-based"),
        ({"fold.rows": 1}, "at least 2"),
    ):
        yield partial(folded().replace, change), words
    # B19: a thickness above the distance of neighbours at rest would drive the sheet apart
    yield changed("hard/b19", self_collision__thickness=0.051), "neighbours of the sheet are nearer"
    yield from joined(GRID, {
        "belongs to a": {"self_collision": {}, **XPBD},
        "belongs to a cloth": {"grid": GRID["grid"] | {"pinned": "top"}, "motion": {"pins": "top"}},
    })  # fmt: skip
    moving: Tables = cloth_scene("moving", "lab").as_dict()
    for change, words in (
        ({"pins": [[1, 1]]}, r"jerk\.pins.*\[1, 1\] is not pinned"),
        ({"pins": "left"}, r"jerk\.pins.*\[1, 0\] is not pinned"),
        ({"pins": [[7, 0]]}, r"jerk\.pins.*outside the sheet; rows are 0 to 6"),
        ({"pins": [[3, 2]]}, r"spin\.pins.*\[3, 2\] already follows jerk"),
        ({"pins": []}, r"jerk\.pins.*must name a mass"),
        ({"pins": "none"}, r"jerk\.pins.*must name a mass"),
        ({"pins": "sides"}, r"jerk\.pins.*left-right"),
        ({"pins": [[0, 0.5]]}, r"jerk\.pins.*\[\[row, column\]"),
        ({"axis": [0.0, 0.0, 0.0]}, r"jerk\.axis.*must not be zero"),
        ({"axis": [1.0, 0.0]}, r"jerk\.axis"),
        ({"angular_velocity": float("inf")}, r"jerk\.angular_velocity"),
        ({"angular_velocity": 1e12, "duration": 1.0}, r"jerk\.angular_velocity.*at most 1e\+09"),
        ({"duration": 0.0}, r"jerk\.duration.*greater than 0"),
        ({"start": -1.0}, r"jerk\.start.*at least 0"),
        ({"speed": 1.0}, r"jerk\.speed.*unknown key"),
        ({"velocity": [1e39, 0.0, 0.0]}, "jerk.*float32 cannot hold it; use float64"),
    ):
        jerk = moving | {"jerk": moving["jerk"] | change}
        yield lambda jerk=jerk: open_simulation(Scene(jerk), precision="float32"), words
    star: Tables = {"kind": "soft_body", "shape": {"name": "star"}, "particle_spacing": 0.1}
    yield from joined({}, {
        "add a table": {"one": box(self_collision=True)},
        "particles have a radius": {"one": star, "contact": {"distance": 0.1}},
    })  # fmt: skip
    yield lambda: bodies_scene(bar=BAR | {"adhesion": 1.0}), "needs contacts"
    words = r"is not supported by the solver newton.*supported by xpbd or vbd"
    yield lambda: pair(method=vbd_scenes.METHOD | {"solver": "newton"}), words


# ---------------------------------------------------------------------- bodies


def bodies() -> Iterator[Case]:
    material: dict[str, Tables] = {
        "linear": {"linear": 1.5}, "plastic_creep: must be over 0": {"plastic_threshold": 0.1},
        "plastic_limit": {"plastic_creep": 1.0, "plastic_limit": 1.0}, "cluster_damping": {"cluster_damping": -1.0},
    }  # fmt: skip
    for words, fields in material.items():
        yield lambda fields=fields: bodies_scene(bar=BAR | fields), words
        yield lambda fields=fields: bodies_scene(brick=BRICK | fields), "."
        yield lambda fields=fields: RigidBody.from_mesh(Shape(name="beam").mesh(), particle_spacing=0.3, **fields), "."
    lattice: dict[str, Tables] = {
        "no box along the axes": {"shape": {"name": "torus"}},
        "link_radius.*does not apply to a lattice": {"link_radius": 0.2},
        "volume_sampling.*does not apply to a lattice": {"volume_sampling": 2.0},
        "region = 0": {"region": 0},
        "region = 1.5": {"region": 1.5},
        "scale": {"shape": {"name": "star", "sides": [1.0, 1.0, 1.0]}},
        "greater than 0": {"shape": {"name": "box", "sides": [1.0, 0.0, 1.0]}},
        "at most 2147483647": {"particle_spacing": 0.004, "region": 10},
    }
    for words, fields in lattice.items():
        yield lambda fields=fields: bodies_scene(body=block() | fields).body_set, words
    sheet: dict[str, Tables] = {
        "volume_sampling": {"volume_sampling": 1.0}, "link_radius": {"link_radius": 0.3},
        "cluster_radius": {"cluster_radius": 0.01}, "cluster_spacing": {"cluster_spacing": 0.01},
        "resolution": {"shape": {"name": "sheet", "resolution": 999}}, "link_stiffness": {"link_stiffness": -1.0},
    }  # fmt: skip
    for words, fields in sheet.items():
        yield lambda fields=fields: bodies_scene(sheet=SHEET | fields).body_set, words
    for kind, field, value in (
        ("soft_sheet", "density", 1e-320), ("soft_sheet", "mass", 1e-322), ("soft_body", "density", 1e-318),
        ("soft_lattice", "mass", 1e-322), ("rigid_body", "mass", 1e-320),
    ):  # fmt: skip
        shape = {"name": "sheet" if kind == "soft_sheet" else "box"}
        body = {"kind": kind, "shape": shape, "particle_spacing": 0.25, field: value}
        yield lambda body=body: Scene({"b": body}).body_set, rf"b\.{field} = .* none can move without a mass"


def tetrahedra() -> Iterator[Case]:
    of, voxels = tetrahedra_scenes, {"volume": "voxels"}
    for field, value, words in (
        ("tetrahedra", 6, "tetrahedra = 5"), ("tetrahedra", "conforming", "tetrahedra = 5"),
        ("sweep", "tetrahedra", 'sweep = "voxels"'), ("material", "corotated", "fixed-corotated or neo-hookean"),
    ):  # fmt: skip
        yield partial(Scene, {"body": of.BODY | voxels | {field: value}}), words
    for solver in ("vbd", "newton"):
        yield partial(Scene, {"body": of.FREE | voxels, "method": {"solver": solver, "dt": 0.01}}), "xpbd only"
    yield (
        lambda: Scene({"body": of.tetrahedra_scene("free").as_dict()["body"] | voxels}).tetrahedra_set,
        "this file has tetrahedra alone",
    )
    method = vbd_scenes.METHOD
    yield from joined({"body": vbd_scenes.BODY}, {
        "belongs to the solver vbd": {"method": method | {"solver": "newton", "chebyshev": 0.5}},
        "chebyshev": {"method": method | {"chebyshev": 1.0}},
    })  # fmt: skip
    newton = changed("fem-cantilever", method__solver="newton", method__substeps=1)
    for more in ({"floor": {"kind": "plane"}}, {"motion": {"velocity": [0.1, 0, 0], "pins": "all"}}):
        yield lambda more=more: Scene(newton().as_dict() | more).replace({"method.order": 2}), "not smooth"
    yield changed("fem-cantilever", method__order=2), "belongs to the solver newton"
    yield changed("fem-newton", method__order=3), "order"


# ---------------------------------------------------------------------- fluids and worlds


def fluids() -> Iterator[Case]:
    method = fluid_scenes.METHOD
    yield from joined({"water": WATER, "method": method}, {
        r"oil\.rest_distance .* must be that of water": {"oil": WATER | {"rest_distance": 0.04}},
        r"oil\.dimensions .* must be that of water": {"oil": {"kind": "fluid", "dimensions": 2, "size": [0.2, 0.2]}},
        r"domain\.size .* 3 supports long": {"domain": {"size": [0.2, 1.0, 0.2]}},
        r"domain\.repeats .* has a z": {"domain": {"size": [1.0, 1.0], "repeats": ["z"]}},
        r"wind\.kind .* is not supported together with fluids": {"wind": {}},
        r"method\.solver .* must be pbf for fluids": XPBD,
        r"method\.scheme .* must be one of": {"method": method | {"scheme": "divergent"}},
        r"method\.relaxation .* must be at most 1": {"method": method | {"relaxation": 1.5}},
        r"method\.softness .* must be greater than 0": {"method": method | {"softness": 0.0}},
        r"^water\.capacity = 70: applies to the fluid of an emitter": {"water": WATER | {"capacity": 70}},
        r"^water\.capacity = 64: must be more than water starts with, 64":
            {"water": WATER | {"capacity": 64}, "tap": TAP},
        r"size: must be given, or a capacity": {"water": {"kind": "fluid"}},
    })  # fmt: skip
    yield from joined(GRID, {
        "domain.*applies to fluids; leave it out": {"domain": {"size": [1.0, 1.0, 1.0]}},
        "tap.*applies to fluids; leave it out": {"tap": TAP},
    })  # fmt: skip
    for density in (1e-320, 1e-306, 1e308):
        distance = 1e4 if density > 1 else 0.1
        water = WATER | {"rest_distance": distance, "size": [2 * distance] * 3}
        scene = {"water": water, "oil": water | {"density": density}, "method": {"solver": "pbf"}}
        yield lambda scene=scene: build(Scene(scene)), r"^oil\.density = \S+: gives particles of .* kg; "
    small: Tables = {"water": WATER | {"rest_distance": 0.05}, "method": {"solver": "pbf"}}
    plane = small | {"water": {"kind": "fluid", "dimensions": 2, "size": [0.2, 0.1], "rest_distance": 0.05}}
    yield from literal(joined(small, {
        "tank.size: must be given": {"tank": {}},
        "tank.size = [1.0, 1.0]: must hold 3 numbers in this scene": {"tank": {"size": [1.0, 1.0]}},
        "tank.size = -1.0": {"tank": {"size": [1.0, -1.0, 1.0]}},
        "tank.origin = [0.0, 0.0]: must hold 3 numbers": {"tank": TANK | {"origin": [0.0, 0.0]}},
        "tank.lid": {"tank": TANK | {"lid": True}},
        "rename one of the tables": {"tank": TANK, "tank-left": {"kind": "sphere"}},
        "did you mean tank?": {"tnak": {"kind": "tnak"}},
        "must be a table, such as [tank]": {"tank": 3},
    }))  # fmt: skip
    yield from joined(plane, {"must hold 2 numbers in this scene: width, height": {"tank": TANK}})
    basin = partial(Scene, small | {"basin": {"kind": "tank", "size": [0.4, 0.5, 0.3]}})
    words = "basin-floor, basin-left, basin-right, basin-back, basin-front"
    yield lambda: basin().replace({"basin.size": [1.0, 1.0, 1.0]}), words


def worlds() -> Iterator[Case]:
    of = world_scenes
    solids: Tables = {"jelly": of.JELLY, "cloth": of.SHEET, "method": of.METHOD | {"tetrahedra": "vbd"}}
    yield lambda: Scene(solids).members, "applies to tetrahedral bodies; this scene has none"
    yield lambda: Scene(solids | {"block": of.BLOCK}).members, "by xpbd only"


ALL: tuple[Case, ...] = (
    *tables(), *sheets(), *contacts_and_motions(), *bodies(), *tetrahedra(), *fluids(), *worlds(),
)  # fmt: skip
