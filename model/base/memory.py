"""Free memory of this machine, to refuse a scene that cannot fit before anything is allocated."""

from __future__ import annotations

from pathlib import Path

import psutil

from softlab.model.base.errors import SceneError

MAX_PARTICLES = 2**31 - 1  # flat indices are 32-bit on the GPU


def available_bytes() -> int:
    """Return the bytes of main memory available without swapping: the smaller of the machine's free memory and the
    remaining limit of a control group (a container)."""
    free, allowed = int(psutil.virtual_memory().available), _control_group_free()
    return free if allowed is None else min(free, allowed)


def _control_group_free() -> int | None:
    try:
        limit = Path("/sys/fs/cgroup/memory.max").read_text().strip()
        used = int(Path("/sys/fs/cgroup/memory.current").read_text())
        return None if limit == "max" else max(0, int(limit) - used)
    except (OSError, ValueError):
        return None


def readable(count: float) -> str:
    """Return a number of bytes with a binary prefix: 1.5 GiB."""
    for unit in ("B", "KiB", "MiB", "GiB", "TiB", "PiB"):
        if count < 1024 or unit == "PiB":
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1024
    raise AssertionError("unreachable")


def require_sheet(rows: int, columns: int, bytes_each: int, name: str) -> None:
    """Raise SceneError if `rows` x `columns` masses of `bytes_each` do not fit into main memory, or into 32-bit indices."""
    field, shape = f"{name}.rows x {name}.columns", f"{rows} x {columns}"
    require(rows * columns * bytes_each, available_bytes(), field, shape, "main memory")
    if rows * columns > MAX_PARTICLES:
        raise SceneError(field, shape, f"at most {MAX_PARTICLES} masses (32-bit indices)")


def require(needed: int, available: int | None, field: str, value: object, where: str) -> None:
    """Raise SceneError if `needed` bytes exceed 90 % of `available` ones (None: unknown, always allowed)."""
    if available is not None and needed > 0.9 * available:
        raise SceneError(
            field,
            value,
            f"needs {readable(needed)} of {where}, of which {readable(available)} is free; use a smaller one",
        )
