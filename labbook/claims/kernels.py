"""Claims of the lab book on the kernels: choice, ceilings, energy and starts; rules in labbook/claims/claim.py."""

from __future__ import annotations

from collections.abc import Sequence

from softlab.bench.measure import words
from softlab.bench.measure.declaration import Part, Sentence
from softlab.bench.measure.starts import COLD, WARM
from softlab.bench.measure.words import masses, number, percent, seconds, times
from softlab.labbook.claims.claim import Claim, Claims, on, trusted
from softlab.labbook.claims.declared import by_backend
from softlab.plots.core.apart import apart, too_few
from softlab.plots.core.backends import on_backends
from softlab.plots.core.bandwidth import disturbed, from_memory
from softlab.plots.core.data import Results, Source, needed, sound
from softlab.plots.core.ladder import defaults, fastest, machine_of
from softlab.plots.core.pairs import at_one_size
from softlab.plots.figures.joules import counted_joules, watts
from softlab.plots.figures.roofline import ceilings

CLAIMS = Claims()


@CLAIMS.add("choice-cpu", "Whether the CPU chooses its fastest kernel was not measured.", ("cpu",))
@CLAIMS.add("choice-gpu", "Whether the GPU chooses its fastest kernel was not measured.", ("gpu",))
def choice(results: Results, backend: str) -> Claim:
    """Number of sizes at which the kernel that a backend chooses is the fastest."""
    source = needed(machine_of(results, backend))
    chosen = {t.particles: t for t in defaults(source, backend)}
    best = needed([t for t in fastest(source, backend) if t.particles in chosen])
    timed = len(fastest(source, backend))
    pairs, suspect = trusted([(chosen[t.particles], t) for t in best])
    best = [t for _, t in pairs]
    slower = [(default.median / t.median, t) for default, t in pairs if apart(default, t) > 0]
    good = len(best) - len(slower)
    text = (
        f"{on(source, backend)}, the default kernel is the fastest, or not slower beyond measurement noise, "
        f"at {good} of the {len(best)} sizes"
    )
    if len(best) < timed:
        text += f" that were timed undisturbed, of {timed}"
    numbers: dict[str, float] = {"good": good, "sizes": len(best)}
    if slower:
        ratio, worst = max(slower, key=lambda pair: pair[0])
        numbers["worst"] = ratio
        text += f"; at worst, at {masses(worst.particles)}, it takes {times(ratio)} as long as {worst.kernel}"
    return Claim(f"{text}{suspect}.", numbers, True)


ROOF = "How the {}'s kernels stand against its ceilings beyond the caches was not measured."


@CLAIMS.add("roof-cpu", ROOF.format("CPU"), ("cpu",))
@CLAIMS.add("roof-gpu", ROOF.format("GPU"), ("gpu",))
def roof(results: Results, backend: str) -> Claim:
    """Largest fraction of the roof of one step per pass that any kernel reaches, and of the arithmetic roof."""
    source = needed(machine_of(results, backend, lambda s: ceilings(s, backend) is not None and not disturbed(s)))
    limits = needed(ceilings(source, backend))
    ranked, suspect = trusted([(t,) for t in fastest(source, backend) if from_memory(source, t)])
    best = max((t for (t,) in needed(ranked)), key=limits.fraction)
    fraction = limits.fraction(best)
    numbers = {"share": fraction, "masses": best.particles}
    more = "more" if fraction > 1 else "no more"
    text = (
        f"{on(source, backend)}, the highest rate on grids beyond the last cache is {percent(fraction)} of that of one step "
        f"per pass ({best.kernel}, {masses(best.particles)}): {more} than a kernel that does one step per pass from memory "
        f"could reach{suspect}"
    )
    if limits.arithmetic_fraction and limits.rate:
        numbers["arithmetic"] = fraction / limits.arithmetic_fraction
        text += f". It uses {percent(fraction / limits.arithmetic_fraction)} of the measured {words.operations(limits.rate)}"
    return Claim(f"{text}.", numbers, True)


