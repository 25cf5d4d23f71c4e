"""Claims of the lab book on tetrahedra (`softlab tetrahedra`); rules in labbook/claims/claim.py."""

from __future__ import annotations

from math import log10

from softlab.bench.experiments.tetrahedral.bars import Bar, bars, of_one_version
from softlab.bench.experiments.tetrahedral.cantilever import BLOCKS, SECOND
from softlab.bench.experiments.tetrahedral.decides import STIFF, Decision, decisions, moves
from softlab.bench.experiments.tetrahedral.meshes import MESH, meshes
from softlab.bench.experiments.tetrahedral.promised import WITHIN
from softlab.bench.measure import words
from softlab.labbook.claims.claim import SUSPECT, Claim, Claims, where
from softlab.plots.core.backends import on_backends
from softlab.plots.core.data import Results, Source, judgements, needed
from softlab.plots.figures.tetrahedra import middle

CLAIMS = Claims()
WHOLE = 0.15  # of the continuum's sag: the requested total error, of mesh and solver
ENOUGH = 0.05  # of the displacement: the requested error in motion
PRECISION = "float64"  # the precision in which rounding does not add to the solver's error
DESCENT = (1, 30)  # substeps and sweeps of vertex block descent
USUAL = (4, 1)  # substeps and sweeps per frame with which programs usually start


def _bars_of(source: Source, backend: str) -> list[Bar]:
    return [b for b in middle(bars(source.measures)) if (b.backend, b.precision) == (backend, PRECISION)]


def _budget(bar: Bar) -> str:
    """Return e.g. `in 16 substeps of 8 sweeps, as blocks`."""
    sweeps = f" of {bar.iterations} sweeps" if bar.iterations > 1 else ""
    return f"in {bar.substeps} substeps{sweeps}{', as blocks' * (bar.solver == BLOCKS)}"


def _solver(bar: Bar) -> str:
    """Return e.g. `newton of order 2`."""
    return "newton of order 2" if bar.solver == SECOND else bar.solver


def _pascal(young: float) -> str:
    """Return e.g. `10⁷ Pa`."""
    exponent = round(log10(young))
    power = f"10{str(exponent).translate(words.SUPERSCRIPTS)}" if young == 10.0**exponent else words.number(young)
    return f"{power}{words.SPACE}Pa"


def _count(rows: list[Bar]) -> str:
    """Return e.g. `400 tetrahedra`: the mesh of bars that have one."""
    return f"{words.count(rows[0].elements)} tetrahedra"


def _settled(results: Results, solver: str, settings: tuple[int, int]) -> list[Bar]:
    """Return the bars of a solver with so many substeps and sweeps, on the first backend. Raises NotMeasured."""
    _, _, rows = needed(on_backends(results, _bars_of))[0]
    return needed([b for b in rows if b.solver == solver and (b.substeps, b.iterations) == settings])


@CLAIMS.add("tetrahedra-usual", "Bars of tetrahedra were not measured.")
def usual(results: Results) -> Claim:
    """Sag of bars with the usual few substeps over the exact sag, a ratio that does not depend on the machine."""
    rows = _settled(results, "xpbd", USUAL)
    ratios = {b.young: 1 + b.solver_error for b in rows}
    texts = [f"{words.times(ratio)} as far at {_pascal(young)}" for young, ratio in ratios.items()]
    text = (
        f"With {USUAL[0]} substeps a frame and one sweep each, a bar of {_count(rows)} sags "
        f"{words.listed(texts)} as the exact rest state of the same mesh."
    )
    return Claim(text, {f"{young:g}": ratio for young, ratio in ratios.items()}, True)


@CLAIMS.add("tetrahedra-mesh", "The error of coarse meshes was not measured.")
def mesh(results: Results) -> Claim:
    """Mesh error of all meshes that were measured."""
    _, measured = needed(results.first_with(lambda source: bars(source.measures)))
    off = {b.elements: b.mesh_error for b in measured}
    texts = [f"{words.percent(abs(error))} too little in {words.count(n)} tetrahedra" for n, error in off.items()]
    text = (
        f"That is the error of the solver, not of the mesh: solved to the end, the bar sags {words.listed(texts)}, "
        "five to a voxel, because a linear tetrahedron cannot bend."
    )
    return Claim(text, {str(n): error for n, error in off.items()}, True)


