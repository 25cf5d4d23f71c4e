"""What a reader reads off a figure: its axes' words, and the numbers beside its ticks."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

STEP, MASSES, ERROR, COST = "step size / ms", "masses", "error / grid spacing h", "wall s / simulated s"
LIMITED = [("step size / s", "stiffness / (N/m)"), ("step size / s", ""), ("step size / s", "")]
BAR = [
    ("", "sag / a rod's"),
    ("", ""),
    ("masses along the bar", "first frequency / a rod's"),
    ("substeps of a frame", ""),
]
LABELS: dict[str, list[tuple[str, str]]] = {  # figure -> (x, y) of each panel, where both backends were measured
    "time-per-step": [(MASSES, "time per step")],
    "thread-scaling": [(MASSES, "speed-up against 1x threads")],
    "crossover": [(MASSES, "CPU time / GPU time")],
    "graphics": [(MASSES, "time per step")],
    "work-precision": [("", COST), ("", ""), (ERROR, COST), (ERROR, "")],
    "regimes": [(ERROR, MASSES), (MASSES, "CPU time / GPU time")],
    "lab-step": [(STEP, ERROR), (STEP, "")],
    "kernels": [(MASSES, "time per step"), (MASSES, "")],
    "roofline": [(MASSES, "share of one step per pass / %"), (MASSES, "")],
    "gpus": [(MASSES, "times one GPU"), (MASSES, "mJ / million mass-steps")],
    "joules": [(MASSES, "J per million mass-steps")],
    "peers": [(MASSES, "time over the lab's"), (MASSES, "")],
    "peers-sheets": [(MASSES, "time over the lab's"), (MASSES, "")],
    "stability-stiffness": [(" ", LIMITED[0][1]), (" ", ""), (" ", ""), *LIMITED],
    "stability-damping": [
        (" ", "damping / (N s/m)"), (" ", ""), (" ", ""), ("step size / s", "damping / (N s/m)"), *LIMITED[1:],
    ],
    "findings-float32": [(STEP, ERROR), ("distance from the origin / m", "")],
    "findings-determinism": [(MASSES, "time / time of the lab's gather")],
    "convergence": [("iterations of a step", "stretch left / stretch at the start"), ("time of the step / ms", "")],
    "ablation": [("change at the end, root mean square, in spacings", "")],
    "projections": [(MASSES, "projections a second")],
    "throughput": [("particles", "particles x substeps / s")],
    "tetrahedra": [
        ("", "error at rest"), ("", ""), ("", ""), ("time of a frame / ms", "error in motion"),
        *[("time of a frame / ms", "")] * 2,
    ],
    "tetrahedra-decides": [("time of a frame / ms", "error in motion"), *[("time of a frame / ms", "")] * 2],
    "tetrahedra-total": [("time of a frame / ms", "mesh + solver")],
    "tetrahedra-mesh": [("voxels across the bar", "sag / the continuum's"), ("substep / ms", "amplitude lost / (1/s)")],
    "fluids-truth": [
        ("time of a frame / ms", "mean density error"), ("time of a frame / ms", "worst error of the front"),
        ("rest distance / m", "viscosity by itself / (m²/s)"),
    ],
    "fluids-phases": [("nanoseconds a particle", "")] * 2,
    "fluids-rest": [
        ("", "tank: rms / √(g H)"), *[("", "")] * 2, ("", "tank: gain / g H"), *[("", "")] * 2,
        ("time / s", "box: rms / √(g H)"), *[("time / s", "")] * 2,
    ],
    "hard-states": [],  # pictures
    "hard-verdicts": [],
    "hard-bodies": [("measured over its bound", "")],
    "bar-solvers": BAR,
    "bar-costs": [("time of a frame / ms", f"{what} off a rod's") for what in ("sag", "first frequency")],
    "bar-clusters": [
        ("masses along the strip", "sag / a rod's"), ("overlap: cluster radius / cluster spacing", "over a rod's"),
    ],
}  # fmt: skip
MINUS = "\N{MINUS SIGN}"
PREFIX = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3}


def labels(figure: Any) -> list[tuple[str, str]]:
    """(x, y) of every panel."""
    return [(ax.get_xlabel(), ax.get_ylabel()) for ax in figure.axes]


def number(text: str) -> float:
    """What a tick's text says, in seconds where it says a time: `2.5`, `10^{-3}` as matplotlib writes it, `20 µs`."""
    power = re.fullmatch(r"\$\\mathdefault\{10\^\{(.*)\}\}\$", text)
    if power:
        return 10.0 ** int(power[1].replace(MINUS, "-"))
    found = re.fullmatch(r"([-\d.e]+)\s?(?:([nµmk]?)s)?", text.replace(MINUS, "-"))
    assert found, text
    return float(found[1]) * PREFIX[found[2] or ""]


def shown(axis: Any, values: Any) -> np.ndarray:
    """What an axis says that these data are: its ticks' numbers over where they stand, to what these are rounded to."""
    places = np.array(axis.get_majorticklocs())
    texts = axis.get_major_formatter().format_ticks(places)
    told = {place: number(text) for place, text in zip(places, texts, strict=True) if text and place}
    assert told, "an axis without ticks"
    ratios = np.array([value / place for place, value in told.items()])
    assert np.ptp(ratios) < 0.05 * abs(ratios).max(), "ticks that do not stand where they say"
    return np.asarray(values, float) * np.median(ratios)


def line(ax: Any, label: str) -> tuple[np.ndarray, np.ndarray]:
    """What a reader takes from one curve: (x, y), in the axes' units."""
    (found,) = [one for one in ax.lines if one.get_label() == label]
    return shown(ax.xaxis, found.get_xdata()), shown(ax.yaxis, found.get_ydata())
