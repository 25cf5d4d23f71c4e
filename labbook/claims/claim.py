"""Claims of the lab book: functions of the results that return a sentence made from the data.

A claim is `supported` if the things it compares differ (plots/core/apart.py), or if the number it needs was measured.
Otherwise its sentence is neutral: no difference beyond measurement noise, or not measured (`needed`). Timings with a wrong
result are not used; suspect ones only where there are no others, and then the sentence says so. Every sentence names the
machine of its numbers. This file has the claims on threads and on each backend by itself; comparisons and accuracy have
files of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from inspect import unwrap

from softlab.bench.experiments.accuracy.points import AccuracyPoint
from softlab.bench.measure import words
from softlab.bench.measure.words import masses, percent, seconds, times
from softlab.bench.store.results import Timing
from softlab.plots.core.apart import apart, too_few
from softlab.plots.core.bandwidth import copy_bandwidth, disturbed, fraction
from softlab.plots.core.data import THREAD_WORDS, NotMeasured, Results, Source, is_suspect, needed, sound
from softlab.plots.core.pairs import at_one_size, float64_pairs

FLAT = 1.5  # a time that grew by less than this factor counts as constant


@dataclass(frozen=True)
class Claim:
    """`sentence`: one or two complete sentences; `numbers`: their input; `supported`: by the data."""

    sentence: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    supported: bool = False


Maker = Callable[..., Claim]  # a function of the results


class Claims(dict[str, Maker]):
    """Claims of a module by name."""

    def add(self, name: str, missing: str = "", arguments: Sequence[object] = ()) -> Callable[[Maker], Maker]:
        """Add the claim `name`: a function of the results, with these further arguments.

        `missing`: the sentence if something was not measured (`needed`), unless that gives one of its own.
        """

        def added(make: Maker) -> Maker:
            @wraps(make)
            def caught(*args: object) -> Claim:
                try:
                    return unwrap(make)(*args)  # of several claims of one function each has its own sentence
                except NotMeasured as reason:
                    return Claim(str(reason) or missing)

            self[name] = lambda results: caught(results, *arguments)
            return caught

        return added


CLAIMS = Claims()


def cpu_source(results: Results) -> Source | None:
    """Return the machine whose CPU times the text quotes: the first featured one with any, at least of forced kernels."""
    for kind in ("timings", "kernels"):
        for source in results.featured:
            if any(timing.backend == "cpu" for timing in getattr(source, kind)):
                return source
    return None


def on_gpu(source: Source) -> str:
    """Return e.g. `On the NVIDIA H200`, with a mark if the measurements are the committed ones and not the reader's."""
    return on(source, "gpu")


def on(source: Source, backend: str) -> str:
    """Return the same phrase for either processor, e.g. `On the AMD EPYC, 2 cores`."""
    return f"On the {named(source, backend)}"


def named(source: Source, backend: str) -> str:
    """Return e.g. `NVIDIA H200 (committed)`: the reader's machine and a committed one never have the same label."""
    return f"{source.device(backend)}{source.bracket}"


def where(backend: str, source: Source) -> str:
    """Return e.g. `the GPU (NVIDIA H200)`."""
    return f"the {backend.upper()} ({source.device(backend)}{source.label and ', '}{source.label})"


def committed_of(sources: Iterable[Source], backend: str) -> str:
    """Return ` (committed)` if the first source that ran a backend is not the reader's, else an empty string."""
    ran = (source for source in sources if any(measure.backend == backend for measure in source.measures))
    return next((source.bracket for source in ran), "")


MARK = " (suspect)"  # for one of several in a sentence
SUSPECT = " (from times that are marked as suspect)"


def trusted(comparisons: Sequence[tuple[Timing, ...]]) -> tuple[list[tuple[Timing, ...]], str]:
    """Return the comparisons without a suspect time and an empty string.

    If every comparison has a suspect time: all of them, and the words that say so.
    """
    clean = [timings for timings in comparisons if not any(is_suspect(timing) for timing in timings)]
    return (clean, "") if clean else (list(comparisons), SUSPECT if comparisons else "")


def suspicion(points: Iterable[AccuracyPoint | None], said: str = SUSPECT) -> str:
    """Return `said` if the time of any of the accuracy runs is suspect, else an empty string."""
    return said if any(point is not None and point.suspect for point in points) else ""


# ---------------------------------------------------------------------- threads


def thread_pairs(source: Source, word: str) -> list[tuple[Timing, Timing]]:
    """Return (1x, `word`) timings of one size, smallest first."""
    return at_one_size(sound(source.select("cpu", "1x")), sound(source.select("cpu", word)))


