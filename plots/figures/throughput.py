"""Figure of particles of bodies per second: clusters alone, with contacts, and of a grid."""

from __future__ import annotations

from functools import partial

from softlab.bench.experiments.throughput import points
from softlab.plots.core.backends import draw_rates, name_of, on_backends, sources_of, timed
from softlab.plots.core.colours import BLUE, GREEN, ORANGE, PURPLE, VERMILLION
from softlab.plots.core.data import Results
from softlab.plots.core.style import Drawing, legend_below, log_axes, new_figure

TITLE = "Particles of bodies a second"
STYLES = {
    "rigid": ("rigid bodies: one cluster", BLUE, "o"),
    "soft": ("soft bodies: overlapping clusters", GREEN, "D"),
    "heap": ("soft bodies in a heap, with contacts", VERMILLION, "^"),
    "grid": ("jelly grid, a cluster around every mass", ORANGE, "s"),
    "lattice": ("jelly cube, a cluster around every mass", PURPLE, "P"),
}
LINES = {0: "-", 1: "-", 2: "--", 4: ":"}  # by the half-width of a grid's or a cube's clusters


panels = partial(on_backends, select=timed(points))  # (backend, source, points) of the backends that were timed


def draw(results: Results) -> Drawing | str:
    """Return the figure with a panel per backend, or the reason why there is none."""
    chosen = panels(results)
    if not chosen:
        return "bodies were not timed (softlab throughput)"
    figure, axes = new_figure(len(chosen), 3.0, sharey=False)
    for ax, (backend, source, measured) in zip(axes, chosen, strict=True):
        draw_rates(ax, measured, STYLES, LINES, lambda p: (p.kind, p.region))
        log_axes(ax, x_label="particles")
        ax.set_title(name_of(backend, source), fontsize=8)
    axes[0].set_ylabel("particles x substeps / s")
    legend_below(figure, axes, columns=2)
    caption = (
        "Particles times substeps over the time of a step, float32, one iteration: blobs of about 280 particles that fall "
        "freely, as soft and as rigid bodies, or into a heap with contacts; and the lab's grid and a cube by shape matching, "
        "their clusters 3 masses wide (solid), 5 (dashed) or 9 (dotted)."
    )
    return Drawing(figure, TITLE, caption, sources_of(chosen))
