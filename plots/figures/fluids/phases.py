"""Figure of the time of each stage of a fluid, with the lower limits by memory and arithmetic."""

from __future__ import annotations

import numpy as np

from softlab.bench.experiments.fluids import PHASES, QUICK, SCHEMES, Fluids, moved_bytes, operations, pool
from softlab.bench.measure.case_timing import Row
from softlab.model.fluid.plan import neighbours_at_rest
from softlab.plots.core.backends import name_of, on_backends, sources_of, timed
from softlab.plots.core.colours import BLACK, BLUE, ORANGE
from softlab.plots.core.data import Results, Source, needed
from softlab.plots.core.style import Drawing, as_figure, new_figure

UNKNOWN = "what the machine copies and computes a second was not measured: softlab sweep --kernels"
LABELS = ("nanoseconds a particle", "")
HALF = 0.5  # of the measured arithmetic rate, which sums of products and roots do not exceed


def on(source: Source, backend: str) -> list[Row]:
    """Return the pools whose stages were timed with the scheme of these stages, smallest first."""
    pools = timed(Fluids().rows)(source, backend)
    return [p for p in pools if p.phases and p.scheme == SCHEMES[0] and p.precision == "float32"]


def rates(source: Source, backend: str) -> tuple[float, float] | None:
    """Return the measured (bytes/s, floating-point operations/s) of the machine; None where they are missing."""
    prefix, record = "gpu_" if backend == "gpu" else "", source.machine.record
    arithmetic = (record.get(f"{prefix}arithmetic") or {}).get("float32")
    copied = record.get(f"{prefix}copy_bandwidth")
    return (float(copied), HALF * float(arithmetic)) if copied and arithmetic else None


def least(point: Row, phase: str, limits: tuple[float, float]) -> tuple[float, str]:
    """Return (lower limit [s] of a stage for all particles, its cause)."""
    scene = pool(min(QUICK))  # a particle costs the same in any pool
    moved = moved_bytes(phase, neighbours_at_rest(scene)) * point.particles / limits[0]
    done = operations(scene, phase) * point.particles / limits[1]
    return (moved, "memory") if moved >= done else (done, "arithmetic")


@as_figure("fluids-phases", "Fluids: stages against their limits", "stages of fluids were not timed: softlab fluids")
def draw(results: Results) -> Drawing:
    """Return the figure with a panel per backend, of its largest pool, or the reason why there is none."""
    chosen = [(b, s, pools[-1]) for b, s, pools in on_backends(results, on) if rates(s, b)]
    needed(chosen, UNKNOWN if on_backends(results, on) else "")
    figure, axes = new_figure(len(chosen), 2.6, sharey=True)
    for ax, (backend, source, point) in zip(axes, chosen, strict=True):
        limits = needed(rates(source, backend))
        shown = [phase for phase in PHASES if phase in point.phases]
        places = np.arange(len(shown))
        taken = [1e9 * point.phases[phase] / point.particles for phase in shown]
        allowed = [least(point, phase, limits) for phase in shown]
        ax.barh(places - 0.2, taken, 0.38, color=BLUE, label="alone")
        ax.barh(places + 0.2, [1e9 * s / point.particles for s, _ in allowed], 0.38, color=ORANGE, label="least")
        for place, (seconds, limit) in zip(places, allowed, strict=True):
            ax.text(1e9 * seconds / point.particles * 1.15, place + 0.2, limit, va="center", fontsize=7, color=BLACK)
        ax.set_yticks(places, shown)
        ax.set_xscale("log")
        ax.set_xlabel(LABELS[0])
        particles = f"{point.particles:,}".replace(",", " ")
        ax.set_title(f"{name_of(backend, source)}, {particles} particles", fontsize=8)
    axes[0].invert_yaxis()
    axes[0].legend(loc="lower right", fontsize=7)
    caption = (
        "A pool at rest, each stage of a substep by itself: what it takes, and the least that the machine's measured "
        "copying, or half of its measured arithmetic, allows, were neighbours' positions in a cache. float32, fast math."
    )
    return Drawing(figure, caption, sources_of(chosen))