@CLAIMS.add("threads-small", "More threads than cores were not measured.", (0,))
@CLAIMS.add("threads-large", "More threads than cores were not measured.", (-1,))
def threads_at(results: Results, end: int) -> Claim:
    """2x and 4x threads compared with 1x, at the smallest (`end` 0) or largest (-1) size that all were measured at."""
    source = needed(cpu_source(results))
    by_word = {word: trusted(thread_pairs(source, word)) for word in THREAD_WORDS[1:]}
    by_word = {word: both for word, both in by_word.items() if both[0]}
    sizes = needed([{base.particles for base, _ in both} for both, _ in by_word.values()])
    size = sorted(needed(set.intersection(*sizes)))[end]
    parts, same, numbers, supported = [], [], {}, True
    for word, (both, suspect) in by_word.items():
        base, more = next(pair for pair in both if pair[0].particles == size)
        verdict = apart(more, base)
        ratio = more.median / base.median
        numbers[word] = ratio
        supported = supported and verdict != 0
        if verdict > 0:
            parts.append(f"a step with {word} threads takes {times(ratio)} as long as with 1x{suspect}")
        elif verdict < 0:
            parts.append(f"a step with {word} threads takes {percent(ratio)} of the time of 1x{suspect}")
        elif too_few(more, base):
            parts.append(f"there are too few repeats to distinguish {word} threads from 1x{suspect}")
        else:
            same.append(word + suspect)
    if same:
        parts.append(f"{words.listed(same)} threads show no difference to 1x beyond measurement noise")
    text = f"{on(source, 'cpu')}, at {masses(size)}, {words.listed(parts)}."
    return Claim(text, numbers | {"masses": size}, supported)


@CLAIMS.add("threads-best", "Whether more threads than cores ever help was not measured.")
def threads_best(results: Results) -> Claim:
    """Number of sizes at which more threads than cores are clearly faster than as many."""
    source = needed(cpu_source(results))
    by_word = {word: trusted(thread_pairs(source, word)) for word in THREAD_WORDS[1:]}
    sizes = needed({base.particles for both, _ in by_word.values() for base, _ in both})
    faster = {base.particles for both, _ in by_word.values() for base, more in both if apart(more, base) < 0}
    slower = {base.particles for both, _ in by_word.values() for base, more in both if apart(more, base) > 0} - faster
    numbers = {"sizes": len(sizes), "faster": len(faster), "slower": len(slower)}
    unsure = (
        {base.particles for both, _ in by_word.values() for base, more in both if too_few(more, base)} - faster - slower
    )
    left_out = len({base.particles for word in by_word for base, _ in thread_pairs(source, word)}) - len(sizes)
    suspect = max((marked for _, marked in by_word.values()), default="")
    if left_out:
        suspect = f" that were timed undisturbed ({words.count(left_out)} more are suspect)"
    start, of = on(source, "cpu"), f"of the {len(sizes)} square sizes{suspect}"
    if not faster and slower:
        text = (
            f"{start}, at none {of} are 2x or 4x threads faster than 1x beyond measurement noise; at {len(slower)} of them "
            "one or both are slower."
        )
    elif faster:
        text = (
            f"{start}, at {len(faster)} {of} 2x or 4x threads are faster than 1x beyond measurement noise, the smallest of "
            f"them {masses(min(faster))}; at {len(slower)} others one or both are slower."
        )
    else:
        text = f"{start}, at none {of} do 2x or 4x threads differ from 1x beyond measurement noise."
    if unsure:
        text = f"{text[:-1]}; at {len(unsure)} there are too few repeats to tell."
    return Claim(text, numbers, bool(faster or slower))


@CLAIMS.add("region-cost", "What an empty parallel region costs was not measured.")
def region_cost(results: Results) -> Claim:
    """Cost of an empty parallel region with few and with many threads."""
    source, costs = needed(results.first_with(lambda s: s.machine.record.get("region_seconds") or {}))
    cores, known = needed(source.machine.record.get("cores")), {int(threads): cost for threads, cost in costs.items()}
    needed(cores in known and max(known) > cores)
    most = max(known)
    layer, policy = source.threading
    text = (
        f"{on(source, 'cpu')}, an empty parallel region costs {seconds(known[cores], 2)} with {cores} threads and "
        f"{seconds(known[most], 2)} with {most} (layer {layer or 'unknown'}, wait policy {policy or 'unknown'})."
    )
    return Claim(text, {"few": known[cores], "many": known[most]}, True)


# ---------------------------------------------------------------------- one backend


def _measured_on(results: Results, backend: str) -> tuple[Source, str | None]:
    """Return the machine of a backend and the number of threads that the text quotes of it. Raises NotMeasured."""
    return (needed(cpu_source(results)), "1x") if backend == "cpu" else (needed(results.with_gpu()), None)


