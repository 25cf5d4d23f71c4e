"""SPlisHSPlasH beside the lab in `softlab fluids --truth` and `--rest`, which find this module by its name."""

from __future__ import annotations

from contextlib import ExitStack

from softlab.bench.peers.base import Peer, PeerError
from softlab.bench.peers.cases import Beside
from softlab.bench.peers.fluids.splishsplash import SplishSplash
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene


def peer_of(method: str) -> Peer:
    """Return the peer that runs one of its METHODS."""
    return SplishSplash(method)


def opened_peer(peer: Peer, scene: Scene, threads: int, stack: ExitStack) -> Beside:
    """Open a scene by a peer, until the stack ends. Raises PeerError."""
    here, reason = peer.available()
    refusal = peer.refusal(scene) if here else reason
    if refusal:
        raise PeerError(f"{peer.label}: {refusal}")
    return _Entered(peer, stack.enter_context(peer.open(scene, "float32", threads)), build(scene))


class _Entered(Beside):
    """A peer's simulation, closed with the stack."""

    def __enter__(self) -> _Entered:
        return self

    def __exit__(self, *_: object) -> None: ...
