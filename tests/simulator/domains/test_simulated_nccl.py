"""Borders sent by NCCL, a stand-in of which copies memory: what is sent, where from, and in which order it is asked for."""

from __future__ import annotations

import ctypes
import sys
from contextlib import nullcontext
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from softlab.app.driver import open_simulation
from softlab.gpu_backend.domains import nccl
from softlab.model.base.errors import BackendUnavailable
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene


class Bindings:
    """Of one process and all its communicators; a group is done when it ends. Raises where a send has no receive."""

    def __init__(self) -> None:
        self.sent: list[tuple[int, int, int, int]] = []
        self.received: list[tuple[int, int, int, int]] = []
        self.groups = 0

    @staticmethod
    def Comm(handle: int) -> int:
        return handle

    def send(self, address: int, size: int, kind: int, peer: int, communicator: int, stream: int) -> None:
        self.sent.append((communicator, peer, address, size))

    def recv(self, address: int, size: int, kind: int, peer: int, communicator: int, stream: int) -> None:
        self.received.append((peer, communicator, address, size))

    def group_start(self) -> None:
        assert not self.sent and not self.received

    def group_end(self) -> None:
        for *way, address, size in self.sent:
            index = next(k for k, (source, target, _, _) in enumerate(self.received) if [source, target] == way)
            _, _, into, expected = self.received.pop(index)
            assert size == expected
            ctypes.memmove(into, address, size)
        assert not self.received
        self.sent.clear()
        self.groups += 1


@pytest.fixture
def bindings(monkeypatch: pytest.MonkeyPatch) -> Bindings:
    found = Bindings()
    ends: list[int] = []

    def communicators(devices: list[int]) -> list[SimpleNamespace]:
        return [SimpleNamespace(ptr=k, destroy=lambda k=k: ends.append(k)) for k in range(len(devices))]

    core = SimpleNamespace(UINT8=1, Communicator=SimpleNamespace(init_all=communicators))
    modules = ModuleType("nccl"), ModuleType("nccl.bindings")
    modules[1].nccl = found  # type: ignore[attr-defined]
    for module in modules:
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(nccl, "nccl", lambda: core)
    return found


def end(scene: Scene, **options: Any) -> State:
    with open_simulation(scene, math="exact", **options) as simulation:
        simulation.advance(5)
        return simulation.state()


@pytest.mark.parametrize("name", ["lab-grid", "cloth-hanging"])
def test_windows_have_the_bits_of_the_cpu(name: str, bindings: Bindings, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a plane and in space; three windows, the middle one with two neighbours."""
    monkeypatch.setattr(nccl, "devices_for", lambda count: list(range(count)))
    for module in ("nccl", "windows"):
        monkeypatch.setattr(f"softlab.gpu_backend.domains.{module}.at", lambda device: nullcontext())
    sheet = "grid" if name == "lab-grid" else "cloth"
    scene = load_scene(name).replace({f"{sheet}.rows": 13, f"{sheet}.columns": 5})
    found = end(scene, backend="gpu", gpus=3, link="nccl", exchange_every=1)
    wanted = end(scene, threads=1)
    assert (found.position == wanted.position).all() and (found.velocity == wanted.velocity).all()
    assert bindings.groups == 5


def test_windows_that_share_a_gpu_are_refused(bindings: Bindings) -> None:
    with pytest.raises(BackendUnavailable, match="one GPU per window"):
        end(load_scene("lab-grid"), backend="gpu", gpus=2, link="nccl")
