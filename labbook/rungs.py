"""The lab book's table of kernels: the speed-up of each over the kernel it is compared with, and where it is fastest."""

from __future__ import annotations

from dataclasses import dataclass

from softlab.bench.measure import words
from softlab.bench.store.results import Timing
from softlab.labbook.claims.claim import trusted
from softlab.labbook.tables import DASH, Table, table
from softlab.plots.core.apart import apart
from softlab.plots.core.data import Results, sound
from softlab.plots.core.ladder import fastest, machine_of
from softlab.plots.core.pairs import at_one_size

BELOW = {  # kernel -> backend, the kernel it is compared with
    "launch": ("gpu", "stages"),
    "graph": ("gpu", "launch"),
    "one-block": ("gpu", "graph"),
    "resident": ("gpu", "graph"),
    "tiles": ("gpu", "graph"),
    "fused": ("cpu", "stages"),
    "tiled": ("cpu", "fused"),
    "team": ("cpu", "fused"),
}
HEAD = (
    "Kernel",
    "Compared with",
    "Masses",
    "Its step",
    "The other's step",
    "Times as fast",
    "Fastest at",
    "Smallest",
    "Largest",
)


@dataclass(frozen=True)
class Rung:
    """A kernel at the size with its largest speed-up.

    `best`, `under`: its timing there and that of the kernel `below`, None if it is at no size faster beyond measurement
    noise; `first`: the numbers of masses at which it is the fastest of all, of `sizes` that were timed; `suspect`: the
    times are marked.
    """

    kernel: str
    below: str
    best: Timing | None
    under: Timing | None
    first: tuple[int, ...]
    sizes: int
    suspect: bool

    @property
    def gain(self) -> float | None:
        """Speed-up over the kernel below."""
        return self.under.median / self.best.median if self.best and self.under else None


def rung(results: Results, kernel: str) -> Rung | None:
    """Return a kernel compared with the one below it, at the size with the largest speed-up.

    None if the two were not timed at one size.
    """
    backend, below = BELOW[kernel]
    source = machine_of(results, backend)
    kernels = source.ladder(backend) if source else {}
    both, suspect = trusted(at_one_size(sound(kernels.get(below, [])), sound(kernels.get(kernel, []))))
    if source is None or not both:
        return None
    gains = [(under.median / t.median, t, under) for under, t in both if apart(t, under) < 0]
    _, best, under = max(gains, key=lambda gain: gain[0], default=(1.0, None, None))
    ranked = fastest(source, backend)
    first = tuple(t.particles for t in ranked if t.kernel == kernel)
    return Rung(kernel, below, best, under, first, len(ranked), bool(suspect))


def rung_tables(results: Results) -> list[Table]:
    """Return one table of both backends, which names their machines; empty if no two kernels were timed at one size."""
    rungs = [entry for kernel in BELOW if (entry := rung(results, kernel))]
    machines = []
    for backend in dict.fromkeys(BELOW[entry.kernel][0] for entry in rungs):
        source = machine_of(results, backend)
        machines.append(f"{backend.upper()}: {source.device(backend)}{source.bracket}" if source else "")
    marked = " Starred: from times that are marked as suspect." if any(entry.suspect for entry in rungs) else ""
    title = (
        "Each kernel compared with the one whose cost it removes (float32), at the size where it gains most; and the number "
        f"of sizes at which no kernel is faster, with the smallest and the largest of them. {'; '.join(machines)}.{marked}"
    )
    return [table(title, HEAD, [_row(entry) for entry in rungs], left=2)] if rungs else []


def _row(entry: Rung) -> list[str]:
    name = f"{entry.kernel} ({BELOW[entry.kernel][0].upper()}){'*' if entry.suspect else ''}"
    cells = [DASH, DASH, DASH, "not faster"]
    if entry.best and entry.under and entry.gain:
        cells = [
            words.count(entry.best.particles), words.seconds(entry.best.median), words.seconds(entry.under.median),
            words.number(entry.gain, 2),
        ]  # fmt: skip
    where = [f"none of {entry.sizes}", DASH, DASH]
    if entry.first:
        where = [f"{len(entry.first)} of {entry.sizes}", *(words.count(n) for n in (entry.first[0], entry.first[-1]))]
    return [name, entry.below, *cells, *where]
