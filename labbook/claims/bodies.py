"""Claims of the lab book on three solvers and one bar (`softlab bar`); rules in labbook/claims/claim.py."""

from __future__ import annotations

from softlab.bench.experiments.bar import FINEST, SOME_LAYERS, SOME_LINKS, SOME_OVERLAP, SOME_VOXELS
from softlab.bench.experiments.bar_body import CLUSTERS, LEVER_ARM
from softlab.bench.experiments.bar_costs import Cost
from softlab.bench.experiments.bar_rows import JELLY, Bar, first_backend, series
from softlab.bench.experiments.bar_strip import (
    ACROSS,
    DECAY,
    FRAME,
    FREQUENCY,
    LENGTH,
    SAG,
    WEIGHT,
    chain_frequency,
    chain_of_clusters,
    chain_sag,
    implicit_frequency,
    method_of,
    strip,
    verlet_frequency,
)
from softlab.bench.measure import words
from softlab.bench.measure.words import number, percent
from softlab.labbook.claims.claim import Claim, Claims, committed_of
from softlab.plots.core.data import Results, needed
from softlab.plots.figures.bar import bars

CLAIMS = Claims()
NEAR = 1e-4  # largest relative difference from a closed form that counts as agreement
EQUAL = 1e-6  # relative: largest difference between two backends in exact math


def measured_bars(results: Results) -> list[Bar]:
    """Return the rows that the chapter uses, from one backend."""
    rows, _ = bars(results)
    return first_backend(rows) if rows else []


def _strips(results: Results, solver: str, size: float = 1) -> list[Bar]:
    return series(measured_bars(results), solver, lambda bar: bar.fine, {"size": size})


def _one(rows: list[Bar], fine: int, substeps: int) -> Bar | None:
    return next((bar for bar in rows if (bar.fine, bar.substeps) == (fine, substeps)), None)


def _off(bar: Bar, name: str, exact: float) -> float:
    return abs(bar.values[name] / exact - 1)


@CLAIMS.add("bar-springs", "A bar of springs was not measured.")
def springs(results: Results) -> Claim:
    """Agreement of mass-spring, and of XPBD with converged iterations, with a chain of springs."""
    explicit, implicit = (
        needed([bar for bar in _strips(results, solver) if {SAG, FREQUENCY} <= set(bar.values)])
        for solver in ("mass-spring", "xpbd, converged")
    )
    refused = [bar for bar in _strips(results, "mass-spring") if bar.refused]
    forces = max(
        max(_off(b, SAG, chain_sag(b.fine)),
            _off(b, FREQUENCY, verlet_frequency(chain_frequency(b.fine), FRAME / b.substeps)))
        for b in explicit
    )  # fmt: skip
    at_once = [b for b in implicit if b.substeps == FINEST]
    positions = max(
        (max(_off(b, SAG, chain_sag(b.fine)),
             _off(b, FREQUENCY, implicit_frequency(chain_frequency(b.fine), FRAME / b.substeps))) for b in at_once),
        default=float("inf"),
    )  # fmt: skip
    coarse = min(explicit, key=lambda b: b.fine)
    text = (
        f"Mass-spring sags and swings as a chain of springs does, to {number(forces, 1)} of it; XPBD, with converged "
        f"iterations and {FINEST} substeps, to {number(positions, 1)}. With {coarse.fine} masses that is "
        f"{percent((coarse.part(SAG) or 1) - 1)} more sag than a rod's."
    )
    if refused:
        most = max(bar.substeps for bar in refused)
        text += (
            f" Up to {most} steps a frame mass-spring is refused at {SOME_LINKS} masses: over the limit of its springs."
        )
    return Claim(text, {"mass-spring": forces, "xpbd": positions}, max(forces, positions) < NEAR)