@CLAIMS.add("energy", "No joules were counted: the machine has no energy counter that may be read.")
def energy(results: Results) -> Claim:
    """Energy of the most and the least economical kernel at the largest size of each backend with a counter."""
    parts, numbers = list[str](), dict[str, float]()
    for backend, source, counted in on_backends(results, counted_joules):
        size = max(t.particles for t, _ in counted)
        here = sorted(((j, t) for t, j in counted if t.particles == size), key=lambda entry: entry[0])
        (least, thrifty), (most, wasteful) = here[0], here[-1]
        numbers |= {f"{backend} least": least, f"{backend} most": most}
        text = (
            f"{on(source, backend)}, at {masses(size)}, a million mass-steps take {number(least, 2)}{words.SPACE}J with "
            f"{thrifty.kernel} (at {number(watts(source, thrifty) or 0.0, 2)}{words.SPACE}W)"
        )
        if wasteful is not thrifty:
            text += (
                f" and {number(most, 2)}{words.SPACE}J with {wasteful.kernel} (at "
                f"{number(watts(source, wasteful) or 0.0, 2)}{words.SPACE}W)"
            )
        parts.append(f"{text}.")
    return Claim(" ".join(needed(parts)), numbers, True)


def _starts(source: Source, backend: str) -> list[float]:
    """Return [cold, warm] [s], or an empty list where one of them was not measured."""
    values = {m.name: m.value for m in source.measures if m.backend == backend}
    durations = [value for name in (COLD, WARM) if (value := values.get(name)) is not None]
    return durations if len(durations) == 2 else []


def starts(durations: Sequence[float]) -> Part:
    """Time to the first step, cold and warm."""
    cold, warm = durations
    return f"{seconds(cold, 2)} the first time and {seconds(warm, 2)} from then on", {"cold": cold, "warm": warm}


CLAIMS["starts"] = by_backend(_starts, Sentence(
    "The whole process of one step of the lab grid, from the command to its end, takes {}.", starts,
    "How long a user waits for the first step was not measured.", form="{part}, on {place}", join="; ".join,
))  # fmt: skip


# ---------------------------------------------------------------------- more threads than cores


@CLAIMS.add("crowded-fused", "", ("fused",))
@CLAIMS.add("crowded-team", "", ("team", "fused"))
def crowded(results: Results, kernel: str, against: str | None = None) -> Claim:
    """A kernel with 4x threads compared with 1x, or with the kernel `against` with 4x, on the smallest grid that both
    ran.
    """
    missing = f"The kernel {kernel} was not timed with more threads than cores."
    source = needed(machine_of(results, "cpu"), missing)
    more = source.ladder("cpu", word="4x").get(kernel, [])
    other = source.ladder("cpu", word="4x" if against else "1x").get(against or kernel, [])
    both, suspect = trusted(at_one_size(sound(other), sound(more)))
    base, packed = needed(both, missing)[0]
    name = f"{against} with 4x" if against else "with 1x"
    ratio = packed.median / base.median
    at = f"{on(source, 'cpu')}, at {masses(packed.particles)} and with 4x threads, a step of {kernel} takes"
    numbers = {"ratio": ratio, "masses": packed.particles}
    verdict = apart(packed, base)
    if verdict == 0:
        differs = f"which differs from {name} by no more than measurement noise"
        if too_few(packed, base):
            differs = f"but there are too few repeats to distinguish that from {name}"
        return Claim(f"{at} {seconds(packed.median)}, {differs}{suspect}.", numbers, False)
    factor = f"{times(ratio)} as long as" if verdict > 0 else f"{percent(ratio)} of what it takes"
    return Claim(f"{at} {seconds(packed.median)}, {factor} {name}{suspect}.", numbers, True)


@CLAIMS.add("policies", "What spinning and sleeping cost was not measured.")
def policies(results: Results) -> Claim:
    """Cost of an empty parallel region with spinning and with sleeping idle threads, with few threads and with many."""
    source, costs = needed(results.first_with(lambda s: s.machine.record.get("region_policies") or {}))
    spin, sleep = ({int(n): cost for n, cost in (costs.get(p) or {}).items()} for p in ("active", "passive"))
    cores, shared = needed(source.machine.record.get("cores")), set(spin) & set(sleep)
    many = max(shared, default=0)
    needed(cores in shared and many > cores)
    few_times, many_times = sleep[cores] / spin[cores], spin[many] / sleep[many]
    text = (
        f"{on(source, 'cpu')}, with {cores} threads on {cores} cores an empty region costs {seconds(spin[cores], 2)} when "
        f"idle threads spin and {seconds(sleep[cores], 2)} when they sleep; with {many}, {seconds(spin[many], 2)} and "
        f"{seconds(sleep[many], 2)}. "
    )
    if few_times > 1 and many_times > 1:
        text += "Spinning is faster as long as each thread has a core, and slower once they share them."
    elif few_times > 1:
        text += "Spinning is the faster of the two in both cases here."
    else:
        text += "Sleeping is not the slower of the two here even where each thread has a core."
    numbers = {"spin few": spin[cores], "sleep few": sleep[cores], "spin many": spin[many], "sleep many": sleep[many]}
    return Claim(text, numbers, True)
