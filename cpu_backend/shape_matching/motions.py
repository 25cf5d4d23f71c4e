"""Rigid motions and frames of clusters in their flat arrays, on CPU threads."""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import rebound
from softlab.model.formulas.shape_matching.pace import MOTION

FRAME = 12  # numbers of a cluster's frame


class Motion(NamedTuple):
    """A cluster's rigid motion: its centre, the velocity there, its spin."""

    x: float
    y: float
    z: float
    u: float
    v: float
    w: float
    spin_x: float
    spin_y: float
    spin_z: float


class Frame(NamedTuple):
    """A cluster's matrix, by rows, and its centre."""

    xx: float
    xy: float
    xz: float
    yx: float
    yy: float
    yz: float
    zx: float
    zy: float
    zz: float
    x: float
    y: float
    z: float


def make_motions(compiler: Compiler, real: Real) -> SimpleNamespace:
    """Make `motion_of(motions, c)`, the Motion of cluster c, and `velocity_at(motion, x, y, z)`, the velocity of a
    particle there that moves with its cluster."""
    rigid = compiler.formulas(rebound, real).rigid

    @compiler.compiled
    def motion_of(motions, c):
        n = np.int64(MOTION) * c
        return Motion(
            motions[n], motions[n + 1], motions[n + 2], motions[n + 3], motions[n + 4], motions[n + 5], motions[n + 6],
            motions[n + 7], motions[n + 8],
        )  # fmt: skip

    @compiler.inlined
    def velocity_at(motion, x, y, z):
        m, dx, dy, dz = motion, x - motion.x, y - motion.y, z - motion.z
        return (
            rigid(m.u, m.spin_y, dz, m.spin_z, dy), rigid(m.v, m.spin_z, dx, m.spin_x, dz),
            rigid(m.w, m.spin_x, dy, m.spin_y, dx),
        )  # fmt: skip

    return SimpleNamespace(motion_of=motion_of, velocity_at=velocity_at)


def make_frames(compiler: Compiler) -> SimpleNamespace:
    """Make `frame_of(frames, c)`, the Frame of cluster c, and `store_matrix(frame, xx, xy, ...)`, which writes the
    matrix of the frame that begins there."""

    @compiler.compiled
    def frame_of(frames, c):
        n = np.int64(FRAME) * c
        return Frame(
            frames[n], frames[n + 1], frames[n + 2], frames[n + 3], frames[n + 4], frames[n + 5], frames[n + 6],
            frames[n + 7], frames[n + 8], frames[n + 9], frames[n + 10], frames[n + 11],
        )  # fmt: skip

    @compiler.compiled
    def store_row(frame, axis, x, y, z):
        frame[3 * axis], frame[3 * axis + 1], frame[3 * axis + 2] = x, y, z

    @compiler.compiled
    def store_matrix(frame, xx, xy, xz, yx, yy, yz, zx, zy, zz):
        store_row(frame, 0, xx, xy, xz)
        store_row(frame, 1, yx, yy, yz)
        store_row(frame, 2, zx, zy, zz)

    return SimpleNamespace(frame_of=frame_of, store_matrix=store_matrix)
