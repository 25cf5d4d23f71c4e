"""Rotations on CUDA in exact math: the CPU's bits, of every kind of matrix."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest
from numba import cuda

from softlab.cpu_backend.core.compile import Compiler
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.model.formulas import rotation


def matrices() -> np.ndarray:
    """(n, 9): random, mirrored, half turns, flat, on a line, nearly so, of tiny and huge entries, none."""
    random, rows = np.random.default_rng(12), []
    rows += [one * scale for one in random.normal(size=(12, 9)) for scale in (1e-12, 1.0)]
    rows += [np.outer(*random.normal(size=(2, 3))) + noise * random.normal(size=(3, 3)) for noise in (0, 1e-7, 1e-3)]
    diagonals = [
        (-1, -1, 1),
        (-3, -2, -1),
        (1, 1, 0),
        (1, 0, 0),
        (1, 1, -1),
        (1, 0.5, -0.4999),
        (0, 0, 0),
        (1e12, 1e12, -9e11),
    ]
    return np.array([np.ravel(row) for row in rows] + [np.diag(np.array(d, float)).ravel() for d in diagonals])


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_exact_math_gives_the_bits_of_the_cpu(real: Any) -> None:
    A = matrices().astype(real)
    before = np.random.default_rng(1).normal(size=(len(A), 4))
    before = (before / np.linalg.norm(before, axis=1, keepdims=True)).astype(real)
    compiler = Compiler(f"rotation_{np.dtype(real).name}", "exact")
    made = compiler.formulas(rotation, real)
    near, far, flat = made.rotation_3d_near, made.rotation_3d_far, made.rotation_2d

    @numba.njit(**compiler.options)
    def on_cpu(A, q, out):
        for k in range(len(A)):
            a, b = A[k], q[k]
            matrix, quaternion = (a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]), (b[0], b[1], b[2], b[3])
            w, x, y, z, reached = near(matrix, quaternion)
            if not reached:
                w, x, y, z = far(matrix, (w, x, y, z))
            out[k, 0], out[k, 1], out[k, 2], out[k, 3] = w, x, y, z
            out[k, 4], out[k, 5] = flat(a[0], a[1], a[3], a[4], b[0], b[1])

    whole, plane = (getattr(device_formulas(rotation, real, "exact"), name) for name in ("rotation_3d", "rotation_2d"))

    @cuda.jit
    def on_gpu(A, q, out):
        k = cuda.grid(1)
        a, b = A[k], q[k]
        w, x, y, z = whole((a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]), (b[0], b[1], b[2], b[3]))
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = w, x, y, z
        out[k, 4], out[k, 5] = plane(a[0], a[1], a[3], a[4], b[0], b[1])

    expected, found = np.zeros((len(A), 6), real), cuda.to_device(np.zeros((len(A), 6), real))
    on_cpu(A, before, expected)
    on_gpu[1, len(A)](cuda.to_device(A), cuda.to_device(before), found)
    assert np.array_equal(found.copy_to_host(), expected)
    assert np.abs(np.linalg.norm(expected[:, :4], axis=1) - 1).max() < 4 * np.finfo(real).eps