@CLAIMS.add("tetrahedra-budget", "The cost of a small solver error was not measured.")
def budget(results: Results) -> Claim:
    """Time of a frame within ENOUGH in motion, by the fastest position-based setting and by the fastest other solver."""
    parts, numbers = list[str](), dict[str, float]()
    for backend, source, measured in _of_one_mesh(results):
        texts = []
        for young in sorted({b.young for b in measured}):
            able = [b for b in measured if b.young == young and abs(b.motion_error) <= ENOUGH and not b.suspect]
            rows = min((b for b in able if b.solver.startswith("xpbd")), key=lambda b: b.seconds, default=None)
            other = min((b for b in able if not b.solver.startswith("xpbd")), key=lambda b: b.seconds, default=None)
            if rows is None:
                texts.append(f"at {_pascal(young)} no position-based setting that was measured gets there")
            else:
                numbers[f"{backend} {young:g} xpbd"] = rows.seconds
                texts.append(f"at {_pascal(young)} {words.seconds(rows.seconds)} ({_budget(rows)}")
            if other is not None:
                numbers[f"{backend} {young:g} {other.solver}"] = other.seconds
                texts[-1] += f"{'; ' if rows else ' ('}{words.seconds(other.seconds)} by {_solver(other)}"
            if rows is not None or other is not None:
                texts[-1] += ")"
        if texts:
            parts.append(f"on {where(backend, source)}, {_count(measured)}, {words.listed(texts)}")
    text = (
        f"For a motion within {words.percent(ENOUGH)} of the exact one, half a vibration after release, a position-based "
        f"frame takes, {'; '.join(needed(parts))}."
    )
    return Claim(text, numbers, True)


def _of_one_mesh(results: Results) -> list[tuple[str, Source, list[Bar]]]:
    """Return the bars of each backend in PRECISION: of the largest mesh that all backends have, else of one mesh each."""
    chosen = on_backends(
        results, lambda source, backend: [b for b in _all(source, backend) if b.precision == PRECISION]
    )
    shared = set.intersection(*({b.elements for b in rows} for _, _, rows in chosen)) if chosen else set()
    sizes = {backend: max(shared, default=middle(rows)[0].elements) for backend, _, rows in chosen}
    return [(name, source, [b for b in rows if b.elements == sizes[name]]) for name, source, rows in chosen]


@CLAIMS.add("tetrahedra-total", "No bar was measured that is near the continuum, mesh and solver together.")
def total(results: Results) -> Claim:
    """Fastest setting within WHOLE of the continuum at rest, mesh and solver together, by Young's modulus."""
    parts, numbers, busy = list[str](), dict[str, float](), False
    for backend, source, measured in on_backends(results, lambda s, backend: of_one_version(_all(s, backend))):
        texts = []
        for young in sorted({b.young for b in measured}):
            able = [b for b in measured if b.young == young and b.total_error <= WHOLE and moves(b) and not b.wrong]
            best = min(able, key=lambda b: b.seconds, default=None)
            if best is None:
                texts.append(f"at {_pascal(young)} none")
                continue
            numbers[f"{backend} {young:g}"] = best.seconds
            busy = busy or best.suspect
            texts.append(
                f"at {_pascal(young)} {_solver(best)} with {words.count(best.elements)} tetrahedra in "
                f"{words.seconds(best.seconds)}, error {words.percent(best.total_error)}"
            )
        parts.append(f"on {where(backend, source)} {words.listed(texts)}")
    text = (
        "Mesh and solver together (the sum of their magnitudes at rest, against the continuum), the fastest frames within "
        f"{words.percent(WHOLE)} are {'; '.join(parts)}{SUSPECT if busy else ''}."
    )
    return Claim(text, needed(numbers), True)


