"""Two more limits of a machine, for the roofline and the cost of threads: measured once, kept in its record.

`arithmetic`, `gpu_arithmetic`: operations a second by precision. `region_policies`: cost of an empty parallel region
when idle threads spin (`active`) and when they sleep (`passive`), by threads. The policy is read when a process starts,
so each is measured in a process of its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from typing import Any

from softlab.bench.measure.gpu import gpu_or_reason, gpu_simulated
from softlab.bench.measure.machine import machine_label, machine_record
from softlab.bench.store.database import Store
from softlab.cpu_backend.core.threads import core_count
from softlab.model.base.digest import ROOT
from softlab.model.core.simulation import PRECISIONS

POLICIES = ("active", "passive")
REGIONS = "import json; from softlab.bench.measure.machine import region_costs; print(json.dumps(region_costs()))"
PATIENCE = 60.0  # s: for a process that measures regions


def enter_limits(store: Store, machine: str) -> None:
    """Measure the limits that the machine's record lacks, and enter them: a few seconds, once per machine."""
    (text,) = store.query("SELECT record FROM machine WHERE key = ?", (machine,))[0]
    record: dict[str, Any] = json.loads(text)
    measured: dict[str, object] = {}
    if record.get("arithmetic") is None:
        measured["arithmetic"] = cpu_arithmetic()
    if record.get("gpu") and record.get("gpu_arithmetic") is None:
        measured["gpu_arithmetic"] = gpu_arithmetic()
    if record.get("region_policies") is None:
        measured["region_policies"] = region_policies()
    if measured:
        store.add_machine(machine, machine_label(machine_record()), measured)


def cpu_arithmetic() -> dict[str, float]:
    """Return {precision: operations/s} of all cores."""
    from softlab.cpu_backend.core.arithmetic import arithmetic_rate

    return {precision: arithmetic_rate(precision, core_count()) for precision in PRECISIONS}


def gpu_arithmetic() -> dict[str, float] | None:
    """Return {precision: operations/s} of the GPU; None if there is none, or if it fails."""
    if not gpu_or_reason()[0] or gpu_simulated():
        return None
    from softlab.gpu_backend.core.arithmetic import arithmetic_rate

    with suppress(Exception):  # a roof is no reason to lose the measurements under it
        return {precision: arithmetic_rate(precision) for precision in PRECISIONS}
    return None


def region_policies() -> dict[str, dict[str, float]] | None:
    """{policy: {threads: seconds of an empty region}}; None where a process of its own could not be had."""
    seconds = {}
    for policy in POLICIES:
        environment = os.environ | {"OMP_WAIT_POLICY": policy}
        try:
            done = subprocess.run(
                [sys.executable, "-c", REGIONS], capture_output=True, text=True, timeout=PATIENCE, env=environment,
                cwd=ROOT,
            )  # fmt: skip
            seconds[policy] = json.loads(done.stdout)
        except (OSError, subprocess.SubprocessError, ValueError):
            return None
    return seconds
