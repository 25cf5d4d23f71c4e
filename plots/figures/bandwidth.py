"""Throughput as a fraction of the machine's measured copy bandwidth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bench.store.results import Timing
from plots.core.data import Results, Source
from plots.core.style import (
    BLUE,
    GPU,
    GREEN,
    GREY,
    SKY,
    Curve,
    Drawing,
    draw_times,
    legend_below,
    log_axes,
    panels,
    plain_ticks,
)

TITLE = "Fraction of the copy bandwidth"
CURVES = (
    ("cpu", "1x", "float32", Curve("CPU 1x, float32", BLUE, "o")),
    ("cpu", "1x", "float64", Curve("CPU 1x, float64", SKY, "s", "--")),
    ("gpu", None, "float32", Curve("GPU, float32", GPU.colour, "D")),
    ("gpu", None, "float64", Curve("GPU, float64", GREEN, "P", "--")),
)


def copy_bandwidth(source: Source, backend: str) -> float | None:
    """The measured copy bandwidth of a backend's memory [B/s]; None where it was not measured."""
    return source.machine.record.get("gpu_copy_bandwidth" if backend == "gpu" else "copy_bandwidth")


def fraction(source: Source, timing: Timing, seconds: float | None = None) -> float | None:
    """Bytes that one fused pass moves, over the time of a step, over the copy bandwidth; None where one is unknown."""
    bandwidth = copy_bandwidth(source, timing.backend)
    if not bandwidth or not timing.bytes_per_step:
        return None
    return timing.bytes_per_step / (timing.median if seconds is None else seconds) / bandwidth


UNKNOWN_CACHE = 1 << 26  # B


def from_memory(source: Source, timing: Timing) -> bool:
    """Whether both buffers of a timing's state outgrow the processor's last cache, so that its bytes come from memory: what
    stays in a cache is no share of the memory's bandwidth. A cache of unknown size counts as 64 MiB."""
    caches = source.machine.record.get("caches") or {}
    on_gpu = timing.backend == "gpu"
    last = source.machine.record.get("gpu_l2_bytes") if on_gpu else caches.get("L3") or caches.get("L2")
    return (timing.bytes_per_step or 0) > (last or UNKNOWN_CACHE)


def draw(results: Results) -> Drawing | str:
    """The figure, or why there is none."""
    figure, chosen = panels(results, lambda source: any(fraction(source, t) for t in source.timings))
    if figure is None:
        return "no copy bandwidth was measured, or no timing to hold against it"
    times: list[Timing] = []
    for ax, source in chosen:
        for backend, word, precision, curve in CURVES:
            mine = [t for t in source.select(backend, word, precision) if fraction(source, t) is not None]
            if mine:
                draw_times(ax, mine, curve, _percent(source))
                times += mine
        ax.axhline(100, color=GREY, linewidth=1, zorder=1)
        log_axes(ax)
        _mark_caches(ax, source, times)
    plain_ticks(chosen[0][0].yaxis)
    chosen[0][0].set_ylabel("bytes moved / copy bandwidth / %")
    legend_below(figure, [ax for ax, _ in chosen], times)
    sources = [source for _, source in chosen]
    caption = (
        "Bytes that one step must move (every mass read and written once), over its time, as a share of the copy "
        "bandwidth measured on arrays beyond every cache. More than 100 % is possible: a grid that stays in a cache "
        "is not bound by main memory, nor a kernel that does several steps in a pass. Dotted: where the float32 state "
        "outgrows the processor's L2 and L3. "
        f"{_bandwidths(sources)}"
    )
    return Drawing(figure, TITLE, caption, tuple(sources))


def _percent(source: Source) -> Callable[[Timing, float], float]:
    return lambda timing, seconds: 100 * (fraction(source, timing, seconds) or 0.0)


def _bandwidths(sources: list[Source]) -> str:
    words = []
    for source in sources:
        for backend, name in (("cpu", "CPU"), ("gpu", "GPU")):
            bandwidth = copy_bandwidth(source, backend)
            if bandwidth:
                words.append(f"{name} {bandwidth / 1e9:.0f} GB/s")
    return f"Copy bandwidth: {', '.join(words)}. " if words else ""


def _mark_caches(ax: Any, source: Source, times: list[Timing]) -> None:
    """Where both buffers of the float32 state outgrow a cache."""
    sample = next((t for t in times if t.precision == "float32" and t.backend == "cpu" and t.bytes_per_step), None)
    if sample is None or not sample.bytes_per_step:
        return
    per_mass = sample.bytes_per_step / sample.particles  # the bytes read and the bytes written are the two buffers
    low, high = ax.get_xlim()
    for name in ("L2", "L3"):
        size = (source.machine.record.get("caches") or {}).get(name)
        if size and low < size / per_mass < high:
            ax.axvline(size / per_mass, color=GREY, linestyle=":", linewidth=1, zorder=1)
            ax.annotate(
                name, (size / per_mass, 1), (2, -2), xycoords=("data", "axes fraction"), textcoords="offset points",
                fontsize=7, color="#555555", va="top",
            )  # fmt: skip
