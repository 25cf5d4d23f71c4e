"""Claims of the lab book that compare: GPU and CPU, with and without drawing, shapes, peers; and on trust in the times.

Rules in labbook/claims/claim.py.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from softlab.app.render.detail import by_software
from softlab.bench.experiments.group import DRAWN_BY
from softlab.bench.measure import words
from softlab.bench.measure.declaration import Part, Sentence
from softlab.bench.measure.words import masses, percent, times
from softlab.bench.peers.registry import label
from softlab.bench.peers.results import Ratio
from softlab.labbook.claims.claim import MARK, SUSPECT, Claim, Claims, cpu_source, named, on, on_gpu, trusted
from softlab.labbook.claims.declared import by_backend
from softlab.plots.core.apart import apart, too_few
from softlab.plots.core.data import Results, Source, is_suspect, is_wrong, needed
from softlab.plots.core.pairs import shape_ratios
from softlab.plots.figures.crossover import Pair, crossing, pairs
from softlab.plots.figures.graphics import drawing_costs, skipped_reason
from softlab.plots.figures.peers import square_ratios

CLAIMS = Claims()


def compared(results: Results, graphics: bool = False) -> tuple[Source, list[Pair], str]:
    """Return (machine, pairs of timings at one size, remark on suspect times). Raises NotMeasured.

    It is the first machine that timed both backends with one version of the code; suspect times are left out if others
    remain.
    """
    source, both = needed(results.first_with(lambda source: pairs(source, graphics=graphics)))
    clean = [pair for pair in both if not (is_suspect(pair.cpu) or is_suspect(pair.gpu))]
    return source, clean or both, "" if clean else SUSPECT


NOT_COMPARED = "no machine in the data has timed both with one version of the code (softlab sweep)"


@CLAIMS.add("overtakes", f"GPU and CPU were not compared: {NOT_COMPARED}.")
def overtakes(results: Results) -> Claim:
    """Size from which the GPU is faster than the CPU's fastest thread count, and the ratio at the largest size."""
    source, usable, suspect = compared(results)
    first, last = usable[0], usable[-1]
    crossed, everything = crossing(usable), pairs(source)
    smallest, largest = (
        f"the {word} size{'' if one.gpu is other.gpu else ' that was timed undisturbed'}"
        for word, one, other in (("smallest", first, everything[0]), ("largest", last, everything[-1]))
    )
    numbers = {"ratio": last.ratio, "masses": last.gpu.particles, "crossing": crossed or 0.0, "first": first.ratio}
    start = f"{on_gpu(source)}, against the fastest thread count of the {source.processor} and at the same step:"
    at_last = f"at {masses(last.gpu.particles)}, {largest},"
    if not last.clear:
        return Claim(f"{start} {at_last} there is no difference beyond measurement noise{suspect}.", numbers, False)
    if last.ratio < 1:
        text = f"{start} {at_last} the GPU's step takes {times(1 / last.ratio)} as long as the CPU's"
    elif crossed:
        text = (
            f"{start} the GPU overtakes at about {masses(crossed, exact=False)}, and {at_last} its step is "
            f"{times(last.ratio)} as fast"
        )
    else:
        text = (
            f"{start} the GPU is ahead from {masses(first.gpu.particles)} on, {smallest}, where it is "
            f"{times(first.ratio)} as fast; {at_last} it is {times(last.ratio)} as fast"
        )
    return Claim(f"{text}{suspect}.", numbers, True)


