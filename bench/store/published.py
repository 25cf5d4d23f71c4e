"""Published times of frames of cloth on a GPU, for comparison with the lab's own.

Each entry is a scene of the catalogue at the published size and number of iterations. Details that the sources omit (masses,
materials, other computations) differ, so that a ratio is only an order of magnitude; the age of the GPUs is
printed with them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from softlab.model.scene.scene import Scene, load_scene


@dataclass(frozen=True)
class Published:
    """`seconds` of a step (a frame) on `processor`, by `source`; `scene` and `changes`: ours of that size."""

    source: str
    what: str
    seconds: float
    processor: str
    scene: str
    changes: dict[str, object] = field(default_factory=dict)

    def ours(self) -> Scene:
        return load_scene(self.scene).replace(self.changes)

    @cached_property
    def text(self) -> str:
        """Name of our measurement in the store."""
        return self.ours().canonical()


XPBD_2016 = "XPBD 2016, table 1"  # Macklin, Mueller, Chentanez, MIG 2016
SMALL_STEPS = "Small Steps 2019, figure 1"  # Macklin et al., SCA 2019
FLAMENCO = "Flamenco"  # Mahesh, Corse

PUBLISHED = (
    *(
        Published(
            XPBD_2016, f"{n} iterations", seconds, "GTX 1070", "cloth-xpbd", {"method.iterations": n}
        )
        for n, seconds in ((20, 0.97e-3), (40, 1.78e-3), (80, 3.34e-3), (160, 5.65e-3))
    ),
    Published(
        SMALL_STEPS, "1 x 30", 12.4e-3, "RTX 2080 Ti", "cloth-small-steps",
        {"method.substeps": 1, "method.iterations": 30},
    ),
    Published(SMALL_STEPS, "30 x 1", 13.5e-3, "RTX 2080 Ti", "cloth-small-steps"),
    Published(FLAMENCO, "30 x 30", 0.94e-3, "RTX 2080", "cloth-flamenco", {"cloth.rows": 30, "cloth.columns": 30}),
    Published(FLAMENCO, "300 x 300", 10.4e-3, "RTX 2080", "cloth-flamenco", {"cloth.rows": 300, "cloth.columns": 300}),
)  # fmt: skip
