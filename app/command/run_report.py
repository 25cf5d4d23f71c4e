"""Numerical report of a run: printed as it is by `softlab run --json`, and in words by `softlab run`
(app/command/tables.py)."""

from __future__ import annotations

from softlab.app.command.run_parts import built_report, contact_report
from softlab.app.outcome import outcome_of
from softlab.app.presentation import presentation_of
from softlab.app.shared import sharing_report
from softlab.model.base.errors import Diverged
from softlab.model.contact.shortfalls import shortfalls
from softlab.model.core.energy import energies
from softlab.model.core.simulation import Simulation, State
from softlab.model.core.spare import counts


def run_report(
    simulation: Simulation, state: State, steps: int, seconds: float, compile_seconds: float, diverged: Diverged | None
) -> dict[str, object]:
    """Return the report of a run of `steps` steps that took `seconds` [s], and ended in `state`: energies [J], speeds
    [m/s], strain, the solver's numbers about contacts, bodies and fluids, and which of its physics is incomplete."""
    scene = simulation.scene
    energy = energies(scene, state.position, state.velocity, state.arrays, state.inverse_mass)
    presentation = presentation_of(scene)
    speed = (state.velocity.astype("float64") ** 2).sum(axis=1)
    count = counts(scene, simulation.body.inverse_mass).particles
    faults = shortfalls(simulation, state.position, state.inverse_mass)
    rate = count * steps / seconds if seconds > 0 and not diverged else None
    return {
        "scene": scene.name,
        "backend": simulation.backend,
        "device": simulation.device,
        "threads": simulation.threads,
        "threads_reason": simulation.threads_reason,
        "precision": simulation.options.precision,
        "math": simulation.options.math,
        "kernel": simulation.kernel,
        **sharing_report(simulation),
        "method": scene.method.label,
        "particles": count,
        "dimensions": scene.dimensions,
        "steps": steps if diverged is None else state.step,
        "dt": scene.method.dt,
        "substeps": scene.method.substeps,
        "iterations": scene.method.iterations,
        "time": state.time,
        "seconds": seconds,
        "compile_seconds": compile_seconds,
        "particle_steps_per_second": rate,
        "kinetic_energy": energy["kinetic"],
        "potential_energy": energy["potential"],
        "conserved": energy["conserved"],
        "max_speed": float(speed.max() ** 0.5),
        "max_strain": presentation.max_strain(scene, state.position, state.arrays),
        "error": None,
        "error_reason": "not judged",
        "outcome": outcome_of(faults, diverged),
        **contact_report(simulation, state),
        **presentation.report(simulation, state),
        **simulation.counters(),
        **built_report(scene),
        **faults,
    }