@CLAIMS.add("drawing")
def drawing(results: Results) -> Claim:
    """Cost of drawing at the largest grid that was timed with it, on each backend."""
    parts, numbers = [], {}
    for source, backend, word in (
        (cpu_source(results), "cpu", "1x"),
        (results.with_gpu(), "gpu", None),
    ):
        costs = drawing_costs(source, backend, word) if source else []
        both, suspect = trusted([pair for pair in costs if not any(is_wrong(timing) for timing in pair)])
        if source is None or not both:
            continue
        without, drawn = both[-1]
        numbers[backend] = drawn.median / without.median
        label = f"on the {named(source, backend)}"
        if apart(drawn, without) > 0:
            parts.append(
                f"{label}, a step with drawing takes {times(drawn.median / without.median)} as long as without, at "
                f"{masses(without.particles)}{suspect}"
            )
        elif too_few(drawn, without):
            parts.append(f"{label} there are too few repeats to tell, at {masses(without.particles)}{suspect}")
        else:
            parts.append(
                f"{label} drawing costs no more than measurement noise, at {masses(without.particles)}{suspect}"
            )
    reason = skipped_reason(results)
    text = words.listed(
        needed(parts, "Nothing was timed with graphics" + (f": {reason.rstrip('.')}." if reason else "."))
    )
    return Claim(text[0].upper() + text[1:] + ".", numbers, True)


@CLAIMS.add("renderer", "The store does not say which renderer drew.")
def renderer(results: Results) -> Claim:
    """Renderer of the pictures that were timed, and how the state of each backend got to it."""
    source, drawn_by = needed(results.first_with(lambda one: [m for m in one.measures if m.name == DRAWN_BY]))
    paths: dict[str, Counter[tuple[str, str]]] = {}
    for measure in drawn_by:
        for name, path in re.findall(r"(.*), (\d+ x \d+ pixels, .*)", measure.reason or ""):
            paths.setdefault(measure.backend, Counter())[name, path] += 1
    usual = {backend: counts.most_common(1)[0][0] for backend, counts in sorted(paths.items())}
    parts = []
    for name in dict.fromkeys(name for name, _ in usual.values()):
        kind = "a renderer in software" if by_software(name) else "a graphics processor"
        of_state = [f"{path}, for the {backend.upper()}" for backend, (drawn, path) in usual.items() if drawn == name]
        parts.append(f"{name} ({kind}; {'; '.join(of_state)})")
    numbers = {backend: float(sum(counts.values())) for backend, counts in paths.items()}
    machine = named(source, "gpu" if source.gpu else "cpu")
    return Claim(f"On the machine of the {machine} the pictures were drawn by {words.listed(parts)}.", numbers, True)


@CLAIMS.add("overtakes-drawing", "GPU and CPU were not compared with graphics.")
def overtakes_drawing(results: Results) -> Claim:
    """GPU compared with CPU with graphics: the size up to which the CPU is ahead, and the largest size."""
    source, usable, suspect = compared(results, graphics=True)
    last = usable[-1]
    ahead = [pair for pair in usable if pair.clear and pair.ratio < 1]
    numbers = {"ratio": last.ratio, "masses": last.gpu.particles, "cpu ahead": ahead[-1].gpu.particles if ahead else 0}
    start = f"{on_gpu(source)} and the {source.processor}, with graphics"
    if ahead and ahead[-1] is last:
        text = (
            f"{start} the CPU's step is the faster up to {masses(last.gpu.particles)}, the largest size that both ran"
        )
        return Claim(f"{text}, there {times(1 / last.ratio)} as fast{suspect}.", numbers, True)
    text = f"{start} the CPU is ahead up to {masses(ahead[-1].gpu.particles)}; at" if ahead else f"{start}, at"
    text = f"{text} {masses(last.gpu.particles)}"
    if not last.clear:
        return Claim(f"{text} GPU and CPU differ by no more than measurement noise{suspect}.", numbers, bool(ahead))
    return Claim(f"{text} the GPU's step is {times(last.ratio)} as fast as the CPU's{suspect}.", numbers, True)


@CLAIMS.add("crossing-drawing", "Where the GPU overtakes with graphics was not measured.")
def crossing_drawing(results: Results) -> Claim:
    """Size at which the GPU overtakes with graphics, interpolated between two sizes."""
    _, measured = needed(results.first_with(lambda one: pairs(one, graphics=True)))
    crossed = crossing(measured)
    doubtful = sum(is_suspect(pair.cpu) or is_suspect(pair.gpu) for pair in measured)
    marked = f" ({words.count(doubtful)} of the {len(measured)} sizes rest on suspect times)" if doubtful else ""
    if crossed is None:
        side = "GPU" if measured[-1].ratio >= 1 else "CPU"
        text = f"With graphics there is no crossing: the {side} is the faster at the largest size{marked}."
        return Claim(text, {"crossing": 0.0, "ratio": measured[-1].ratio}, False)
    text = f"With graphics the CPU is the faster below about {masses(crossed, exact=False)}, the GPU above{marked}."
    return Claim(text, {"crossing": crossed, "ratio": measured[-1].ratio}, True)


