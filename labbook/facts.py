"""Numbers of the design for the text, read from the code so that none is typed by hand.

Constants of the GPU backend are read from its source, because its import needs the CUDA package.
"""

from __future__ import annotations

import ast
from typing import Any

import numpy as np

from softlab.bench.experiments.accuracy.cases import STEP_SIZES
from softlab.bench.experiments.accuracy.judgement import RESOLVED
from softlab.bench.experiments.accuracy.points import END
from softlab.bench.experiments.checks import CHECK_COLUMNS, CHECK_ROWS, CHECK_STEPS
from softlab.bench.experiments.stability.experiment import LINKS
from softlab.bench.experiments.stability.experiment import ROWS as STABILITY_ROWS
from softlab.bench.experiments.stability.runs import END as STABILITY_END
from softlab.bench.experiments.stability.runs import TOLERANCE as STABILITY_TOLERANCE
from softlab.bench.experiments.sweep import FULL, QUICK
from softlab.bench.measure.timing import DRAW_EVERY, SHORTEST_SAMPLE
from softlab.bench.measure.words import percent, seconds
from softlab.bench.store.results import SPREAD_LIMIT
from softlab.cpu_backend.core.threads import MULTIPLES
from softlab.gpu_backend.core.sheet import BLOCK
from softlab.model.base.digest import ROOT
from softlab.model.mass_spring.plan import mass_spring_plan
from softlab.model.scene.scene import load_scene
from softlab.plots.core.apart import SMALL


def constant(module: str, name: str) -> Any:
    """Return the literal that a module assigns to `name` at top level. Raises LookupError if there is none."""
    for node in ast.parse((ROOT / module).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == name for t in node.targets):
            return ast.literal_eval(node.value)
    raise LookupError(f"{module} assigns no {name}")


def facts() -> dict[str, str]:
    """Return name in the text -> printed number."""
    passes = constant("gpu_backend/core/launch.py", "CHUNKS")
    scene = load_scene("lab-grid")
    plan = mass_spring_plan(scene)
    return {
        "block-columns": str(BLOCK[0]),
        "block-rows": str(BLOCK[1]),
        "graph-passes": str(max(passes)),
        "pair-bytes": str(np.dtype(np.complex64).itemsize),
        "pair-bytes-double": str(np.dtype(np.complex128).itemsize),
        "bytes-per-mass": str(plan.bytes(4)),
        "operations": str(plan.operations),
        "rows": str(scene.grid.rows),
        "columns": str(scene.grid.columns),
        "thread-words": ", ".join(MULTIPLES),
        "draw-every": str(DRAW_EVERY),
        "check-rows": str(CHECK_ROWS),
        "check-columns": str(CHECK_COLUMNS),
        "check-steps": str(CHECK_STEPS),
        "repeats": str(FULL.repeats),
        "repeats-quick": str(QUICK.repeats),
        "sample-seconds": seconds(FULL.min_seconds),
        "sample-seconds-quick": seconds(QUICK.min_seconds, 2),
        "shortest-sample": seconds(SHORTEST_SAMPLE, 1),
        "spread-limit": percent(SPREAD_LIMIT),
        "small-difference": percent(SMALL),
        "accuracy-end": f"{END:g}\N{NO-BREAK SPACE}s",
        "accuracy-steps": ", ".join(f"{1000 * dt:g}" for dt in STEP_SIZES) + "\N{NO-BREAK SPACE}ms",
        "resolved": str(RESOLVED),
        "stability-links": str(LINKS),
        "stability-rows": str(STABILITY_ROWS),
        "stability-end": f"{STABILITY_END:g}\N{NO-BREAK SPACE}s",
        "stability-tolerance": percent(STABILITY_TOLERANCE),
    }
