"""When a state counts as diverged, and how often it is looked at."""

from __future__ import annotations

# Steps between two looks for a diverged state. A look takes 0.01 ms of a small grid on a CPU, 0.4 ms (its launches and
# copies) on a GPU; it is to cost under 1 % (measured by bench/experiments/findings/costs.py). So the interval is a number of
# mass-steps, which a GPU does in a small part of a CPU's time; small grids, whose steps take less than a microsecond,
# have a largest one.
MIN_INTERVAL = 1024
MAX_INTERVAL = {"cpu": 2**15, "gpu": 2**19}
INTERVAL_WORK = {"cpu": 2**28, "gpu": 2**35}  # mass-steps
DIVERGED_SIZE = 1e6  # times the scene's size, along an axis from the centre of its start: beyond it counts as diverged


def check_interval(particle_count: int, backend: str) -> int:
    """Steps between two looks for a diverged state: so many that looking costs under 1 %, whatever the size."""
    return max(MIN_INTERVAL, min(MAX_INTERVAL[backend], INTERVAL_WORK[backend] // max(1, particle_count)))
