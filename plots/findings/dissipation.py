"""The finding about damping that nobody asked for: what a step takes from, or adds to, an undamped oscillation by itself."""

from __future__ import annotations

from functools import cache
from math import log

import numpy as np

from bench.experiments.findings import DISSIPATION, oscillator
from model.core.integrators import amplification_matrix
from plots.core.data import Results
from plots.core.style import BLACK, Drawing, legend_below, new_figure, plain_ticks
from plots.figures.work_precision import INTEGRATORS
from plots.findings.points import of_finding

TITLE = "Damping that is not in the scene"
NOTHING = 1e-10  # 1/s: rounding of the measurement; rates under it are called none


def theory(scheme: str, dt: float) -> float:
    """The rate [1/s] at which the amplitude falls (negative: grows): -ln |eigenvalue of one step| / dt.

    Of the oscillator of bench/experiments/findings.py, from the step's matrix (model/core/integrators.py).
    """
    matrix = amplification_matrix(scheme, dt, _frequency(), 0.0)
    return -log(float(np.abs(np.linalg.eigvals(matrix)).max())) / dt


@cache
def _frequency() -> float:
    """Of the oscillator [1/s], which is one of the same mass and spring under every scheme."""
    scene = oscillator("lab", 0.01)
    assert scene.springs is not None
    return float((scene.springs.stiffness / scene.grid.mass) ** 0.5)


def draw(results: Results) -> Drawing | str:
    """The figure: what is added (left) and what is taken (right), measured and by theory; or why there is none."""
    source, found = of_finding(results, DISSIPATION)
    if source is None:
        return "what a step damps by itself was not measured"
    figure, axes = new_figure(2, 3.6, share_y=False)
    steps = sorted({row.dt for row in found})
    for ax, sign, title in ((axes[0], -1, "amplitude gained"), (axes[1], 1, "amplitude lost")):
        for scheme, (colour, marker) in INTEGRATORS.items():
            mine = [row for row in found if row.scheme == scheme and sign * row.value > NOTHING]
            if not mine:
                continue
            fine = np.geomspace(steps[0], steps[-1], 40)
            ax.plot(fine, [sign * theory(scheme, dt) for dt in fine], "-", color=colour, linewidth=1)
            ax.plot([r.dt for r in mine], [sign * r.value for r in mine], marker, color=colour, label=scheme)
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xticks(steps, [f"{1000 * dt:g}" for dt in steps])
        ax.set_xticks([], minor=True)
        ax.set_xlabel("step size / ms")
        ax.set_title(title)
    plain_ticks(axes[0].yaxis)
    axes[0].set_ylabel("rate / (1/s)")
    axes[0].plot([], [], "-", color=BLACK, linewidth=1, label="theory")
    legend_below(figure, axes)
    none = [name for name in INTEGRATORS if (own := [r for r in found if r.scheme == name]) and
            all(abs(r.value) <= NOTHING for r in own)]  # fmt: skip
    caption = (
        "An undamped mass on a spring: the rate at which each integrator makes its amplitude grow (left) or fall (right) "
        "against the step size, measured (markers) and from the eigenvalues of a step (lines). "
        + (f"Not shown, because under {NOTHING:g} per second at every step size: {', '.join(none)}." if none else "")
    )
    return Drawing(figure, TITLE, caption, (source,))
