"""What is run side by side: scenes that the lab and others can be given alike, each by a word.

A sheet keeps its material and its spacing at every size. Cloth by implicit Euler is the same sheet at three step sizes, of
one, four and sixteen steps in a sixtieth of a second: there the peers are iterative solvers, whose error grows with the step.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from bench.experiments.checks import CHECK_STEPS
from bench.experiments.sweep import shapes
from model.core.errors import SceneError
from model.scene.scene import Scene, load_scene

GRID_SQUARES = tuple(32 << k for k in range(9))  # 32 ... 8192
CLOTH_SQUARES = (32, 64, 128, 256, 512, 1024)
IMPLICIT_SQUARES = (32, 64, 128, 256)
QUICK_SQUARES = (32, 128, 512)
UNDAMPED = {f"{kind}.damping": 0.0 for kind in ("structural", "shear", "bending")}


@dataclass(frozen=True)
class PeerScene:
    """`word`: how it is asked for; `catalogue`: the scene it is made of, with `changes`; `squares`: masses a side of a full
    sweep; `check_steps`: after which answers are compared, fewer for sheets of very many masses; `text`: for tables."""

    word: str
    text: str
    catalogue: str
    squares: tuple[int, ...]
    changes: Mapping[str, Any] = field(default_factory=dict)
    check_steps: int = CHECK_STEPS

    def sized(self, quick: bool, sizes: Iterable[int] | None) -> list[Scene]:
        """The scene at every size, smallest first. Raises SceneError for an impossible one."""
        chosen = sizes if sizes is not None else QUICK_SQUARES if quick else self.squares
        base = load_scene(self.catalogue).replace(dict(self.changes))
        table = "grid" if base.cloth is None else "cloth"
        return [base.replace({f"{table}.rows": n, f"{table}.columns": m}) for n, m in shapes(quick, chosen)]


def _implicit(word: str, steps: int) -> PeerScene:
    changes = UNDAMPED | {"method.integrator": "implicit-euler", "method.dt": 1 / (60 * steps)}
    text = f"cloth by implicit Euler, {1000 / (60 * steps):.3g} ms a step"
    return PeerScene(word, text, "cloth-warp", IMPLICIT_SQUARES, changes)


SCENES = {
    scene.word: scene
    for scene in (
        PeerScene("grid", "grid", "lab-grid", GRID_SQUARES),
        PeerScene("cloth", "cloth by semi-implicit Euler", "cloth-warp", CLOTH_SQUARES),
        PeerScene(
            "xpbd", "cloth by XPBD", "cloth-xpbd", CLOTH_SQUARES,
            {"method.ordering": "gauss-seidel", "method.substeps": 2, "method.iterations": 10}, check_steps=20,
        ),
        _implicit("implicit-16", 16),
        _implicit("implicit-4", 4),
        _implicit("implicit-1", 1),
    )
}  # fmt: skip


def peer_scenes(words: Iterable[str] | None, quick: bool) -> list[PeerScene]:
    """Those asked for by word; without, all of them, and the grid alone in a quick sweep. Raises SceneError."""
    chosen = list(words) if words is not None else ["grid"] if quick else list(SCENES)
    for word in chosen:
        if word not in SCENES:
            raise SceneError("--scene", word, f"with --peers one of {', '.join(SCENES)}")
    return [SCENES[word] for word in dict.fromkeys(chosen)]


def word_of(scene: Mapping[str, Any]) -> str:
    """The word of a scene as the store describes it."""
    method = scene["method"]
    if method["solver"] == "xpbd":
        return "xpbd"
    if method["integrator"] == "implicit-euler":
        return f"implicit-{1 / (60 * method['dt']):.0f}"
    return (
        "grid" if any(part.get("kind", name) == "grid" for name, part in scene.items() if name != "title") else "cloth"
    )
