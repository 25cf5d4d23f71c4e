"""The cost of sending: a latency and the bytes over a bandwidth per message."""

from __future__ import annotations

from dataclasses import dataclass

from softlab.model.base.errors import SceneError


@dataclass(frozen=True)
class Link:
    """A link between two neighbours, used in both directions at once. `latency` [s], `bandwidth` [B/s], and the
    `source` of these numbers."""

    name: str
    latency: float
    bandwidth: float
    source: str

    def __post_init__(self) -> None:
        for field in ("latency", "bandwidth"):
            value = getattr(self, field)
            if not 0 < value < float("inf"):
                raise SceneError(f"--{field}", value, "must be greater than 0 and finite")

    def seconds(self, size: float) -> float:
        """Return the time of a message of `size` bytes."""
        return self.latency + size / self.bandwidth


NVLINK = Link(
    "NVLink", 2.9e-6, 395e9,
    "measured between two H200s of one host with 18 NVLinks: a copy of 8 kB took 2.9 us, of 2 MB 7.9 us, large ones 395 GB/s",
)  # fmt: skip
NETWORK = Link(
    "network", 10e-6, 50e9, "assumed: a port of 400 Gb/s for each GPU, as its makers state it, and 10 us for a message"
)
