"""A sheet on several GPUs, borders sent by NCCL: by one process for all GPUs of its host, or, if MPI started several,
by each for its own, on one host or many (NVIDIA, "NCCL4Py": Communicator.init, init_all; ncclSend, ncclRecv in a
group).

NVLink multicast is off (NCCL_NVLS_ENABLE=0), since a group of two does not use it. Arguments are resolved once: an
exchange is a few calls of NCCL's bindings with numbers.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from softlab.gpu_backend.core.device import Event, require_gpu
from softlab.gpu_backend.core.simulation import CudaSimulation
from softlab.gpu_backend.domains.devices import at, devices_for, gpu_count, new_event, sharing
from softlab.gpu_backend.domains.units import StateUnits
from softlab.gpu_backend.domains.windows import GpuWindows
from softlab.model.base.errors import BackendUnavailable
from softlab.model.core.options import Options
from softlab.model.core.sharing.decomposition import Decomposition
from softlab.model.domains.exchange import PATIENCE, Exchange
from softlab.model.domains.launched import launched_ranks
from softlab.model.domains.processes import gather_rows, largest_of, lost, mpi, world_of
from softlab.model.domains.simulation import cut
from softlab.model.scene.scene import Scene

if TYPE_CHECKING:
    import nccl.core as nccl_core
    from mpi4py.MPI import Intracomm

INSTALL = 'pip install "nccl4py[cu13]" (or [cu12]); for several processes also the lab\'s extra mpi'
NAP = 1e-4  # s, between two checks of an event
Call = tuple[int, int, int, int, object, int]  # address, bytes, type, neighbour, communicator, stream


def nccl() -> ModuleType:
    """Return the module nccl.core of nccl4py. Raises BackendUnavailable."""
    if find_spec("nccl") is None:
        raise BackendUnavailable("nccl4py is not installed", INSTALL)
    os.environ.setdefault("NCCL_NVLS_ENABLE", "0")
    try:
        import nccl.core as found
    except ImportError as error:  # of the library that it calls
        raise BackendUnavailable(f"NCCL cannot be loaded ({error})", INSTALL) from None
    return found


class NcclExchange(Exchange):
    """Exchange by NCCL (see Exchange). `windows`: of this process, window k is domain `places[k]`, on GPU `devices[k]`.

    `world`: MPI's processes, a window each; None: this one has all. All messages of an exchange are one group on the
    windows' streams, which order it with the steps before and after.
    """

    def __init__(
        self,
        windows: Sequence[CudaSimulation],
        places: Sequence[int],
        decomposition: Decomposition,
        devices: Sequence[int],
        world: Intracomm | None,
    ):
        self.decomposition, self._world = decomposition, world
        self.rank = world.Get_rank() if world else 0
        self._windows, self._devices, module = windows, devices, nccl()
        if world is None:
            self._groups = list(module.Communicator.init_all(list(devices)))
        else:
            unique_id = module.get_unique_id() if self.rank == 0 else None
            self._groups = [module.Communicator.init(world.Get_size(), self.rank, world.bcast(unique_id, root=0))]
        from nccl.bindings import nccl as bindings

        self._bindings, self._bytes = bindings, int(module.UINT8)
        self._calls = []  # of each window: sent, received
        for window, place, group in zip(windows, places, self._groups, strict=True):
            out = [(b.from_row, b.rows, b.target) for b in decomposition.borders if b.source == place]
            into = [(b.to_row, b.rows, b.source) for b in decomposition.borders if b.target == place]
            self._calls.append((self._resolved(window, group, out), self._resolved(window, group, into)))
        self._done = [self._event(device) for device in devices]

    def _resolved(
        self, window: CudaSimulation, group: nccl_core.Communicator, ends: Sequence[tuple[int, int, int]]
    ) -> list[list[Call]]:
        """Return, for either buffer, the calls for the borders' `ends`: (first row, rows, neighbour)."""
        state, how = (
            StateUnits(window, self.decomposition.columns),
            (self._bindings.Comm(group.ptr), int(window.stream)),
        )
        resolved: list[list[Call]] = [[], []]
        for row, rows, neighbour in ends:
            for calls, spans in zip(resolved, state.spans(row, rows), strict=True):
                calls += [(address, size, self._bytes, neighbour, *how) for address, size in spans]
        return resolved

    @staticmethod
    def _event(device: int) -> Event | None:
        with at(device):
            return new_event()

    def post(self) -> None:
        send, receive = self._bindings.send, self._bindings.recv
        self._bindings.group_start()
        try:
            for window, (out, into) in zip(self._windows, self._calls, strict=True):
                for call in out[window._current]:
                    send(*call)
                for call in into[window._current]:
                    receive(*call)
        finally:
            self._bindings.group_end()

    def wait(self) -> None:
        """Do nothing: the streams wait; `require_answers` has the timeout."""

    def require_answers(self) -> None:
        """Return when all queued work is done. Raises BackendUnavailable after PATIENCE."""
        end = time.monotonic() + PATIENCE
        for window, device, done in zip(self._windows, self._devices, self._done, strict=True):
            if done is None:
                continue
            with at(device):
                done.record(window.stream)
                while not done.query():
                    if time.monotonic() > end:
                        for group in self._groups:
                            group.abort()
                        raise lost("another GPU", PATIENCE)
                    time.sleep(NAP)

    def gather(self, owned: np.ndarray) -> np.ndarray:
        return gather_rows(self._world, owned) if self._world else owned

    def largest_each(self, numbers: np.ndarray) -> np.ndarray:
        return largest_of(self._world, numbers) if self._world else super().largest_each(numbers)

    def close(self) -> None:
        for group in self._groups:
            group.destroy()


class NcclSimulation(GpuWindows):
    """The windows of this process of a sheet on `count` GPUs (model/domains/simulation.py)."""

    exchange: NcclExchange

    def __init__(self, scene: Scene, options: Options, count: int, steps: int | None = None):
        require_gpu()
        nccl()
        self._world: Intracomm | None = None
        if launched_ranks() > 1:
            self._world = world_of(count, "--gpus")
            place = self._world.Split_type(mpi().COMM_TYPE_SHARED).Get_rank()  # among the processes of this host
            if place >= gpu_count() and not sharing():
                raise BackendUnavailable(
                    f"process {place} of this host has no GPU; the host has {gpu_count()}",
                    "start one process per GPU",
                )
            places, devices = [self._world.Get_rank()], [place % gpu_count()]
        else:
            places, devices = list(range(count)), devices_for(count)
            if len(set(devices)) < count:
                raise BackendUnavailable("NCCL needs one GPU per window", "use --link flags")
        super().__init__(scene, options, cut(scene, count, steps, "--gpus"), places, devices)

    def _connect(self) -> NcclExchange:
        with at(self.devices[0]):
            return NcclExchange(self.windows, [domain.number for domain in self.local], self.decomposition, self.devices,
                                self._world)  # fmt: skip

    def _first_diverged(self) -> int:
        self.exchange.require_answers()
        return super()._first_diverged()
