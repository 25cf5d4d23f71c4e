"""Prints a hash of every array that an opened simulation of each scene holds: python host_arrays.py [SCENE ...]

Run under different processors, or what pretends to be one (OPENBLAS_CORETYPE, NPY_DISABLE_CPU_FEATURES, GLIBC_TUNABLES), the
hashes must be the same: nothing that decides a state hangs on the order in which a library adds."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
LEFT_OUT = {"soft-rain"}  # ten thousand bodies like those of soft-pile
DEEPEST = 9


def arrays_of(
    value: Any, path: str = "", seen: set[int] | None = None, depth: int = 0
) -> Iterator[tuple[str, np.ndarray]]:
    """(where, array) of all arrays within an object of the lab: in its attributes, tuples, lists and dictionaries."""
    seen = set() if seen is None else seen
    if isinstance(value, np.ndarray):
        if value.dtype != object:
            yield path, value
        return
    if depth > DEEPEST or id(value) in seen or isinstance(value, (str, bytes, int, float, complex, type, type(None))):
        return
    seen.add(id(value))
    if isinstance(value, Mapping):
        inner = [(f"{path}[{key}]", one) for key, one in value.items()]
    elif isinstance(value, (tuple, list)):
        inner = [(f"{path}[{k}]", one) for k, one in enumerate(value)]
    elif type(value).__module__.startswith(("softlab.model.", "softlab.cpu_backend.")):
        names = [field.name for field in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else []
        attributes = {**{name: getattr(value, name) for name in names}, **getattr(value, "__dict__", {})}
        inner = [(f"{path}.{name}", one) for name, one in attributes.items()]
    else:
        return
    for where, one in inner:
        yield from arrays_of(one, where, seen, depth + 1)


def hashes(scene: str, precision: str) -> dict[str, str]:
    """Of the arrays that a simulation of the scene starts from, each by its place."""
    from softlab.app.driver import open_simulation

    with open_simulation(scene, threads=1, precision=precision, math="exact", allow_unstable=True) as simulation:
        simulation.__dict__.pop("_bad", None)
        return {
            where: hashlib.sha256(str(array.dtype).encode() + np.ascontiguousarray(array).tobytes()).hexdigest()[:16]
            for where, array in arrays_of(simulation)
        }


def main() -> None:
    """Of the scenes asked for, or of all of the catalogue, as JSON."""
    sys.path[:0] = [str(ROOT)]
    from softlab.model.scene.reader import catalogue

    wanted = sys.argv[1:] or [name for name in catalogue() if name not in LEFT_OUT]
    found = {scene: hashes(scene, "float64") for scene in wanted}
    print(json.dumps(found))


if __name__ == "__main__":
    main()
