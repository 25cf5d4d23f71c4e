"""Links between the GPUs of this machine, from NVML."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType


@dataclass(frozen=True)
class Links:
    """`count` GPUs; `nvlinks`: active ones of each; `apart`: pairs without access to each other's memory."""

    count: int
    nvlinks: tuple[int, ...]
    apart: tuple[tuple[int, int], ...]

    def __str__(self) -> str:
        if self.count < 2:
            return "1 GPU, nothing to link"
        alike = len(set(self.nvlinks)) == 1
        links = f"{self.nvlinks[0]} NVLinks each" if alike else f"NVLinks: {', '.join(map(str, self.nvlinks))}"
        pairs = ", ".join(f"{one}-{other}" for one, other in self.apart)
        access = f"no access to each other's memory: {pairs}" if pairs else "each has access to the others' memory"
        return f"{self.count} GPUs, {links}, {access}"


def find_links() -> Links:
    """Query NVML. Raises ImportError without nvidia-ml-py, NVML's own errors without a driver."""
    import pynvml

    with _started(pynvml):
        handles = [pynvml.nvmlDeviceGetHandleByIndex(k) for k in range(pynvml.nvmlDeviceGetCount())]
        pairs = [(one, other) for one in range(len(handles)) for other in range(one)]
        apart = tuple((other, one) for one, other in pairs if not _has_access(pynvml, handles[one], handles[other]))
        return Links(len(handles), tuple(_active(pynvml, handle) for handle in handles), apart)


@contextmanager
def _started(library: ModuleType) -> Iterator[None]:
    library.nvmlInit()
    try:
        yield
    finally:
        library.nvmlShutdown()


def _has_access(library: ModuleType, one: object, other: object) -> bool:
    """Return True if both read and write each other's memory. pynvml 13.615 defines one of these as a tuple, because of
    a superfluous comma."""
    named = library.NVML_P2P_CAPS_INDEX_READ, library.NVML_P2P_CAPS_INDEX_WRITE
    kinds = [kind[0] if isinstance(kind, tuple) else kind for kind in named]
    directions = ((one, other), (other, one))
    states = [library.nvmlDeviceGetP2PStatus(*direction, kind) for direction in directions for kind in kinds]
    return all(status == library.NVML_P2P_STATUS_OK for status in states)


def _active(library: ModuleType, handle: object) -> int:
    """Return the number of active NVLinks; a GPU without any reports them as unsupported."""
    up = 0
    for link in range(library.NVML_NVLINK_MAX_LINKS):
        try:
            up += library.nvmlDeviceGetNvLinkState(handle, link) == library.NVML_FEATURE_ENABLED
        except library.NVMLError:
            break
    return up