@CLAIMS.add("bar-iterations", "XPBD with one iteration per substep was not measured on the bar.")
def iterations(results: Results) -> Claim:
    """Error of XPBD with one iteration, which transmits a load by one mass only.

    Too few substeps make the bar softer, and more so the finer it is.
    """
    by_solver = {name: _strips(results, name) for name in ("xpbd", "xpbd, converged")}
    few = [bar for bar in by_solver["xpbd"] if bar.fine == SOME_LINKS and SAG in bar.values]
    fine = [bar for bar in by_solver["xpbd"] if bar.substeps == FINEST and SAG in bar.values]
    needed(len(few) > 1 and len({bar.fine for bar in fine} | {SOME_LINKS}) > 1 and _one(few, SOME_LINKS, FINEST))
    worst, finest = min(few, key=lambda b: b.substeps), max(fine, key=lambda b: b.fine)
    right = _one(by_solver["xpbd, converged"], worst.fine, worst.substeps)
    numbers = {
        "few": worst.values[SAG] / chain_sag(worst.fine), "fine": finest.values[SAG] / chain_sag(finest.fine),
        "converged": right.values[SAG] / chain_sag(right.fine) if right and SAG in right.values else 1.0,
    }  # fmt: skip
    text = (
        f"With one iteration per substep, XPBD sags {words.times(numbers['few'])} as far as its springs should at "
        f"{substeps_of(worst)} a frame, and with converged iterations {number(numbers['converged'], 3)} times; at "
        f"{FINEST} substeps one iteration leaves it {percent(_sag(few, FINEST) - 1)} too soft with {SOME_LINKS} masses, "
        f"and {percent(numbers['fine'] - 1)} with {finest.fine}"
    )
    grows = numbers["few"] > 1.1 and numbers["fine"] > _sag(few, FINEST)
    reason = ": an iteration passes a load on by one mass or colour, so that a finer bar needs more of them."
    return Claim(text + (reason if grows else "."), numbers, grows)


def substeps_of(bar: Bar | Cost) -> str:
    """Return e.g. `4 substeps`."""
    return f"{bar.substeps} substep{'' if bar.substeps == 1 else 's'}"


def _sag(rows: list[Bar], substeps: int) -> float:
    """Return the sag over the chain's, of SOME_LINKS with that many substeps; 1 where it was not measured."""
    bar = _one(rows, SOME_LINKS, substeps)
    return bar.values[SAG] / chain_sag(bar.fine) if bar and SAG in bar.values else 1.0


@CLAIMS.add("bar-windows", "A bar by shape matching was not measured.")
def windows(results: Results) -> Claim:
    """Agreement of the lattice of clusters with its linear system; effect of cut-off windows and of too few substeps."""
    bars_matched = [bar for bar in measured_bars(results) if bar.solver == "shape-matching"]
    lattices = needed([bar for bar in bars_matched if {SAG, FREQUENCY} <= set(bar.values)])
    sags, swings = [], []
    for bar in lattices:
        method = method_of(bar.solver, bar.substeps, region=int(bar.size))
        sag, frequency = chain_of_clusters(strip(bar.fine, method))
        sags.append(_off(bar, SAG, sag))
        swings.append(_off(bar, FREQUENCY, frequency))
    large = max(lattices, key=lambda b: (b.size, -b.fine, b.substeps))
    small = _one([b for b in lattices if b.size == 1], large.fine, large.substeps)
    numbers = {"sag": max(sags), "frequency": max(swings), "largest": large.part(SAG) or 0.0}
    text = (
        f"Shape matching is the linear system of its clusters: sags agree with it to {number(max(sags), 1)}, frequencies to "
        f"{number(max(swings), 1)}, because the oscillation is not exactly one of their modes"
    )
    if small and large.size > 1:
        numbers["smallest"] = small.part(SAG) or 0.0
        text += (
            ". All windows are equally stiff in a long, uniform stretch, but those cut off by an end are softer: with "
            f"{large.fine} masses and {substeps_of(large)} windows of {_window(small)} sag by "
            f"{number(numbers['smallest'])} times what a rod does, of {_window(large)} by {number(numbers['largest'])}"
        )
    return Claim(text + ".", numbers, max(sags) < NEAR)


