"""Five against six tetrahedra to a voxel, meshes against the continuum, and what steps take: `softlab tetrahedra`."""

from __future__ import annotations

import io
from math import log, pi
from typing import Any

import pytest
from read_figures import LABELS, labels
from rich.console import Console
from synthetic_store import CPU_RECORD

from softlab.bench.experiments.bar_strip import REFUSED
from softlab.bench.experiments.tetrahedral.meshes import (
    CONTINUUM,
    CUTS,
    DECAY,
    FREQUENCY,
    LAW,
    PART,
    TETRAHEDRA,
    bar,
    decay,
    first_mode,
    law,
    mesh_items,
    mesh_part,
    meshes,
    print_meshes,
    steps,
    swinging,
)
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.labbook.claims.tetrahedra import CLAIMS
from softlab.model.base.errors import BackendUnavailable
from softlab.plots.core.read import load
from softlab.plots.core.style import settings
from softlab.plots.figures import tetrahedra_mesh

NOTHING = Store(":memory:")
SAGS = {  # cut, Poisson's ratio -> tip sag [m] with 1 and 2 voxels across, of another program
    (5, 0.3): (1.4276e-4, 2.7106e-4), (5, 0.499): (1.2212e-4, 2.3473e-4), (6, 0.3): (8.844e-5, 2.0305e-4),
    (6, 0.499): (5.08e-6, 8.48e-6),
}  # fmt: skip


@pytest.mark.parametrize(("cut", "poisson"), SAGS)
def test_meshes_sag_as_another_program_found(cut: int, poisson: float) -> None:
    for across, sag in zip((1, 2), SAGS[cut, poisson], strict=True):
        found = mesh_part(bar(across, cut, poisson))
        assert found[PART][0] == pytest.approx(sag / CONTINUUM[poisson], rel=2e-3)  # three digits were printed
        assert found[TETRAHEDRA][0] == cut * 10 * across**3


def test_the_law_is_implicit_eulers() -> None:
    """w^2 h / 2 of slow ones; a step of h multiplies by 1 / (1 + i w h)."""
    assert law(1.0, 1e-5) == pytest.approx((2 * pi) ** 2 * 1e-5 / 2, rel=1e-6)
    h, turn = 1 / 60, 2 * pi * 0.8334 / 60
    assert law(0.8334, h) == pytest.approx(-log(abs(1 / (1 + 1j * turn))) / h)
    assert first_mode(swinging("newton", 1, 1))[0] == pytest.approx(0.8334, abs=1e-4)  # Hz, of this mesh elsewhere


@pytest.mark.parametrize("solver", ["newton", "xpbd"])
def test_a_swing_loses_what_the_law_says(solver: str) -> None:
    """Newton's method to 1e-3; rows of 32 substeps to 4 %, being a little softer."""
    found = decay(swinging(solver, 4 if solver == "newton" else 32, 1), "cpu")
    assert found[DECAY][0] == pytest.approx(found[LAW][0], rel=1e-3 if solver == "newton" else 0.04)
    assert found[FREQUENCY][0] == pytest.approx(0.8334, rel=1e-3 if solver == "newton" else 0.02)


def test_what_a_backend_lacks_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: Any, **__: Any) -> None:
        raise BackendUnavailable("no kernels", "run it elsewhere")

    monkeypatch.setattr("softlab.bench.experiments.tetrahedral.meshes.open_simulation", missing)
    found = decay(swinging("newton", 1, 1), "gpu")
    assert all(str(reason).startswith(REFUSED) for _, _, reason in found.values())


def test_quick_is_a_part_of_the_whole() -> None:
    whole, quick = ({str(one.description) for one in mesh_items(NOTHING, ["cpu"], few)} for few in (False, True))
    assert quick < whole and len(whole) == len(mesh_items(NOTHING, ["cpu"], False))


@pytest.fixture
def made() -> Store:
    """Meshes of which six a voxel lock, and steps that follow the law, but for rows, which lose half of it."""
    store = Store(":memory:")
    store.add_machine("cpu", "Made-up machine", CPU_RECORD)
    run = store.start_run("cpu", "softlab tetrahedra", None)
    for one in mesh_items(NOTHING, ["cpu"], False):
        scene = one.description["scene"]
        if one.name == PART:
            cut = scene["beam"].get("tetrahedra", CUTS[0])
            numbers = {TETRAHEDRA: 100.0, PART: 0.6 if cut == 5 else 0.02}
        else:
            h = scene["method"]["dt"] / scene["method"]["substeps"]
            right = law(0.8334, h, scene["method"].get("order", 1))
            lost = right / 2 if scene["method"]["solver"] == "xpbd" else right
            numbers = {LAW: right, FREQUENCY: 0.83, DECAY: lost}
        for name, value in numbers.items():
            store.add_measure(run, one.description, "s", name, value, "", None)
    return store


def test_what_is_told_drawn_and_claimed(made: Store) -> None:
    held = list(measures(made))
    assert len(meshes(held)) == 2 * 3 * 3 and len(steps(held)) == 3 * 6 + 1
    console = Console(width=100, record=True, file=io.StringIO())
    print_meshes(console, made, "cpu")
    told = console.export_text()
    assert "0.020 (100)" in told and "by its law" in told and "…" not in told
    results = load(made)
    cuts = CLAIMS["tetrahedra-cuts"](results)
    assert cuts.supported and cuts.numbers["6 0.499"] == 0.02 and "4 voxels across" in cuts.sentence
    with settings():
        drawing = tetrahedra_mesh.draw(results)
        assert not isinstance(drawing, str) and labels(drawing.figure) == LABELS["tetrahedra-mesh"]
        assert isinstance(tetrahedra_mesh.draw(load(None)), str)
