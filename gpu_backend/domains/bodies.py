"""Bodies that never touch, on several GPUs of one host, in one process: each subset on a GPU, without communication.

All work is queued on streams, and nothing waits on the host, so subsets step concurrently.
"""

from __future__ import annotations

from softlab.gpu_backend.core.device import require_gpu
from softlab.gpu_backend.domains.devices import devices_for
from softlab.gpu_backend.domains.windows import OnGpus
from softlab.model.core.options import Options
from softlab.model.domains.exchange import Exchange, NothingSent
from softlab.model.domains.shared_bodies import SharedBodies, division
from softlab.model.scene.scene import Scene


class GpuBodies(OnGpus, SharedBodies):
    """Subsets on the GPUs of this machine, `count` of them."""

    def __init__(self, scene: Scene, options: Options, count: int, steps: int | None = None):
        decomposition = division(scene, count, steps, "--gpus")
        require_gpu()
        self.devices = devices_for(count)
        super().__init__(scene, options, decomposition, range(count))
        self._warn_of_turns()

    def _connect(self) -> Exchange:
        return NothingSent()
