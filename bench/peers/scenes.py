"""Scenes for comparisons, which the lab and its peers can run alike, each with a word.

A sheet has the same material and spacing at every size. Cloth by implicit Euler is the same sheet at three step sizes,
of one, four and sixteen steps in 1/60 s: there the peers are iterative solvers, whose error grows with the step. Rigid
bodies are n x n towers of ten beams that fall 1 cm on each other and come to rest. Tetrahedra are a bar fixed at one
end, n voxels across and five times as many long; and, at three Young's moduli, the bar of bars/tip.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from softlab.bench.experiments.checks import CHECK_STEPS
from softlab.bench.experiments.sweep import Shape, shapes
from softlab.bench.peers.bars.tip import ACROSS, BARS, NEAR, Tip, bar_of, exact_tip
from softlab.model.base.errors import SceneError
from softlab.model.base.table import Table, Tables
from softlab.model.scene.scene import Scene, load_scene

GRID_SQUARES = tuple(32 << k for k in range(9))  # 32 ... 8192
CLOTH_SQUARES = (32, 64, 128, 256, 512, 1024)
IMPLICIT_SQUARES = (32, 64, 128, 256)
QUICK_SQUARES = (32, 128, 512)
UNDAMPED = {f"{kind}.damping": 0.0 for kind in ("structural", "shear", "bending")}


TOWER_SQUARES = (1, 4, 16)
BAR_SQUARES = (2, 4, 8, 16)
VOXEL, SLENDER = 0.1, 5  # m; ratio of length to width
LAYERS = 10  # beams per tower
REST = 120  # steps of 1/60 s after which a tower is at rest
TOWERS: Table = {
    "title": "Towers of rigid beams",
    "beams": {
        "kind": "rigid_body", "shape": {"name": "beam"}, "particle_spacing": 0.125, "volume_sampling": 1.0,
        "surface_sampling": 0.0, "density": 500.0, "origin": [0.0, 0.135, 0.0], "apart": [1.5, 0.26, 0.75],
    },
    "contact": {"static_friction": 0.6, "dynamic_friction": 0.5, "sleeping_speed": 0.005},
    "plane": {"thickness": 0.0625, "static_friction": 0.6, "dynamic_friction": 0.5},
    "gravity": {"acceleration": 9.81},
    "method": {"solver": "shape-matching", "dt": 1 / 60, "substeps": 8, "iterations": 2},
}  # fmt: skip


@dataclass(frozen=True)
class PeerScene:
    """A scene for comparisons.

    `word`: its name in options; `text`: for tables; `make(rows, columns)`: the scene; `squares`: masses (towers) per
    side of a full sweep; `check_steps`: number of steps after which states are compared, fewer for sheets of very many
    masses; `bound` [spacings]: largest distance of any peer, None for rounding; `tip`: the exact result, for scenes
    that have one.
    """

    word: str
    text: str
    make: Callable[[int, int], Scene]
    squares: tuple[int, ...]
    check_steps: int = CHECK_STEPS
    bound: float | None = None
    tip: Callable[[Scene], Tip] | None = None

    def sized(self, quick: bool, sizes: Iterable[int | Shape] | None) -> list[Scene]:
        """Return the scene at every size, smallest first. Raises SceneError for an impossible one."""
        usual = tuple(n for n in self.squares if n <= QUICK_SQUARES[-1])[:2] if quick else self.squares
        chosen = sizes if sizes is not None else QUICK_SQUARES if quick and self.word == "grid" else usual
        return [self.make(*shape) for shape in shapes(quick, chosen)]


def _sheet(catalogue: str, changes: Mapping[str, object] | None = None) -> Callable[[int, int], Scene]:
    def make(rows: int, columns: int) -> Scene:
        base = load_scene(catalogue)
        table = "grid" if base.cloth is None else "cloth"
        return base.replace({f"{table}.rows": rows, f"{table}.columns": columns} | dict(changes or {}))

    return make


def _implicit(steps: int) -> PeerScene:
    dt = 1 / (60 * steps)
    make = _sheet("cloth-warp", UNDAMPED | {"method.integrator": "implicit-euler", "method.dt": dt})
    return PeerScene(f"implicit-{steps}", f"cloth by implicit Euler, {1000 * dt:.3g} ms a step", make, IMPLICIT_SQUARES)


def _towers(rows: int, columns: int) -> Scene:
    beams = TOWERS["beams"] | {"copies": [columns, LAYERS, rows]}
    return Scene(TOWERS | {"beams": beams})


def _bar(rows: int, columns: int) -> Scene:
    sides = [VOXEL * SLENDER * columns, VOXEL * rows, VOXEL * rows]
    body = {
        "kind": "tetrahedral_body", "shape": {"name": "box", "sides": sides}, "edge": VOXEL, "material": "neo-hookean",
        "young_modulus": 1e5, "poisson_ratio": 0.4, "pinned": ["left"],
    }  # fmt: skip
    return Scene({"bar": body, "gravity": {}, "method": {"solver": "xpbd", "dt": 1 / 60, "substeps": 20}})


TWENTY = {"method.ordering": "gauss-seidel", "method.substeps": 2, "method.iterations": 10}
SCENES = {
    scene.word: scene
    for scene in (
        PeerScene("grid", "grid", _sheet("lab-grid"), GRID_SQUARES),
        PeerScene("cloth", "cloth by semi-implicit Euler", _sheet("cloth-warp"), CLOTH_SQUARES),
        PeerScene("xpbd", "cloth by XPBD", _sheet("cloth-xpbd", TWENTY), CLOTH_SQUARES, check_steps=20),
        *(_implicit(steps) for steps in (16, 4, 1)),
        PeerScene("tetrahedra", "bars of tetrahedra by XPBD", _bar, BAR_SQUARES, check_steps=20),
        *(
            PeerScene(
                word,
                f"bars of tetrahedra, {young:.0e} Pa".replace("e+0", "e"),
                bar_of(young, substeps),
                ACROSS,
                bound=NEAR,
                tip=exact_tip,
            )
            for word, (young, substeps) in BARS.items()
        ),
        PeerScene("rigid", "towers of rigid beams", _towers, TOWER_SQUARES, check_steps=REST, bound=0.1),
    )
}


def peer_scenes(words: Iterable[str] | None, quick: bool) -> list[PeerScene]:
    """Return the scenes by word, or by the common prefix of several words.

    Without words: all of them, or only the grid in a quick sweep. Raises SceneError.
    """
    asked = list(words) if words is not None else ["grid"] if quick else list(SCENES)
    chosen: list[str] = []
    for word in asked:
        matches = [one for one in SCENES if one == word or one.startswith(f"{word}-")]
        if not matches:
            raise SceneError("--scene", word, f"with --peers one of {', '.join(SCENES)}")
        chosen += matches
    return [SCENES[word] for word in dict.fromkeys(chosen)]


def word_of(scene: Tables) -> str:
    """Return the word of a scene as the store describes it."""
    method = scene["method"]
    if method["solver"] == "shape-matching":
        return "rigid"
    if method["solver"] == "newton":
        return next(
            word for word, (young, _) in BARS.items() if young == _by_kind(scene)["tetrahedral_body"]["young_modulus"]
        )
    if method["solver"] == "xpbd":
        return "tetrahedra" if "tetrahedral_body" in _by_kind(scene) else "xpbd"
    if method["integrator"] == "implicit-euler":
        return f"implicit-{1 / (60 * method['dt']):.0f}"
    return "grid" if "grid" in _by_kind(scene) else "cloth"


def shape_of(scene: Tables) -> tuple[int, int]:
    """Return (rows, columns) of masses of a sheet as the store describes it; of bodies (towers, beams); of a bar
    voxels.
    """
    parts = _by_kind(scene)
    if "tetrahedral_body" in parts:
        part = parts["tetrahedral_body"]
        long, high, _ = part["shape"]["sides"]
        across = round(high / part["edge"])
        return across, across if scene["method"]["solver"] == "newton" else round(long / VOXEL / SLENDER)
    sheet = parts.get("grid") or parts.get("cloth")
    if sheet:
        return sheet["rows"], sheet["columns"]
    across, high, deep = parts["rigid_body"]["copies"]
    return across * deep, high


def _by_kind(scene: Tables) -> dict[str, Tables]:
    return {part.get("kind", name): part for name, part in scene.items() if isinstance(part, Mapping)}