def _window(bar: Bar) -> str:
    wide = 2 * int(bar.size) + 1
    return f"{wide}{words.SPACE}{words.TIMES}{words.SPACE}{wide}"


@CLAIMS.add("bar-shear", "What resists shear was not measured.")
def shear(results: Results) -> Claim:
    """Displacement of a bar that is fixed at its side: springs hang down, clusters bend."""
    loaded = {
        name: _one(_strips(results, name), SOME_LINKS, FINEST) for name in ("mass-spring", "xpbd", "shape-matching")
    }
    bent = {name: bar for name, bar in loaded.items() if bar and ACROSS in bar.values}
    clusters = needed(bent.pop("shape-matching", None))
    least = min(bar.values[ACROSS] for bar in needed(bent).values())
    numbers = {"springs": least / LENGTH, "clusters": clusters.part(ACROSS) or 0.0}
    clear = numbers["springs"] > 0.9 and numbers["clusters"] < 2
    text = (
        f"Held at its left side, under an acceleration of {number(WEIGHT, 1)} m/s², the strip of springs hangs straight "
        f"down, its end {percent(least / LENGTH)} of its length lower, under mass-spring and XPBD alike: it has no "
        f"resistance to shear, whatever the load. The strip of clusters bends by "
        f"{percent(clusters.values[ACROSS] / LENGTH)} of its length, "
        f"{number(numbers['clusters'])} times a beam of the same material."
    )
    return Claim(text, numbers, clear)


@CLAIMS.add("bar-losses", "The damping of the bar's swing by the solvers was not measured.")
def losses(results: Results) -> Claim:
    """Damping of an undamped vibration by each solver."""
    parts, numbers = [], {}
    for solver, name in (("mass-spring", "mass-spring"), ("xpbd", "XPBD"), ("shape-matching", "shape matching")):
        rows = [bar for bar in _strips(results, solver) if bar.fine == SOME_LINKS and DECAY in bar.values]
        bar = _one(rows, SOME_LINKS, FINEST)
        if bar:
            numbers[solver] = abs(bar.values[DECAY])
            loss = "nothing" if numbers[solver] < 1e-9 else f"{number(numbers[solver], 2)} of it a second"
            parts.append(f"{name} takes {loss}")
    needed(len(parts) == 3)
    text = f"Of the amplitude of an undamped swing, at {FINEST} steps or substeps a frame, {words.listed(parts)}."
    return Claim(text, numbers, numbers["mass-spring"] < 1e-9 < min(numbers["xpbd"], numbers["shape-matching"]))


@CLAIMS.add("bar-overlap", "A jelly bar was not measured at several overlaps.")
def overlap(results: Results) -> Claim:
    """Stiffness of the jelly bar against overlap and spacing, and where clusters give one material."""
    jellies = [bar for bar in measured_bars(results) if bar.solver == JELLY and FREQUENCY in bar.values]
    by_size = [b for b in jellies if (b.fine, b.substeps) == (SOME_LAYERS, FINEST)]
    needed(len(by_size) > 1)
    by_size.sort(key=lambda b: b.size)
    parts = [
        f"{number(100 * (bar.part(FREQUENCY) or 0.0), 3)}{words.SPACE}% at {number(bar.size, 3)} "
        f"({number(bar.values[CLUSTERS], 2)} clusters a particle)"
        for bar in by_size
    ]
    stiffer = (by_size[-1].values[LEVER_ARM] / by_size[0].values[LEVER_ARM]) ** 2
    numbers = {f"{bar.size:g}": bar.part(FREQUENCY) or 0.0 for bar in by_size} | {"stiffer": stiffer}
    return Claim(
        "A cluster stiffness is not a material constant: in uniform stretch the bar's stiffness is that times the "
        f"mean square of the offsets in its clusters, {words.times(stiffer)} as much at an overlap of "
        f"{number(by_size[-1].size, 2)} as at "
        f"{number(by_size[0].size, 2)}. After division by this, it swings at {words.listed(parts)} of a rod's frequency.",
        numbers, abs(numbers.get(f"{SOME_OVERLAP:g}", 0.0) - 1) < 0.05,
    )  # fmt: skip


