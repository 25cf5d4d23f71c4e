"""Asks a separate process for the kernel keys of configurations, under the code of this checkout or of another."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from softlab.bench.store.schema import Description

PROBE = Path(__file__).with_name("probe.py")
NO_KERNELS = ("SOFTLAB_PLAIN_PYTHON", "NUMBA_ENABLE_CUDASIM")  # with these set, nothing is compiled that has a digest
Descriptions = dict[str, Description]  # by hash
Key = tuple[str, str]  # of kernels, of arrays


def keys_at(folder: Path, descriptions: Descriptions, compared: str = "kernels") -> dict[str, Key]:
    """Return the keys of configurations under the code in a folder, without those that it cannot open. `compared`:
    "kernels", or "code" for keys of their machine code. Configurations with the same simulation are opened once.
    """
    names: dict[str, list[str]] = {}
    for name, d in descriptions.items():
        opening = json.dumps([d[part] for part in ("scene", "backend", "kernel", "precision", "math")], sort_keys=True)
        names.setdefault(opening, []).append(name)
    lines = "".join(json.dumps([same[0], descriptions[same[0]]]) + "\n" for same in names.values())
    environment = {name: value for name, value in os.environ.items() if name not in NO_KERNELS}
    environment["PYTHONHASHSEED"] = "0"  # numba writes some instructions in the order of sets
    done = subprocess.run(
        [sys.executable, str(PROBE), str(folder), compared],
        input=lines,
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment,
    )
    if done.returncode:
        raise RuntimeError(f"{folder}: the kernels of this code cannot be read: {done.stderr[-2000:]}")
    same_as = {same[0]: same for same in names.values()}
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    keys = {name: (kernels, arrays) for first, kernels, arrays, _ in answers if kernels for name in same_as[first]}
    if answers and not keys:
        raise RuntimeError(f"{folder}: no configuration can be opened with this code; the first error: {answers[0][3]}")
    return keys
