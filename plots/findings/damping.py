"""The finding about dampers: taken explicitly, they cost velocity Verlet an order; implicit in the second half kick, none."""

from __future__ import annotations

from bench.experiments.findings import DAMPERS, DAMPING
from plots.core.data import Results
from plots.core.style import BLUE, GREY, VERMILLION, Drawing, legend_below, new_figure
from plots.findings.points import of_finding

TITLE = "What a damper costs velocity Verlet"
CURVES = {  # scheme: label, colour, marker, order
    DAMPERS[0]: ("damper implicit in the second half kick", BLUE, "o", 2),
    DAMPERS[1]: ("damper explicit", VERMILLION, "s", 1),
}


def draw(results: Results) -> Drawing | str:
    """The figure, or why there is none."""
    source, found = of_finding(results, DAMPING)
    if source is None:
        return "velocity Verlet's dampers were not measured"
    figure, (ax,) = new_figure()
    steps = sorted({row.dt for row in found})
    for scheme, (label, colour, marker, order) in CURVES.items():
        mine = [row for row in found if row.scheme == scheme]
        if not mine:
            continue
        ax.plot([r.dt for r in mine], [r.value for r in mine], marker=marker, color=colour, label=label)
        anchor = mine[0]
        line = [0.6 * anchor.value * (dt / anchor.dt) ** order for dt in steps]
        ax.plot(steps, line, color=GREY, linewidth=0.7, zorder=1)
        ax.annotate(f"order {order}", (steps[0], line[0]), (0, -3), textcoords="offset points", fontsize=7,
                    color="#555555", va="top")  # fmt: skip
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xticks(steps, [f"{1000 * dt:g}" for dt in steps])
    ax.set_xticks([], minor=True)
    ax.set_xlabel("step size / ms")
    ax.set_ylabel("error / spacings")
    ax.margins(y=0.1)
    legend_below(figure, [ax])
    caption = (
        "Error of velocity Verlet against step size on S2 in float64: with the damper taken at the half step's velocity, as "
        "the plain scheme has it, and with the damper implicit in the second half kick, as the lab has it. Thin: slopes."
    )
    return Drawing(figure, TITLE, caption, (source,))
