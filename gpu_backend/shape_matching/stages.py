"""The stages of the plan of bodies on CUDA, one by one: slow, easy to time and to test against whole substeps."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.gpu_backend.core.forces import bind_forces
from softlab.gpu_backend.core.quads import AXES, SIZE
from softlab.gpu_backend.position_based.stages import make_xpbd_stages
from softlab.model.core.plan import Moment, StageRun


def bind_bodies_stages(sim: Any) -> dict[str, StageRun]:
    """Return the function of each stage of the plan of `sim`, a gpu_backend.shape_matching.solver.Bodies. The state
    stays in its buffer; the positions at the start of a substep are copied."""
    flat, shape = sim._flat, (np.int32(1), np.int32(sim.particle_count))
    position, velocity, before, old = sim.position[0], sim.velocity[0], sim.position[1], sim.velocity[1]
    a = sim._zeros(SIZE * sim.particle_count)
    stage = make_xpbd_stages(sim.real, sim.options.math, sim._parts, AXES)

    def predict(moment: Moment) -> None:
        before.copy_to_device(position, stream=sim.stream)
        if sim._rigid:
            sim._rigid.begins.predict[flat](before, velocity, a, position, sim.record, sim._rigid.travel)
        else:
            stage.predict[flat](before, velocity, a, position, sim.record, *shape)

    def find(moment: Moment) -> None:
        sim.contacts.find(position)

    def project(moment: Moment) -> None:
        sim.contacts.project(before, position, sim.inertial, sim.couples)

    def turn(moment: Moment) -> None:
        sim._couples.turn(position, sim._entries, sim._leans, sim._gathered, sim.inertial)

    def update(moment: Moment) -> None:
        if sim.contacts and sim.contacts.bounces:
            old.copy_to_device(velocity, stream=sim.stream)
        if sim._rigid:
            ends, last = sim._rigid.ends, (sim.record, sim._rigid.travel)
            if sim.contacts:
                ends.update_calmed[flat](before, position, velocity, sim.contacts.record, *last)
            else:
                ends.update[flat](before, position, velocity, *last)
        elif sim.contacts:
            sim._contact_ends.update_velocity[flat](before, position, velocity, sim.contacts.record, sim.record)
        else:
            stage.update_velocity[flat](before, position, velocity, sim.record)

    def collide(moment: Moment) -> None:
        number = np.int64(moment.number)
        if sim._rebounds and sim._rebounds.turns:
            sim._rebounds.impulses.copy_to_device(velocity, stream=sim.stream)
        stage.collide[flat](before, position, velocity, sim.record, sim.bodies, sim.integers, number)

    def move(moment: Moment) -> None:
        sim._move(position)
        sim._lattices.move(position)

    def steady(moment: Moment) -> None:
        sim._rigid.steady(position, velocity, sim._entries, sim._leans, sim._gathered)

    def rest(moment: Moment) -> None:
        sim._rigid.rest(before, position, velocity, sim._entries)

    def damp(moment: Moment) -> None:
        sim._material.gather(position, velocity, sim._entries, sim._leans)
        sim._material.ends.slow[flat](position, velocity, *sim._material.slowing(sim._gathered))

    def rebound(moment: Moment) -> None:
        sim._rebounds.differ(velocity)
        sim._rebound(position, velocity)

    def link(number: int) -> StageRun:
        return lambda moment: sim._links.project(position, sim.record, number, moment.fresh)

    colours = sim.scene.body_set.links.colours
    return (
        {f"project links {number}": link(number) for number in range(colours)}
        | bind_forces(sim, sim._parts, position, a)
        | {
            "predict": predict,
            "match clusters": lambda moment: sim._match(position, sim.rotation),
            "move to goals": move,
            "find neighbours": find,
            "project contacts": project,
            "bounce": lambda moment: sim._bounce(position, old, velocity),
            "turn by friction": turn,
            "update velocity": update,
            "keep momenta": steady,
            "rest": rest,
            "damp clusters": damp,
            "collide": collide,
            "rebound": rebound,
        }
    )