@CLAIMS.add("cpu-bandwidth", "How much of the CPU's copy bandwidth a step reaches was not measured.", ("cpu",))
@CLAIMS.add("gpu-bandwidth", "How much of the GPU's copy bandwidth a step reaches was not measured.", ("gpu",))
def bandwidth_reached(results: Results, backend: str) -> Claim:
    """Fraction of the copy bandwidth that a backend reaches at its largest grid."""
    source, word = _measured_on(results, backend)
    timings, suspect = trusted([(t,) for t in sound(source.select(backend, word))])
    ((largest,),) = needed(timings[-1:])
    reached, limit = needed(fraction(source, largest)), needed(copy_bandwidth(source, backend))
    comparison = f"{percent(reached)} of the measured copy bandwidth"
    if doubted := disturbed(source):
        comparison = "which is not compared with the copy bandwidth, because other programs disturbed that measurement"
    beyond = (
        "; more than all of it is possible where the grid stays in a cache, or where a pass over memory does several steps"
        if reached > 1 and not doubted
        else ""
    )
    threads = ", with 1x threads" if word else ""
    text = (
        f"{on(source, backend)}{threads}, a step of {masses(largest.particles)} has an effective bandwidth (the bytes "
        f"that one step a pass would move, over its time) of {words.bandwidth(reached * limit)}, "
        f"{comparison}{beyond}{suspect}."
    )
    return Claim(text, {"share": reached, "masses": largest.particles}, not doubted)


@CLAIMS.add("cpu-float64", "What float64 costs on the CPU was not measured.", ("cpu",))
@CLAIMS.add("gpu-float64", "What float64 costs on the GPU was not measured.", ("gpu",))
def float64_cost(results: Results, backend: str) -> Claim:
    """Time of float64 over that of float32 on a backend's largest grid."""
    source, word = _measured_on(results, backend)
    both, suspect = trusted(float64_pairs(source, backend, word))
    single, double = needed(both)[-1]
    ratio = double.median / single.median
    start = f"{on(source, backend)}, at"
    if apart(double, single) == 0:
        differ = (
            "there are too few repeats to distinguish float64 from float32"
            if too_few(double, single)
            else "float64 and float32 differ by no more than measurement noise"
        )
        text = f"{start} {masses(single.particles)}, {differ}{suspect}."
        return Claim(text, {"ratio": ratio}, False)
    text = f"{start} {masses(single.particles)}, a step in float64 takes {times(ratio)} as long as in float32{suspect}."
    return Claim(text, {"ratio": ratio, "masses": single.particles}, True)


def _trusted_curve(results: Results) -> tuple[Source, list[Timing]]:
    """Return the GPU's machine and its times that are not suspect, smallest grid first. Raises NotMeasured."""
    source = needed(results.with_gpu())
    curve = [t for t in sound(source.select("gpu")) if not is_suspect(t)]
    needed(len(curve) > 1)
    return source, curve


@CLAIMS.add("gpu-flat", "How the GPU's time depends on the size of the grid was not measured.")
def gpu_flat(results: Results) -> Claim:
    """Size up to which the GPU's time hardly depends on the number of masses."""
    source, curve = _trusted_curve(results)
    flat = curve[0]
    for timing in curve[1:]:
        if timing.median > FLAT * curve[0].median:
            break
        flat = timing
    numbers = {"masses": flat.particles, "factor": flat.particles / curve[0].particles}
    if flat is curve[0]:
        text = f"{on_gpu(source)}, the time of a step grows from the smallest size, {masses(flat.particles)}, on."
        return Claim(text, numbers, False)
    factor = flat.particles / curve[0].particles
    text = (
        f"{on_gpu(source)}, a step takes {seconds(curve[0].median)} at {masses(curve[0].particles)} and "
        f"{seconds(flat.median)} at {times(factor)} as many: up to this size, launching and waiting dominate."
    )
    return Claim(text, numbers, True)


@CLAIMS.add("gpu-growth", "How the GPU's time grows at large sizes was not measured.")
def gpu_growth(results: Results) -> Claim:
    """Growth of the GPU's time between its two largest squares."""
    source, curve = _trusted_curve(results)
    left, right = curve[-2:]
    more, longer = right.particles / left.particles, right.median / left.median
    text = (
        f"{on_gpu(source)}, between the two largest squares, {masses(left.particles)} and {masses(right.particles)}, "
        f"{times(more)} the masses take {times(longer)} the time."
    )
    return Claim(text, {"masses": more, "time": longer}, apart(right, left) > 0)


@CLAIMS.add("launch-cost", "The cost of a launch was not measured.")
def launch_cost(results: Results) -> Claim:
    """Cost of one launch from Python on the GPU's machine."""
    source = needed(results.with_gpu())
    cost = needed(source.machine.record.get("gpu_launch_seconds"))
    return Claim(f"{on_gpu(source)}, even an empty launch costs {seconds(cost, 2)}.", {"seconds": cost}, True)
