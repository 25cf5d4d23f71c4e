"""The table of bits (bits_rows.py): grids, cloths, sheets of constraints, meshes, fluids, scenes of the catalogue."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import cloth_scenes
import release_scenes
import xpbd_scenes
from bits_row import CPU, GPU, LAUNCHED, ONE, PRECISIONS, SIMULATOR, STAGES, Row
from cloth_scenes import PARTS, POKE, cloth_scene
from contact_scenes import folded
from field_scenes import FALLING
from flow_scenes import FLOWS
from fluid_scenes import SCENES as FLUIDS
from fluid_scenes import shaken
from tetrahedra_scenes import through
from xpbd_scenes import poke_of, xpbd_scene

from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene, load_scene

UNSTABLE = ("explicit-euler", "taylor")  # from small steps on: hundreds of these stay finite
SINGLE, DOUBLE = ("float32",), ("float64",)
ORDERINGS = ("gauss-seidel", "jacobi", "averaged-jacobi")


def with_one_force(integrator: str, *kernels: str) -> tuple[str, ...]:
    """Kernels of integrators that ask for forces once a step."""
    return kernels if integrator != "rk4" else ()


def resident(*tiles: str) -> tuple[str, ...]:
    return tuple(f"resident:{tile}" for tile in tiles)


# ---------------------------------------------------------------------- grids

ON_CPU = ("fused", "team", "tiled", "stages")
BUSY = {"grid.pinned": "every:3", "external.magnitude": 0.05, "perturbation.amplitude": 0.05}
BARE = {"grid.pinned": "none", "gravity.enabled": False, "damping.coefficient": 0.0}
ALTERNATING = BUSY | {"springs.stiffness_ratio": 7.0, "external.magnitude": 0.0}
TILES = tuple(f"tiles:{tile}" for tile in ("4x2x4h1", "8x2x3h2", "6x4x2h2"))  # that fit and that do not


def grid(integrator: str, rows: int, columns: int, parts: dict[str, Any], dt: float | None = None) -> Scene:
    size = {"grid.rows": rows, "grid.columns": columns, "method.integrator": integrator}
    return load_scene("lab-grid").replace(size | parts | ({"method.dt": dt} if dt else {}))


def over_blocks(integrator: str, full: int) -> Scene:
    """Two blocks of threads each way: just full, or with a single row or column in the last."""
    from softlab.gpu_backend.core.sheet import BLOCK

    rows, columns = (BLOCK[1] + 1, 2 * BLOCK[0]) if full else (2 * BLOCK[1], BLOCK[0] + 1)
    return grid(integrator, rows, columns, BUSY)


def grids() -> Iterator[Row]:
    poke = (0.05, -0.02)
    for number, integrator in enumerate(INTEGRATORS):
        on_cpu = ("fused", *with_one_force(integrator, "team", "tiled"), "stages")
        kernels = (*LAUNCHED, *with_one_force(integrator, "one-block"))
        usual = {SIMULATOR: (PRECISIONS[number % 2],)}
        steps = {CPU: 9, SIMULATOR: 9}
        yield Row(
            f"grid busy {integrator}", partial(grid, integrator, 8, 9, BUSY), steps, poke=(20, poke), kernels=kernels,
            on_cpu=on_cpu, usual=usual,
        )  # fmt: skip
        yield Row(
            f"grid bare {integrator}", partial(grid, integrator, 8, 9, BARE), steps, kernels=kernels, on_cpu=on_cpu,
            usual=usual if integrator in ("lab", "rk4") else {},
        )  # fmt: skip
        if integrator in ("lab", "velocity-verlet"):
            yield Row(
                f"grid in tiles {integrator}", partial(grid, integrator, 11, 13, BUSY), {SIMULATOR: 7}, poke=(14, poke),
                kernels=TILES, usual={SIMULATOR: SINGLE},
            )  # fmt: skip
            for rows, columns, tile in (
                (10, 8, "6x2x3h1"),
                (11, 9, "7x2x4h2"),
            ):  # exchanged every step, every other one
                yield Row(
                    f"grid in {tile} {integrator}", partial(grid, integrator, rows, columns, BUSY), {SIMULATOR: 6},
                    poke=(columns + 1, poke), kernels=resident(tile),
                    usual={SIMULATOR: SINGLE if tile == "6x2x3h1" else ()},
                )  # fmt: skip
        if integrator not in ("explicit-euler", "semi-implicit-euler"):
            yield Row(
                f"grid alternating {integrator}", partial(grid, integrator, 8, 9, ALTERNATING),
                {CPU: 9, SIMULATOR: 9, GPU: 9 if integrator in UNSTABLE else 60}, on_cpu=on_cpu,
                usual={SIMULATOR: SINGLE if integrator in ("taylor", "rk4") else DOUBLE},
            )  # fmt: skip
        yield Row(
            f"grid over blocks {integrator}", partial(over_blocks, integrator, number % 2), {SIMULATOR: 2},
            usual={SIMULATOR: DOUBLE},
        )  # fmt: skip
        dt, parts = (
            0.0003 if integrator in UNSTABLE else 0.01,
            BUSY | {"grid.pinned": "every:7", "external.seed": 2**40 + 17},
        )
        for rows, columns, count, places in (
            (37, 61, 1000, ("graph", "launch")),
            (29, 31, 1000, with_one_force(integrator, "one-block")),
            (32, 32, 1000, with_one_force(integrator, "one-block")),
            (3, 2, 1000, with_one_force(integrator, "one-block")),
            (101, 93, 1001, with_one_force(integrator, "tiles:32x8x4h4", "resident:32x8x4h4", "resident:24x7x3h1")),
            (9, 13, 60, STAGES),
        ):
            if places:
                yield Row(
                    f"grid {rows}x{columns} {integrator}", partial(grid, integrator, rows, columns, parts, dt),
                    {GPU: count}, poke=(columns + 1, poke), kernels=places, more=(),
                )  # fmt: skip
    live = (("gravity", "gravity.enabled", False), ("dt", "method.dt", 0.008), ("stiffness", "springs.stiffness", 12.0))
    scene = partial(grid, "lab", 5, 5, BUSY)
    yield Row("grid live", scene, {SIMULATOR: 7, GPU: 300}, later=live, usual={SIMULATOR: SINGLE})
    for rows, columns in ((1, 1), (1, 9), (9, 1), (3, 7)):
        small = {"grid.pinned": "none"}
        yield Row(
            f"grid {rows}x{columns}", partial(grid, "lab", rows, columns, small), {CPU: 7, SIMULATOR: 7},
            kernels=(*LAUNCHED, "one-block"), on_cpu=ON_CPU, usual={SIMULATOR: SINGLE},
        )  # fmt: skip
        yield Row(
            f"grid alternating {rows}x{columns}", partial(grid, "lab", rows, columns, ALTERNATING | small),
            {CPU: 7, SIMULATOR: 7}, usual={SIMULATOR: SINGLE}, on_cpu=ON_CPU,
        )  # fmt: skip
    for rows, columns in ((2, 2), (19, 33), (9, 1100)):  # several tiles, bands of uneven height
        scene = partial(grid, "velocity-verlet", rows, columns, ALTERNATING)
        yield Row(f"grid alternating {rows}x{columns}", scene, {CPU: 60}, on_cpu=ON_CPU)


# ---------------------------------------------------------------------- cloths

CORNERS = {"pinned": "top-corners"}
OF_CPU = {  # integrator, part, tables left out
    "springs": ("semi-implicit-euler", "springs", ()),
    "shear alone": ("lab", "springs", ("structural", "bending", "gravity")),
    "kicks meet": ("velocity-verlet", "random", ()),
    "kicks apart": ("velocity-verlet", "everything", ()),
    "rk4": ("rk4", "everything", ()),
}
SHEETS = ((5, 7), (1, 6), (6, 1), (2, 2), (3, 3), (16, 16))  # without an inside, of a row or column, of whole blocks
CLOTH_TILES = ("8x8x1h1", "7x5x3h1", "16x4x4h1", "13x13x1h2", "20x5x4h3")


def cloth(part: str, integrator: str, rows: int, columns: int, left_out: tuple[str, ...] = (), **sheet: Any) -> Scene:
    scene = cloth_scene(part, integrator, rows=rows, columns=columns, **sheet)
    scene = Scene({name: table for name, table in scene.as_dict().items() if name not in left_out}, part)
    return scene.replace({"method.dt": 1e-5}) if integrator in UNSTABLE else scene


def slower(dt: float) -> tuple[tuple[str, str, float]]:
    """A step size to go on with."""
    return (("dt", "method.dt", 0.75 * dt),)


def cloths() -> Iterator[Row]:
    dt, block = PARTS["springs"]["method"]["dt"], (*LAUNCHED, "one-block")
    for number, integrator in enumerate(INTEGRATORS):
        kernels = (*LAUNCHED, *with_one_force(integrator, "one-block"))
        for name, left_out in (("everything", ()), ("everything free", tuple(cloth_scenes.BODIES))):
            usual = {SIMULATOR: (PRECISIONS[number // 2 % 2],) if number % 2 == bool(left_out) else ()}
            scene = partial(cloth, "everything", integrator, 7, 6, left_out)
            yield Row(
                f"cloth {name} {integrator}", scene, {CPU: 4, SIMULATOR: 2}, poke=POKE, kernels=kernels, usual=usual
            )
    for part in ("springs", "damped", "random", "air", "bodies", "bare"):
        usual = {SIMULATOR: DOUBLE if part in ("springs", "random", "bodies", "bare") else ()}
        yield Row(
            f"cloth {part}", partial(cloth_scene, part, "velocity-verlet"), {SIMULATOR: 2, GPU: 300}, poke=POKE,
            kernels=block, usual=usual,
        )  # fmt: skip
    for part, integrator in (
        ("moving", "velocity-verlet"), ("damped moving", "velocity-verlet"), ("damped moving", "rk4"), ("moving", "lab"),
    ):  # fmt: skip
        yield Row(
            f"cloth {part} {integrator}", partial(cloth_scene, part, integrator), {CPU: 6, SIMULATOR: 5}, poke=POKE,
            later=slower(dt), kernels=(*LAUNCHED, *with_one_force(integrator, "one-block")),
            usual={SIMULATOR: DOUBLE if integrator == "lab" else SINGLE},
        )  # fmt: skip
    for body, table in cloth_scenes.BODIES.items():
        alone = {name: table for name, table in PARTS["bodies"].items() if name not in cloth_scenes.BODIES}
        yield Row(
            f"cloth beside {body}", partial(Scene, alone | {body: table}), {SIMULATOR: 2}, kernels=("one-block",),
            without=partial(Scene, alone), usual={SIMULATOR: SINGLE},
        )  # fmt: skip
    for part, integrator, tile in (
        ("springs", "velocity-verlet", "2x2x1h1"), ("springs", "velocity-verlet", "4x2x2h1"),
        ("bodies", "taylor", "2x3x1h1"), ("random", "velocity-verlet", "6x6x1h2"),
        ("springs", "lab", "3x4x1h1"), ("everything moving", "lab", "3x2x2h1"),
        ("everything moving", "semi-implicit-euler", "6x3x2h2"),
    ):  # fmt: skip
        yield Row(
            f"cloth in {tile} {part} {integrator}", partial(cloth_scene, part, integrator), {SIMULATOR: 6}, poke=POKE,
            kernels=resident(tile), usual={SIMULATOR: DOUBLE if tile == "3x4x1h1" else SINGLE},
        )  # fmt: skip
    one = partial(cloth_scene, "springs", "velocity-verlet", rows=4, columns=4, pinned="top")
    yield Row("cloth in one tile", one, {SIMULATOR: 5}, kernels=resident("4x2x2h1"), usual={SIMULATOR: SINGLE})
    for left_out in (("shear", "bending"), ("structural", "bending"), ("bending",), ("structural", "shear")):
        yield Row(
            f"cloth in tiles without {' '.join(left_out)}", partial(cloth, "springs", "lab", 7, 6, left_out),
            {SIMULATOR: 4}, kernels=resident("3x3x1h1"), usual={SIMULATOR: SINGLE if len(left_out) == 1 else ()},
        )  # fmt: skip
    for name, (integrator, part, left_out) in OF_CPU.items():
        for rows, columns in SHEETS:
            scene = partial(cloth, part, integrator, rows, columns, left_out, **CORNERS)
            usual = {CPU: SINGLE if (rows, columns) == (5, 7) else ()}
            yield Row(f"cloth {name} {rows}x{columns}", scene, {CPU: 8}, usual=usual)
    for part, integrator in (("everything moving", "implicit-euler"), ("springs", "implicit-euler-linear")):
        scene = partial(cloth_scene, part, integrator, rows=5, columns=6, pinned=[[0, 0], [3, 2]])
        usual = {SIMULATOR: DOUBLE if integrator == "implicit-euler" else SINGLE}
        yield Row(
            f"cloth {part} {integrator}", scene, {CPU: 3, SIMULATOR: 2}, poke=POKE, later=slower(dt), kernels=ONE,
            usual=usual,
        )  # fmt: skip
        scene = partial(cloth_scene, "everything", integrator, rows=5, columns=300)  # rows of several segments
        yield Row(f"cloth long {integrator}", scene, {CPU: 6}, poke=POKE, later=slower(dt), kernels=ONE)
    for rows, columns in ((1, 1), (1, 5), (4, 1), (2, 2)):
        scene = partial(cloth, "air", "velocity-verlet", rows, columns, pinned="none")
        yield Row(
            f"cloth {rows}x{columns}", scene, {SIMULATOR: 2}, kernels=block, usual={SIMULATOR: DOUBLE}
        )  # fmt: skip
    live = (("gravity", "gravity.enabled", False), ("dt", "method.dt", 0.0012))
    kernels = ("one-block", "resident:8x8x1h1")
    hanging = partial(of_catalogue, "cloth-hanging", {})
    yield Row("cloth live", hanging, {GPU: 301}, later=live, kernels=kernels, usual={GPU: SINGLE})
    yield from cloths_on_gpus()


def cloths_on_gpus() -> Iterator[Row]:
    """Sheets that neither a block nor a warp divides, that one block holds, and that no tile divides."""
    dt = PARTS["springs"]["method"]["dt"]
    for integrator in INTEGRATORS:
        for part in ("springs", "everything", "moving", "everything moving"):
            moves = "moving" in part
            step = 1e-5 if integrator in UNSTABLE else dt
            for rows, columns, kernels in (
                (37, 45, ("graph", "launch")),
                (29, 31, with_one_force(integrator, "one-block")),
                (7, 6, STAGES),
            ):
                if kernels:
                    yield Row(
                        f"cloth {part} {rows}x{columns} {integrator}", partial(cloth, part, integrator, rows, columns),
                        {GPU: 300}, poke=POKE, later=slower(step) if moves else (), kernels=kernels, more=(),
                    )  # fmt: skip
        if integrator not in ("velocity-verlet", "rk4"):
            scene = partial(cloth, "everything moving", integrator, 37, 45)
            kernels = resident("8x4x2h1", "14x7x2h2")
            usual = {GPU: PRECISIONS if integrator == "lab" else SINGLE}
            yield Row(
                f"cloth resident {integrator}", scene, {GPU: 300}, poke=POKE, kernels=kernels, more=(), usual=usual
            )
    for rows, columns in ((37, 45), (101, 26)):
        scene = partial(cloth, "springs", "velocity-verlet", rows, columns)
        yield Row(
            f"cloth resident {rows}x{columns}", scene, {GPU: 300}, poke=POKE, kernels=resident(*CLOTH_TILES), more=()
        )
    for part in ("bodies", "random", "moving"):
        yield Row(
            f"cloth resident {part}", partial(cloth, part, "velocity-verlet", 37, 45), {GPU: 300}, poke=POKE,
            kernels=resident("8x4x2h1", "16x8x2h2"), more=(), usual={GPU: SINGLE},
        )  # fmt: skip
    for left_out in (("shear", "bending"), ("bending",), ("structural", "shear")):
        yield Row(
            f"cloth resident without {' '.join(left_out)}",
            partial(cloth, "damped", "semi-implicit-euler", 33, 41, left_out), {GPU: 300}, poke=POKE,
            kernels=resident("16x4x2h2"), more=(), usual={GPU: SINGLE},
        )  # fmt: skip
    for rows, columns in ((1, 1), (1, 7), (7, 1), (2, 2), (1, 33), (32, 32)):
        scene = partial(cloth, "air", "velocity-verlet", rows, columns, pinned="none")
        yield Row(
            f"cloth shape {rows}x{columns}", scene, {GPU: 300}, kernels=("one-block",), usual={GPU: SINGLE}
        )  # fmt: skip
    for part, integrator, precisions in (
        ("everything", "implicit-euler", SINGLE), ("damped", "implicit-euler", DOUBLE),
        ("springs", "implicit-euler-linear", SINGLE), ("everything moving", "implicit-euler", DOUBLE),
    ):  # fmt: skip
        for rows, columns in (
            (7, 6),
            (37, 45),
            (5, 530),
            (200, 4),
        ):  # of one block, of many, of rows of several segments
            yield Row(
                f"cloth {part} {integrator} {rows}x{columns}", partial(cloth, part, integrator, rows, columns),
                {GPU: 70}, poke=POKE, later=(("dt", "method.dt", 2 * dt),), kernels=ONE, usual={GPU: precisions},
            )  # fmt: skip
    stiff = {"method.integrator": "implicit-euler", "method.dt": 0.02, "structural.stiffness": 1e4}
    hanging = partial(of_catalogue, "cloth-hanging", stiff | {"shear.stiffness": 1e4})
    yield Row("cloth hanging at large steps", hanging, {GPU: 50}, kernels=ONE, usual={GPU: SINGLE})


# ---------------------------------------------------------------------- sheets of constraints


def sheet(name: str, ordering: str, **changes: Any) -> Any:
    return partial(xpbd_scene, name, ordering, **changes)


def constraints() -> Iterator[Row]:
    tiled = ("one-block", "tiled:4x4x32d1")
    for ordering in ORDERINGS:
        scene = sheet("everything", ordering, substeps=1, iterations=3)
        yield Row(
            f"sheet everything {ordering}", scene, {CPU: 3, SIMULATOR: 2}, poke=POKE,
            kernels=(*LAUNCHED, *tiled, "tiled:8x4x64d2"), usual={SIMULATOR: DOUBLE if ordering == "jacobi" else ()},
        )  # fmt: skip
    for name, orderings in (
        ("net", ORDERINGS[:1]), ("pbd", ORDERINGS[1:2]), ("loaded", ORDERINGS), ("alternating", ORDERINGS),
        ("rigid", ORDERINGS[:1]), ("free", ORDERINGS[1:2]), ("stretchy", ORDERINGS[:2]), ("bodies", ORDERINGS[2:]),
        ("held", ORDERINGS[:1]),
    ):  # fmt: skip
        for ordering in orderings:
            scene = sheet(name, ordering, substeps=2, iterations=2)
            usual = {SIMULATOR: SINGLE if name in ("net", "rigid", "bodies", "held") or ordering == "jacobi" else ()}
            yield Row(f"sheet {name} {ordering}", scene, {SIMULATOR: 2}, kernels=(*LAUNCHED, *tiled), usual=usual)
    live = (
        ("gravity", "gravity.acceleration", 3.0), ("dt", "method.dt", 0.002), ("damping", "damping.coefficient", 0.05),
        ("stiffness", "structural.stiffness", 300.0), ("wind", "wind.velocity", [0.0, 0.0, 9.0]),
    )  # fmt: skip
    yield Row(
        "sheet live",
        sheet("air", "gauss-seidel", rows=4, columns=4, pinned="top", iterations=1),
        {CPU: 4},
        later=live,
        usual={CPU: DOUBLE},
    )
    live = (("gravity", "gravity.enabled", False), ("dt", "method.dt", 0.003))
    scene = sheet("springs", "gauss-seidel", rows=20, columns=20)
    yield Row("sheet live on a GPU", scene, {GPU: 33}, later=live, kernels=("tiled", "one-block"), usual={GPU: SINGLE})
    alone = xpbd_scenes.PARTS["springs"] | {"method": xpbd_scenes.METHOD | {"ordering": "jacobi", "iterations": 1}}
    for body in ("floor", "ball", "rod", "block"):
        yield Row(
            f"sheet beside {body}", partial(Scene, alone | {body: cloth_scenes.BODIES[body]}), {SIMULATOR: 2},
            kernels=("one-block",), without=partial(Scene, alone), usual={SIMULATOR: SINGLE if body == "floor" else ()},
        )  # fmt: skip
    many = sheet("damped", "jacobi", rows=13, columns=15, substeps=1, iterations=3)  # sixteen tiles, odd sides
    yield Row(
        "sheet many tiles", many, {SIMULATOR: 2}, kernels=("one-block", "tiled:4x4x64d2"), usual={SIMULATOR: SINGLE}
    )
    for name, ordering, shapes in (
        ("everything", "gauss-seidel", ((17, 19),)), ("everything", "jacobi", ((17, 19),)),
        ("damped", "jacobi", ((7, 6), (17, 19))),
        ("net", "gauss-seidel", ((1, 1), (1, 7), (7, 1), (2, 2), (3, 5), (7, 6), (17, 35))),
        ("alternating", "averaged-jacobi", ((1, 1), (1, 7), (7, 1), (2, 2), (3, 5), (7, 6), (17, 35))),
    ):  # fmt: skip
        for rows, columns in shapes:
            pins = {} if name == "everything" else CORNERS
            scene = sheet(name, ordering, rows=rows, columns=columns, **pins)
            usual = {CPU: SINGLE if (rows, columns) == (3, 5) else ()}
            yield Row(f"sheet {name} {ordering} {rows}x{columns}", scene, {CPU: 4}, usual=usual)
    for ordering in ("gauss-seidel", "averaged-jacobi"):
        for rows, columns in ((1, 5), (4, 1), (2, 2), (3, 3), (2, 33)):
            scene = sheet("air", ordering, rows=rows, columns=columns, pinned="none", substeps=1, iterations=2)
            usual = {SIMULATOR: DOUBLE if rows * columns in (5, 4) else ()}
            yield Row(
                f"sheet {ordering} {rows}x{columns}", scene, {SIMULATOR: 2}, kernels=("launch", *tiled), usual=usual
            )
    yield from constraints_on_gpus()


def constraints_on_gpus() -> Iterator[Row]:
    for ordering in ORDERINGS:
        for name in ("springs", "everything"):
            for rows, columns, kernels in (
                (37, 45, ("graph", "launch", "tiled:8x8x160d2", "tiled:24x16x512d1")),
                (29, 31, ("one-block", "tiled:8x16x256d3")),
                (7, 6, ("stages", "one-block")),
            ):
                scene = sheet(name, ordering, rows=rows, columns=columns)
                yield Row(
                    f"sheet {name} {ordering} {rows}x{columns}", scene, {GPU: 60}, poke=POKE, kernels=kernels, more=()
                )
        for name in xpbd_scenes.PARTS:
            if name not in ("springs", "everything", "stretchy"):
                yield Row(
                    f"sheet {name} {ordering} on a GPU", sheet(name, ordering), {GPU: 60}, poke=poke_of(xpbd_scene(name)),
                    kernels=("tiled", "one-block"), usual={GPU: SINGLE},
                )  # fmt: skip
        for rows, columns in ((1, 1), (1, 7), (7, 1), (2, 2), (1, 33), (64, 64), (1, 300)):
            if ordering != "averaged-jacobi":
                scene = sheet("air", ordering, rows=rows, columns=columns, pinned="none")
                yield Row(
                    f"sheet shape {rows}x{columns} {ordering}", scene, {GPU: 60}, kernels=("tiled", "one-block", None),
                    usual={GPU: SINGLE},
                )  # fmt: skip


# ---------------------------------------------------------------------- contacts of a cloth, distance fields, releases


def touching_sheets() -> Iterator[Row]:
    for ordering in ("gauss-seidel", "jacobi"):
        for rows, columns, layer, apart in ((37, 33, 9, 1), (13, 5, 7, 0)):  # layers in one place, too
            scene = partial(folded, rows, columns, layer, apart)
            yield Row(
                f"folded {rows}x{columns} {ordering}",
                lambda scene=scene, ordering=ordering: scene().replace({"method.ordering": ordering}), {GPU: 40},
            )  # fmt: skip
    method = {"solver": "xpbd", "dt": 1 / 60, "substeps": 3, "iterations": 1}
    yield Row("folded", partial(folded, method=method), {SIMULATOR: 2}, on_cpu=STAGES, usual={SIMULATOR: DOUBLE})
    method = method | {"substeps": 4, "iterations": 2}
    for name, ordering in (("folded strip", "gauss-seidel"), ("folded strip jacobi", "jacobi")):
        scene = partial(folded, 10, 5, 4, method=method | {"ordering": ordering})
        yield Row(name, scene, {CPU: 6}, on_cpu=STAGES, usual={CPU: SINGLE}, without=partial(without_contacts, scene))
    placed = {"origin": [0.0, 0.05, 0.0], "restitution": 0.4}
    for name, make in FALLING.items():
        kernels = {"bar": LAUNCHED, "implicit-euler": ONE}.get(name, ("launch",))
        usual = {SIMULATOR: SINGLE if name in ("semi-implicit-euler", "mesh") else ()}
        yield Row(
            f"field {name}", partial(make, **placed), {SIMULATOR: 4} | ({GPU: 5} if name == "bar" else {}),
            kernels=kernels, usual=usual,
            without=partial(make, **placed | {"origin": [0.0, -50.0, 0.0]}),
        )  # fmt: skip
    for name in release_scenes.TABLES:
        only = {"kernels": ONE} if name in ("implicit", "newton") else {}
        yield Row(
            f"release {name}", partial(release_scenes.release_scene, name), {SIMULATOR: 8, GPU: 8}, more=(),
            usual={SIMULATOR: DOUBLE if name not in ("world", "newton") else ()}, **only,
        )  # fmt: skip


def without_contacts(make: Callable[[], Scene]) -> Scene:
    """The same without its contacts."""
    return Scene({name: table for name, table in make().as_dict().items() if name != "self_collision"})


# ---------------------------------------------------------------------- fluids


def flung(scene: Scene) -> State:
    """A particle a thousand metres away, where the table of cells cannot reach with cells of the support."""
    state = shaken(scene)
    state.position[5] = 1000.0, 900.0, -800.0
    return state


def fluids() -> Iterator[Row]:
    for name, make in FLUIDS.items():
        small = {} if "column" in name or name == "free cup" else {SIMULATOR: 1}
        usual = {SIMULATOR: PRECISIONS if "flat" in name else SINGLE if name != "cup" else ()}
        yield Row(f"fluid {name}", make, small | {GPU: 20}, shaken, reads=("pressure",), usual=usual)
    for scheme in ("macklin", "divergence-free"):
        scene = partial(of_catalogue, "dam-break", {"method.scheme": scheme})
        yield Row(f"fluid dam {scheme}", scene, {GPU: 10}, usual={GPU: SINGLE})
    few = {SIMULATOR: 1, GPU: 3}
    yield Row("fluid flung", FLUIDS["averaged"], few, flung, kernels=("launch",), usual={SIMULATOR: DOUBLE})
    for name, make in FLOWS.items():
        usual = {SIMULATOR: PRECISIONS if name != "tap" else ()}
        yield Row(f"flow {name}", make, {SIMULATOR: 4, GPU: 20}, usual=usual)


# ---------------------------------------------------------------------- the catalogue


def catalogue() -> Iterator[Row]:
    """A second or less of scenes as they are, in float32."""
    newton = {"method.solver": "newton", "method.substeps": 1, "method.iterations": 3}
    by_vertices = {"method.solver": "vbd", "method.substeps": 1, "method.iterations": 10}
    for name, steps, kernels, changes in (
        ("cloth-hanging", 600, ("graph", "one-block"), {}), ("cloth-wind", 600, ("graph", "one-block"), {}),
        ("cloth-sphere", 600, ("graph", "one-block"), {}), ("cloth-twist", 600, ("graph",), {}),
        ("cloth-mesh", 12, ONE, {}), ("jelly-drop", 60, ONE, {}), ("soft-on-mesh", 80, ("graph", "stages"), {}),
        ("fem-drop", 60, ("resident", "graph"), {}),
        ("fem-drop", 70, ONE, newton), ("fem-cantilever", 60, ONE, by_vertices), ("fem-twist", 60, ONE, {}),
        ("fem-kinematic", 60, ONE, {}), ("fem-attached", 60, ONE, {}), ("fem-cloth", 60, ONE, {}),
    ):  # fmt: skip
        yield Row(
            f"catalogue {name}{' by newton' * (changes is newton)}", partial(of_catalogue, name, changes), {GPU: steps},
            kernels=kernels, more=(), usual={GPU: SINGLE},
        )  # fmt: skip


def of_catalogue(name: str, changes: dict[str, Any]) -> Scene:
    scene = through(load_scene(name)) if name == "fem-drop" else load_scene(name)
    return scene.replace(changes) if changes else scene


FAMILIES = grids, cloths, constraints, touching_sheets, fluids, catalogue
SHEETS_AND_FLUIDS: tuple[Row, ...] = tuple(row for family in FAMILIES for row in family())
