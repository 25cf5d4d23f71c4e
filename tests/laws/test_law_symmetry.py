"""The same motion somewhere else, turned, mirrored, renumbered, in other units, and beside others."""

from __future__ import annotations

from typing import Any

import numpy as np
from lab import Lab, farthest, rounded, start, stirred_run
from law import limit_of, of
from rows import Row
from units import in_units

from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

STEPS = 4
SHIFT = 4.0  # m: a power of two, so that float64 starts are the same ones
FAR = 1024.0  # m


def changed(state: State, place: Any, turn: Any) -> State:
    """The state with `place` of its positions, `turn` of its velocities."""
    position = np.asarray(state.position, np.float64)
    return State(place(position), turn(np.asarray(state.velocity, np.float64)), state.inverse_mass, 0.0, 0)


def quarter(vectors: np.ndarray) -> np.ndarray:
    """Turned by a right angle about z: (x, y) -> (-y, x), which rounds nothing."""
    result = vectors.copy()
    result[:, 0], result[:, 1] = -vectors[:, 1], vectors[:, 0]
    return result


def mirror(vectors: np.ndarray) -> np.ndarray:
    """x -> -x"""
    return vectors * np.array([-1.0, 1.0, 1.0][: vectors.shape[1]])


def spread(row: Row, lab: Lab, *states: State) -> float:
    """[m]: how far two runs may be apart after STEPS whose every substep is rounded differently by `noise`. A
    difference grows while it is stiff no faster than the motion itself does: n substeps, `iterations` each, over the
    time t, and half as much for each turn of a vibration in it."""
    n = STEPS * row.bare.method.substeps
    return n * (1 + row.bare.method.iterations) * lab.noise(row.bare, *states) * row.h * n


@of("symmetry")
def test_the_same_motion_shifted_turned_mirrored_renumbered(row: Row, case: str, lab: Lab) -> None:
    """step(T x) = T step(x) for a shift, a quarter turn, a reflection, and two bodies that change places in the
    scene: nothing but the order of roundings is different, which `spread` bounds. A shift by d adds an ulp of d to
    each coordinate. Renumbered bodies are other particles in other tables, and have the same bits."""
    if case == "renumbered":
        renumbered(row, lab)
        return
    begin, one = stirred_run(lab, row, STEPS)

    def shifted(position: np.ndarray) -> np.ndarray:
        return position + SHIFT

    place, turn = {"shifted": (shifted, lambda v: v), "turned": (quarter, quarter), "mirrored": (mirror, mirror)}[case]
    two = lab.run(row.bare, STEPS, changed(begin, place, turn))
    limit = limit_of("symmetry", row)
    far = farthest(np.asarray(two.position, np.float64) - place(np.asarray(one.position, np.float64)))
    moved = farthest(np.asarray(one.position, np.float64) - begin.position)
    assert far <= spread(row, lab, begin, one, two) + (limit.part * moved if limit else 0.0), (far, moved)


def renumbered(row: Row, lab: Lab) -> None:
    """The bodies of a scene, in the file's order and the other way round; the second one is another copy, 4 m away."""
    if row.bare.fluids and row.family != "world":
        swapped_particles(row, lab)
        return
    tables = dict(row.tables)
    if row.family != "world":
        tables["other"] = tables[row.body] | {"origin": [0.0, 0.0, 4.0]}
    first, second = Scene(tables, "law"), Scene(dict(reversed(tables.items())), "law")
    names = [name for name in tables if name in ("body", "other", "cloth", "jelly")]
    begin, random = start(first), np.random.default_rng(7)
    away = random.uniform(-1, 1, begin.position.shape) * row.stretch * 0.25
    begin = start(first, rounded(begin.position + away), rounded(random.uniform(-1, 1, away.shape)))
    order = np.empty(len(begin.position), np.int64)
    for name in names:
        order[particles(second, name)] = particles(first, name)
    other = State(begin.position[order], begin.velocity[order], begin.inverse_mass[order], 0.0, 0)
    one, two = lab.run(first, STEPS, begin), lab.run(second, STEPS, other)
    limit = limit_of("bystanders", row)
    if limit is None and row.family != "world":
        assert np.array_equal(one.position[order], two.position)
    else:
        far = farthest(np.asarray(one.position[order], np.float64) - two.position)
        moved = farthest(np.asarray(one.position, np.float64) - begin.position)
        assert far <= (limit.part * moved if limit else 0.0) + spread(row, lab, one, two), far