@CLAIMS.add("bar-tetrahedra", "A bar of tetrahedra was not compared with the same rod.")
def tetrahedra(results: Results) -> Claim:
    """Comparison of the bar of tetrahedra with the rod's material in sag and frequency, and with the beam in bending."""
    by_solver = {name: _strips(results, f"tetrahedra, {name}") for name in ("xpbd", "newton")}
    finest = {name: _one(some, SOME_VOXELS, FINEST) for name, some in by_solver.items()}
    hanging = needed([b for b in by_solver["xpbd"] if b.fine == SOME_VOXELS and SAG in b.values])
    few = min(hanging, key=lambda b: b.substeps)
    rows, newton = needed(finest["xpbd"]), needed(finest["newton"])
    needed({SAG, FREQUENCY} <= set(rows.values) & set(newton.values))
    numbers = {
        "few": few.part(SAG) or 0.0, "rows": rows.part(SAG) or 0.0, "newton": newton.part(SAG) or 0.0,
        "frequency": newton.part(FREQUENCY) or 0.0,
    }  # fmt: skip
    text = (
        f"A bar of tetrahedra takes only Young's modulus and Poisson's ratio: {SOME_VOXELS} voxels long it hangs by "
        f"{number(numbers['newton'], 4)} times a rod's sag by Newton's method, and by {number(numbers['few'])} and "
        f"{number(numbers['rows'], 4)} times with one position-based sweep at {substeps_of(few)} and at {FINEST}, and "
        f"swings at {percent(numbers['frequency'])} of a rod's frequency"
    )
    bent = [b for b in by_solver["newton"] if ACROSS in b.values]
    if bent:
        numbers |= {f"across {b.fine}": b.part(ACROSS) or 0.0 for b in bent}
        bends = words.listed([f"{percent(b.part(ACROSS) or 0.0)} with {b.fine}" for b in bent])
        text += f"; loaded across, solved to the end, it bends by {bends} voxels of what a beam does: the mesh locks"
    return Claim(text + ".", numbers, abs(numbers["newton"] - 1) < 0.02 < numbers["few"] - 1)


@CLAIMS.add("bar-backends", "The bar was not measured on any backend.")
def backends(results: Results) -> Claim:
    """Largest difference between the results of both backends."""
    by_setting: dict[object, dict[str, Bar]] = {}
    for bar in bars(results)[0]:
        key = (bar.precision, bar.solver, bar.fine, bar.size, bar.substeps, bar.law)
        by_setting.setdefault(key, {})[bar.backend] = bar
    both = [pair for pair in needed(by_setting).values() if len(pair) == 2]
    if not both:
        (name,) = {name for pair in by_setting.values() for name in pair}
        return Claim(f"These are of the {name.upper()} alone, so that the backends are not compared.")
    off = 0.0
    for pair in both:
        one, other = pair.values()
        for name in one.values.keys() & other.values.keys():
            scale = max(abs(one.values[name]), abs(other.values[name]), 1e-9)
            off = max(off, abs(one.values[name] - other.values[name]) / scale)
    same = off < EQUAL
    what = "the same numbers" if same else "other numbers, a bug of this lab:"
    sources = bars(results)[1]
    names = " and ".join(f"{name.upper()}{committed_of(sources, name)}" for name in ("cpu", "gpu"))
    text = f"On {len(both)} configurations {names} give {what} to {number(off, 1) if off else 'the last bit'}."
    return Claim(text, {"off": off, "configurations": float(len(both))}, same)
