"""The stages of a position-based sheet's plan on CUDA, one by one, each over the whole sheet."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.gpu_backend.core.forces import bind_forces
from softlab.gpu_backend.position_based.stages import make_xpbd_stages
from softlab.model.core.plan import Moment, StageRun
from softlab.model.position_based.plan import colour_order


def bind_xpbd_stages(sim: Any) -> dict[str, StageRun]:
    """Return the function of each named stage of `sim`, a gpu_backend.xpbd.solver.PositionBased. The state stays in its
    buffer; the positions at the start of a substep are copied."""
    axes, parts = sim.scene.dimensions, sim.plan.parts
    stage, flat = make_xpbd_stages(sim.real, sim.options.math, parts, axes), sim._flat
    position, velocity, record, integers = sim.position[0], sim.velocity[0], sim.record, sim.integers
    a, before = sim.new_array(), sim.new_array()

    def predict(moment: Moment) -> None:
        before.copy_to_device(position, stream=sim.stream)
        stage.predict[flat](before, velocity, a, position, record, *sim.shape)

    def project(entry: int) -> StageRun:
        return lambda moment: sim.project_colour(entry, before, position, moment.fresh)

    def project_all(moment: Moment) -> None:
        sim.project_all(before, position, sim.scratch, moment.fresh)
        position.copy_to_device(sim.scratch, stream=sim.stream)

    def move(moment: Moment) -> None:
        sim.matching.move(position, sim.scratch, record)
        position.copy_to_device(sim.scratch, stream=sim.stream)

    def wind(moment: Moment) -> None:
        stage.wind[flat](position, velocity, record, integers, np.int64(moment.number), a, *sim.shape)

    def update_velocity(moment: Moment) -> None:
        stage.update_velocity[flat](before, position, velocity, record)

    def collide(moment: Moment) -> None:
        stage.collide[flat](before, position, velocity, record, sim.bodies, integers, np.int64(moment.number))

    colours = {
        f"project {family.name} {colour}": project(entry) for entry, (family, colour) in enumerate(colour_order(parts))
    }
    return (
        colours
        | bind_forces(sim, parts, position, a)
        | {
            "wind": wind,
            "predict": predict,
            "project all": project_all,
            "match clusters": lambda moment: sim.matching.match(position),
            "move to goals": move,
            "find contacts": lambda moment: sim.contacts.find(before, position),
            "project contacts": lambda moment: sim.contacts.project(before, position),
            "attachments": lambda moment: sim.attach(before, position),
            "update velocity": update_velocity,
            "collide": collide,
        }
    )
