"""The criterion of divergence, and the interval between checks."""

from __future__ import annotations

# Steps between two checks for divergence. A check takes 0.01 ms of a small grid on a CPU, 0.4 ms (its launches and
# copies) on a GPU; it must cost under 1 % (measured by bench/experiments/findings/costs.py). So the interval is a
# number of mass-steps, which a GPU does in a small part of a CPU's time; small grids, whose steps take less than a
# microsecond, have a largest one.
MIN_INTERVAL = 1024
MAX_INTERVAL = {"cpu": 2**15, "gpu": 2**19}
INTERVAL_WORK = {"cpu": 2**28, "gpu": 2**35}  # mass-steps
DIVERGED_SIZE = 1e6  # times the scene's size, along an axis from its initial centre


def check_interval(particle_count: int, backend: str) -> int:
    """Return the steps between two checks for divergence, so many that checks cost under 1 % at any size."""
    return max(MIN_INTERVAL, min(MAX_INTERVAL[backend], INTERVAL_WORK[backend] // max(1, particle_count)))
