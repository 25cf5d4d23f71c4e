"""Arrays of the neighbour search among particles and of their contacts for the CPU kernels, by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class PairRows(NamedTuple):
    """Rows of pairs of kinds (model/contact/particle_parameters.py), the largest distance between neighbours, number of
    kinds."""

    record: np.ndarray
    reach: float
    kinds: int


class Particles(NamedTuple):
    """Body, kind and rest position (three planes) of each particle."""

    body: np.ndarray
    kind: np.ndarray
    rest: np.ndarray


class Table(NamedTuple):
    """Cells of particles (three planes); boxes of bands; of the table the lowest cell and the counts along the axes (3,),
    and 1 if it covers all cells (1,); indices of particles' cells in the table; first particle of each cell; particles of
    a band's cells."""

    cells: np.ndarray
    boxes: np.ndarray
    low: np.ndarray
    counts: np.ndarray
    holds: np.ndarray
    buckets: np.ndarray
    starts: np.ndarray
    totals: np.ndarray


class Sorted(NamedTuple):
    """In the order of cells: particles, their positions and rest positions (six planes), their bodies; scratch of bands
    for the runs around a cell."""

    order: np.ndarray
    places: np.ndarray
    bodies: np.ndarray
    runs: np.ndarray


class Lists(NamedTuple):
    """Particles with neighbours, from each band's first place on, and their numbers of neighbours; the neighbours, one
    particle after the other, from MAX_NEIGHBOURS times that place on, and the offsets of their pairs in the record, or -1
    minus the offset within a body; of bands: first place, particles with neighbours, neighbours lost so far."""

    who: np.ndarray
    numbers: np.ndarray
    entries: np.ndarray
    pairs: np.ndarray
    begins: np.ndarray
    active: np.ndarray
    lost: np.ndarray


class Search(NamedTuple):
    """All arrays of the neighbour search."""

    particles: Particles
    table: Table
    in_order: Sorted
    lists: Lists


class Contacts(NamedTuple):
    """Places in the lists of the neighbours that are contacts now; their number of each particle; displacements or
    velocity changes by place in `who`, three each; impulses of contacts in the substep, if bodies are rigid."""

    acting: np.ndarray
    counts: np.ndarray
    moves: np.ndarray
    pressed: np.ndarray


class ContactArrays(NamedTuple):
    """All arrays of contacts; `old`: velocities at the start of the substep, if particles bounce."""

    rows: PairRows
    sweeps: int
    search: Search
    contacts: Contacts
    old: np.ndarray
