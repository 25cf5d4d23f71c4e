"""Every declared experiment, by the command that measures it; modules are imported on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softlab.model.base.components import named

if TYPE_CHECKING:  # every command imports this list
    from softlab.bench.measure.declaration import Experiment

# command -> where its experiments are, in the order of the commands and of `softlab lab`
EXPERIMENTS: dict[str, tuple[str, ...]] = {
    command: tuple(place if ".bench." in place else f"softlab.bench.experiments.{place}" for place in places.split())
    for command, places in {
        "sweep": "scaling.experiment:Scaling",
        "accuracy": "accuracy.experiment:Accuracy findings.experiment:Findings findings.costs:Costs convergence:Convergence",
        "stability": "stability.experiment:Stability",
        "hard": "softlab.bench.stress.experiment:Hard",
        "projections": "projections:Projections element_projections:ElementProjections",
        "throughput": "throughput:Throughput",
        "fluids": "fluids:Fluids fluid_truth.rows:FluidTruth fluid_rest:FluidRest",
        "busy": "busy:Busy",
        "tetrahedra": "tetrahedral.decides:Tetrahedra tetrahedral.meshes:Meshes",
        "bar": "bar_rows:BarMaterial bar_costs:BarCosts",
    }.items()
}


def experiments(*commands: str) -> list[Experiment]:
    """Import and return the experiments of these commands, or all."""
    return [named(place)() for command in commands or EXPERIMENTS for place in EXPERIMENTS[command]]
