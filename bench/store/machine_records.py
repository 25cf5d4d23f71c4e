"""Combination of two records of the same machine."""

from __future__ import annotations

from collections.abc import Mapping

LIMITS = ("copy_bandwidth", "copy_bytes", "region_seconds", "gpu_copy_bandwidth", "gpu_launch_seconds")
DISTURBED = "limits_suspect"  # why not to trust them


def gained(old: Mapping[str, object], new: Mapping[str, object]) -> dict[str, object]:
    """Return a machine's record with its missing fields, and with undisturbed limits in place of disturbed ones.

    The reason why limits are doubtful is replaced with them.
    """
    measured = [name for name in LIMITS if old.get(name) is not None]
    again = bool(old.get(DISTURBED)) and not new.get(DISTURBED) and all(new.get(name) is not None for name in measured)
    usable = dict(old) | dict.fromkeys([*measured, DISTURBED] if again else [])
    gained = {name: value for name, value in new.items() if usable.get(name) is None}
    if measured and not again:
        gained.pop(DISTURBED, None)
    return usable | gained
