"""What many GPUs would do with a grid, by a small model: the steps of a window, an exchange, neighbours that wait for one
another, files to restart from, and a GPU that fails.

A step of the largest window is taken from the table of kernels (gpu_backend/mass_spring/grid/choice.py), an exchange from a
link (model/domains/link.py). Nothing is hidden behind anything, so that this is an upper bound of what these two cost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np

from model.domains.decomposition import Decomposition, Reach, decompose
from model.domains.link import NETWORK, NVLINK, Link

MASS_BYTES = 16  # of a mass's state in float32
CYCLES = 400  # of `waiting`
EVERY = (1, 2, 4, 8, 16, 32, 64)  # steps between exchanges, of which the quickest is taken
SEED = 1
Seconds = Callable[[int, int], float]


@dataclass(frozen=True)
class Cluster:
    """GPUs in hosts of `per_host`, linked by `inside`, the hosts by `across`. `launches` [s]: what an exchange costs besides
    its message. `jitter`: how much longer a cycle takes at random, of its own time, the mean of an exponential. `files`
    [B/s]: to the file system, of all together. `mean_life` [h]: of a GPU between failures.

    The last four are assumptions, apart from `mean_life`: 419 unexpected interruptions in 54 days on 16 384 GPUs (A. Dubey
    and others, "The Llama 3 Herd of Models", 2024, section 3.3.4).
    """

    per_host: int = 8
    inside: Link = NVLINK
    across: Link = NETWORK
    launches: float = 5e-6
    jitter: float = 0.01
    files: float = 100e9
    mean_life: float = 54 * 24 * 16384 / 419

    def link(self, count: int) -> Link:
        """The slowest that `count` GPUs exchange by."""
        return self.inside if count <= self.per_host else self.across


@dataclass(frozen=True)
class Predicted:
    """Of a grid on several GPUs, a step [s]: `compute` of the largest window, `exchange`; `waiting`: for neighbours that take
    longer than it does itself."""

    decomposition: Decomposition
    compute: float
    exchange: float
    waiting: float

    @property
    def step(self) -> float:
        return self.compute + self.exchange + self.waiting

    @property
    def rate(self) -> float:
        """Masses a second."""
        return self.decomposition.rows * self.decomposition.columns / self.step


def window_seconds(rows: int, columns: int) -> float:
    """A step of a float32 window on one GPU [s], by the table of kernels and on the GPU that it was measured on."""
    from gpu_backend.mass_spring.grid.choice import MEASURED_LIMITS, step_seconds

    return step_seconds(rows, columns, np.float32, MEASURED_LIMITS)


def predicted(
    rows: int, columns: int, count: int, cluster: Cluster, steps: int | None = None, seconds: Seconds = window_seconds
) -> Predicted:
    """A step of a grid on `count` GPUs that exchange every `steps` steps (None: whatever of EVERY is quickest). Raises
    SceneError where its rows do not do."""
    if count > 1 and steps is None:
        able = [n for n in EVERY if n == 1 or Reach().halo(n) <= rows // count]
        found = [predicted(rows, columns, count, cluster, n, seconds) for n in able]
        return min(found, key=lambda one: one.step)
    cut = decompose(rows, columns, count, Reach(), steps)
    compute = seconds(max(domain.window_rows for domain in cut.domains), columns)
    if count == 1:
        return Predicted(cut, compute, 0.0, 0.0)
    exchange = cluster.link(count).seconds(cut.bytes_sent(MASS_BYTES)) + cluster.launches
    cycle = compute * cut.steps
    late = waiting(count, cycle, exchange, cluster.jitter) - cycle * (1 + cluster.jitter) - exchange
    return Predicted(cut, compute, exchange / cut.steps, late / cut.steps)


def waiting(
    count: int, cycle: float, exchange: float, jitter: float, *, together: bool = False, cycles: int = CYCLES
) -> float:
    """Seconds of a cycle of `count` domains in a row, each of which takes `cycle` [s] and now and then longer, and begins the
    next one when it and its neighbours have done this one and exchanged. `together`: when all have, as with a collective."""
    random = np.random.default_rng(SEED)
    done = np.zeros(count)
    for _ in range(cycles):
        done = done + cycle * (1 + jitter * random.exponential(size=count))
        if together:
            done = np.full(count, done.max() + exchange)
            continue
        padded = np.pad(done, 1, constant_values=-np.inf)
        done = np.maximum(done, np.maximum(padded[:-2], padded[2:])) + exchange
    return float(done.max()) / cycles


@dataclass(frozen=True)
class Restart:
    """Of a run on many GPUs: `write` [s] of a file with all masses, `life` [s] until one of the GPUs fails, `interval` [s]
    between files, `lost`: the share of time that writing, and doing again what was lost, takes."""

    write: float
    life: float
    interval: float
    lost: float


def restart(masses: int, count: int, cluster: Cluster) -> Restart:
    """The interval that loses least: sqrt(2 write life) (J. W. Young, "A first order approximation to the optimum checkpoint
    interval", 1974)."""
    write, life = masses * MASS_BYTES / cluster.files, 3600 * cluster.mean_life / count
    interval = sqrt(2 * write * life)
    return Restart(write, life, interval, write / interval + interval / (2 * life))
