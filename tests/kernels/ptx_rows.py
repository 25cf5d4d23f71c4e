"""The table of CUDA kernels whose PTX is read: how each is made, and how often its text holds some words.

test_kernels_ptx.py has the checks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from itertools import product
from typing import Any

from kernel_text import Letters

from softlab.gpu_backend.core.tiling import parsed_tile
from softlab.gpu_backend.tetrahedra import newton_arrays, resident
from softlab.gpu_backend.tetrahedra.descent_kernels import DescentArrays
from softlab.gpu_backend.xpbd.choice import cut
from softlab.gpu_backend.xpbd.tile import whole
from softlab.model.contact.cloth_parameters import B_DYNAMIC, B_RESTITUTION, B_STATIC
from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE
from softlab.model.formulas.constraints.tetrahedron import MATERIALS
from softlab.model.particles.links import LINKS
from softlab.model.position_based.mesh_constraints import projection_of
from softlab.model.position_based.mesh_plan import BODY_DAMPING
from softlab.model.position_based.plan import colour_order
from softlab.model.shape_matching.cluster_tables import shaping
from softlab.model.tetrahedra import springs
from softlab.model.tetrahedra.aggregates import Aggregates, Couplings
from softlab.model.tetrahedra.block_rows import BlockRows
from softlab.model.tetrahedra.constraints import BLOCKS, DAMPED, ITERATED, part_of_run, projections_of
from softlab.model.tetrahedra.newton import STAGED
from softlab.model.tetrahedra.newton_arrays import Elements, Matrix

NEWTON = (  # arguments of the kernel of Newton's method
    (newton_arrays.Solver, (
        (Elements, "IIR"), (BlockRows, "I" * 7), (springs.SpringArrays, "IIIR"), (newton_arrays.Vectors, "R" * 15),
        (Matrix, "R" * 5), (Aggregates, "I" * 4), (Couplings, "I" * 8), (newton_arrays.Coarse, "RRRRRRi"), "I",
    )),
    "N", "R", "U", "L", (newton_arrays.Control, "RIL"), (newton_arrays.Limits, "lllr"),
)  # fmt: skip
DESCENT = DescentArrays, (*"IIIIIRR", (springs.SpringArrays, "IIIR"), "R", "i")
VISITS = {
    "remember": ("R", DESCENT), "start": (*"RRRR", DESCENT, "i", "D"),
    "descend": (*"RRR", DESCENT, *"iiDRU", (tuple, "Llll")),
}  # fmt: skip
SLABS = (  # arguments of the kernel `resident` of tetrahedra
    (resident.State, "RR"), (resident.State, "RR"), (resident.SlabArrays, "IIRRiiii"), (resident.Exchange, "RiiI"),
    *"TRUL", (resident.Limits, "lli"),
)  # fmt: skip
GENERATOR = "3528531795"  # a multiplier of the random generator
SOME = -1  # of a count: any but 0
Counts = Mapping[str, Mapping[str, int]]


@dataclass(frozen=True)
class Row:
    """Kernels of one factory.

    `factory`: a module of the GPU backend, and its factory; `letters`: of the arguments of each kernel, by its name or
    place in what the factory returns ("" where that is a kernel, "*" for all); `arguments`: of the factory, after
    precision and math, if it takes them (`takes`). `counts`, `double_counts`: how often words stand in a kernel in fast
    math of float32 and float64. `atomics`: kernels with atomics, which count. `allowed`: words that other kernels may
    not hold. `rare`: checked by `--rest` alone; `lean`: False if another row's kernels with more parts are checked.
    """

    factory: str
    letters: Mapping[str, Letters]
    arguments: tuple[Any, ...] = ()
    takes: str = "precision math"
    counts: Counts = field(default_factory=dict)
    double_counts: Counts = field(default_factory=dict)
    atomics: frozenset[str] = frozenset()
    allowed: frozenset[str] = frozenset()
    rare: bool = False
    lean: bool = True

    def kernels(self, real: Any, math: str) -> dict[str, Any]:
        """The kernels by name."""
        module, _, name = self.factory.partition(":")
        variant = [{"precision": real, "math": math}[word] for word in self.takes.split()]
        made = getattr(import_module(f"softlab.gpu_backend.{module}"), name)(*variant, *self.arguments)
        if "" in self.letters:
            return {"": made}
        if isinstance(made, tuple | list):
            made = {str(place): kernel for place, kernel in enumerate(made)}
        made = made if isinstance(made, dict) else vars(made)
        return made if "*" in self.letters else {name: made[name] for name in self.letters}


def some(*words: str) -> frozenset[str]:
    return frozenset(words)


# ---------------------------------------------------------------------- bodies of clusters, and contacts of particles

BODIES = some("gravity", "poke", "damping", "load", "plane", "friction")
SHAPED = BODIES | {"linear", "plastic", "cluster_damping"}
REBOUNDING = BODIES | {"restitution", "sleeping", "speed-limit"}
ENDING = "RRRIIRRPRULlll"


def clusters() -> Iterator[Row]:
    of = "shape_matching."
    yield Row(
        f"{of}kernels:make_bodies_clusters", {"sum_up": "RIIIRR", "turn": "RIRRRRR", "move": "RIIRR"},
        counts={"sum_up": {"bar.sync": 1, "st.shared": 12, "st.global": 1}},  # behind one barrier
    )  # fmt: skip
    yield Row(
        f"{of}kernels:make_bodies_ends", {"begin": "RRRPU", "finish": ENDING}, (BODIES,),
        counts={"finish": {"st.global.v4.f32": 2}},
    )  # fmt: skip
    yield Row("core.constraints:make_projections", {"": "RRIRRiiiiP"}, (LINKS,))
    for rigid in (0, 1):  # a turn writes a couple, a place and a travel
        yield Row(
            f"{of}couples:make_couples", {"gather": "RRIIIRRR", "turn": "RRIIRR" + "R" * rigid}, (bool(rigid),),
            counts={"gather": {"st.global.v4.f32": 2}, "turn": {"st.global.v4.f32": 2 + rigid}},
        )  # fmt: skip
    yield Row(f"{of}shapes:make_shaped_turn", {"": "RIRRRRRRRR"}, (shaping(SHAPED),))
    yield Row(
        f"{of}damping:make_gather", {"": "RRIIIRRR"},  # a number a lane, then one of each sum; three quads of them
        counts={"": {"bar.sync": 2, "st.shared": 16, "st.global.v4.f32": 3}},
    )  # fmt: skip
    yield Row(f"{of}damping:make_damping_ends", {"rate": "RRRIIRRP", "slow": "RRIIRR", "finish": ENDING}, (SHAPED,))
    yield Row(f"{of}matching:make_matching", {"match": "RRWWii", "move": "RRRWWPii"}, (1,))
    windows = dict.fromkeys(("sum_slices", "sum_windows", "goal_slices"), "IRRiRRRi")
    lines = {"sum_lines": "IRRiRR", "goal_lines": "IRRiRRRi", "move_lines": "IRRiRR", "turn": "IRRiRRRRRb"}
    yield Row(f"{of}lattice_kernels:make_lattice_kernels", windows | lines)
    yield Row(f"{of}rigid:make_begin", {"begin": "RRRPUR", "predict": "RRRRPR"}, (REBOUNDING,))
    ends = {"move": "RIIRRR", "rate": "RRRIIRRPR", "update": "RRRPR", "update_calmed": "RRRRPR"}
    yield Row(f"{of}rigid:make_ends", ends | {"rest": "RRRIII", "steady": "RRIIRR"}, (REBOUNDING,))
    yield Row(f"{of}rebound:make_rebound", {"weigh": "RRIIRRRR", "go": "RRRIIRR", "differ": "RR"})
    yield Row(f"{of}rebound:make_rebound", {"weigh": "RRIIRRRR"}, (True,))
    yield Row(f"{of}rebound:make_collide_rebound", {"": "RRRRPRULlll"}, (REBOUNDING,))
    yield Row(f"{of}bodies_bounce:make_give", {"": "RRRIIRIIiRRRRR"}, (True, True, True))
    yield Row(f"{of}bodies_bounce:make_bodies_bounce", {"spread": "IIRRR", "join": "RRRIIRR"})


def contacts_of_particles() -> Iterator[Row]:
    of = "contact.particles_"
    find = {
        "hash_particles": "RRII",
        "fill_buckets": "IIII",
        "arrange": "RIIIIRII",
        "find_neighbours": "RRIIRIIIIiRIIL",
    }
    for own, many in product((True, False), repeat=2):
        yield Row(
            f"{of}find:make_find", find, (own, many), takes="precision", rare=own != many,
            atomics=some("hash_particles", "fill_buckets", "find_neighbours"),
        )  # fmt: skip
    pairs = {"count": "RIIRIIiR", "project": "RRIIRIIiRRRR"}
    for friction, adhesion, both in product((True, False), repeat=3):
        rare = len({friction, adhesion, both}) > 1
        yield Row(f"{of}project:make_project", pairs, (friction, adhesion, both, both), rare=rare)
    for more in ((True,), (False, True), (True, True)):  # with travels of rigid bodies and couples, a quad each
        yield Row(
            f"{of}project:make_project", {"project": pairs["project"]},
            (True, True, True, True, *more), counts={"project": {"st.global.v4.f32": 1 + sum(more)}},
        )  # fmt: skip
    yield Row(f"{of}project:make_project", {"clear": "IR"}, (True, True, True, True, True))
    for parts in ({"speed-limit", "sleeping"}, {"speed-limit"}, {"sleeping", "pins"}, set()):
        ends = {"finish": "RRRRPRULlll", "update_velocity": "RRRRP"}
        quads = {name: {"st.global.v4.f32": 2} for name in ends}
        yield Row(f"{of}project:make_contact_ends", ends, (BODIES | parts,), counts=quads, rare=len(parts) == 1)
    yield Row(f"{of}project:make_contact_ends", {"collide": "RRRPRULlll"}, (REBOUNDING,))
    yield Row(f"{of}bounce:make_bounce", {"count": "RRRIIRIIiRRR", "bounce": "RRRIIRIIiR"}, (True, True))
    yield Row(f"{of}bounce:make_bounce", {"count": "RRRIIRIIiRRR"}, (True, True, True))


# ---------------------------------------------------------------------- colliders, and contacts of surfaces


def colliders() -> Iterator[Row]:
    """The kernel in which masses of a position-based solver meet colliders. A walk through a mesh needs no stack."""
    bare, place = BODIES - {"plane"}, f"+{4 * B_RESTITUTION}]"
    settling = {"friction", FRICTION_IN_PLACE}
    for parts, bounces, rare in (
        (BODIES, 0, False),
        (BODIES | {"restitution"}, SOME, False),
        (bare | {"mesh_collider"}, 0, False),
        (bare | {"mesh_collider", "restitution"}, SOME, True),
        (bare | {"distance_field"}, 0, False),
        (bare | {"distance_field", "restitution"}, SOME, True),
        (bare | {"plane", "sphere", "restitution"} | settling, SOME, True),
        (bare | {"mesh_collider"} | settling, 0, True),
        (bare | {"distance_field"} | settling, 0, True),
    ):
        counts = {"collide": {place: bounces}} if bounces or parts == BODIES else {}
        yield Row(
            "position_based.stages:make_xpbd_stages", {"collide": "RRRPRUl"}, (parts, 3), counts=counts, rare=rare
        )


def contacts_of_surfaces() -> Iterator[Row]:
    find = {"clear": "IIR", "hash_cells": "RRKRLIIRii", "fill_buckets": "III", "find_contacts": "RRKRLIIIRIIRRIILii"}
    local = some(".local")  # a search keeps its nearest ones in order there
    yield Row(
        "contact.self_find:make_find", find, atomics=some("hash_cells", "fill_buckets", "find_contacts"), allowed=local
    )
    links = {"fill_links": "IIIIR", "sort_links": "III", "load_up": "IRIIIRR"}
    moves = {"deepen": "RRIIRRIIIR", "push": "RRIIRRRRKRR", "gather": "RIRIIIRRRR"}
    for friction in (True, False):
        yield Row(
            "contact.self_project:make_project", links | moves, (friction,), atomics=some("fill_links"), rare=friction
        )
    yield Row("core.scan:make_scan", {"chunks": "III", "totals": "I", "add": "III"}, takes="")
    find = {"take": "RIR", "clear": "II", "find_contacts": "RRRIIIIIIIISRIIRRIIL"}
    yield Row("contact.surfaces_find:make_find", find, atomics=some("find_contacts"), allowed=local)
    rub = {"push": "RRIIRRRRSRR", "rub": "RRIIRRRRSRR", "gather_rubbed": "RIRIIIRRRR"}
    yield Row("contact.self_project:make_project", moves | rub, (True, True))


# ---------------------------------------------------------------------- cloths

KINDS = some("structural", "shear", "bending")
PLAIN = KINDS | {"damping", "gravity", "pins"}
AIR = some("wind", "gust", "external")
COLLIDERS = some("plane", "sphere", "capsule", "box", "friction")
CLOTH = PLAIN | {f"{kind}-damping" for kind in KINDS} | AIR | COLLIDERS | {"poke", "motion"}


def cloths() -> Iterator[Row]:
    of, step = "mass_spring.cloth.", "RRRRPRULlii"
    passes = f"{of}kernels:make_cloth_passes"
    everything = {"rsqrt": SOME, GENERATOR: SOME, "bar.sync": SOME}  # gusts: one thread of a block computes them
    yield Row(passes, {"step": step}, ("lab", CLOTH), counts={"step": everything})
    yield Row(passes, {"*": step}, ("velocity-verlet", CLOTH))
    for integrator in ("semi-implicit-euler", "explicit-euler", "taylor"):
        yield Row(passes, {"step": step}, (integrator, PLAIN), rare=True)
    # an absent part leaves no instruction: position and velocity, and the two constants of the step
    bare = {"rsqrt": 0, GENERATOR: 0, "bar.sync": 0, "ld.global": 4}
    yield Row(passes, {"step": step}, ("lab", some()), counts={"step": bare}, lean=False)
    yield Row(passes, {"step": step}, ("lab", KINDS), counts={"step": {"rsqrt": 12}}, lean=False)  # one a spring
    air = {"rsqrt": 12 + 6 * 2}  # a triangle's normal and the air's speed
    yield Row(passes, {"step": step}, ("lab", KINDS | {"wind"}), counts={"step": air}, lean=False)
    for parts, count in ((some("plane"), 0), (some("plane", "friction"), SOME)):
        places = {f"+{4 * place}]": count for place in (B_STATIC, B_DYNAMIC)}
        yield Row(passes, {"step": step}, ("lab", parts), counts={"step": places}, lean=False)
    # twelve neighbours, the mass itself and its velocity, in loads of 16 bytes
    single = {"ld.global.v4.f32": 14, "st.global.v4.f32": 2, "st.global.f32": 0}
    double = {"ld.global.v2.f64": 28, "st.global.v2.f64": 4, "st.global.f64": 0}
    yield Row(
        passes, {"middle": step}, ("velocity-verlet", PLAIN), counts={"middle": single}, double_counts={"middle": double},
        lean=False,
    )  # fmt: skip
    yield Row(f"{of}kernels:make_cloth_rk4_stages", {"*": "RRRR" + step}, (CLOTH,), rare=True)
    shared = {
        "ld.shared.v4.f32": SOME,
        "st.shared.v4.f32": SOME,
        "bar.sync": SOME,
        "ld.shared.f32": 0,
        "st.shared.f32": 0,
    }
    shared["ld.global.v4.f32"] = 2  # a mass's own position and velocity, once
    for integrator, parts in product(("lab", "velocity-verlet"), (PLAIN, CLOTH)):
        yield Row(
            f"{of}block:make_cloth_block", {"": "RRRRPRULllii"}, (integrator, parts, 256), counts={"": shared},
            lean=parts == CLOTH, rare=parts == CLOTH,
        )  # fmt: skip
    yield from cloths_by_stages()
    yield from cloths_in_tiles()
    implicit = {"": "RRRRRRRRRRRRILPMRULlii"}
    counted = some("")  # blocks that have come to a barrier
    yield Row(f"{of}implicit:make_cloth_implicit", implicit, (False, KINDS | {"gravity", "pins"}), atomics=counted)
    yield Row(f"{of}implicit:make_cloth_implicit", implicit, (False, CLOTH), atomics=counted, rare=True)


def cloths_by_stages() -> Iterator[Row]:
    of, verlet = "mass_spring.cloth.stages:", ("velocity-verlet", CLOTH)
    tools = {"count": "Ll", "first_diverged": "RRrrrrI", "write_position": "RW", "write_normal": "RWii"}
    yield Row("core.sheet:make_cloth_tools", tools, takes="precision", atomics=some("first_diverged"))
    forces = {"spring_forces": "RRPRii", "no_forces": "R", "wind": "RRPUlrRii", "damping": "RPR"}
    yield Row(f"{of}make_force_stages", forces, verlet)
    motion = {"integrate": "RRRP", "first_kick": "RRRP", "second_kick": "RRP", "accumulate": "iRRRPR"}
    yield Row(f"{of}make_motion_stages", motion, verlet)
    yield Row(f"{of}make_bound_stages", {"collide": "RRRPRUl", "pins": "RRR", "moving_pins": "RRPRli"}, verlet)
    yield Row("core.forces:make_force_stages", {"*": "RPUlR"}, (CLOTH,))


def cloths_in_tiles() -> Iterator[Row]:
    """The kernel `resident`. A mass is sent in as few words as carry a tag: positions alone where no force asks for
    velocities and no tiles overlap; of 8 x 8 masses 64 threads fetch 80."""
    four, words = some("structural", "gravity"), ("st.relaxed.gpu.global.b128", "ld.relaxed.gpu.global.b128")

    def row(tile: str, parts: frozenset[str], integrator: str = "lab", **more: Any) -> Row:
        arguments = integrator, parts, parsed_tile(tile)
        return Row("mass_spring.cloth.resident:make_cloth_resident", {"": "RRRRRRiIPRULlii"}, arguments, **more)

    yield row("8x4x2h1", CLOTH, counts={"": {words[0]: 4, words[1]: SOME, GENERATOR: SOME}}, rare=True)
    yield row("8x4x2h1", four, counts={"": {words[0]: 2, GENERATOR: 0, "rsqrt": 2 * 2 + 2 + 1}}, lean=False)
    sent = dict.fromkeys(words, SOME)
    yield row("16x4x4h1", PLAIN, "velocity-verlet", counts={"": sent})
    yield row("16x16x1h2", PLAIN, "velocity-verlet", counts={"": sent}, rare=True)
    counts = [{"": {words[0]: each, words[1]: 2 * each}} for each in (1, 3)]
    yield row("8x8x1h1", four | KINDS, counts=counts[0], double_counts=counts[1], lean=False)
    # Of a strip of four: its own column and two beyond either end, both next columns and one beyond, the two after those;
    # four masses are written at the end. 4 structural and bending springs along it and 1 and 2 above, of 12 a mass.
    strip = {"ld.shared.f32": 3 * (8 + 12 + 8) + 3 * 4, "rsqrt": 4 * 8 + (4 + 1) + (4 + 2), "bar.sync": 3}
    yield row("16x4x4h1", KINDS, counts={"": strip}, lean=False)


# ---------------------------------------------------------------------- position-based sheets and meshes

SOFT = KINDS | {f"{kind}-compliance" for kind in KINDS} | {"damping", "gravity", "pins"}
SHEET = SOFT | {f"{kind}-damping" for kind in KINDS} | AIR | COLLIDERS | {"poke", "load", "attachments"}
FLAT = some("structural", "structural-compliance", "alternating", "gravity", "pins", "external", "jacobi")


def sheets() -> Iterator[Row]:
    of, parts = "position_based.", SHEET | {"gauss-seidel"}
    rising = next(entry for entry in colour_order(parts) if entry[0].name == "rising")
    yield Row(f"{of}kernels:make_begin", {"": "RRRPULlllii"}, (parts, 3))
    yield Row(f"{of}kernels:make_colour", {"": "RRRliPii"}, (parts, *rising, 3))
    yield Row(f"{of}kernels:make_jacobi", {"": "RRRRiPii"}, (FLAT, 2))
    yield Row(f"{of}kernels:make_attach", {"": "RRIRi"})
    yield Row(f"{of}kernels:make_end", {"": "RRRPRULlll"}, (parts, 3))
    yield Row(f"{of}kernels:make_plane_tools", {"write_position": "RW"}, takes="precision")
    stages = {"wind": "RRPUlRii", "predict": "RRRRPii", "update_velocity": "RRRP", "collide": "RRRPRUl"}
    yield Row(f"{of}stages:make_xpbd_stages", stages, (SHEET | {"jacobi"}, 3))
    registers = {
        "rsqrt.approx.ftz.f32": SOME,
        "sqrt.rn": 0,
        "st.shared.v4.f32": SOME,
        "ld.shared.f32": 0,
        "st.shared.f32": 0,
    }
    for ordering, barriers, loads in (
        (
            "gauss-seidel",
            12 + 2,
            2 * 12 + 2,
        ),  # a colour each, and around the substep; both ends, and the thread's masses
        ("jacobi", 1 + 2, 13 * 2 + 2),
    ):
        yield Row(
            "xpbd.tiled:make_one_block", {"": "RRIRiPRULlllii"}, (SOFT | {ordering}, 3, whole(32, 32, 512)),
            counts={"": registers | {"bar.sync": barriers, "ld.shared.v4.f32": loads}},
        )  # fmt: skip
    for parts in (SHEET | {"gauss-seidel"}, SOFT | {"structural-damping", "attachments", "averaged-jacobi"}):
        tiled = {"": "RRRRRRRIRiPRULllliilii"}
        yield Row("xpbd.tiled:make_tiled", tiled, (parts, 3, cut(parts, (8, 8), 1)), rare="jacobi" in parts)


def meshes() -> Iterator[Row]:
    soft, one = some("structural-compliance", "bending-compliance"), "core.constraints:make_projections"
    for kind, parts, counts in (  # multipliers are only there for what gives
        ("structural", soft, {"st.global.f32": 1, "st.global.v4.f32": 2}),
        ("structural", some(), {"st.global.f32": 0, "st.global.v4.f32": 2}),
        ("structural", soft | {"structural-damping"}, {}),
        ("bending", soft, {}),
        ("bending", soft | {"bending-isometric"}, {"st.global.v4.f32": 4}),
        ("bending", soft | {"bending-dihedral"}, {}),
        ("attachments", soft | {"attachments-2"}, {}),
    ):
        yield Row(
            one, {"": "RRIRRiiiiP"}, (projection_of(kind, parts | {kind}),), counts={"": counts} if counts else {}
        )
    begin = {"": "RRRIIIPULlll"}
    parts = some("wind", "gust", "external", "gravity", "poke", "damping", "pins", "load", "gauss-seidel")
    yield Row("position_based.mesh_kernels:make_mesh_begin", begin, (parts,))
    bare = {"": {"rsqrt": 0, "bar.sync": 0, "ld.global.v4.f32": 2}}
    yield Row("position_based.mesh_kernels:make_mesh_begin", begin, (some("gravity"),), counts=bare, lean=False)
    yield Row("core.sheet:make_mesh_tools", {"write_normal": "RWIII"}, takes="precision")


# ---------------------------------------------------------------------- tetrahedra


def tetrahedra() -> Iterator[Row]:
    one, letters = "core.constraints:make_projections", {"": "RRIRRiiiiT"}
    names = (*((name, DAMPED, ITERATED) for name in MATERIALS), *((name, ITERATED) for name in MATERIALS))
    blocks = (("fixed-corotated", DAMPED, ITERATED, BLOCKS), ("corotated", ITERATED, BLOCKS))
    attached = ((ITERATED, f"attachment-{model}") for model in ("world", "bodies", "cloth"))
    voxels = [("neo-hookean", DAMPED, ITERATED, part_of_run("neo-hookean", 5, True))]
    voxels += [("fixed-corotated", DAMPED, ITERATED, part_of_run("fixed-corotated", run)) for run in (5, 6)]
    for number, parts in enumerate((*names, *blocks, *attached, *voxels)):
        for projection in projections_of(frozenset(parts)):
            yield Row(one, letters, (projection,), rare=number % 2 == 1)
    for parts, stored in ((("fixed-corotated",), 0), (("fixed-corotated", ITERATED), 2)):  # multipliers, where kept
        (projection,) = projections_of(frozenset(parts))
        yield Row(one, letters, (projection,), counts={"": {"st.global.f32": stored}}, lean=False)
    for material in MATERIALS:
        parts = some(material, part_of_run(material, 5), DAMPED, ITERATED, "gravity", "damping", "pins", "load")
        (projection,) = projections_of(parts)
        messages = {"st.relaxed.gpu.global.b128": SOME, "ld.shared.v4.f32": SOME}
        yield Row(
            "tetrahedra.resident:make_tetrahedra_resident", {"": SLABS}, (parts, projection),
            counts={"": messages}, rare=material != MATERIALS[0],
        )  # fmt: skip
    parts = some("gravity", "load", "pins", "plane", "sphere", "friction", "restitution", FRICTION_IN_PLACE)
    yield Row("position_based.touching:make_touching", {"touch": "RRRTRULlll", "release": "RR"}, (parts,))
    yield Row("contact.pins:make_drive", {"": "RRTRIiiLlll"})
    yield Row("position_based.mesh_kernels:make_slow", {"": "RRT"})
    yield from by_vertices_and_newton()


def by_vertices_and_newton() -> Iterator[Row]:
    parts, of = springs.PARTS | {"plane", "box", "friction"}, "tetrahedra.descent_kernels:"
    for material, damped in product(range(len(MATERIALS)), (True, False)):
        yield Row(f"{of}make_visits", VISITS, (material, damped, parts), rare=material > 0 or not damped)
    yield Row(f"{of}make_accelerate", {"": "RRr"})
    free = some("gravity", "load")
    everything = free | COLLIDERS | {DAMPED, "pins", "damping", "external", "poke", FRICTION_IN_PLACE}
    for parts in (
        free, everything - {"external"}, everything, free | {DAMPED, STAGED},
        free | springs.PARTS | {DAMPED, "pins", "motion", BODY_DAMPING},
    ):  # fmt: skip
        yield Row(
            "tetrahedra.newton_kernel:make_newton",
            {"": NEWTON},
            (parts,),
            rare=parts != free,
            atomics=some(""),
        )


# ---------------------------------------------------------------------- fluids

TIME = "RULlll"  # bodies, integers, counter, place, substeps, substep
WATER = some("gravity", "plane", "walls")
ALL = WATER | COLLIDERS | {
    "fluids", "repeats", "averaged", "tensile", "restitution", "drag", "held-back", "viscosity", "cohesion",
    "surface-tension", "vorticity", "poke", "external",
}  # fmt: skip
COMING = WATER | {
    "fluids", "capsule", "box", "swept", "mesh_collider", "distance_field", "emitter", "sink", "viscosity",
}  # fmt: skip


def fluids() -> Iterator[Row]:
    sort = {
        "bound": "RrR", "hash_particles": "RRIIII", "chunks": "IIII", "totals": "II", "fill": "IIIIIIIII",
        "arrange": "IIIRRRIRRRII",
    }  # fmt: skip
    counted = some("hash_particles")
    yield Row("fluid.sort_kernels:make_cell_sort", sort, (some(),), takes="precision", atomics=counted)
    yield Row("fluid.sort_kernels:make_cell_sort", {"span": "RFiRI"}, (some("x"),), takes="precision")
    coming = {name: sort[name] for name in ("totals", "fill", "arrange")}
    yield Row("fluid.sort_kernels:make_cell_sort", coming, (some(), True), takes="precision")
    for parts in (WATER, ALL, COMING):
        yield from substep(parts)
    due = {"due": "LlllFRIR", "rank": "IIII", "totals": "II", "emit": "RRIIIRRIRII", "arrive": "IIIRIRIIL"}
    flow = due | {"take": "RIRIRIIII", "rest": "III"}
    yield Row("fluid.flow_kernels:make_flow_kernels", flow, (COMING,), atomics=some("take"))
    sampling = {"sample": "IiIRRRRRR", "gather": "IiI", "follow": "IIRRR", "push": "RIIRRR"}
    yield Row("fluid.solids:make_sampling", sampling)
    solids = {
        "factors": f"RFIIIiRRRRRR{TIME}", "density": f"RFIIIiRRRRR{TIME}", "correct": f"RRFIIIiRRR{TIME}RR",
    }  # fmt: skip
    yield Row("fluid.solids:make_solid_kernels", solids, ((ALL - {"repeats", "averaged"}) | {"solids"},))
    for parts in (WATER, ALL - {"averaged", "tensile"} | {"moving"}):
        yield from divergence_free(parts | {"divergence-free"})


def around(parts: frozenset[str]) -> frozenset[str]:
    """The axes along which a fluid repeats."""
    return some("x", "z") if "repeats" in parts else some()


def substep(parts: frozenset[str]) -> Iterator[Row]:
    both, rare = (parts, around(parts)), parts == COMING
    yield Row("fluid.motion:make_begin", {"": f"RRIrFR{TIME}RRRRL"}, both, atomics=some(""), rare=rare)
    settle = {"settle": f"RRRFIIRRRR{TIME}RR", "update": f"RRRFRR{TIME}RR", "limit": "RRRFR"}
    yield Row("fluid.motion:make_settle", settle, both, rare=rare)
    smooth = {"shape": "RRFIIRR", "smooth": "RRFIIRRRRR"}
    yield Row("fluid.smoothing:make_smoothing", smooth, (*both, True), rare=rare)
    density = {
        "find": "RFIIIIIL", "prepare": f"RFIIIIILRRRRR{TIME}R", "factors": f"RFIIRRRRR{TIME}", "density": f"RFIIRRRR{TIME}",
        "correct": f"RRFIIRR{TIME}R",
    }  # fmt: skip
    counted = some("find", "prepare")
    yield Row("fluid.kernels:make_density_kernels", density, (*both, 64), atomics=counted, rare=rare)


def divergence_free(parts: frozenset[str]) -> Iterator[Row]:
    both = parts, around(parts)
    targets = {"survey": f"RRFIIRRR{TIME}", "foresee": "RRFIIRRR"}
    yield Row("fluid.divergence:make_targets", targets, both)
    yield Row("fluid.divergence:make_solve", {"relax": "RRFIIRRRRRii", "push": "RRFIIRRRi"}, both)
    motion = {
        "gather": "RFR", "take_up": "RRRFR", "accelerate": f"RRIRFR{TIME[1:]}RL", "move": f"RRRRRFR{TIME}RR",
    }  # fmt: skip
    yield Row("fluid.divergence_motion:make_free_motion", motion, both, atomics=some("accelerate"))


# ---------------------------------------------------------------------- the grid

GRID = some("springs", "gravity", "damping", "pins", "external", "poke")
PASS, TILES, RESIDENT = "CCCCGULlBBii", "CCCCGULllBiiii", "CCCCCCIiIGULlBii"


def grids() -> Iterator[Row]:
    of, local = "mass_spring.grid.", some(".local")
    for integrator in ("lab", "velocity-verlet", "semi-implicit-euler", "explicit-euler", "taylor"):
        yield Row(
            f"{of}kernels:make_passes",
            {"*": PASS},
            (integrator, GRID),
            rare=integrator not in ("lab", "velocity-verlet"),
        )
    yield Row(f"{of}kernels:make_rk4_stages", {"*": "CCCC" + PASS}, (GRID,))
    full = {"rsqrt.approx": SOME, "sqrt.rn": 0, GENERATOR: SOME, "sub.rn": SOME}  # p' - p, once an axis
    yield Row(f"{of}kernels:make_passes", {"step": PASS}, ("lab", GRID), counts={"step": full}, lean=False)
    bare = {"rsqrt": 0, GENERATOR: 0, "ld.global": 4}  # position and velocity, and the two constants of the step
    yield Row(f"{of}kernels:make_passes", {"step": PASS}, ("lab", some()), counts={"step": bare}, lean=False)
    # four neighbours, the mass itself and its velocity; the rest are constants
    single, double = (
        {f"ld.global.v2.{word}": 6, f"st.global.v2.{word}": 2, f"st.global.{word}": 0} for word in ("f32", "f64")
    )
    yield Row(
        f"{of}kernels:make_passes", {"step": PASS}, ("lab", some("springs")), counts={"step": single},
        double_counts={"step": double}, lean=False,
    )  # fmt: skip
    pairs = {"ld.shared.v2.f32": SOME, "st.shared.v2.f32": SOME, "bar.sync": SOME, "ld.shared.f32": 0}
    lab = GRID - {"external"}
    for name, tile, strip in (
        ("one-block", "32x32x1h0", "32x4x8h0"),
        ("tiles", "64x8x8h4", "32x4x8h4"),
        ("resident", "64x8x8h4", "32x4x8h4"),
    ):
        for integrator in ("lab", "velocity-verlet"):  # with a random force a strip of 8 is not unrolled
            yield tile_row(name, integrator, tile, GRID, True, allowed=local, rare=integrator == "lab")
            yield tile_row(name, integrator, tile, lab, True, counts={"": pairs})
        # a strip of n masses has n + 1 springs above and below and 2 n to the sides: 3 n + 1 roots a step, not 4 n
        yield tile_row(name, "lab", strip, GRID, False, counts={"": {"rsqrt.approx": 3 * 8 + 1}}, lean=False)
    # 20 bits from the hardware and one step of arithmetic, where the library's root checks for special numbers
    roots = {"rsqrt.approx.ftz.f64": 3 * 4 + 1, "sqrt.rn": 0}
    yield tile_row("tiles", "lab", "32x4x4h4", GRID, False, double_counts={"": roots}, lean=False)
    for word, name in (("f32", "counts"), ("f64", "double_counts")):  # borders pass by the first-level cache
        words = "st.release.gpu.global.s32", "ld.acquire.gpu.global.s32", f"ld.relaxed.gpu.global.v2.{word}"
        yield tile_row(
            "resident", "lab", "32x8x4h4", GRID, True, **{name: {"": dict.fromkeys(words, SOME)}}, lean=False
        )


def tile_row(name: str, integrator: str, tile: str, parts: frozenset[str], is_cut: bool, **more: Any) -> Row:
    """Of a kernel of the grid that keeps tiles on the chip."""
    variant = integrator, parts, parsed_tile(tile), is_cut
    if name == "resident":
        return Row("mass_spring.grid.resident:make_resident", {"": RESIDENT}, variant, **more)
    return Row("mass_spring.grid.tiles:make_tile_pass", {"": TILES}, (*variant, name == "one-block"), **more)


def rows() -> tuple[Row, ...]:
    """The whole table."""
    tables = (
        clusters,
        contacts_of_particles,
        colliders,
        contacts_of_surfaces,
        cloths,
        sheets,
        meshes,
        tetrahedra,
        fluids,
        grids,
    )
    return tuple(row for table in tables for row in table())
