"""The bar's figures and claims, from made-up measurements."""

from __future__ import annotations

import pytest
from read_figures import LABELS, labels
from synthetic_store import CPU_RECORD, GPU_RECORD, Maker

from softlab.bench.experiments.bar import ELEMENTS, LAW, STRIP, experiments
from softlab.bench.experiments.bar_body import (
    CLUSTERS,
    LENGTH,
    LEVER_ARM,
    rod_swing,
    standing_sag,
)
from softlab.bench.experiments.bar_rows import JELLY
from softlab.bench.experiments.bar_strip import (
    ACROSS,
    DECAY,
    FRAME,
    FREQUENCY,
    REFUSED,
    SAG,
    beam_tip,
    chain_frequency,
    chain_of_clusters,
    chain_sag,
    implicit_frequency,
    method_of,
    rod_frequency,
    rod_sag,
    strip,
    verlet_frequency,
)
from softlab.bench.experiments.body_laws import (
    ANGULAR_MOMENTUM,
    DROP,
    ENERGY,
    MOMENTUM,
    SPIN,
    SPIN_LAW,
    spin_left,
)
from softlab.bench.store.database import Store
from softlab.labbook.claims import bodies, body_laws
from softlab.plots.core.data import Results
from softlab.plots.core.read import load
from softlab.plots.core.style import Drawing, settings
from softlab.plots.figures.bar import bars, draw, draw_clusters

CLAIMS = {**bodies.CLAIMS, **body_laws.CLAIMS}


# ---------------------------------------------------------------------- figures and lab book


def made_up(record=CPU_RECORD, softer: float = 0.3, gpu_off: float = 0.0) -> Results:
    """Chains of springs, positions too soft by `softer` (h / d)^2, a GPU that is off by a part."""
    store = Store(":memory:")
    maker = Maker(store, record, "b")

    def add(told, name: str, number: float | None, unit: str = "", reason: str | None = None) -> None:
        store.add_measure(maker.run, told, "sources", name, number, unit, reason)

    for backend in ("cpu", "gpu") if record["gpu"] else ("cpu",):
        off = 1 + (gpu_off if backend == "gpu" else 0)
        for one in experiments(backend):
            told_ = one.description
            finding, substeps = told_["finding"], told_["substeps"]
            if finding == LAW:
                law = told_["law"]
                add(
                    told_,
                    ANGULAR_MOMENTUM if law != DROP else ENERGY,
                    spin_left(substeps) * off if law != DROP else 1e-5 / 10**substeps,
                )
                if law != DROP:
                    add(told_, SPIN_LAW if law == SPIN else MOMENTUM, spin_left(substeps) if law == SPIN else 1e-13)
                continue
            fine = told_.get("links", told_.get("layers"))
            soft = 1 + softer * (fine / substeps / 4) ** 2
            if finding == STRIP:
                solver = told_["solver"]
                if solver == "mass-spring" and substeps < 4:
                    add(told_, one.name, None, "", f"{REFUSED}: over the stability limit")
                    continue
                scene = strip(fine, method_of(told_["solver"].split(",")[0], substeps, region=told_["region"]))
                sag, frequency = chain_sag(fine), chain_frequency(fine)
                frequency = (verlet_frequency if solver == "mass-spring" else implicit_frequency)(
                    frequency, FRAME / substeps
                )
                if solver == "shape-matching":
                    sag, frequency = chain_of_clusters(scene)
                elif solver == "xpbd":
                    sag, frequency = sag * soft, frequency / soft
                numbers = {
                    SAG: sag,
                    FREQUENCY: frequency,
                    ACROSS: 1.1 * beam_tip() if solver == "shape-matching" else LENGTH,
                }
                add(told_, one.name, numbers[one.name] * off)
                if one.name == FREQUENCY:
                    add(told_, DECAY, 0.0 if solver == "mass-spring" else 0.1)
            elif finding == ELEMENTS:
                worse = soft if told_["solver"] == "tetrahedra, xpbd" else 1.0
                numbers = {SAG: rod_sag() * worse, FREQUENCY: rod_frequency() / worse, ACROSS: 0.6 * beam_tip()}
                add(told_, one.name, numbers[one.name] * off)
            elif one.name == SAG:
                add(told_, SAG, standing_sag(fine) * soft * off)
            else:
                for name, number in (
                    (FREQUENCY, rod_swing() / soft),
                    (DECAY, 0.2),
                    (LEVER_ARM, 0.05 * told_["overlap"]),
                    (CLUSTERS, 3),
                ):
                    add(told_, name, number * off)
    return load(store)


def test_figures_are_drawn_or_say_why_not() -> None:
    with settings():
        for figure, wanted in ((draw, LABELS["bar-solvers"]), (draw_clusters, LABELS["bar-clusters"])):
            drawing = figure(made_up())
            assert isinstance(drawing, Drawing)
            assert labels(drawing.figure) == wanted
            assert "Made-up CPU" in drawing.caption and "  " not in drawing.caption
            assert figure(load(None)) == "the bar was not measured (softlab bar)"
    curves = {line.get_label() for line in draw(made_up()).figure.axes[1].lines}
    assert {"mass-spring", "XPBD, 1 iteration", "shape matching, jelly bar", "tetrahedra, Newton"} <= curves
    explicit = next(line for line in draw(made_up()).figure.axes[1].lines if line.get_label() == "mass-spring")
    assert list(explicit.get_xdata()) == [4, 8, 16]  # what was refused has no mark


def test_claims_follow_the_measurements() -> None:
    results, nothing = made_up(), load(None)
    for name, claim in CLAIMS.items():
        made, neutral = claim(results), claim(nothing)
        assert made.sentence[0].isupper() and made.sentence.endswith("."), name
        assert "nan" not in made.sentence and "None" not in made.sentence, name
        assert not neutral.supported and neutral.sentence.endswith("."), name
        assert made.supported == (name != "bar-backends"), name
    claims = {name: claim(results) for name, claim in CLAIMS.items()}
    assert "Up to 2 steps a frame mass-spring is refused" in claims["bar-springs"].sentence
    assert claims["bar-iterations"].numbers["few"] == pytest.approx(1 + 0.3 * 16)
    assert claims["bar-overlap"].numbers["stiffer"] == pytest.approx(4)
    assert claims["body-spin"].numbers["kept"] == pytest.approx(spin_left(16))
    assert not CLAIMS["bar-iterations"](made_up(softer=0.0)).supported


def test_backends_are_held_against_each_other() -> None:
    same, other = (CLAIMS["bar-backends"](made_up(GPU_RECORD, gpu_off=off)) for off in (0.0, 1e-3))
    assert same.supported and "the same numbers to the last bit" in same.sentence
    assert not other.supported and "a bug of this lab" in other.sentence
    found, _ = bars(made_up(GPU_RECORD))
    assert {bar.backend for bar in found} == {"cpu", "gpu"} and any(bar.solver == JELLY for bar in found)
