"""What the lab book may say of one thing against another: GPU and CPU, drawing and not, shapes; and how far to trust it.

See labbook/claims/claim.py for the rules.
"""

from __future__ import annotations

from collections.abc import Callable

from labbook import words
from labbook.claims.claim import Claim, clearly, cpu_source, on_gpu
from labbook.words import masses, percent, times
from plots.core.data import Results, is_wrong
from plots.core.shapes import shape_ratios
from plots.figures.crossover import crossing, pairs
from plots.figures.graphics import drawing_costs, skipped_reason


def overtakes(results: Results) -> Claim:
    """From which size on the GPU is faster than the CPU's fastest thread count, and by how much at the largest."""
    source = next((s for s in (*results.featured, *results.background) if pairs(s)), None)
    if source is None:
        return Claim("GPU and CPU were not compared: no machine in the data has timed both.")
    found = pairs(source)
    first, last = found[0], found[-1]
    where = crossing(found)
    numbers = {"ratio": last.ratio, "masses": last.gpu.particles, "crossing": where or 0.0}
    start = f"{on_gpu(source)}, against the fastest thread count of the {source.processor}:"
    at_last = f"at {masses(last.gpu.particles)}, the largest size that both ran,"
    if not last.clear:
        return Claim(f"{start} {at_last} there is no difference beyond the spread.", numbers, False)
    if last.ratio < 1:
        text = f"{start} {at_last} the GPU's step takes {times(1 / last.ratio)} as long as the CPU's."
    elif where:
        text = (
            f"{start} the GPU overtakes at about {masses(where, exact=False)}, and {at_last} its step is "
            f"{times(last.ratio)} as fast."
        )
    else:
        text = (
            f"{start} the GPU is ahead from {masses(first.gpu.particles)} on, the smallest size, where it is "
            f"{times(first.ratio)} as fast; {at_last} it is {times(last.ratio)} as fast."
        )
    return Claim(text, numbers, True)


def drawing(results: Results) -> Claim:
    """What drawing costs at the largest grid that was timed with it, on each backend."""
    parts, numbers = [], {}
    for source, backend, word, name in (
        (cpu_source(results), "cpu", "1x", "the CPU"),
        (results.with_gpu(), "gpu", None, "the GPU"),
    ):
        costs = drawing_costs(source, backend, word) if source else []
        both = [pair for pair in costs if not any(is_wrong(timing) for timing in pair)]
        if source is None or not both:
            continue
        without, drawn = both[-1]
        numbers[backend] = drawn.median / without.median
        label = name if source.own or backend == "cpu" else f"{name} (committed measurements)"
        if clearly(drawn, without) > 0:
            parts.append(
                f"on {label} a step with drawing takes {times(drawn.median / without.median)} as long as without, at "
                f"{masses(without.particles)}"
            )
        else:
            parts.append(f"on {label} drawing costs no more than the spread, at {masses(without.particles)}")
    if not parts:
        reason = skipped_reason(results)
        return Claim("Nothing was timed with graphics" + (f": {reason.rstrip('.')}." if reason else "."))
    text = words.listed(parts)
    return Claim(text[0].upper() + text[1:] + ".", numbers, True)


def overtakes_drawing(results: Results) -> Claim:
    """GPU against CPU with graphics."""
    source = next((s for s in (*results.featured, *results.background) if pairs(s, graphics=True)), None)
    if source is None:
        return Claim("GPU and CPU were not compared with graphics.")
    last = pairs(source, graphics=True)[-1]
    at = f"With graphics, at {masses(last.gpu.particles)},"
    if not last.clear:
        return Claim(f"{at} GPU and CPU differ by no more than the spread.", {"ratio": last.ratio}, False)
    if last.ratio > 1:
        return Claim(f"{at} the GPU's step is {times(last.ratio)} as fast as the CPU's.", {"ratio": last.ratio}, True)
    return Claim(f"{at} the CPU's step is {times(1 / last.ratio)} as fast as the GPU's.", {"ratio": last.ratio}, True)


def shape(results: Results) -> Claim:
    """Whether long, tall and odd grids cost more than squares, on the CPU with 1x threads."""
    source = cpu_source(results)
    found = shape_ratios(source, "cpu", "1x") if source else []
    if not found:
        return Claim("Whether the shape of the grid matters was not measured.")
    ratios = [timing.median / square for timing, square in found]
    off = [timing for timing, square in found if timing.low > square or timing.high < square]
    numbers = {"least": min(ratios), "most": max(ratios), "off": len(off)}
    start = f"Against squares of as many masses, the {len(found)} long, tall and odd grids"
    if not off:
        return Claim(f"{start} show no difference beyond the spread.", numbers, False)
    text = f"{start} take between {percent(min(ratios))} and {percent(max(ratios))} of the time on the CPU."
    return Claim(text, numbers, True)


def trust(results: Results) -> Claim:
    """How many of the timings are suspect or wrong."""
    everything = [timing for source in results.featured for timing in source.timings]
    if not everything:
        return Claim("Nothing was timed.")
    wrong = sum(is_wrong(timing) for timing in everything)
    suspect = sum(bool(timing.suspect) for timing in everything)
    checked = sum(timing.error is not None for timing in everything)
    text = (
        f"Of the {len(everything)} configurations timed for this book, {checked} were held against the reference, "
        f"{wrong or 'none'} gave a wrong answer, and {suspect or 'none'} {'is' if suspect == 1 else 'are'} suspect."
    )
    return Claim(text, {"timed": len(everything), "wrong": wrong, "suspect": suspect, "checked": checked}, True)


CLAIMS: dict[str, Callable[[Results], Claim]] = {
    "overtakes": overtakes,
    "drawing": drawing,
    "overtakes-drawing": overtakes_drawing,
    "shape": shape,
    "trust": trust,
}
