"""The stages of a fluid's plan on CUDA, one by one: slow, easy to time and to test against whole substeps."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from softlab.gpu_backend.core.device import Arguments
from softlab.gpu_backend.fluid.cells import Particles
from softlab.model.core.plan import Moment, StageRun


class Bound(NamedTuple):
    """The function of each stage of a plan, `stages`, and the arrays `now`, as the last stage left them.

    `now`: the prediction ("given") and the positions ("position", "other").
    """

    stages: dict[str, StageRun]
    now: dict[str, Any]


def bind_fluid_stages(sim: Any) -> Bound:
    """Return the function of each stage of `sim`, a gpu_backend.fluid.solver.Fluid. The state stays in its buffer."""
    flat, cells, relaxing, settling = sim._flat, sim.cells, sim.relaxing, sim.settling
    state, velocity, start = sim.position[0], sim.velocity[0], sim.on_device(np.zeros(1, np.int64))
    now: dict[str, Any] = {"given": (), "position": sim.sorted, "other": sim.corrected}

    def world(moment: Moment) -> Arguments:
        return sim.bodies, sim.integers, *time(moment)

    def time(moment: Moment) -> Arguments:
        return start, np.int64(moment.step), np.int64(moment.substeps), np.int64(moment.substep)

    def emit(moment: Moment) -> None:
        sim.flow.emit(state, velocity, sim.particle[0], time(moment))

    def predict(moment: Moment) -> None:
        now["given"] = sim.predict(0, time(moment))

    def sort(moment: Moment) -> None:
        into = Particles(sim.sorted, sim.before, sim.predicted_velocity, sim.particle[1])
        cells.sort(sim.record, now["given"], into)
        sim.particle[0].copy_to_device(sim.particle[1], stream=sim.stream)
        now["position"], now["other"] = sim.sorted, sim.corrected

    def find(moment: Moment) -> None:
        relaxing.find[flat](now["position"], sim.record, *sim.near, cells.counts)
        relaxing.factors[flat](now["position"], sim.record, *sim.lists, *sim.relaxed, sim.fluids, *world(moment))

    def density(moment: Moment) -> None:
        relaxing.density[flat](now["position"], sim.record, *sim.lists, *sim.relaxed, *world(moment))

    def correct(moment: Moment) -> None:
        arguments = sim.before, now["position"], sim.record, *sim.lists, sim.gradients, sim.fluids, *world(moment)
        relaxing.correct[flat](*arguments, now["other"])
        now["position"], now["other"] = now["other"], now["position"]

    def update(moment: Moment) -> None:
        arguments = sim.before, sim.predicted_velocity, now["position"], sim.record, sim.multipliers, sim.fluids
        settling.update[flat](*arguments, *world(moment), state, velocity)

    def shape(moment: Moment) -> None:
        sim.smoothing.shape[flat](state, velocity, sim.record, *sim.lists, sim.before, sim.sorted)

    def limit(moment: Moment) -> None:
        if sim.smoothing:
            smooth()
        settling.limit[flat](state, velocity, sim.constraints, sim.record, sim.fluids)

    def smooth() -> None:
        sim.predicted_velocity.copy_to_device(velocity, stream=sim.stream)
        sim.smoothing.smooth[flat](
            state,
            sim.predicted_velocity,
            sim.record,
            *sim.lists,
            sim.constraints,
            sim.fluids,
            sim.before,
            sim.sorted,
            velocity,
        )

    stages: dict[str, StageRun] = {
        "emit": emit,
        "predict": predict,
        "sort into cells": sort,
        "find neighbours": find,
        "density": density,
        "correct": correct,
        "update velocity": update,
        "normals and vorticity": shape,
        "limit velocities": limit,
    }
    return Bound(stages, now)
