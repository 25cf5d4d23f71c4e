"""The stages of single masses of a position-based plan as CUDA kernels, each with separate arrays: slow, but easy to
read, to time and to test against the fused kernels. In all, `a` is the acceleration (quads)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import collide as collide_mass
from softlab.gpu_backend.contact.motion import predict as predict_mass
from softlab.gpu_backend.contact.motion import rate_of
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.forces import particle_features
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.wind import block_air
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.position_based.gather import valence_of, weight_of
from softlab.gpu_backend.position_based.point import add_wind
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine


@routine
def wind(position, velocity, record, integers, number, a, rows, columns):
    parameters = record[0]
    air = block_air(parameters, integers, number, 0.0)
    k = np.int32(cuda.grid(1))
    if k < a.size // SIZE:
        rows, columns = np.int32(rows), np.int32(columns)
        i, j = np.int32(k // columns), np.int32(k % columns)
        p, v, b = load_quad(position, k), load_quad(velocity, k), load_quad(a, k)
        cell = Cell(i, j, rows, columns)
        ax, ay, az = add_wind((b[0], b[1], b[2]), position, velocity, k, cell, p, v, parameters, air)
        store_quad(a, k, ax, ay, az, 0.0)


@routine
def predict(before, velocity, a, position, record, rows, columns):
    """Predict positions; `a` is set to 0, for the next substep's forces."""
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < a.size // SIZE:
        rows, columns = np.int32(rows), np.int32(columns)
        p, b = load_quad(before, k), load_quad(a, k)
        x, y, z = predict_mass(p, load_quad(velocity, k), b[0], b[1], b[2], parameters)
        spare = p[3]
        if FEATURE.jacobi or FEATURE.averaged_jacobi:
            spare = weight_of(valence_of(Cell(np.int32(k // columns), np.int32(k % columns), rows, columns)), spare)
        store_quad(position, k, x, y, z, spare)
        store_quad(a, k, 0.0, 0.0, 0.0, 0.0)


@routine
def update_velocity(before, position, velocity, record):
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        b, p = load_quad(before, k), load_quad(position, k)
        vx, vy, vz = rate_of(p, b, parameters)
        store_quad(position, k, p[0], p[1], p[2], b[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def collide(before, position, velocity, record, bodies, integers, number):
    world = World(record[0], bodies, integers)
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        b, p, v = load_quad(before, k), load_quad(position, k), load_quad(velocity, k)
        px, py, pz, vx, vy, vz = collide_mass(b, p, v[0], v[1], v[2], world, number)
        store_quad(position, k, px, py, pz, p[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@cache
def make_xpbd_stages(real: Real, math: str, parts: frozenset[str], axes: int) -> SimpleNamespace:
    """Compile the stages of single masses: wind, prediction, velocity, colliders. core/forces.py has other forces."""
    variant, kernels = (
        device_variant(real, math, particle_features(parts, axes)),
        (wind, predict, update_velocity, collide),
    )
    return kernels_of(variant, math, kernels, f"xpbd_{variant_name(real, math, axes, parts)}")