@CLAIMS.add("shape", "Whether the shape of the grid matters was not measured.")
def shape(results: Results) -> Claim:
    """Cost of long, tall and odd grids over that of squares, on the CPU with 1x threads."""
    source = needed(cpu_source(results))
    everything = needed(shape_ratios(source, "cpu", "1x"))
    clean = [(timing, square) for timing, square in everything if not is_suspect(timing)]
    usable, suspect = (clean, "") if clean else (everything, SUSPECT)
    ratios = [timing.median / square for timing, square in usable]
    off = [timing for timing, square in usable if timing.low > square or timing.high < square]
    numbers = {"least": min(ratios), "most": max(ratios), "off": len(off)}
    start = f"{on(source, 'cpu')}, against squares of as many masses, {len(usable)} long, tall and odd grids"
    if not off:
        return Claim(f"{start} show no difference beyond measurement noise{suspect}.", numbers, False)
    text = f"{start} take between {percent(min(ratios))} and {percent(max(ratios))} of the time{suspect}."
    return Claim(text, numbers, True)


@CLAIMS.add("trust", "Nothing was timed.")
def trust(results: Results) -> Claim:
    """Number of timings that are suspect or wrong."""
    everything = needed([timing for source in results.featured for timing in source.timings])
    wrong = sum(is_wrong(timing) for timing in everything)
    suspect = sum(bool(timing.suspect) for timing in everything)
    checked = sum(timing.error is not None for timing in everything)
    costs = [timing for source in results.featured for timing in source.costs.values()]
    doubtful = sum(bool(timing.suspect) for timing in costs)
    accuracy = f", and of the {len(costs)} times of accuracy runs {doubtful or 'none'}" if costs else ""
    text = (
        f"Of the {len(everything)} configurations timed for this book, {checked} were compared with the reference, "
        f"{wrong or 'none'} gave a wrong answer, and {suspect or 'none'} {'is' if suspect == 1 else 'are'} suspect"
        f"{accuracy}; sentences use those only where they say so."
    )
    left_out = sum(source.left_out for source in results.featured)
    if left_out:
        text += f" {words.count(left_out)} more are of another version of the code and not used."
    numbers = {"timed": len(everything), "wrong": wrong, "suspect": suspect, "checked": checked, "left out": left_out}
    return Claim(text, numbers, True)


def peers(ratios: Sequence[Ratio]) -> Part | None:
    """Time of a step of the grid by peers over the lab's, at the largest size that most of them ran."""
    right = [one for one in ratios if not one.wrong]
    sizes = [one.particles for one in right]
    size = max(sizes, key=lambda n: (sizes.count(n), n), default=0)
    here = sorted((one for one in right if one.particles == size), key=lambda one: one.ratio)
    factors = []
    for one in here:
        mark = MARK if one.suspect and not all(each.suspect for each in here) else ""
        same = one.low <= 1 <= one.high
        long = "as long, within measurement noise," if same else f"{times(one.ratio)} as long"
        factors.append(f"{long} with {label(one.peer)}{mark}")
    if not factors:
        return None
    suspect = SUSPECT if all(one.suspect for one in here) else ""
    return f"at {masses(size)}, {words.listed(factors)}{suspect}", {one.peer: one.ratio for one in here}


CLAIMS["peers"] = by_backend(square_ratios, Sentence(
    "Compared with the lab, a step of the grid takes, {}.", peers, "Nothing was timed beside the lab.",
    form="on {place}, {part}", join="; ".join,
))  # fmt: skip
