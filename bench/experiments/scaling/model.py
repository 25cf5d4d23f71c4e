"""Model of a grid on many GPUs: the steps of a window, exchanges, waiting for neighbours, checkpoint files, failures.

The time of a step of the largest window comes from the table of kernels (gpu_backend/mass_spring/grid/choice.py), that
of an exchange from a link (model/domains/link.py). The method of sending (WAYS) determines what can overlap and the
time on the host.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np

from softlab.model.core.sharing.decomposition import Decomposition, Stencil, decompose
from softlab.model.domains.link import NETWORK, NVLINK, Link

MASS_BYTES = 16  # state of a mass in float32
PASS = 4  # steps of the kernel `tiles` per pass
CYCLES = 400  # cycles that `waiting` simulates
EVERY = (1, 2, 4, 8, 16, 32, 64)  # steps between exchanges, of which the fastest is chosen
SEED = 1
Seconds = Callable[[int, int], float]


@dataclass(frozen=True)
class Transfer:
    """Variant of the exchange between windows.

    `hidden`: overlapped with a pass over the inner rows. `host` [s]: shortest duration of a cycle, since Python
    requests it; of two windows and an exchange, measured where these took longer than their GPUs (2048 x 2048 on two
    H100s).
    """

    hidden: bool
    host: float


TRANSFERS = {"flags": Transfer(True, 0.0), "nccl": Transfer(False, 1.7e-4)}


@dataclass(frozen=True)
class Cluster:
    """GPUs in hosts of `per_host`, linked by `inside`, the hosts by `across`.

    `launches` [s] and `copying` [B/s]: cost of an exchange besides its message, its kernels and the copy from the
    inbox. `ends` [s]: cost of all blocks of a cycle ending before the next cycle begins, where nothing is overlapped.
    `jitter`: random delay of a cycle relative to its own time, the mean of an exponential distribution. `files` [B/s]:
    bandwidth of the file system for all together. `mean_life` [h]: of a GPU between failures.

    `launches` and `copying` are from exchanges alone between two H100s, which took 8.0 us for 0.5 MB and 13.2 us for
    2.1 MB. `ends` is from passes of one launch and in bands there, which differ by 20 to 26 us. `jitter` and `files`
    are assumptions. `mean_life`: 419 unexpected interruptions in 54 days on 16 384 GPUs (A. Dubey and others, "The
    Llama 3 Herd of Models", 2024, section 3.3.4).
    """

    per_host: int = 8
    inside: Link = NVLINK
    across: Link = NETWORK
    launches: float = 3.4e-6
    copying: float = 1.3e12
    ends: float = 22e-6
    jitter: float = 0.01
    files: float = 100e9
    mean_life: float = 54 * 24 * 16384 / 419

    def link(self, count: int) -> Link:
        """Return the slowest link among `count` GPUs."""
        return self.inside if count <= self.per_host else self.across

    def exchange(self, count: int, size: int) -> float:
        """Return the time [s] of an exchange of `size` bytes in each direction among `count` GPUs."""
        return self.link(count).seconds(size) + self.launches + size / self.copying


@dataclass(frozen=True)
class Predicted:
    """Predicted times [s] per step of a grid on several GPUs.

    `compute`: of the largest window; `exchange`; `waiting`: for neighbours that take longer than the window itself.
    """

    decomposition: Decomposition
    compute: float
    exchange: float
    waiting: float

    @property
    def step(self) -> float:
        return self.compute + self.exchange + self.waiting

    @property
    def rate(self) -> float:
        """Masses per second."""
        return self.decomposition.rows * self.decomposition.columns / self.step


def window_seconds(rows: int, columns: int) -> float:
    """Return the time [s] of a step of a float32 window, by the table of kernels, on the GPU of that table."""
    from softlab.gpu_backend.mass_spring.grid.choice import MEASURED_LIMITS, step_seconds

    return step_seconds(rows, columns, np.float32, MEASURED_LIMITS)


def predicted(
    rows: int,
    columns: int,
    count: int,
    cluster: Cluster,
    steps: int | None = None,
    seconds: Seconds = window_seconds,
    transfer: Transfer = TRANSFERS["flags"],
) -> Predicted:
    """Return the times of a step of a grid on `count` GPUs that exchange every `steps` steps.

    `steps` None: the fastest of EVERY, among whole passes if the partitions have enough rows. Raises SceneError if the
    grid has too few rows.
    """
    if count > 1 and steps is None:
        able = [n for n in EVERY if n == 1 or Stencil().halo(n) <= rows // count]
        able = [n for n in able if n >= PASS] or able[-1:]
        candidates = [predicted(rows, columns, count, cluster, n, seconds, transfer) for n in able]
        return min(candidates, key=lambda one: one.step)
    cut = decompose(rows, columns, count, Stencil(), steps)
    compute = seconds(max(domain.window_rows for domain in cut.domains), columns)
    if count == 1:
        return Predicted(cut, compute, 0.0, 0.0)
    exchange = cluster.exchange(count, cut.bytes_sent(MASS_BYTES))
    cycle = compute * cut.steps
    exchange = max(0.0, exchange - min(PASS, cut.steps) * compute) if transfer.hidden else exchange + cluster.ends
    exchange = max(exchange, transfer.host - cycle)
    late = waiting(count, cycle, exchange, cluster.jitter) - cycle * (1 + cluster.jitter) - exchange
    return Predicted(cut, compute, exchange / cut.steps, late / cut.steps)


def waiting(
    count: int, cycle: float, exchange: float, jitter: float, *, together: bool = False, cycles: int = CYCLES
) -> float:
    """Return the time [s] of a cycle of `count` domains in a row.

    Each takes `cycle` [s] plus a random delay, and begins the next cycle when it and its neighbours have finished this
    one and exchanged. `together`: when all have, as with a collective.
    """
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
    """Checkpoints of a run on many GPUs.

    `write` [s]: time of a file with all masses; `life` [s]: until one of the GPUs fails; `interval` [s]: between files;
    `lost`: fraction of the time for writing and for repeating lost work.
    """

    write: float
    life: float
    interval: float
    lost: float


def restart(masses: int, count: int, cluster: Cluster) -> Restart:
    """Return the interval with the smallest loss, sqrt(2 write life).

    J. W. Young, "A first order approximation to the optimum checkpoint interval", 1974.
    """
    write, life = masses * MASS_BYTES / cluster.files, 3600 * cluster.mean_life / count
    interval = sqrt(2 * write * life)
    return Restart(write, life, interval, write / interval + interval / (2 * life))