@CLAIMS.add("tetrahedra-decided", "Whether another solver is worth it for stiff bars was not measured.")
def decided(results: Results) -> Claim:
    """Time of the best solver over that of the cheapest position-based setting, at the stiffest bars.

    Both within WITHIN of the mesh's exact rest state and motion; the target is a tenth.
    """
    parts, numbers, busy = list[str](), dict[str, float](), False
    for backend, source, measured in on_backends(results, _all):
        stiff = [one for one in decisions(measured) if one.young == STIFF and one.best is not None]
        largest = max((one.elements for one in stiff), key=lambda n: (_shared(stiff, n), n), default=0)
        texts = []
        for one in stiff:
            if one.elements != largest or one.best is None:
                continue
            busy = busy or one.best.suspect or (one.rows is not None and one.rows.suspect)
            if one.time_ratio is None:
                numbers[f"{backend} {one.where} alone"] = one.best.seconds
                texts.append(
                    f"{one.where} {words.seconds(one.best.seconds)} a frame ({_solver(one.best)}), where none does"
                )
            else:
                numbers[f"{backend} {one.where}"] = one.time_ratio
                texts.append(f"{one.where} {words.percent(one.time_ratio)} of its time ({_solver(one.best)})")
        if texts:
            parts.append(f"on {where(backend, source)}, {words.count(largest)} tetrahedra, {words.listed(texts)}")
    stiffest = max((b.young for _, _, measured in on_backends(results, _all) for b in measured), default=0.0)
    near = f"At {_pascal(STIFF)} nothing that was measured comes within {words.percent(WITHIN)}."
    needed(parts, near if stiffest == STIFF else "")
    text = (
        f"At {_pascal(STIFF)} the fastest solver within {words.percent(WITHIN)} of the mesh's own answer takes, beside the "
        f"cheapest position-based setting that gets so near: {'; '.join(parts)}{SUSPECT if busy else ''}."
    )
    return Claim(text, numbers, True)


def _shared(stiff: list[Decision], elements: int) -> bool:
    """Return True if a position-based setting on that mesh is available for comparison."""
    return any(one.elements == elements and one.time_ratio is not None for one in stiff)


def _all(source: Source, backend: str) -> list[Bar]:
    return [b for b in bars(source.measures) if b.backend == backend]


@CLAIMS.add("tetrahedra-creeping", "Vertex block descent was not measured in motion.")
def creeping(results: Results) -> Claim:
    """Motion of vertex block descent, whose error does not show at rest because a step begins where the last one
    ended."""
    rows = _settled(results, "vbd", DESCENT)
    by_young = {b.young: b for b in rows}
    texts = [f"{words.percent(1 + b.motion_error)} at {_pascal(young)}" for young, b in by_young.items()]
    text = (
        f"Vertex block descent with {DESCENT[1]} sweeps a frame, with {_count(rows)}, comes to rest in the right "
        "place, because each step begins where the last one ended. Half a vibration after release, however, it has "
        f"moved only {words.listed(texts)} of the way."
    )
    return Claim(text, {f"{young:g}": b.motion_error for young, b in by_young.items()}, True)


@CLAIMS.add("tetrahedra-cuts", "Five and six tetrahedra to a voxel were not compared.")
def cuts(results: Results) -> Claim:
    """Five compared with six tetrahedra per voxel."""
    measured, _ = judgements(results, lambda measure: measure.description.get("finding") == MESH)
    parts = {(m.cut, m.poisson, m.across): m for m in meshes(measured)}
    across = max((n for _, _, n in parts), default=0)
    ratios = sorted(needed({ratio for cut, ratio, n in parts if n == across and (11 - cut, ratio, n) in parts}))
    pairs = [(ratio, parts[5, ratio, across].part, parts[6, ratio, across].part) for ratio in ratios]
    texts = [f"{words.percent(five)} and {words.percent(six)} at {ratio:g}" for ratio, five, six in pairs]
    numbers = {f"{cut} {ratio:g}": part for ratio, *both in pairs for cut, part in zip((5, 6), both, strict=True)}
    return Claim(
        f"With five and with six tetrahedra to a voxel, {across} voxels across, a bar that is solved to the end reaches "
        f"{words.listed(texts)} (Poisson's ratios) of the continuum's sag: six lock where the material is nearly "
        "incompressible.",
        numbers, all(five > six for _, five, six in pairs),
    )  # fmt: skip
