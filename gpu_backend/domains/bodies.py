"""Bodies that never meet on several GPUs of one host, in one process: each share on a GPU, which is told nothing of others.

Everything is asked of streams in turn, and nothing waits on the host, so that shares step beside one another.
"""

from __future__ import annotations

from gpu_backend.core.device import require_gpu
from gpu_backend.domains.devices import devices_for
from gpu_backend.domains.windows import OnGpus
from model.core.options import Options
from model.domains.exchange import Exchange, NothingSent
from model.domains.shared_bodies import SharedBodies, division
from model.scene.scene import Scene


class GpuBodies(OnGpus, SharedBodies):
    """Shares on the GPUs of this machine, `count` of them."""

    def __init__(self, scene: Scene, options: Options, count: int, steps: int | None = None):
        found = division(scene, count, steps, "--gpus")
        require_gpu()
        self.devices = devices_for(count)
        super().__init__(scene, options, found, range(count))
        self._tell_of_turns()

    def _connect(self) -> Exchange:
        return NothingSent()