def swapped_particles(row: Row, lab: Lab) -> None:
    """Particles of a fluid change their numbers: sums over neighbours are in another order."""
    begin = start(row.bare)
    begin = State(begin.position, -2.0 * (begin.position - begin.position.mean(axis=0)), begin.inverse_mass, 0.0, 0)
    order = np.random.default_rng(5).permutation(len(begin.position))
    other = State(begin.position[order], begin.velocity[order], begin.inverse_mass[order], 0.0, 0)
    one, two = lab.run(row.bare, STEPS, begin), lab.run(row.bare, STEPS, other)
    far = farthest(np.asarray(one.position[order], np.float64) - two.position)
    assert far <= 30 * spread(row, lab, one, two)  # a sum over 30 neighbours rounds as often


def particles(scene: Scene, name: str) -> np.ndarray:
    """Which particles a body of the scene has."""
    if scene.is_world:
        member = next(one for one, part in scene.members.items() if name in part.parts)
        return scene.world_set.slices()[member].start + particles(scene.members[member], name)
    if scene.bodies:
        return np.concatenate(
            [np.arange(one.particles.start, one.particles.stop) for one in scene.body_set.copies if one.name == name]
        )
    if scene.tetrahedra:
        result = scene.tetrahedra_set
        ends, number = [*result.first_particle, result.particle_count], result.names.index(name)
        return np.arange(ends[number], ends[number + 1])
    if scene.fluids:
        return np.flatnonzero(scene.fluid_set.fluid == scene.fluid_set.names.index(name))
    return np.arange(scene.grid.particle_count)


@of("similarity")
def test_other_units_of_length_time_and_mass_give_the_same_bits(row: Row, case: str, lab: Lab) -> None:
    """A motion has no units: with all lengths (times, masses) times 4 every product is the same number but for its
    exponent, so that positions over the length and velocities over length and time are the same bits. What differs is
    a bound that has a unit of its own and stands in a kernel as a number."""
    scale = {"length": 1.0, "time": 1.0, "mass": 1.0} | {case: 4.0}
    other = Scene(in_units(row.tables, **scale), "law")
    begin, one = stirred_run(lab, row, STEPS)
    ratio = scale["length"] / scale["time"]
    start_of_other = State(
        begin.position * scale["length"], begin.velocity * ratio, begin.inverse_mass / scale["mass"], 0.0, 0
    )
    two = lab.run(other, STEPS, start_of_other)
    assert np.array_equal(two.position / one.position.dtype.type(scale["length"]), one.position)
    assert np.array_equal(two.velocity / one.position.dtype.type(ratio), one.velocity)


@of("far")
def test_the_same_motion_far_from_the_origin(row: Row, case: str, lab: Lab) -> None:
    """A kilometre away coordinates are coarser, and nothing else: the difference to the motion at the origin is what
    `noise` of coordinates of that size makes of it, which `spread` adds up."""
    begin, one = stirred_run(lab, row, STEPS)
    two = lab.run(row.bare, STEPS, changed(begin, lambda position: position + FAR, lambda v: v))
    far = farthest(np.asarray(two.position, np.float64) - FAR - one.position)
    assert far <= spread(row, lab, begin, one, two), far


@of("bystanders")
def test_bystanders_keep_every_bit(row: Row, case: str, lab: Lab) -> None:
    """A second body 32 m away that meets nothing changes no bit of the first: neither sums, orders nor constants of a
    scene depend on it (model/core/stability/laws.py has the one solver whose steps do)."""
    body = row.tables["jelly" if row.family == "world" else row.body]
    away = [32.0, 0.0, 0.0][: 2 if body.get("dimensions") == 2 else 3]
    more = Scene(row.tables | {"beside": body | {"origin": away}}, "law")
    both, (alone, one) = start(more), stirred_run(lab, row, STEPS)
    first_body = np.ones(len(both.position), bool)
    first_body[particles(more, "beside")] = False
    random, rest = np.random.default_rng(3), both.position[~first_body]
    position, velocity = both.position.copy(), both.velocity.copy()
    position[first_body], velocity[first_body] = alone.position, alone.velocity
    position[~first_body] = rounded(rest + random.uniform(-0.25, 0.25, rest.shape) * row.stretch)
    velocity[~first_body] = 0.25
    two = lab.run(more, STEPS, State(position, velocity, both.inverse_mass, 0.0, 0))
    limit = limit_of("bystanders", row)
    if limit is None:
        assert np.array_equal(two.position[first_body], one.position)
        assert np.array_equal(two.velocity[first_body], one.velocity)
        return
    far = farthest(np.asarray(two.velocity[first_body], np.float64) - one.velocity)
    change = farthest(np.asarray(one.velocity, np.float64) - alone.velocity)
    assert far <= limit.part * change + spread(row, lab, one, two) / (row.h * STEPS * row.bare.method.substeps)
