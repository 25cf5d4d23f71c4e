"""Waiting time for the first step: `softlab run` with one step, from the start of its process to its end.

`cold`: with an empty folder for machine code. `warm`: the same again. On the GPU nothing is kept between processes, so
both compile.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

from softlab.bench.measure.experiment import host_of
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration
from softlab.model.base.digest import ROOT
from softlab.model.scene.scene import Scene

COLD, WARM = "start_seconds_cold", "start_seconds_warm"
PATIENCE = 120.0  # s


def measure_starts(store: Store, run: str, machine: str, scene: Scene, backend: str, sources: str) -> None:
    """Store both starts of a catalogue scene on a backend, unless they are held; nothing where a process fails."""
    description = configuration(scene, backend=backend, **host_of(backend))
    if store.has_measure(description, machine, sources, WARM):
        return
    with tempfile.TemporaryDirectory(prefix="softlab-start-") as folder:
        for name in (COLD, WARM):
            seconds = start_seconds(scene.name, backend, folder)
            if seconds is None:
                return
            store.add_measure(
                run, description, sources, name, seconds, "s", "softlab run of one step, the whole process"
            )


def start_seconds(scene: str, backend: str, cache: str) -> float | None:
    """Duration [s] of a process that does one step of a catalogue scene; `cache`: folder of its machine code."""
    words = ["run", scene, "--backend", backend, "--steps", "1", "--no-judge", "--json"]
    begin = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "softlab", *words], capture_output=True, timeout=PATIENCE, cwd=ROOT,
            env=os.environ | {"NUMBA_CACHE_DIR": cache},
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return time.perf_counter() - begin if done.returncode == 0 else None
