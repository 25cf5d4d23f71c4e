"""What several GPUs have loaded is unloaded once."""

import weakref
from types import SimpleNamespace

from softlab.gpu_backend.domains.devices import unload_once


class Module:
    """As numba-cuda's: its finalizer unloads the library when the process ends."""

    def __init__(self, library: int, unloaded: list[int]):
        self.handle = library
        self._finalizer = weakref.finalize(self, unloaded.append, library)


def test_a_library_of_two_gpus_is_unloaded_by_one() -> None:
    unloaded: list[int] = []
    gpus = [
        SimpleNamespace(modules={k: Module(k, unloaded) for k in libraries}) for libraries in ((1, 2), (2, 3), (1, 2))
    ]
    unload_once(gpu.modules for gpu in gpus)
    for gpu in gpus:
        gpu.modules.clear()
    assert sorted(unloaded) == [1, 2, 3]
